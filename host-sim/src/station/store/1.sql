CREATE TABLE alert (
    id INTEGER PRIMARY KEY,
    received_at TEXT NOT NULL DEFAULT (strftime('%Y-%m-%dT%H:%M:%fZ', 'now')),
    source TEXT NOT NULL,          -- recording or line that it came from
    bridge TEXT NOT NULL,
    passage INTEGER NOT NULL,      -- number of the passage since the logger's start
    start_s REAL NOT NULL,         -- beginning of the passage, in the recording's time
    objective REAL NOT NULL,       -- misfit, (m/s^2)^2
    objective_healthy REAL NOT NULL,
    forward_solves INTEGER NOT NULL,
    text TEXT NOT NULL             -- the alert as a sentence
) STRICT;
CREATE TABLE alert_element (
    alert INTEGER NOT NULL REFERENCES alert (id),
    element INTEGER NOT NULL,      -- from 1
    damage REAL NOT NULL,          -- fraction of bending stiffness lost
    damage_std REAL NOT NULL,
    certain INTEGER NOT NULL,      -- 1: beyond doubt
    PRIMARY KEY (alert, element)
) STRICT;
