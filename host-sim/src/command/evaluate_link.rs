//! `host-sim evaluate link`: campaigns of faults against the way from decision to disk.

use anyhow::{Result, bail};
use clap::{Args, ValueEnum};
use host_sim::campaign::{power, sequential};
use host_sim::terminal;
use serde_json::json;

use super::{print, print_json};

#[derive(Debug, Args)]
pub(super) struct Link {
    /// What goes wrong
    #[arg(long, value_enum, default_value_t = Campaign::Power)]
    campaign: Campaign,
    /// Faults at least, over all rows; without it 1000000
    #[arg(long, value_name = "NUMBER")]
    faults: Option<u64>,
    /// Seed of the first run; the same seed makes the same faults
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// power: what holds the messages
    #[arg(long, value_enum, default_value_t = Store::Outbox)]
    store: Store,
    /// Print one JSON array in place of the table
    #[arg(long)]
    json: bool,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Campaign {
    /// The power goes at every byte that the outbox writes or erases, and again while it recovers
    Power,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Store {
    /// The logger's
    Outbox,
    /// The queue of the crate of that name, for comparison
    SequentialStorage,
}

/// Faults unless others are asked for.
const FAULTS: u64 = 1_000_000;

pub(super) fn run(arguments: &Link) -> Result<()> {
    let faults = arguments.faults.unwrap_or(FAULTS);
    if faults == 0 {
        bail!("--faults must be at least 1");
    }
    match arguments.campaign {
        Campaign::Power => power(arguments, faults),
    }
}

fn power(arguments: &Link, faults: u64) -> Result<()> {
    let bar = terminal::progress(faults, "cutting");
    let done = |row: &power::Row| bar.inc(row.counts.cuts);
    let rows = match arguments.store {
        Store::Outbox => power::run(faults, arguments.seed, done),
        Store::SequentialStorage => sequential::run(faults, arguments.seed, done),
    };
    bar.finish_and_clear();
    if arguments.json {
        print_json(&rows.iter().map(power_json).collect())
    } else {
        print(&power::table(&rows))
    }
}

fn power_json(row: &power::Row) -> serde_json::Value {
    let counts = &row.counts;
    json!({
        "word_bytes": row.word,
        "torn_words": row.tear.words,
        "any_order": row.tear.shuffled,
        "operations": counts.operations,
        "cuts": counts.cuts,
        "cuts_in_recovery": counts.cuts_in_recovery,
        "lost": counts.lost,
        "duplicated": counts.duplicated,
        "altered": counts.altered,
        "reused": counts.reused,
        "evidence_lost": counts.evidence_lost,
        "dead": counts.dead,
        "dropped_and_counted": counts.dropped,
        "seed": row.seed,
        "seconds": row.seconds,
    })
}
