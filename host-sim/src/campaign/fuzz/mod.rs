//! Whatever is read, and what is done because of it: random, mutated and absurd input by seed, millions of times.
//!
//! | target | what is read | what must not be |
//! |---|---|---|
//! | [`Target::Decoder`] | bytes of a line | a frame that the format does not have, or one that is missed behind garbage |
//! | [`Target::Session`] | frames at both ends, also sealed nonsense of an end that is faulty | a number confirmed that was never given, a request obeyed that was not asked in this session |
//! | [`Target::Requests`] | sealed requests at a whole logger | a request without exactly one answer, work without end |
//! | [`Target::Models`], [`Target::Tracks`], [`Target::Evidence`] | blobs, their checksum mostly right | one accepted that gives numbers which are none |
//! | [`Target::Files`] | recordings, bridges, trains, track tables as people write them | an error that is no sentence |
//! | [`Target::Images`] | the flash, as age and power cuts leave it | an outbox that opens and then does not work |
//!
//! And nowhere a panic. Every run has chances of its own, made of seed, target and number: what it did is done again by [`run_one`] alone.
//! A loop without end is found by counting: frames and slices where the campaign turns the handle, operations of the flash
//! ([`Metered`](images::Metered)) where the outbox does.

mod blobs;
mod decoder;
mod files;
mod images;
mod mutation;
mod requests;
mod session;

use std::cell::{Cell, RefCell};
use std::panic;
use std::sync::Once;
use std::time::Instant;

use rayon::prelude::*;

use super::line::Chance;

/// Failures that are told one by one.
const TOLD: usize = 5;
/// Runs that are begun together.
const BATCH: u64 = 10_000;

/// What is fuzzed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Target {
    /// The decoder of frames.
    Decoder,
    /// Both ends of a session.
    Session,
    /// A logger's requests.
    Requests,
    /// The reader of bridge models.
    Models,
    /// The reader of learnt tracks.
    Tracks,
    /// The reader of an evidence.
    Evidence,
    /// The readers of files on the PC.
    Files,
    /// The outbox on a flash.
    Images,
}

impl Target {
    /// Every one.
    pub const EACH: [Self; 8] = [
        Self::Decoder,
        Self::Session,
        Self::Requests,
        Self::Models,
        Self::Tracks,
        Self::Evidence,
        Self::Files,
        Self::Images,
    ];

    /// Its share of all runs, in hundredths: what is cheap has more, a whole logger least.
    fn share(self) -> u64 {
        match self {
            Self::Decoder => 34,
            Self::Session => 16,
            Self::Requests => 2,
            Self::Models => 6,
            Self::Tracks | Self::Images | Self::Files => 10,
            Self::Evidence => 12,
        }
    }

    /// Its name.
    pub fn name(self) -> &'static str {
        match self {
            Self::Decoder => "decoder",
            Self::Session => "session",
            Self::Requests => "requests",
            Self::Models => "models",
            Self::Tracks => "tracks",
            Self::Evidence => "evidence",
            Self::Files => "files",
            Self::Images => "images",
        }
    }

    fn run(self, chance: &mut Chance) -> Result<Counts, String> {
        match self {
            Self::Decoder => decoder::run(chance),
            Self::Session => session::run(chance),
            Self::Requests => requests::run(chance),
            Self::Models => blobs::run_model(chance),
            Self::Tracks => blobs::run_track(chance),
            Self::Evidence => blobs::run_evidence(chance),
            Self::Files => files::run(chance),
            Self::Images => images::run(chance),
        }
    }
}

/// What became of what was read.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Counts {
    /// Taken.
    pub accepted: u64,
    /// Refused, with a reason.
    pub refused: u64,
}

impl Counts {
    fn of(accepted: bool) -> Self {
        Self {
            accepted: accepted.into(),
            refused: (!accepted).into(),
        }
    }
}

/// A run that went wrong.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Failure {
    /// Its number.
    pub run: u64,
    /// What went wrong.
    pub words: String,
}

/// A row of the campaign's table.
#[derive(Debug, Clone)]
pub struct Row {
    /// What was fuzzed.
    pub target: Target,
    /// How often.
    pub runs: u64,
    /// What became of it.
    pub counts: Counts,
    /// Runs that went wrong.
    pub failed: u64,
    /// The first few of them.
    pub failures: Vec<Failure>,
    /// The seed.
    pub seed: u64,
    /// Time that it took, s.
    pub seconds: f64,
}

