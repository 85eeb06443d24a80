//! Questions to the file: which loggers, which alerts since when.

use anyhow::{Result, bail};
use clap::ValueEnum;
use rusqlite::types::Value;
use rusqlite::{OptionalExtension, params_from_iter};

use super::Store;

/// A value of the answer.
pub type Cell = Value;

/// What is asked for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Topic {
    /// Who is known, and when each was heard last
    Loggers,
    /// Damage
    Alerts,
    /// Each alert's elements, with their ranges
    Elements,
    /// Trains that have passed
    Passages,
    /// How the loggers were
    Health,
    /// What is missing: seen as missing, dropped for lack of room, lost
    Gaps,
}

/// The answer.
#[derive(Debug, Clone, PartialEq)]
pub struct Table {
    /// Names of the columns.
    pub columns: Vec<String>,
    /// Rows.
    pub rows: Vec<Vec<Cell>>,
}

impl Topic {
    /// What is shown, by a query whose columns `logger` and, but of the loggers, `at` can be asked for.
    const fn sql(self) -> &'static str {
        match self {
            Self::Loggers => {
                "SELECT device AS logger, name,
                     CASE WHEN unixepoch('now') - unixepoch(last_seen) < 60 THEN 'heard'
                          ELSE 'silent for ' || (unixepoch('now') - unixepoch(last_seen)) / 60 || ' minutes' END AS state,
                     last_seen AS last_heard, first_seen, source,
                     (SELECT count(*) FROM message WHERE message.logger = device AND kind = 'alert') AS alerts,
                     (SELECT count(*) FROM message WHERE message.logger = device AND kind = 'passage') AS passages
                 FROM logger"
            }
            Self::Alerts => {
                "SELECT message.logger, coalesce(happened_at, alert.received_at) AS at, alert.received_at, series, number, previous, bridge, alert.source,
                     passage, text
                 FROM alert LEFT JOIN message ON message.id = alert.message"
            }
            Self::Elements => {
                "SELECT message.logger, coalesce(happened_at, alert.received_at) AS at, alert.received_at, number, element, damage, damage_low, damage_high,
                     certain
                 FROM alert JOIN alert_element ON alert_element.alert = alert.id LEFT JOIN message ON message.id = alert.message"
            }
            Self::Passages => {
                "SELECT logger, coalesce(happened_at, received_at) AS at, received_at, number, previous, passage, verdict, speed_kmh, load_factor, stiffness_factor,
                     unexplained, hidden, change, level_db, bad_samples, reason
                 FROM passage JOIN message ON message.id = passage.message"
            }
            Self::Health => "SELECT * FROM health",
            Self::Gaps => "SELECT * FROM gap",
        }
    }
}

impl Store {
    /// What the file knows, oldest first: of one logger, from a time on, where these are given.
    pub fn query(&self, topic: Topic, logger: Option<u32>, since: Option<&str>) -> Result<Table> {
        let since = since.map(|since| self.time(since)).transpose()?;
        let mut sql = format!("SELECT * FROM ({}) WHERE 1", topic.sql());
        let mut values: Vec<Value> = vec![];
        if let Some(logger) = logger {
            values.push(logger.into());
            sql += &format!(" AND logger = ?{}", values.len());
        }
        if let Some(since) = since {
            values.push(since.into());
            let number = values.len();
            sql += &match topic {
                // What happened before and has come since is news, too.
                Topic::Alerts | Topic::Elements | Topic::Passages => {
                    format!(" AND (at >= ?{number} OR received_at >= ?{number})")
                }
                Topic::Health | Topic::Gaps => format!(" AND at >= ?{number}"),
                // One that is silent since then is what matters most.
                Topic::Loggers => format!(" AND ?{number} IS NOT NULL"),
            };
        }
        sql += if topic == Topic::Loggers {
            " ORDER BY logger"
        } else {
            " ORDER BY at"
        };
        let mut statement = self.connection.prepare(&sql)?;
        let columns: Vec<String> = statement.column_names().map(str::to_owned).collect();
        let rows = statement.query_map(params_from_iter(values), |row| {
            (0..columns.len()).map(|column| row.get(column)).collect()
        })?;
        Ok(Table {
            rows: rows.collect::<Result<_, _>>()?,
            columns,
        })
    }

    /// A time as an engineer says it: a date with or without a time (UTC), a weekday (the last one, today included), or how long ago (`36h`,
    /// `7d`).
    fn time(&self, text: &str) -> Result<String> {
        const DAYS: [&str; 7] = [
            "sunday",
            "monday",
            "tuesday",
            "wednesday",
            "thursday",
            "friday",
            "saturday",
        ];
        let lower = text.to_lowercase();
        let modifiers = if let Some(day) = DAYS.iter().position(|&day| day == lower) {
            vec![
                "now".to_owned(),
                "start of day".to_owned(),
                "-6 days".to_owned(),
                format!("weekday {day}"),
            ]
        } else if let Some((number, unit)) = ago(&lower) {
            vec!["now".to_owned(), format!("-{number} {unit}")]
        } else {
            vec![text.to_owned()]
        };
        let marks = vec!["?"; modifiers.len()].join(", ");
        let found: Option<Option<String>> = (self.connection)
            .query_row(
                &format!("SELECT strftime('%Y-%m-%dT%H:%M:%fZ', {marks})"),
                params_from_iter(&modifiers),
                |row| row.get(0),
            )
            .optional()?;
        // SQLite takes a lone number for a day of its own count, and the 30th of February for the 2nd of March.
        let sound = |time: &String| modifiers.len() > 1 || time.get(..10) == text.get(..10);
        match found.flatten().filter(sound) {
            Some(time) => Ok(time),
            None => bail!(
                "\"{text}\" is no time: give a date (2026-11-23, 2026-11-23T14:00), a weekday, or how long ago (36h, 7d)"
            ),
        }
    }
}

/// How long ago: a number, and the word that SQLite has for its unit.
fn ago(text: &str) -> Option<(u32, &'static str)> {
    let at = text.len().checked_sub(1)?;
    let (number, unit) = text.split_at_checked(at)?;
    let unit = match unit {
        "m" => "minutes",
        "h" => "hours",
        "d" => "days",
        _ => return None,
    };
    Some((number.parse().ok()?, unit))
}
