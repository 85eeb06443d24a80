//! What loggers say, on disk: one SQLite file, appended to.
//!
//! A message is there once it is committed, and only once: its logger, the series of the logger's numbers and its number are unique. The
//! file is in SQLite's WAL mode with every commit flushed. `1.sql`, `2.sql` make each version of the tables from the one before.

mod query;

use std::path::Path;
use std::time::Duration;

use anyhow::{Context, Result, bail};
use rusqlite::{Connection, OptionalExtension, Transaction, TransactionBehavior, params};
use spanwatch::session::Device;
use spanwatch::session::packet::Heartbeat;
use spanwatch::wire::message::{Alert, Event, Notice, PassageReport, TrackReport, VERSION, Verdict};

use super::line::now_ms;
use super::{Heard, words};

pub use query::{Cell, Table, Topic};

/// What makes each version of the tables from the one before; SQLite's `user_version` says which it is.
const VERSIONS: [&str; 2] = [include_str!("1.sql"), include_str!("2.sql")];
/// Another program may hold the file for a moment.
const BUSY_TIMEOUT: Duration = Duration::from_secs(2);
/// A logger's health is kept so often, and whenever something has gone wrong in between.
const HEALTH_EVERY_MS: u64 = 10 * 60 * 1000;
/// A time as the tables have it, of milliseconds since 1970.
const TIME: &str = "strftime('%Y-%m-%dT%H:%M:%fZ', ?1 / 1000.0, 'unixepoch')";

/// Whose message it is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Origin {
    /// The logger.
    pub logger: Device,
    /// The series of its numbers.
    pub series: u32,
    /// Its number there.
    pub number: u32,
    /// The number before it.
    pub previous: u32,
}

/// An open file.
pub struct Store {
    connection: Connection,
}

impl Store {
    /// Opens the file, makes it, or brings it to this program's version.
    ///
    /// # Errors
    /// The file is no SQLite file, holds something else, or is of a later version.
    pub fn open(path: &Path) -> Result<Self> {
        let name = path.display();
        let mut connection = Connection::open(path).with_context(|| format!("cannot open the database {name}"))?;
        connection.busy_timeout(BUSY_TIMEOUT)?;
        migrate(&mut connection, &name.to_string())?;
        // Other than tables, the mode outlives nothing that it is asked for twice.
        connection
            .pragma_update(None, "journal_mode", "WAL")
            .and_then(|()| connection.pragma_update(None, "synchronous", "FULL"))
            .with_context(|| format!("cannot write the database {name}"))?;
        Ok(Self { connection })
    }

    /// The file may not grow beyond this many pages: a disk that is full.
    pub fn limit_pages(&self, pages: u32) -> Result<()> {
        let _: i64 = (self.connection).query_row(&format!("PRAGMA max_page_count = {pages}"), [], |row| row.get(0))?;
        Ok(())
    }

    /// Everything of a logger's series of numbers up to here is stored.
    pub fn stored(&self, logger: Device, series: u32) -> Result<u32> {
        let stored = self
            .connection
            .query_row(
                "SELECT stored FROM series WHERE logger = ?1 AND series = ?2",
                params![logger, series],
                |row| row.get(0),
            )
            .optional()?;
        Ok(stored.unwrap_or(0))
    }

    /// A logger has proven on the line `source` who it is.
    pub fn seen(&mut self, logger: Device, name: Option<&str>, series: u32, source: &str, now_ms: u64) -> Result<()> {
        self.connection.execute(
            &format!(
                "INSERT INTO logger (device, name, series, source, first_seen, last_seen) VALUES (?2, ?3, ?4, ?5, {TIME}, {TIME})
                 ON CONFLICT (device) DO UPDATE SET name = excluded.name, series = excluded.series, source = excluded.source,
                     last_seen = excluded.last_seen"
            ),
            params![now_ms, logger, name, series, source],
        )?;
        Ok(())
    }

