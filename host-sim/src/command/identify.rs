//! `host-sim identify`: which elements have lost stiffness, by one recording.

use std::fmt::Write as _;
use std::path::PathBuf;

use anyhow::Result;
use clap::{Args, ValueEnum};
use host_sim::identification::{Found, Known, Method, Observed, search};
use host_sim::replay::{self, Prepared};
use host_sim::station::words;
use host_sim::terminal;
use serde_json::json;
use spanwatch::identify::paper_ga;

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Search {
    /// The logger's: a small genetic search, then Gauss-Newton, with uncertainties
    Hybrid,
    /// The paper's genetic algorithm (population 50, up to 1000 generations)
    PaperGa,
}

#[derive(Debug, Args)]
pub(super) struct Arguments {
    /// A recording: a CSV with a TOML of the same stem beside it
    #[arg(value_name = "REC.csv")]
    recording: PathBuf,
    /// How to search
    #[arg(long, value_enum, default_value_t = Search::Hybrid)]
    method: Search,
    /// Seed of the search
    #[arg(long, default_value_t = replay::DEFAULT_SEED)]
    seed: u64,
    /// The bridge, where it is not the one that the recording names: a name or a bridge file NAME.toml
    #[arg(long)]
    bridge: Option<String>,
    /// One JSON object instead of sentences
    #[arg(long)]
    json: bool,
}

pub(super) fn run(arguments: &Arguments) -> Result<()> {
    let prepared = replay::prepare(&arguments.recording, arguments.bridge.as_deref(), arguments.seed)?;
    let observed = Observed::recorded(&prepared)?;
    let (method, length) = match arguments.method {
        Search::Hybrid => (Method::Hybrid, 0),
        Search::PaperGa => (Method::PaperGa, paper_ga::MAX_GENERATIONS),
    };
    let bar = terminal::progress(length.into(), "searching");
    let found = search(
        &observed.problem(),
        method,
        arguments.seed,
        paper_ga::LIMIT,
        &Known::default(),
        &mut |generation| bar.set_position(generation.into()),
    )?;
    bar.finish_and_clear();
    if arguments.json {
        return super::print_json(&as_json(&found, &prepared, observed.bridge.elements));
    }
    super::print(&in_words(&found, &observed))
}

fn as_json(found: &Found, prepared: &Prepared, elements: usize) -> serde_json::Value {
    let recording = &prepared.recording;
    let genes = found.code.genes();
    json!({
        "damage": &found.damage[..elements],
        "damage_std": found.std.as_ref().map(|std| &std[..elements]),
        "code": &genes[..elements],
        "speed_kmh": recording.speed_kmh,
        "entry_time_s": recording.entry_time_s,
        "load_factor": recording.load_factor.unwrap_or(1.0),
        "objective": found.objective,
        "forward_solves": found.forward_solves,
        "generations": found.generations,
        "converged": found.converged,
        "certain": super::certain_elements(found.certain),
        "explained": found.explained,
    })
}

fn in_words(found: &Found, observed: &Observed) -> String {
    let unexplained = words::percent(f64::from(found.objective / observed.problem().power().mean()));
    if found.explained == Some(false) {
        return format!(
            "No damage explains this passage: the best leaves {unexplained} of the signal's power unexplained. Check train, \
             speed, entry time, load, and the node, unit and sign of each channel.\n"
        );
    }
    let mut text = String::from("element  loss of bending stiffness\n");
    for e in 0..observed.bridge.elements {
        let _ = write!(text, "{:>7}  {:5.1} %", e + 1, 100.0 * found.damage[e]);
        match &found.std {
            Some(std) if std[e] < 0.0005 => text.push_str("  ± < 0.1 %"),
            Some(std) => {
                let _ = write!(text, "  ± {:5.1} %", 200.0 * std[e]);
            }
            None => {}
        }
        if found.certain >> e & 1 == 1 {
            text.push_str("  damaged beyond doubt");
        }
        text.push('\n');
    }
    if found.std.is_some() {
        text.push_str(
            "The ranges hold two standard deviations, of what the noise and the residual leave open; not of what the model does not know.\n",
        );
    }
    let end = if found.converged {
        "converged"
    } else {
        "NOT converged within its budget"
    };
    let _ = writeln!(
        text,
        "The model leaves {unexplained} of the signal's power unexplained (misfit {:.2e} (m/s²)²); {} forward solves, {} \
         generations, {end}.",
        found.objective, found.forward_solves, found.generations
    );
    text
}
