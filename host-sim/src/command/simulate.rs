//! `host-sim simulate`: a passage made by the computer, written as a recording.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, anyhow, bail};
use clap::{Args, ValueEnum};
use host_sim::model::{self, BridgeFrame, Structure};
use host_sim::recording::{Channel, Margins, Recording, Run, Unit, description_path};
use host_sim::simulate::{Scenario, simulate_reporting};
use host_sim::train::TrainName;
use host_sim::{output, terminal, track};
use spanwatch::capacity::CARS;
use spanwatch::interaction::{Direction, Kinematics, Scheme};
use spanwatch::wire::message::Quantity;

/// Modes of a girder where nobody says how many.
const GIRDER_MODES: usize = 8;
/// Frequency up to which modes of a frame are taken where nobody says, Hz: twice the usual recorder's band.
const FRAME_MODES_HZ: f64 = 80.0;

#[derive(Debug, Args)]
pub(super) struct Arguments {
    /// A bridge that comes with the program, or a bridge file NAME.toml
    #[arg(long)]
    bridge: String,
    /// What rolls: inspection-2dof, shinkansen-3d, rdso-test, or a train file NAME.toml
    #[arg(long)]
    train: String,
    /// Number of cars, 1 to 16; a train file has its own
    #[arg(long, allow_negative_numbers = true)]
    cars: Option<i64>,
    /// Speed as the first axle enters
    #[arg(long, allow_negative_numbers = true)]
    speed_kmh: f64,
    /// Change of the speed; negative when the train brakes
    #[arg(long, default_value_t = 0.0, allow_negative_numbers = true)]
    acceleration_mps2: f64,
    /// The train enters by the bridge's last node and runs towards node 1
    #[arg(long)]
    backward: bool,
    /// An element, from 1, or a named group of elements, and the fraction of stiffness it has lost, 0 to 0.7; may be given
    /// several times
    #[arg(long, value_name = "ELEMENT=FRACTION", value_parser = damage)]
    damage: Vec<(String, f64)>,
    /// Irregularity of the track, a table that `host-sim track generate` writes [default: smooth]
    #[arg(long, value_name = "FILE.csv")]
    track: Option<PathBuf>,
    /// Bridge nodes (sensors of a frame) that are observed, 1 to 3 of them
    #[arg(long, value_delimiter = ',', default_value = "6")]
    nodes: Vec<u16>,
    /// What is observed: acceleration in m/s2 or displacement in mm, both positive up
    #[arg(long, value_enum, default_value_t = Observed::Acceleration)]
    quantity: Observed,
    /// Modes of the bridge [default: 8 of a girder; of a frame, whose lowest modes seldom bend under wheels, all up to 80 Hz]
    #[arg(long)]
    modes: Option<usize>,
    /// Instead of a number of modes: all up to this frequency
    #[arg(long, conflicts_with = "modes", allow_negative_numbers = true)]
    up_to_hz: Option<f64>,
    /// Step of the solver
    #[arg(long, default_value_t = 0.001, allow_negative_numbers = true)]
    step_s: f64,
    /// How time is stepped [default: average-acceleration, as the paper, for the raw solution, where it is off by 1 to 2 % at
    /// 1 ms; exact for a recorder's]
    #[arg(long, value_enum)]
    scheme: Option<TimeScheme>,
    /// How the rail's motion under a rolling wheel is taken
    #[arg(long, value_enum, default_value_t = WheelKinematics::Paper)]
    kinematics: WheelKinematics,
    /// Samples a second [default: one every step]
    #[arg(long, allow_negative_numbers = true)]
    rate_hz: Option<f64>,
    /// Cut-off of a low-pass (4th-order Butterworth, causal) before sampling [default: none]
    #[arg(long, allow_negative_numbers = true)]
    antialias_hz: Option<f64>,
    /// White noise, its standard deviation as a part of each channel's RMS
    #[arg(long, default_value_t = 0.0, allow_negative_numbers = true)]
    noise: f64,
    /// Seed of the noise
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Scales the static wheel loads
    #[arg(long, default_value_t = 1.0, allow_negative_numbers = true)]
    load_factor: f64,
    /// Stiffness of the whole bridge, as a part of its model's: a warm bridge is softer; damage counts from there
    #[arg(long, default_value_t = 1.0, allow_negative_numbers = true)]
    stiffness_factor: f64,
    /// What the recording's TOML shall not say, so that it is estimated: speed, entry, load; track, so that it is unknown
    #[arg(long, value_enum, value_delimiter = ',', value_name = "WHAT")]
    withhold: Vec<Withheld>,
    /// Time before the first axle enters
    #[arg(long, default_value_t = 1.0, allow_negative_numbers = true)]
    lead_s: f64,
    /// Time after the last axle has left
    #[arg(long, default_value_t = 2.0, allow_negative_numbers = true)]
    tail_s: f64,
    /// Where to write; a TOML of the same stem is written beside it
    #[arg(short, long, value_name = "OUT.csv")]
    output: PathBuf,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Withheld {
    Speed,
    Entry,
    Load,
    Track,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum Observed {
    Acceleration,
    Displacement,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum WheelKinematics {
    /// Without slope and curvature of the deflected rail
    Paper,
    /// With them
    Convective,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum TimeScheme {
    /// Newmark's average acceleration
    AverageAcceleration,
    /// Each mode's free vibration exact at any step
    Exact,
}

/// `ELEMENT=FRACTION`.
fn damage(text: &str) -> Result<(String, f64)> {
    let (element, loss) = text
        .rsplit_once('=')
        .context("it must be ELEMENT=FRACTION, as in 5=0.3")?;
    let loss: f64 = loss
        .trim()
        .parse()
        .map_err(|_| anyhow!("the fraction must be a number such as 0.3, not \"{loss}\""))?;
    Ok((element.trim().to_owned(), loss))
}

pub(super) fn run(arguments: &Arguments) -> Result<()> {
    let file = model::find(&arguments.bridge)?;
    let csv_path = arguments.output.as_path();
    let toml_path = description_path(csv_path)?;
    let inputs = [
        ("bridge", Some(Path::new(&arguments.bridge))),
        ("train", Some(Path::new(&arguments.train))),
        ("track", arguments.track.as_deref()),
    ];
    for (what, input) in inputs {
        if let Some(input) = input.filter(|input| same_file(&toml_path, input) || same_file(csv_path, input)) {
            bail!(
                "-o {} would overwrite the {what} file {}; choose another name",
                csv_path.display(),
                input.display()
            );
        }
    }
    let scenario = scenario(arguments, &file)?;
    output::check(csv_path)?;
    output::check(&toml_path)?;

    let bridge = Structure::new(file)?;
    let bar = terminal::progress(0, "solving the passage");
    let passage = simulate_reporting(&bridge, &scenario, &mut |done, total| {
        bar.set_length(total as u64);
        bar.set_position(done as u64);
    })?;
    bar.finish_and_clear();

    let rows = passage.channels[0].len();
    let (prefix, suffix, unit) = match scenario.quantity {
        Quantity::Acceleration => ("acc", "mps2", Unit::MetrePerSecondSquared),
        Quantity::Displacement => ("disp", "mm", Unit::Millimetre),
    };
    let channels = (scenario.nodes.iter().zip(passage.channels))
        .map(|(&node, values)| Channel::new(format!("{prefix}_node{node}_{suffix}"), Some(node), unit, values));
    let told = |what: Withheld, value: f64| (!arguments.withhold.contains(&what)).then_some(value);
    let recording = Recording {
        start_s: 0.0,
        interval_s: passage.interval_s,
        runs: vec![Run {
            first_sample: 0,
            first_row: 0,
            rows,
        }],
        channels: channels.collect(),
        bridge: Some(bridge.bridge.name.clone()),
        train: Some(scenario.train.clone()),
        cars: scenario.cars,
        speed_kmh: told(Withheld::Speed, scenario.speed_kmh),
        entry_time_s: told(Withheld::Entry, scenario.lead_s),
        load_factor: told(Withheld::Load, scenario.load_factor),
        margins: Margins::default(),
        antialias_hz: scenario.antialias_hz,
        track: (arguments.track.as_deref())
            .filter(|_| !arguments.withhold.contains(&Withheld::Track))
            .map(|track| beside(track, csv_path))
            .transpose()?,
        acceleration_mps2: scenario.acceleration_mps2,
        direction: scenario.direction,
    };
    let mut remarks = vec![
        format!("Made by: {}", command_line(arguments, &bridge.bridge.name, &scenario)),
        format!("True damage: {}.", damage_in_words(&arguments.damage)),
    ];
    if scenario.stiffness_factor != 1.0 {
        remarks.push(format!(
            "True stiffness of the whole bridge: {} of the model's.",
            scenario.stiffness_factor
        ));
    }
    recording.write(csv_path, &remarks)?;
    super::print(&format!(
        "wrote {} and {}: {rows} samples of {} channel{} at {} Hz, {:.2} s\n",
        csv_path.display(),
        toml_path.display(),
        recording.channels.len(),
        if recording.channels.len() == 1 { "" } else { "s" },
        rounded(recording.rate_hz()),
        rows as f64 * recording.interval_s
    ))
}

fn scenario(arguments: &Arguments, bridge: &BridgeFrame) -> Result<Scenario> {
    let groups = &bridge.frame.groups;
    let mut loss = vec![0.0; groups.len()];
    let mut named = vec![false; groups.len()];
    for (element, fraction) in &arguments.damage {
        let number = element.parse().ok().and_then(|number: usize| number.checked_sub(1));
        let by_name = groups.iter().position(|group| group == element);
        let Some(index) = by_name.or(number.filter(|&index| index < groups.len())) else {
            bail!(
                "--damage names element {element}, but the bridge has elements 1 to {}: {}",
                groups.len(),
                groups.join(", ")
            );
        };
        if named[index] {
            bail!("--damage names element {element} twice");
        }
        named[index] = true;
        loss[index] = *fraction;
    }
    let cars = match arguments.cars {
        Some(cars) => Some(usize::try_from(cars).map_err(|_| anyhow!("--cars must be 1 to {CARS}, not {cars}"))?),
        None => None,
    };
    Ok(Scenario {
        train: TrainName::parse(&arguments.train)?,
        cars,
        speed_kmh: arguments.speed_kmh,
        acceleration_mps2: arguments.acceleration_mps2,
        direction: if arguments.backward {
            Direction::Backward
        } else {
            Direction::Forward
        },
        track: arguments.track.as_deref().map(track::read).transpose()?,
        damage: loss,
        nodes: arguments.nodes.clone(),
        quantity: match arguments.quantity {
            Observed::Acceleration => Quantity::Acceleration,
            Observed::Displacement => Quantity::Displacement,
        },
        modes: arguments.modes.unwrap_or(GIRDER_MODES),
        up_to_hz: arguments
            .up_to_hz
            .or((arguments.modes.is_none() && !bridge.is_girder()).then_some(FRAME_MODES_HZ)),
        step_s: arguments.step_s,
        rate_hz: arguments.rate_hz,
        antialias_hz: arguments.antialias_hz,
        noise: arguments.noise,
        seed: arguments.seed,
        load_factor: arguments.load_factor,
        stiffness_factor: arguments.stiffness_factor,
        lead_s: arguments.lead_s,
        tail_s: arguments.tail_s,
        kinematics: match arguments.kinematics {
            WheelKinematics::Paper => Kinematics::Paper,
            WheelKinematics::Convective => Kinematics::Convective,
        },
        scheme: match arguments.scheme {
            Some(TimeScheme::AverageAcceleration) => Scheme::AverageAcceleration,
            Some(TimeScheme::Exact) => Scheme::Exact,
            // The paper's own for the raw solution, the better one for what a recorder would keep of it.
            None if arguments.rate_hz.is_none() && arguments.antialias_hz.is_none() => Scheme::AverageAcceleration,
            None => Scheme::Exact,
        },
    })
}

/// The command that makes the same recording again, without paths.
fn command_line(arguments: &Arguments, bridge: &str, scenario: &Scenario) -> String {
    let nodes: Vec<String> = scenario.nodes.iter().map(u16::to_string).collect();
    let mut line = format!("host-sim simulate --bridge {bridge} --train {}", scenario.train.name());
    if let Some(cars) = scenario.cars {
        let _ = write!(line, " --cars {cars}");
    }
    let _ = write!(line, " --speed-kmh {}", scenario.speed_kmh);
    if scenario.acceleration_mps2 != 0.0 {
        let _ = write!(line, " --acceleration-mps2 {}", scenario.acceleration_mps2);
    }
    if scenario.direction == Direction::Backward {
        line += " --backward";
    }
    if let Some(name) = arguments.track.as_deref().and_then(Path::file_name) {
        let _ = write!(line, " --track {}", name.display());
    }
    for (element, loss) in &arguments.damage {
        let _ = write!(line, " --damage {element}={loss}");
    }
    let quantity = match scenario.quantity {
        Quantity::Acceleration => "acceleration",
        Quantity::Displacement => "displacement",
    };
    let _ = write!(line, " --nodes {} --quantity {quantity}", nodes.join(","));
    if scenario.kinematics == Kinematics::Convective {
        line += " --kinematics convective";
    }
    match scenario.up_to_hz {
        Some(limit) => line += &format!(" --up-to-hz {limit}"),
        None => line += &format!(" --modes {}", scenario.modes),
    }
    let _ = write!(
        line,
        " --scheme {} --step-s {}",
        match scenario.scheme {
            Scheme::Exact => "exact",
            Scheme::AverageAcceleration | Scheme::FoxGoodwin => "average-acceleration",
        },
        scenario.step_s
    );
    for (flag, value) in [
        ("--rate-hz", scenario.rate_hz),
        ("--antialias-hz", scenario.antialias_hz),
        ("--noise", (scenario.noise > 0.0).then_some(scenario.noise)),
    ] {
        if let Some(value) = value {
            let _ = write!(line, " {flag} {value}");
        }
    }
    if scenario.noise > 0.0 {
        let _ = write!(line, " --seed {}", scenario.seed);
    }
    if scenario.stiffness_factor != 1.0 {
        let _ = write!(line, " --stiffness-factor {}", scenario.stiffness_factor);
    }
    if !arguments.withhold.is_empty() {
        let what = [
            (Withheld::Speed, "speed"),
            (Withheld::Entry, "entry"),
            (Withheld::Load, "load"),
        ];
        let withheld: Vec<&str> = (what.iter())
            .filter(|(what, _)| arguments.withhold.contains(what))
            .map(|(_, name)| *name)
            .collect();
        let _ = write!(line, " --withhold {}", withheld.join(","));
    }
    let _ = write!(
        line,
        " --load-factor {} --lead-s {} --tail-s {}",
        scenario.load_factor, scenario.lead_s, scenario.tail_s
    );
    line
}

fn damage_in_words(damage: &[(String, f64)]) -> String {
    let damaged: Vec<String> = (damage.iter().filter(|(_, loss)| *loss > 0.0))
        .map(|(element, loss)| match element.parse::<usize>() {
            Ok(number) => format!("element {number} {} %", rounded(100.0 * loss)),
            Err(_) => format!("{element} {} %", rounded(100.0 * loss)),
        })
        .collect();
    if damaged.is_empty() {
        "none".to_owned()
    } else {
        damaged.join(", ")
    }
}

/// A number for the eye, without the dust of binary fractions.
fn rounded(value: f64) -> f64 {
    (value * 1e6).round() / 1e6
}

/// A file as one beside `other` names it: by its name alone, if both are in one folder.
fn beside(file: &Path, other: &Path) -> Result<String> {
    let full = file
        .canonicalize()
        .with_context(|| format!("cannot find {}", file.display()))?;
    let folder = other
        .parent()
        .filter(|folder| !folder.as_os_str().is_empty())
        .unwrap_or(Path::new("."));
    let name = match (folder.canonicalize(), full.file_name()) {
        (Ok(folder), Some(name)) if full.parent() == Some(&folder) => Path::new(name),
        _ => full.as_path(),
    };
    Ok(name.display().to_string())
}

fn same_file(a: &Path, b: &Path) -> bool {
    matches!((a.canonicalize(), b.canonicalize()), (Ok(a), Ok(b)) if a == b)
}
