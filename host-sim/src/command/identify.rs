//! `host-sim identify`: which elements have lost stiffness, by one recording.

use std::fmt::Write as _;
use std::path::PathBuf;

use anyhow::{Result, bail};
use clap::{Args, ValueEnum};
use host_sim::identification::{self, Found, Known, Method, Observed, search};
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

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Tail {
    /// Nothing: its samples are compared with the rest
    None,
    /// The natural frequencies
    Frequencies,
    /// The natural frequencies and the damping ratios
    FrequenciesAndDamping,
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
    /// What is compared of the free vibration after the train, in place of its samples
    #[arg(long, value_enum, default_value_t = Tail::None)]
    free_vibration: Tail,
    /// One JSON object instead of sentences
    #[arg(long)]
    json: bool,
}

pub(super) fn run(arguments: &Arguments) -> Result<()> {
    let prepared = replay::prepare(&arguments.recording, arguments.bridge.as_deref(), arguments.seed)?;
    if arguments.free_vibration != Tail::None && arguments.method != Search::Hybrid {
        bail!("--free-vibration goes with --method hybrid: the paper's search compares samples only");
    }
    let damping = arguments.free_vibration == Tail::FrequenciesAndDamping;
    let observed = match arguments.free_vibration {
        Tail::None => Observed::recorded(&prepared)?,
        _ => Observed::recorded_with_tail(&prepared, damping, arguments.seed)?,
    };
    if let Some(note) = &observed.note {
        eprintln!("note: {note}");
    }
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
        return super::print_json(&as_json(&found, &prepared, &observed));
    }
    super::print(&in_words(&found, &prepared, &observed))
}

/// When the train entered, in the recording's own time, s.
fn entry_s(found: &Found, prepared: &Prepared, observed: &Observed) -> f64 {
    let recording = &prepared.recording;
    recording.start_s + observed.first_sample as f64 * recording.interval_s + f64::from(found.run.entry_time_s)
}

/// What the recording gives and the search therefore holds.
struct Given {
    speed: Option<f64>,
    entry: Option<f64>,
    load: Option<f64>,
    stiffness: bool,
}

impl Given {
    fn of(prepared: &Prepared, observed: &Observed) -> Self {
        let recording = &prepared.recording;
        let ranges = &observed.observation.ranges;
        let held = |value: Option<f64>, range: f32| value.filter(|_| range == 0.0);
        Self {
            speed: held(recording.speed_kmh, ranges.speed),
            entry: held(recording.entry_time_s, ranges.entry_s),
            load: held(recording.load_factor.or(Some(1.0)), ranges.load),
            stiffness: ranges.stiffness == 0.0,
        }
    }

    /// The JSON's keys of what is estimated.
    fn estimated(&self) -> Vec<&'static str> {
        let all = [
            ("speed_kmh", self.speed.is_some()),
            ("entry_time_s", self.entry.is_some()),
            ("load_factor", self.load.is_some()),
            ("stiffness_factor", self.stiffness),
        ];
        all.into_iter()
            .filter_map(|(key, given)| (!given).then_some(key))
            .collect()
    }
}

/// How the train ran, and what of that was given.
fn run_in_words(found: &Found, prepared: &Prepared, observed: &Observed) -> String {
    let given = Given::of(prepared, observed);
    let word = |given: bool| if given { "given" } else { "estimated" };
    let mut text = format!(
        "Train: {:.2} km/h ({}), first axle enters at {:.3} s ({}), load {:.3} ({})",
        given.speed.unwrap_or(3.6 * f64::from(found.run.speed_mps)),
        word(given.speed.is_some()),
        given.entry.unwrap_or(entry_s(found, prepared, observed)),
        word(given.entry.is_some()),
        given.load.unwrap_or(found.run.load_factor.into()),
        word(given.load.is_some()),
    );
    if !given.stiffness {
        let _ = write!(
            text,
            "; whole bridge {:.3} of its model's stiffness (estimated)",
            found.stiffness_factor
        );
    }
    text + ".\n"
}

fn as_json(found: &Found, prepared: &Prepared, observed: &Observed) -> serde_json::Value {
    let elements = observed.bridge.elements;
    let given = Given::of(prepared, observed);
    let genes = found.code.genes();
    json!({
        "damage": &found.damage[..elements],
        "damage_std": found.std.as_ref().map(|std| &std[..elements]),
        "code": &genes[..elements],
        "speed_kmh": given.speed.unwrap_or(3.6 * f64::from(found.run.speed_mps)),
        "entry_time_s": given.entry.unwrap_or(entry_s(found, prepared, observed)),
        "load_factor": given.load.unwrap_or(found.run.load_factor.into()),
        "stiffness_factor": found.stiffness_factor,
        "estimated": given.estimated(),
        "objective": found.objective,
        "forward_solves": found.forward_solves,
        "generations": found.generations,
        "converged": found.converged,
        "certain": super::certain_elements(found.certain),
        "explained": found.explained,
        "free_vibration": observed.tail.as_ref().map(free_vibration_json),
    })
}

fn free_vibration_json(tail: &identification::Tail) -> serde_json::Value {
    let modes = tail.vibration.modes.iter().map(|mode| {
        json!({
            "mode": mode.mode + 1,
            "frequency_hz": mode.frequency_hz,
            "std_hz": mode.frequency_std_hz,
            "damping_ratio": mode.damping_ratio,
            "damping_ratio_std": mode.damping_ratio_std,
        })
    });
    modes.collect()
}

/// What was found of the bridge's own vibration after the train, a line a mode.
fn free_vibration_in_words(tail: &identification::Tail) -> String {
    let compared = match tail.damping {
        true => "natural frequencies and damping ratios",
        false => "natural frequencies",
    };
    let mut text = format!("Free vibration after the train, compared by its {compared} in place of its samples:\n");
    for mode in &tail.vibration.modes {
        let _ = writeln!(
            text,
            "   mode {}  fn {:.4} Hz ± {:.4},  xi {:.3} % ± {:.3}",
            mode.mode + 1,
            mode.frequency_hz,
            2.0 * mode.frequency_std_hz,
            100.0 * mode.damping_ratio,
            200.0 * mode.damping_ratio_std
        );
    }
    text
}

fn in_words(found: &Found, prepared: &Prepared, observed: &Observed) -> String {
    let unexplained = words::percent(f64::from(found.objective / observed.problem().power().mean()));
    if found.explained == Some(false) {
        return format!(
            "No damage explains this passage: the best leaves {unexplained} of the signal's power unexplained. Check train, \
             speed, entry time, load, and the node, unit and sign of each channel.\n{}",
            run_in_words(found, prepared, observed)
        );
    }
    let mut text = run_in_words(found, prepared, observed);
    if let Some(tail) = &observed.tail {
        text += &free_vibration_in_words(tail);
    }
    text += "element  loss of bending stiffness\n";
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
