//! `host-sim identify`: which elements have lost stiffness, by one recording, and how surely.

use std::fmt::Write as _;
use std::path::PathBuf;

use anyhow::{Result, bail};
use clap::{Args, ValueEnum};
use host_sim::identification::{self, Found, Known, Method, Observed, search};
use host_sim::replay::{self, Prepared};
use host_sim::station::words::identification::{self as words, How, Number, Ran};
use host_sim::station::words::why;
use host_sim::{calibrate, output, picture, terminal};
use serde_json::{Value, json};
use spanwatch::identify::estimate::CONTRADICTION;
use spanwatch::identify::{Identification, paper_ga};
use spanwatch::track::learnt::LearntTrack;
use spanwatch::track::watch::{Finding, Watch};
use spanwatch::wire::message::{Reason, TrainKind};

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
    /// A track that was learnt (host-sim calibrate)
    #[arg(long, value_name = "FILE.blob")]
    track: Option<PathBuf>,
    /// What is compared of the free vibration after the train, in place of its samples
    #[arg(long, value_enum, default_value_t = Tail::None)]
    free_vibration: Tail,
    /// One JSON object instead of sentences
    #[arg(long)]
    json: bool,
    /// Draw the passage, measured and fitted, and the damage by element into this file, too
    #[arg(long, value_name = "FILE.svg")]
    svg: Option<PathBuf>,
}

pub(super) fn run(arguments: &Arguments) -> Result<()> {
    let mut prepared = replay::prepare(&arguments.recording, arguments.bridge.as_deref(), arguments.seed)?;
    match arguments.track {
        Some(_) => prepared.loosen(),
        None => prepared.refuse_irregular()?,
    }
    if arguments.free_vibration != Tail::None && arguments.method != Search::Hybrid {
        bail!("--free-vibration goes with --method hybrid: the paper's search compares samples only");
    }
    let damping = arguments.free_vibration == Tail::FrequenciesAndDamping;
    let observed = match arguments.free_vibration {
        Tail::None => Observed::recorded(&prepared)?,
        _ => Observed::recorded_with_tail(&prepared, damping, arguments.seed)?,
    };
    let observed = match (&arguments.track, &prepared.bridge) {
        (Some(path), Some(bridge)) => observed.with_track(&calibrate::read(path, bridge)?),
        _ => observed,
    };
    if let Some(path) = &arguments.svg {
        output::check(path)?;
    }
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
    if let Some(path) = &arguments.svg {
        let stem = arguments.recording.file_stem().unwrap_or_default().to_string_lossy();
        let subtitle = format!(
            "{}, {} over {}",
            cars(&prepared),
            kmh(&ran(&found, &prepared, &observed)),
            prepared.recording.bridge.as_deref().unwrap_or("the bridge")
        );
        picture::passage(path, &stem, &subtitle, &prepared, &observed, &found, None)?;
    }
    let ran = ran(&found, &prepared, &observed);
    let elements = observed.bridge.elements;
    let strange = (found
        .identification
        .as_ref()
        .zip(prepared.configuration.traffic.as_ref()))
    .and_then(|(found, traffic)| strange(found, &observed.track, traffic.train));
    if arguments.json {
        return super::print_json(&as_json(&found, observed.tail.as_ref(), elements, &ran, strange));
    }
    super::print(&match &found.identification {
        Some(identification) => in_words(identification, observed.tail.as_ref(), elements, &ran, strange),
        None => code_in_words(&found, elements, &ran),
    })
}

/// Why a logger would not believe a passage that is explained: it is not like those that the track was learnt from.
fn strange(found: &Identification, track: &LearntTrack, train: TrainKind) -> Option<Reason> {
    if !found.explained() || found.estimate.contradiction > CONTRADICTION {
        return None;
    }
    if track.is_learnt() && !track.knows(train, &found.run) {
        return Some(Reason::Uncalibrated);
    }
    // By itself: what passages say together only their logger knows.
    let mut watch = Watch::NEW;
    let finding = watch.judge(track, 0, Some(track.misfit(&found.mean_squares)));
    (finding != Finding::Same).then_some(Reason::AnotherTrack)
}

fn cars(prepared: &Prepared) -> String {
    let train = prepared.recording.train.as_ref().map_or("", |train| train.name());
    match prepared.recording.cars {
        Some(1) | None => format!("1 car {train}"),
        Some(cars) => format!("{cars} cars {train}"),
    }
}

fn kmh(ran: &Ran) -> String {
    format!("{:.1} km/h", ran.speed_kmh.value)
}

/// How the train ran, in the recording's units and time. What it gives and the search held comes back as it was given.
fn ran(found: &Found, prepared: &Prepared, observed: &Observed) -> Ran {
    let recording = &prepared.recording;
    let observation = &observed.observation;
    let ranges = &observation.ranges;
    let hypothesis = found.hypothesis(observation);
    let run = &hypothesis.run;
    let first_s = recording.start_s + observed.first_sample as f64 * recording.interval_s;
    // In the units of the unknowns: parts of what was expected, seconds.
    let std = found.identification.map(|found| found.std.map(f64::from));
    let known = |given: Option<f64>, range: f32, value: f64, std: Option<f64>| match (given, std) {
        (Some(value), _) if range == 0.0 => Number { value, how: How::Given },
        (_, Some(std)) if range > 0.0 => Number {
            value,
            how: How::Estimated { std },
        },
        _ => Number {
            value,
            how: How::Guessed,
        },
    };
    let part_of = |whole: f32, which: usize| std.map(|std| f64::from(whole) * std[which]);
    let expected = &observation.run;
    let weighed = hypothesis.cars.iter().take(observed.problem().weighable());
    Ran {
        speed_kmh: known(
            recording.speed_kmh,
            ranges.speed,
            3.6 * f64::from(run.speed_mps),
            part_of(3.6 * expected.speed_mps, 1),
        ),
        entry_s: known(
            recording.entry_time_s,
            ranges.entry_s,
            first_s + f64::from(run.entry_time_s),
            part_of(1.0, 2),
        ),
        load: known(
            recording.load_factor,
            ranges.load,
            run.load_factor.into(),
            part_of(expected.load_factor, 3),
        ),
        stiffness: known(
            Some(1.0),
            ranges.stiffness,
            hypothesis.stiffness.into(),
            part_of(1.0, 0),
        ),
        cars: weighed.map(|car| run.load_factor * car).collect(),
    }
}

