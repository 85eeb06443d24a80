-- Loggers, and everything that they say, once. Times are UTC.
CREATE TABLE logger (
    device INTEGER PRIMARY KEY,
    name TEXT,                     -- as the key file has it
    series INTEGER NOT NULL,       -- of its numbers, now
    source TEXT NOT NULL,          -- line that it was heard on last
    first_seen TEXT NOT NULL,
    last_seen TEXT NOT NULL
) STRICT;
CREATE TABLE series (
    logger INTEGER NOT NULL,
    series INTEGER NOT NULL,
    stored INTEGER NOT NULL,       -- everything up to here is in `message`, or in `gap`
    PRIMARY KEY (logger, series)
) STRICT;
-- What a logger's clock is worth: UTC less its time since that start.
CREATE TABLE start (
    logger INTEGER NOT NULL,
    series INTEGER NOT NULL,       -- a flash that was erased counts its starts anew
    start INTEGER NOT NULL,
    clock_offset_ms INTEGER NOT NULL,
    PRIMARY KEY (logger, series, start)
) STRICT;
CREATE TABLE message (
    id INTEGER PRIMARY KEY,
    logger INTEGER NOT NULL,
    series INTEGER NOT NULL,
    number INTEGER NOT NULL,
    previous INTEGER NOT NULL,     -- number before it
    received_at TEXT NOT NULL,
    happened_at TEXT,              -- when the logger said it first, if its clock is known
    source TEXT NOT NULL,
    kind TEXT NOT NULL,            -- alert, passage, track; unknown: of another version of the program
    version INTEGER NOT NULL,      -- of the message's layout
    payload BLOB NOT NULL,
    UNIQUE (logger, series, number)
) STRICT;
CREATE INDEX message_by_logger ON message (logger, id);
CREATE TABLE passage (
    message INTEGER PRIMARY KEY REFERENCES message (id),
    passage INTEGER NOT NULL,      -- number since the logger's start
    verdict TEXT NOT NULL,         -- healthy, undecided, damaged, not identified
    reason TEXT,                   -- why not
    unexplained REAL,              -- part of its power
    speed_kmh REAL,
    load_factor REAL,
    stiffness_factor REAL,
    change TEXT,
    hidden REAL,                   -- loss of one element that could have gone unseen
    level_db REAL NOT NULL,        -- re 1 um/s^2
    bad_samples INTEGER NOT NULL
) STRICT;
CREATE TABLE track (
    message INTEGER PRIMARY KEY REFERENCES message (id),
    passage INTEGER NOT NULL,
    since INTEGER NOT NULL,
    misfit REAL NOT NULL,
    mean_misfit REAL NOT NULL
) STRICT;
CREATE TABLE health (
    id INTEGER PRIMARY KEY,
    logger INTEGER NOT NULL,
    at TEXT NOT NULL,
    start INTEGER NOT NULL,
    restart TEXT NOT NULL,         -- why it started
    uptime_ms INTEGER NOT NULL,
    setup INTEGER NOT NULL,        -- generation; 0: none is kept
    rolled_back INTEGER NOT NULL,
    passages INTEGER NOT NULL,
    alerts INTEGER NOT NULL,
    alerts_waiting INTEGER NOT NULL,
    reports_waiting INTEGER NOT NULL,
    fill_permille INTEGER NOT NULL,
    alerts_dropped INTEGER NOT NULL,
    reports_dropped INTEGER NOT NULL,
    unreadable INTEGER NOT NULL,
    wear INTEGER NOT NULL,         -- erasures of the flash's most worn sector
    rejected INTEGER NOT NULL,     -- frames
    forged INTEGER NOT NULL,
    replayed INTEGER NOT NULL,
    unsealed INTEGER NOT NULL,
    overruns INTEGER NOT NULL,     -- bytes
    stack_peak_bytes INTEGER NOT NULL,
    clock_offset_ms INTEGER
) STRICT;
CREATE INDEX health_by_logger ON health (logger, id);
-- What is missing: seen as missing and come since, dropped by the logger for lack of room, or lost.
CREATE TABLE gap (
    id INTEGER PRIMARY KEY,
    logger INTEGER NOT NULL,
    series INTEGER NOT NULL,
    at TEXT NOT NULL,
    state TEXT NOT NULL,           -- detected, recovered, dropped, lost
    after INTEGER,                 -- number before the gap
    upto INTEGER,                  -- last number of the gap
    alerts INTEGER,                -- so many, where the logger has counted them
    reports INTEGER
) STRICT;

ALTER TABLE alert RENAME TO alert_1;
ALTER TABLE alert_element RENAME TO alert_element_1;
CREATE TABLE alert (
    id INTEGER PRIMARY KEY,
    message INTEGER UNIQUE REFERENCES message (id),
    received_at TEXT NOT NULL,
    source TEXT NOT NULL,          -- recording or line that it came from
    bridge TEXT NOT NULL,
    passage INTEGER NOT NULL,      -- number of the passage since the logger's start
    start_s REAL,                  -- beginning of the passage, in the recording's time
    passages REAL,                 -- that it rests on
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
    damage_low REAL,               -- 95 % lie between these
    damage_high REAL,
    certain INTEGER NOT NULL,      -- 1: beyond doubt
    PRIMARY KEY (alert, element)
) STRICT;
INSERT INTO alert
    SELECT id, NULL, received_at, source, bridge, passage, start_s, NULL, objective, objective_healthy, forward_solves, text FROM alert_1;
INSERT INTO alert_element SELECT alert, element, damage, damage_std, NULL, NULL, certain FROM alert_element_1;
DROP TABLE alert_element_1;
DROP TABLE alert_1;