    /// Begins a change. It waits for others before it has read anything: one that has read cannot go on once another has written.
    fn change(&mut self) -> rusqlite::Result<Transaction<'_>> {
        self.connection
            .transaction_with_behavior(TransactionBehavior::Immediate)
    }

    /// Stores a message, and returns when it is on the disk; false: it was there. `start_s` is the beginning of its passage in the time
    /// of the recording `source`.
    pub fn keep(
        &mut self,
        origin: Origin,
        message: &[u8],
        source: &str,
        start_s: Option<f64>,
        now_ms: u64,
    ) -> Result<bool> {
        let notice = postcard::from_bytes::<Notice>(message).ok();
        let change = self.change()?;
        let new = insert_message(&change, origin, message, notice.as_ref(), source, now_ms)?;
        if let (Some(id), Some(notice)) = (new, &notice) {
            match &notice.event {
                Event::Alert(alert) => insert_alert(&change, id, alert, source, start_s, now_ms)?,
                Event::Passage(report) => insert_passage(&change, id, report)?,
                Event::Track(report) => insert_track(&change, id, report)?,
            }
        }
        raise_stored(&change, origin.logger, origin.series, origin.number)?;
        change.execute(
            "UPDATE gap SET state = 'recovered' WHERE logger = ?1 AND series = ?2 AND state = 'detected' AND upto <= ?3",
            params![origin.logger, origin.series, origin.number],
        )?;
        change.commit()?;
        Ok(new.is_some())
    }

    /// Stores what a logger has said of the recording `source`, beginning at `start_s` of it.
    pub fn keep_heard(&mut self, heard: &Heard, source: &str, start_s: f64) -> Result<bool> {
        self.keep(heard.origin, &heard.message, source, Some(start_s), now_ms())
    }

    /// Messages behind number `after`, up to `upto`, have not come yet.
    pub fn gap_detected(&mut self, logger: Device, series: u32, after: u32, upto: u32, now_ms: u64) -> Result<()> {
        self.connection.execute(
            &format!(
                "INSERT INTO gap (logger, series, at, state, after, upto) SELECT ?2, ?3, {TIME}, 'detected', ?4, ?5
                 WHERE NOT EXISTS (SELECT 1 FROM gap WHERE logger = ?2 AND series = ?3 AND upto >= ?5)"
            ),
            params![now_ms, logger, series, after, upto],
        )?;
        Ok(())
    }

    /// The logger has forgotten messages that are not here, up to number `upto`: they are lost.
    pub fn declare_lost(&mut self, logger: Device, series: u32, after: u32, upto: u32, now_ms: u64) -> Result<()> {
        let change = self.change()?;
        change.execute(
            &format!(
                "INSERT INTO gap (logger, series, at, state, after, upto) VALUES (?2, ?3, {TIME}, 'lost', ?4, ?5)"
            ),
            params![now_ms, logger, series, after, upto],
        )?;
        raise_stored(&change, logger, series, upto)?;
        change.commit()?;
        Ok(())
    }

    /// A logger lives: what its clock is worth, what it has dropped since the last time, and now and then how it is.
    pub fn heartbeat(&mut self, logger: Device, series: u32, heartbeat: &Heartbeat, now_ms: u64) -> Result<()> {
        let vitals = &heartbeat.vitals;
        let change = self.change()?;
        change.execute(
            "INSERT INTO start (logger, series, start, clock_offset_ms) VALUES (?1, ?2, ?3, ?4)
             ON CONFLICT (logger, series, start) DO UPDATE SET clock_offset_ms = excluded.clock_offset_ms",
            params![
                logger,
                series,
                heartbeat.starts,
                now_ms.cast_signed().saturating_sub(heartbeat.uptime_ms.cast_signed())
            ],
        )?;
        change.execute(
            &format!("UPDATE logger SET last_seen = {TIME} WHERE device = ?2"),
            params![now_ms, logger],
        )?;
        let last = change
            .query_row(
                "SELECT start, alerts_dropped, reports_dropped, unreadable, setup, rolled_back, unixepoch(at) * 1000 FROM health
                 WHERE logger = ?1 ORDER BY id DESC LIMIT 1",
                [logger],
                |row| {
                    let counts = [row.get::<_, u32>(0)?, row.get(1)?, row.get(2)?, row.get(3)?, row.get(4)?, row.get(5)?];
                    Ok((counts, row.get::<_, i64>(6)?.cast_unsigned()))
                },
            )
            .optional()?;
        let now = [
            heartbeat.starts,
            vitals.alerts_dropped,
            vitals.reports_dropped,
            vitals.unreadable,
            vitals.setup.generation,
            vitals.setup.rolled_back.into(),
        ];
        let (before, at_ms) = last.unwrap_or(([0; 6], 0));
        if before != now || now_ms >= at_ms.saturating_add(HEALTH_EVERY_MS) {
            let [_, alerts, reports, ..] = before;
            let alerts = vitals.alerts_dropped.saturating_sub(alerts);
            let reports = vitals.reports_dropped.saturating_sub(reports);
            if alerts > 0 || reports > 0 {
                change.execute(
                    &format!(
                        "INSERT INTO gap (logger, series, at, state, alerts, reports) VALUES (?2, ?3, {TIME}, 'dropped', ?4, ?5)"
                    ),
                    params![now_ms, logger, series, alerts, reports],
                )?;
            }
            insert_health(&change, logger, heartbeat, now_ms)?;
        }
        change.commit()?;
        Ok(())
    }

    /// The last message of a logger that is stored, by its place in the file; 0: none.
    pub fn last_message(&self, logger: Device) -> Result<u32> {
        let last = "SELECT coalesce(max(id), 0) FROM message WHERE logger = ?1";
        Ok(self.connection.query_row(last, [logger], |row| row.get(0))?)
    }

    /// The first message of a logger behind a place in the file: its place, and what it says.
    pub fn message_after(&self, logger: Device, place: u32) -> Result<Option<(u32, Vec<u8>)>> {
        let next = "SELECT id, payload FROM message WHERE logger = ?1 AND id > ?2 ORDER BY id LIMIT 1";
        let found = self
            .connection
            .query_row(next, params![logger, place], |row| Ok((row.get(0)?, row.get(1)?)));
        Ok(found.optional()?)
    }

    /// Alerts stored so far.
    pub fn alerts(&self) -> Result<i64> {
        Ok(self
            .connection
            .query_row("SELECT count(*) FROM alert", [], |row| row.get(0))?)
    }
}

