//! Alerts on disk: one SQLite file, appended to.

use std::path::Path;
use std::time::Duration;

use anyhow::{Context, Result, bail};
use rusqlite::{Connection, params};
use spanwatch::wire::message::Alert;

/// Version of the tables, in SQLite's `user_version`.
const SCHEMA_VERSION: i32 = 1;
const SCHEMA: &str = "
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
";
/// Another program may hold the file for a moment.
const BUSY_TIMEOUT: Duration = Duration::from_secs(5);

/// An open file of alerts.
pub struct Store {
    connection: Connection,
}

impl Store {
    /// Opens the file, or makes it.
    ///
    /// # Errors
    /// The file is no SQLite file, holds something else, or is of another version.
    pub fn open(path: &Path) -> Result<Self> {
        let name = path.display();
        let connection = Connection::open(path).with_context(|| format!("cannot open the alert file {name}"))?;
        connection.busy_timeout(BUSY_TIMEOUT)?;
        let version = |connection: &Connection| connection.pragma_query_value(None, "user_version", |row| row.get(0));
        let found: i32 = version(&connection).with_context(|| format!("{name} cannot be used as an alert file"))?;
        match found {
            SCHEMA_VERSION => {}
            0 => {
                let tables: i64 = connection.query_row("SELECT count(*) FROM sqlite_schema", [], |row| row.get(0))?;
                if tables > 0 {
                    bail!("{name} is a database of something else; name another file for the alerts");
                }
                connection
                    .execute_batch(&format!(
                        "BEGIN; {SCHEMA} PRAGMA user_version = {SCHEMA_VERSION}; COMMIT;"
                    ))
                    .with_context(|| format!("cannot write the alert file {name}"))?;
            }
            other => bail!("{name} has version {other} of the alert tables; this program writes {SCHEMA_VERSION}"),
        }
        Ok(Self { connection })
    }

    /// Appends an alert and returns when it is on the disk.
    pub fn append(&mut self, source: &str, start_s: f64, alert: &Alert, text: &str) -> Result<()> {
        let change = self.connection.transaction()?;
        change.execute(
            "INSERT INTO alert (source, bridge, passage, start_s, objective, objective_healthy, forward_solves, text)
             VALUES (?1, ?2, ?3, ?4, ?5, ?6, ?7, ?8)",
            params![
                source,
                alert.bridge.as_str(),
                alert.passage,
                start_s,
                f64::from(alert.objective),
                f64::from(alert.objective_healthy),
                alert.forward_solves,
                text
            ],
        )?;
        let id = change.last_insert_rowid();
        for (e, (damage, std)) in alert.damage_permille.iter().zip(&alert.std_permille).enumerate() {
            change.execute(
                "INSERT INTO alert_element (alert, element, damage, damage_std, certain) VALUES (?1, ?2, ?3, ?4, ?5)",
                params![
                    id,
                    e as i64 + 1,
                    f64::from(*damage) / 1000.0,
                    f64::from(*std) / 1000.0,
                    alert.certain >> e & 1
                ],
            )?;
        }
        change.commit().context("cannot store the alert")
    }

    /// Alerts stored so far.
    pub fn count(&self) -> Result<i64> {
        Ok(self
            .connection
            .query_row("SELECT count(*) FROM alert", [], |row| row.get(0))?)
    }
}