/// Every target, `runs` in all at least; `done` hears of every batch.
pub fn run(runs: u64, seed: u64, done: impl Fn(u64) + Sync) -> Vec<Row> {
    Target::EACH
        .into_iter()
        .map(|target| row(target, 0, (runs * target.share()).div_ceil(100), seed, &done))
        .collect()
}

/// One target: `runs` of it from number `first` on.
pub fn row(target: Target, first: u64, runs: u64, seed: u64, done: impl Fn(u64) + Sync) -> Row {
    let start = Instant::now();
    let mut row = Row {
        target,
        runs,
        counts: Counts::default(),
        failed: 0,
        failures: vec![],
        seed,
        seconds: 0.0,
    };
    let end = first + runs;
    for from in (first..end).step_by(BATCH as usize) {
        let batch = from..end.min(from + BATCH);
        done(batch.end - batch.start);
        let results: Vec<(u64, Result<Counts, String>)> = batch
            .into_par_iter()
            .map(|number| (number, run_one(target, number, seed)))
            .collect();
        for (run, result) in results {
            match result {
                Ok(counts) => {
                    row.counts.accepted += counts.accepted;
                    row.counts.refused += counts.refused;
                }
                Err(words) => {
                    row.failed += 1;
                    if row.failures.len() < TOLD {
                        row.failures.push(Failure { run, words });
                    }
                }
            }
        }
    }
    row.seconds = start.elapsed().as_secs_f64();
    row
}

/// One run; what went wrong, if anything did.
///
/// # Errors
/// In words: where it panicked, or what was not as it must be.
pub fn run_one(target: Target, number: u64, seed: u64) -> Result<Counts, String> {
    let mut chance = Chance::new(seed.rotate_left(40) ^ (target as u64) << 56 ^ number);
    quietly(|| target.run(&mut chance))
}

thread_local! {
    /// Panics of this thread are the campaign's.
    static QUIET: Cell<bool> = const { Cell::new(false) };
    /// Where the last of them was.
    static PLACE: RefCell<String> = const { RefCell::new(String::new()) };
}

/// Does it; a panic becomes words and is not printed.
fn quietly<T>(work: impl FnOnce() -> Result<T, String>) -> Result<T, String> {
    static HOOK: Once = Once::new();
    HOOK.call_once(|| {
        let others = panic::take_hook();
        panic::set_hook(Box::new(move |info| {
            if QUIET.get() {
                PLACE.set(format!("panic: {info}").replace('\n', " "));
            } else {
                others(info);
            }
        }));
    });
    QUIET.set(true);
    let result = panic::catch_unwind(panic::AssertUnwindSafe(work));
    QUIET.set(false);
    result.unwrap_or_else(|_| Err(PLACE.take()))
}

/// Fails the run unless it is so.
macro_rules! must {
    ($so:expr, $($words:tt)+) => {
        if !$so {
            return Err(format!($($words)+));
        }
    };
}
use must;

/// The rows as text, their sum, and how each failure is made again.
pub fn table(rows: &[Row]) -> String {
    use std::fmt::Write as _;
    let mut text = String::from("| target | runs | accepted | refused | failures | s |\n|---|---|---|---|---|---|\n");
    let mut line = |name: &str, numbers: [u64; 4], seconds: f64| {
        let [runs, accepted, refused, failed] = numbers;
        // Writing to a string cannot fail.
        let _ = writeln!(
            text,
            "| {name} | {runs} | {accepted} | {refused} | {failed} | {seconds:.1} |"
        );
    };
    let mut all = [0; 4];
    for row in rows {
        let numbers = [row.runs, row.counts.accepted, row.counts.refused, row.failed];
        line(row.target.name(), numbers, row.seconds);
        all.iter_mut().zip(numbers).for_each(|(all, number)| *all += number);
    }
    line("all", all, rows.iter().map(|row| row.seconds).sum());
    for row in rows {
        for Failure { run, words } in &row.failures {
            let _ = writeln!(
                text,
                "{}: {words}\n  again: host-sim evaluate link --campaign fuzz --target {0} --first {run} --number 1 --seed {}",
                row.target.name(),
                row.seed
            );
        }
    }
    text
}