/// Brings the tables to the version of this program.
fn migrate(connection: &mut Connection, name: &str) -> Result<()> {
    let version = |connection: &Connection| connection.pragma_query_value(None, "user_version", |row| row.get(0));
    let found: u32 = version(connection).with_context(|| format!("{name} cannot be used as a database of alerts"))?;
    if found as usize == VERSIONS.len() {
        return Ok(());
    }
    // Two programs may open a new file at the same time: the second finds what the first has made.
    let change = connection
        .transaction_with_behavior(TransactionBehavior::Immediate)
        .with_context(|| format!("cannot write the database {name}"))?;
    let found: u32 = version(&change)?;
    let Some(missing) = VERSIONS.get(found as usize..) else {
        bail!(
            "{name} has version {found} of the tables; this program knows {}: use the later program",
            VERSIONS.len()
        );
    };
    if found == 0 {
        let tables: i64 = change.query_row("SELECT count(*) FROM sqlite_schema", [], |row| row.get(0))?;
        if tables > 0 {
            bail!("{name} is a database of something else; name another file for the alerts");
        }
    }
    for sql in missing {
        change.execute_batch(sql)?;
    }
    change.pragma_update(None, "user_version", VERSIONS.len() as u32)?;
    change
        .commit()
        .with_context(|| format!("cannot write the database {name}"))
}

fn raise_stored(change: &Transaction<'_>, logger: Device, series: u32, number: u32) -> Result<()> {
    change.execute(
        "INSERT INTO series (logger, series, stored) VALUES (?1, ?2, ?3)
         ON CONFLICT (logger, series) DO UPDATE SET stored = max(stored, excluded.stored)",
        params![logger, series, number],
    )?;
    Ok(())
}

/// The message's place in the file; none: it is there already.
fn insert_message(
    change: &Transaction<'_>,
    origin: Origin,
    message: &[u8],
    notice: Option<&Notice>,
    source: &str,
    now_ms: u64,
) -> Result<Option<i64>> {
    let kind = match notice.map(|notice| &notice.event) {
        Some(Event::Alert(_)) => "alert",
        Some(Event::Passage(_)) => "passage",
        Some(Event::Track(_)) => "track",
        None => "unknown",
    };
    let offset_ms: Option<i64> = match notice {
        Some(notice) => change
            .query_row(
                "SELECT clock_offset_ms FROM start WHERE logger = ?1 AND series = ?2 AND start = ?3",
                params![origin.logger, origin.series, notice.start],
                |row| row.get(0),
            )
            .optional()?,
        None => None,
    };
    let happened_ms = offset_ms.zip(notice).map(|(offset_ms, notice)| {
        offset_ms
            .saturating_add(notice.uptime_ms.cast_signed())
            .min(now_ms.cast_signed())
    });
    let new = change.execute(
        &format!(
            "INSERT INTO message (logger, series, number, previous, received_at, happened_at, source, kind, version, payload)
             VALUES (?2, ?3, ?4, ?5, {TIME}, strftime('%Y-%m-%dT%H:%M:%fZ', ?6 / 1000.0, 'unixepoch'), ?7, ?8, ?9, ?10)
             ON CONFLICT (logger, series, number) DO NOTHING"
        ),
        params![
            now_ms,
            origin.logger,
            origin.series,
            origin.number,
            origin.previous,
            happened_ms,
            source,
            kind,
            VERSION,
            message
        ],
    )?;
    Ok((new > 0).then(|| change.last_insert_rowid()))
}

