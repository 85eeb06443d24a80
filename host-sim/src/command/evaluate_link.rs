//! `host-sim evaluate link`: campaigns of faults against the way from decision to disk.

use anyhow::{Context, Result, bail};
use clap::{Args, ValueEnum};
use host_sim::campaign::{attack, fuzz, kill, link, power, sequential};
use host_sim::channel::built_image;
use host_sim::terminal;
use serde_json::json;

use super::{print, print_json};

#[derive(Debug, Args)]
pub(super) struct Link {
    /// What goes wrong
    #[arg(long, value_enum, default_value_t = Campaign::Power)]
    campaign: Campaign,
    /// power: cuts in all; link: alerts in each cell; attack: frames of each kind; kill: kills; fuzz: runs in all, or of the one target
    #[arg(long, default_value_t = 1_000_000)]
    number: u64,
    /// Seed of the first run; the same seed makes the same faults
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// power: what holds the messages
    #[arg(long, value_enum, default_value_t = Store::Outbox)]
    store: Store,
    /// fuzz: one target only, such as decoder
    #[arg(long, value_parser = target)]
    target: Option<fuzz::Target>,
    /// fuzz: number of the first run of the one target
    #[arg(long, default_value_t = 0, requires = "target")]
    first: u64,
    /// Print one JSON array in place of the table
    #[arg(long)]
    json: bool,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Campaign {
    /// The power goes at every byte that the outbox writes or erases, and again while it recovers
    Power,
    /// The line drops, repeats, reorders, changes and invents bytes, one direction dies, either end restarts
    Link,
    /// The image in QEMU and the base station are killed at any moment, on a faulty line
    Kill,
    /// Someone replays, reflects, truncates, splices, changes and forges frames
    Attack,
    /// Frames, sealed messages, models, tracks, evidence, files and flashes are random, changed or absurd
    Fuzz,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Store {
    /// The logger's
    Outbox,
    /// The queue of the crate of that name, for comparison
    SequentialStorage,
}

pub(super) fn run(arguments: &Link) -> Result<()> {
    if arguments.number == 0 || arguments.number > u64::from(u32::MAX / 2) {
        bail!("--number must be 1 to {}", u32::MAX / 2);
    }
    if arguments.store != Store::Outbox && arguments.campaign != Campaign::Power {
        bail!("--store goes with the campaign power only");
    }
    if arguments.target.is_some() && arguments.campaign != Campaign::Fuzz {
        bail!("--target goes with the campaign fuzz only");
    }
    match arguments.campaign {
        Campaign::Power => power(arguments, arguments.number),
        Campaign::Link => link(arguments),
        Campaign::Attack => attack(arguments),
        Campaign::Kill => kill(arguments),
        Campaign::Fuzz => fuzz(arguments),
    }
}

fn kill(arguments: &Link) -> Result<()> {
    let folder = std::env::temp_dir().join(format!("spanwatch-kill-{}", std::process::id()));
    std::fs::create_dir_all(&folder).with_context(|| format!("cannot make the folder {}", folder.display()))?;
    let recording = folder.join("passage.csv");
    std::fs::write(&recording, include_str!("../../recordings/case1-60kmh.csv"))?;
    std::fs::write(
        recording.with_extension("toml"),
        include_str!("../../recordings/case1-60kmh.toml"),
    )?;
    let kills = arguments.number as u32;
    let bar = terminal::progress(kills.into(), "killing");
    let program = std::env::current_exe()?;
    let outcome = kill::run(
        &program,
        &built_image("logger"),
        &recording,
        &folder,
        kills,
        arguments.seed,
        |_| bar.inc(1),
    );
    bar.finish_and_clear();
    let outcome = outcome?;
    std::fs::remove_dir_all(&folder)?;
    let kill::Outcome {
        logger_kills,
        station_kills,
        faults,
        logged,
        alerts,
        stored,
        cut_off,
        lost,
        wrong,
        seconds,
    } = outcome;
    let seed = arguments.seed;
    if arguments.json {
        return print_json(&json!({
            "logger_kills": logger_kills, "station_kills": station_kills, "faults": faults, "logged": logged, "alerts": alerts,
            "stored": stored, "cut_off": cut_off, "lost": lost, "wrong": wrong, "seconds": seconds, "seed": seed,
        }));
    }
    print(&format!(
        "{logger_kills} kills of the image, {station_kills} of the base station, {faults} faults of the line, seed {seed}: of {logged} \
         alerts and reports ({alerts} alerts) that the image has logged {stored} are stored, once and in order; {cut_off} were cut off by a \
         kill before they were on its flash; {lost} lost, {wrong} wrong. {seconds} s.\n"
    ))
}

fn link(arguments: &Link) -> Result<()> {
    let bar = terminal::progress(link::CELLS, "sending");
    let cells = link::run(arguments.number, arguments.seed, |_| bar.inc(1));
    bar.finish_and_clear();
    if !arguments.json {
        return print(&link::table(&cells));
    }
    let json = |cell: &link::Cell| {
        json!({
            "fault": format!("{:?}", cell.fault).to_lowercase(),
            "rate": cell.rate,
            "alerts": cell.counts.alerts,
            "stored": cell.counts.stored,
            "lost": cell.counts.lost,
            "duplicated": cell.counts.duplicated,
            "wrong": cell.counts.wrong,
            "faults": cell.counts.faults,
            "sessions": cell.counts.sessions,
            "frames": cell.counts.frames,
            "simulated_s": cell.counts.simulated_s,
            "seed": cell.seed,
            "seconds": cell.seconds,
        })
    };
    print_json(&cells.iter().map(json).collect())
}

fn attack(arguments: &Link) -> Result<()> {
    let bar = terminal::progress(attack::Attack::EACH.len() as u64, "attacking");
    let rows = attack::run(arguments.number, arguments.seed, |_| bar.inc(1));
    bar.finish_and_clear();
    if !arguments.json {
        return print(&attack::table(&rows));
    }
    let json = |row: &attack::Row| {
        json!({
            "attack": format!("{:?}", row.attack).to_lowercase(),
            "frames": row.frames,
            "accepted": row.accepted,
            "bytes_in": row.bytes_in,
            "bytes_out": row.bytes_out,
            "amplified": row.amplified,
            "lost": row.lost,
            "seed": row.seed,
            "seconds": row.seconds,
        })
    };
    print_json(&rows.iter().map(json).collect())
}

fn target(name: &str) -> Result<fuzz::Target, String> {
    let named = fuzz::Target::EACH.into_iter().find(|target| target.name() == name);
    named.ok_or_else(|| {
        format!(
            "the targets are {}",
            fuzz::Target::EACH.map(fuzz::Target::name).join(", ")
        )
    })
}

fn fuzz(arguments: &Link) -> Result<()> {
    let bar = terminal::progress(arguments.number, "fuzzing");
    let done = |runs| bar.inc(runs);
    let rows = match arguments.target {
        Some(target) => vec![fuzz::row(
            target,
            arguments.first,
            arguments.number,
            arguments.seed,
            done,
        )],
        None => fuzz::run(arguments.number, arguments.seed, done),
    };
    bar.finish_and_clear();
    if !arguments.json {
        return print(&fuzz::table(&rows));
    }
    let failure = |failure: &fuzz::Failure| json!({ "run": failure.run, "words": failure.words });
    let json = |row: &fuzz::Row| {
        json!({
            "target": row.target.name(),
            "runs": row.runs,
            "accepted": row.counts.accepted,
            "refused": row.counts.refused,
            "failed": row.failed,
            "failures": row.failures.iter().map(failure).collect::<Vec<_>>(),
            "seed": row.seed,
            "seconds": row.seconds,
        })
    };
    print_json(&rows.iter().map(json).collect())
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