/// Standard deviation of a number of the run; 0 if it was held.
fn std(number: &Number) -> f64 {
    match number.how {
        How::Estimated { std } => std,
        How::Given | How::Guessed => 0.0,
    }
}

fn as_json(
    found: &Found,
    tail: Option<&identification::Tail>,
    elements: usize,
    ran: &Ran,
    strange: Option<Reason>,
) -> Value {
    let numbers = [
        ("speed_kmh", &ran.speed_kmh),
        ("entry_time_s", &ran.entry_s),
        ("load_factor", &ran.load),
        ("stiffness_factor", &ran.stiffness),
    ];
    let estimated: Vec<&str> = (numbers.iter())
        .filter_map(|(key, number)| (number.how != How::Given).then_some(*key))
        .collect();
    // What a genetic search does not tell is null.
    let sure = found.identification.as_ref();
    let each = |of: fn(&Identification) -> &[f32]| sure.map(|found| &of(found)[..elements]);
    let std = |number: &Number| sure.map(|_| std(number));
    json!({
        "damage": &found.damage()[..elements],
        "damage_std": each(|found| &found.estimate.std),
        "damage_low": each(|found| &found.estimate.low),
        "damage_high": each(|found| &found.estimate.high),
        "significance": each(|found| &found.estimate.significance),
        "code": &found.code.genes()[..elements],
        "certain": sure.map(|found| words::numbers(found.certain())),
        "inseparable": sure.map(|found| inseparable(found, elements)),
        "rival": sure.and_then(|found| found.rival).map(|rival| json!({
            "whole_element": rival.whole + 1,
            "damage": &rival.damage[..elements],
            "loses_by": rival.loses_by,
        })),
        "speed_kmh": ran.speed_kmh.value,
        "speed_std_kmh": std(&ran.speed_kmh),
        "entry_time_s": ran.entry_s.value,
        "entry_std_s": std(&ran.entry_s),
        "load_factor": ran.load.value,
        "load_std": std(&ran.load),
        "stiffness_factor": ran.stiffness.value,
        "stiffness_std": std(&ran.stiffness),
        "car_loads": &ran.cars,
        "estimated": estimated,
        "objective": found.objective,
        "unexplained": sure.map(|found| found.unexplained),
        "explained": sure.map(Identification::explained),
        "forward_solves": found.forward_solves,
        "generations": found.generations,
        "converged": found.converged,
        "free_vibration": tail.map(free_vibration_json),
        "stop": sure.map(|found| words::stop(found.stop)),
        "contradiction": sure.map(|found| found.estimate.contradiction),
        "kind": sure.map(|found| strange.map_or_else(|| words::kind(found, elements), |_| "strange")),
        "verdict": sure.map(|found| strange.map_or_else(|| words::verdict(found, elements), unbelieved)),
    })
}

/// Of each element with a loss, by its number, the elements that it cannot be told apart from.
fn inseparable(found: &Identification, elements: usize) -> Value {
    (0..elements)
        .map(|e| (e, words::inseparable(found, elements, e)))
        .filter(|&(_, others)| others != 0)
        .map(|(e, others)| ((e + 1).to_string(), json!(words::numbers(others))))
        .collect()
}

fn unbelieved(reason: Reason) -> String {
    format!("Nothing is identified: {}.", why(&reason))
}

fn in_words(
    found: &Identification,
    tail: Option<&identification::Tail>,
    elements: usize,
    ran: &Ran,
    strange: Option<Reason>,
) -> String {
    let verdict = match strange {
        Some(reason) => unbelieved(reason) + " What the search found all the same:",
        None => words::verdict(found, elements),
    };
    let mut text = verdict + "\n\n" + &words::ran(ran);
    if let Some(tail) = tail {
        text += &free_vibration_in_words(tail);
    }
    if found.explained() {
        text += "\n";
        text += &words::table(found, elements);
        text += "\n";
    }
    text + &words::search(found)
}

/// What a genetic search alone found.
fn code_in_words(found: &Found, elements: usize, ran: &Ran) -> String {
    let mut text = words::ran(ran) + "element  loss of bending stiffness, in steps of 10 %\n";
    for (e, loss) in found.damage().iter().take(elements).enumerate() {
        let _ = writeln!(text, "{:>7}  {:3.0} %", e + 1, 100.0 * loss);
    }
    let end = if found.converged {
        "the misfit fell below its limit"
    } else {
        "the misfit did NOT fall below its limit"
    };
    let _ = writeln!(
        text,
        "A genetic search alone does not say how surely. Misfit {:.2e} (m/s²)²; {} forward solves, {} generations: {end}.",
        found.objective, found.forward_solves, found.generations
    );
    text
}

fn free_vibration_json(tail: &identification::Tail) -> Value {
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