fn insert_alert(
    change: &Transaction<'_>,
    message: i64,
    alert: &Alert,
    source: &str,
    start_s: Option<f64>,
    now_ms: u64,
) -> Result<()> {
    change.execute(
        &format!(
            "INSERT INTO alert (message, received_at, source, bridge, passage, start_s, passages, objective, objective_healthy,
                 forward_solves, text)
             VALUES (?2, {TIME}, ?3, ?4, ?5, ?6, ?7, ?8, ?9, ?10, ?11)"
        ),
        params![
            now_ms,
            message,
            source,
            alert.bridge.as_str(),
            alert.passage,
            start_s,
            f64::from(alert.passages),
            f64::from(alert.objective),
            f64::from(alert.objective_healthy),
            alert.forward_solves,
            words::alert(alert)
        ],
    )?;
    let id = change.last_insert_rowid();
    let fraction = |permille: Option<&u16>| permille.map(|&permille| f64::from(permille) / 1000.0);
    for (e, (damage, std)) in alert.damage_permille.iter().zip(&alert.std_permille).enumerate() {
        change.execute(
            "INSERT INTO alert_element (alert, element, damage, damage_std, damage_low, damage_high, certain)
             VALUES (?1, ?2, ?3, ?4, ?5, ?6, ?7)",
            params![
                id,
                e as i64 + 1,
                fraction(Some(damage)),
                fraction(Some(std)),
                fraction(alert.low_permille.get(e)),
                fraction(alert.high_permille.get(e)),
                alert.certain >> e & 1
            ],
        )?;
    }
    Ok(())
}

fn insert_passage(change: &Transaction<'_>, message: i64, report: &PassageReport) -> Result<()> {
    let (verdict, reason, hidden) = match report.verdict {
        Verdict::Healthy { hidden_permille, .. } => ("healthy", None, Some(hidden_permille)),
        Verdict::Undecided { hidden_permille, .. } => ("undecided", None, Some(hidden_permille)),
        Verdict::Damaged { .. } => ("damaged", None, None),
        Verdict::NotIdentified(reason) => ("not identified", Some(words::why(&reason)), None),
    };
    let fit = report.verdict.fit();
    change.execute(
        "INSERT INTO passage (message, passage, verdict, reason, unexplained, speed_kmh, load_factor, stiffness_factor, change, hidden,
             level_db, bad_samples)
         VALUES (?1, ?2, ?3, ?4, ?5, ?6, ?7, ?8, ?9, ?10, ?11, ?12)",
        params![
            message,
            report.passage,
            verdict,
            reason,
            fit.map(|fit| f64::from(fit.unexplained)),
            fit.map(|fit| 3.6 * f64::from(fit.speed_mps)),
            fit.map(|fit| f64::from(fit.load_factor)),
            fit.map(|fit| f64::from(fit.stiffness)),
            fit.map(|fit| format!("{:?}", fit.change).to_lowercase()),
            hidden.map(|permille| f64::from(permille) / 1000.0),
            f64::from(report.level_db),
            report.quality.total()
        ],
    )?;
    Ok(())
}

fn insert_track(change: &Transaction<'_>, message: i64, report: &TrackReport) -> Result<()> {
    change.execute(
        "INSERT INTO track (message, passage, since, misfit, mean_misfit) VALUES (?1, ?2, ?3, ?4, ?5)",
        params![
            message,
            report.passage,
            report.since,
            f64::from(report.misfit),
            f64::from(report.mean_misfit)
        ],
    )?;
    Ok(())
}

fn insert_health(change: &Transaction<'_>, logger: Device, heartbeat: &Heartbeat, now_ms: u64) -> Result<()> {
    let vitals = &heartbeat.vitals;
    change.execute(
        &format!(
            "INSERT INTO health (logger, at, start, restart, uptime_ms, setup, rolled_back, passages, alerts, alerts_waiting,
                 reports_waiting, fill_permille, alerts_dropped, reports_dropped, unreadable, wear, rejected, forged, replayed, unsealed,
                 overruns, stack_peak_bytes, clock_offset_ms)
             VALUES (?2, {TIME}, ?3, ?4, ?5, ?6, ?7, ?8, ?9, ?10, ?11, ?12, ?13, ?14, ?15, ?16, ?17, ?18, ?19, ?20, ?21, ?22, ?23)"
        ),
        params![
            now_ms,
            logger,
            heartbeat.starts,
            words::restart(vitals.restart()),
            heartbeat.uptime_ms,
            vitals.setup.generation,
            vitals.setup.rolled_back,
            vitals.passages,
            vitals.alerts,
            vitals.alerts_waiting,
            vitals.reports_waiting,
            vitals.fill_permille,
            vitals.alerts_dropped,
            vitals.reports_dropped,
            vitals.unreadable,
            vitals.wear,
            vitals.rejections.iter().fold(0, |sum: u32, count| sum.saturating_add(*count)),
            vitals.forged,
            vitals.replayed,
            vitals.unsealed,
            vitals.health.overruns,
            vitals.health.stack_peak_bytes,
            vitals.clock_offset_ms
        ],
    )?;
    Ok(())
}
