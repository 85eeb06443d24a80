//! `host-sim evaluate track`: what can be told of damage on a track that nobody has measured, and what is.

use std::fs;
use std::path::PathBuf;

use anyhow::{Context, Result, bail};
use clap::{Args, ValueEnum};
use host_sim::model::{self, reduce::reduce};
use host_sim::study::track::bound::design_knots;
use host_sim::study::track::campaign::{self, Plan};
use host_sim::study::track::design;
use host_sim::study::track::method::Logged;
use host_sim::study::track::table;
use host_sim::study::track::truth::{Change, SENSORS, Speeds, State, Traffic};
use host_sim::track::Spectrum;
use host_sim::{calibrate, terminal};
use serde_json::Value;
use spanwatch::capacity::ELEMENTS;

use super::evaluate::{SensorSet, check_wear};
use super::{print, print_json};

/// Seed of all searches.
const SEED: u64 = 1;
/// Fewest healthy passages.
const FEWEST: usize = 5;
/// Largest loss that is searched for.
const MOST_LOSS: f64 = 0.7;
/// Most of the stiffness that may vary from passage to passage: as much as a logger may be told of.
const MOST_TEMPERATURE: f32 = 0.3;

/// Largest change of a track, mm: more is another track.
const MOST_CHANGE_MM: f64 = 10.0;

#[derive(Debug, Args)]
pub(super) struct Track {
    /// What to find out
    #[arg(long, value_enum, default_value_t = Campaign::Bound)]
    campaign: Campaign,
    /// Classes of the track, 1 (worst) to 6 (best)
    #[arg(long, value_delimiter = ',', default_value = "6", value_name = "CLASSES")]
    class: Vec<u8>,
    /// Nodes with a sensor, of 3,6,9; give it again for another set; without it 3,6,9, and 6
    #[arg(long, value_name = "NODES")]
    sensors: Vec<SensorSet>,
    /// Speeds of the trains: by chance, or all the same
    #[arg(long, value_enum, default_value_t = Timetable::Both)]
    speeds: Timetable,
    /// Trains that pass (all campaigns but bound, which has six of sixteen cars, four inspection cars, and all ten)
    #[arg(long, value_enum, default_value_t = Trains::Shinkansen3d)]
    train: Trains,
    /// Viaducts of each row, each with a track of its own seed; without it 4 for bound, 10 for rmse, else 20
    #[arg(long, visible_alias = "seeds")]
    tracks: Option<u32>,
    /// Seed of the first of them (all campaigns but bound): a long campaign can be run in parts
    #[arg(long, default_value_t = 1)]
    first_seed: u32,
    /// Passages that are monitored at most; without it 6 for rmse, 100 for healthy, else 20
    #[arg(long)]
    passages: Option<usize>,
    /// Healthy passages that the track is learnt from
    #[arg(long, default_value_t = 60)]
    healthy: usize,
    /// All cars are as heavy as their model; without it each is off by 2 % rms, which nobody is told
    #[arg(long)]
    alike: bool,
    /// Standard deviation of the stiffness of the whole bridge from passage to passage, as a part of it
    #[arg(long, default_value_t = 0.0, value_name = "PART")]
    temperature: f32,
    /// rmse: part of its stiffness that every element has lost since the track was learnt
    #[arg(long, default_value_t = 0.0, value_name = "PART")]
    wear: f64,
    /// detect: elements that lose stiffness, one at a time; without it each of them
    #[arg(long, value_delimiter = ',', value_name = "ELEMENTS")]
    elements: Vec<usize>,
    /// detect: how much they lose
    #[arg(long, value_delimiter = ',', default_value = "0.05,0.1,0.2", value_name = "PARTS")]
    losses: Vec<f64>,
    /// change: RMS of it, mm
    #[arg(long, default_value_t = 1e3 * Change::HALF_A_MILLIMETRE.rms_m, value_name = "MM")]
    change_mm: f64,
    /// change: longest wave of it; without it the longest of the spectrum, which trains feel most
    #[arg(long, value_name = "M")]
    change_longest_m: Option<f64>,
    /// bound: the coarser knots of the design's bounds, in place of those that are learnt
    #[arg(long)]
    design_knots: bool,
    /// Keep learnt tracks in this folder, and take them from there: campaigns over the same viaducts learn them once
    #[arg(long, value_name = "DIR")]
    lessons: Option<PathBuf>,
    /// Print one JSON array in place of the table
    #[arg(long)]
    json: bool,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Campaign {
    /// The least that the standard deviation of the losses can be, by what is known of the track
    Bound,
    /// Errors of the losses from a few passages, after learning
    Rmse,
    /// False alarms on healthy bridges
    Healthy,
    /// Passages until a loss is found
    Detect,
    /// A change of the track: whether it is reported, or taken for damage
    Change,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Timetable {
    /// By chance, 205 to 270 km/h (inspection car: 60 to 120)
    Spread,
    /// All 240 km/h (inspection car: 90)
    Equal,
    /// Both, one after the other
    Both,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Trains {
    /// Sixteen 15-degree-of-freedom cars
    #[value(name = "shinkansen-3d", alias = "3d")]
    Shinkansen3d,
    /// One inspection car
    #[value(name = "inspection-2dof", alias = "2dof")]
    Inspection2Dof,
    /// Of ten trains six of sixteen cars and four inspection cars
    Both,
}

impl Track {
    fn classes(&self) -> Result<Vec<Spectrum>> {
        (self.class.iter())
            .map(|class| {
                Ok(match class {
                    1 => Spectrum::Fra1,
                    2 => Spectrum::Fra2,
                    3 => Spectrum::Fra3,
                    4 => Spectrum::Fra4,
                    5 => Spectrum::Fra5,
                    6 => Spectrum::Fra6,
                    _ => bail!("--class must be 1 to 6, not {class}"),
                })
            })
            .collect()
    }

    fn sensors(&self) -> Result<Vec<Vec<u16>>> {
        let sets: Vec<Vec<u16>> = match self.sensors.as_slice() {
            [] => vec![SENSORS.to_vec(), vec![6]],
            sets => sets.iter().map(|set| set.0.clone()).collect(),
        };
        if let Some(node) = sets.iter().flatten().find(|node| !SENSORS.contains(node)) {
            bail!("--sensors must be of the nodes 3, 6 and 9, not {node}: all sets see the same passages");
        }
        Ok(sets)
    }

    fn speeds(&self) -> Vec<Speeds> {
        match self.speeds {
            Timetable::Spread => vec![Speeds::Spread],
            Timetable::Equal => vec![Speeds::Equal],
            Timetable::Both => vec![Speeds::Spread, Speeds::Equal],
        }
    }

    fn plan(&self) -> Result<Plan> {
        if self.healthy < FEWEST {
            bail!(
                "--healthy must be at least {FEWEST}, not {}: a track is learnt from no fewer passages",
                self.healthy
            );
        }
        let (tracks, passages) = match self.campaign {
            Campaign::Bound => (4, 1),
            Campaign::Rmse => (10, 6),
            Campaign::Healthy => (20, 100),
            Campaign::Detect | Campaign::Change => (20, 20),
        };
        let plan = Plan {
            classes: self.classes()?,
            sensors: self.sensors()?,
            speeds: self.speeds(),
            traffic: match self.train {
                Trains::Shinkansen3d => Traffic::Sixteen,
                Trains::Inspection2Dof => Traffic::Inspection,
                Trains::Both => Traffic::Both,
            },
            uneven: !self.alike,
            temperature: self.temperature,
            change: Change {
                rms_m: 1e-3 * self.change_mm,
                longest_m: self.change_longest_m.unwrap_or(f64::INFINITY),
            },
            healthy: self.healthy,
            passages: self.passages.unwrap_or(passages),
            viaducts: self.tracks.unwrap_or(tracks),
            first_seed: self.first_seed.into(),
        };
        if plan.viaducts == 0 || plan.passages == 0 {
            bail!("--tracks and --passages must be at least 1");
        }
        Ok(plan)
    }

    /// The elements that are damaged, from 0.
    fn damaged(&self) -> Result<Vec<usize>> {
        if let Some(element) = self.elements.iter().find(|element| !(1..=ELEMENTS).contains(element)) {
            bail!("--elements must be 1 to {ELEMENTS}, not {element}");
        }
        if let Some(loss) = (self.losses.iter()).find(|loss| !(**loss > 0.0 && **loss <= MOST_LOSS)) {
            bail!("--losses must be above 0 and at most {MOST_LOSS}, not {loss}");
        }
        Ok(match self.elements.as_slice() {
            [] => (0..ELEMENTS).collect(),
            elements => elements.iter().map(|element| element - 1).collect(),
        })
    }
}

/// Evaluates and prints.
pub(super) fn run(arguments: &Track) -> Result<()> {
    check_wear(arguments.wear)?;
    if !(0.0..=MOST_TEMPERATURE).contains(&arguments.temperature) {
        bail!(
            "--temperature must be 0 to {MOST_TEMPERATURE}, not {}",
            arguments.temperature
        );
    }
    if !(arguments.change_mm > 0.0 && arguments.change_mm <= MOST_CHANGE_MM) {
        bail!(
            "--change-mm must be above 0 and at most {MOST_CHANGE_MM}, not {}",
            arguments.change_mm
        );
    }
    let plan = arguments.plan()?;
    let bridge = model::shipped("girder50")?;
    let reduced = reduce(&bridge)?;
    if arguments.campaign == Campaign::Bound {
        let length_m = reduced.path.length_m();
        let plan = design::Plan {
            knots: match arguments.design_knots {
                true => design_knots()?,
                false => calibrate::knots(length_m).context("a profile for this bridge")?,
            },
            classes: plan.classes,
            sensors: plan.sensors,
            speeds: plan.speeds,
            uneven: plan.uneven,
            temperature: plan.temperature,
            tracks: plan.viaducts,
        };
        let bar = terminal::progress(plan.passages(), "linearising");
        let rows = design::run(&bridge, &plan, &|| bar.inc(1));
        bar.finish_and_clear();
        let rows = rows?;
        return tell(arguments, || design::json(&rows), || design::table(&rows));
    }
    let elements = arguments.damaged()?;
    let times = match arguments.campaign {
        Campaign::Detect => elements.len() * arguments.losses.len(),
        _ => 1,
    };
    if let Some(folder) = &arguments.lessons {
        fs::create_dir_all(folder).with_context(|| format!("cannot make the folder {}", folder.display()))?;
    }
    let method = Logged::new(&reduced, SEED, arguments.lessons.clone())?;
    let bar = terminal::progress(plan.work(times), "learning and monitoring");
    let done = |passages: u64| bar.inc(passages);
    match arguments.campaign {
        Campaign::Bound => Ok(()),
        Campaign::Rmse => {
            let state = State {
                damage: [arguments.wear; ELEMENTS],
                ..State::HEALTHY
            };
            let rows = campaign::errors(&bridge, &plan, &state, &method, &done);
            bar.finish_and_clear();
            let rows = rows?;
            tell(arguments, || table::errors_json(&rows), || table::errors(&rows))
        }
        Campaign::Healthy => {
            let rows = campaign::healthy(&bridge, &plan, &method, &done);
            bar.finish_and_clear();
            let rows = rows?;
            tell(arguments, || table::healthy_json(&rows), || table::healthy(&rows))
        }
        Campaign::Change => {
            let rows = campaign::changes(&bridge, &plan, &method, &done);
            bar.finish_and_clear();
            let rows = rows?;
            tell(arguments, || table::healthy_json(&rows), || table::changes(&rows))
        }
        Campaign::Detect => {
            let rows = campaign::detection(&bridge, &plan, &elements, &arguments.losses, &method, &done);
            bar.finish_and_clear();
            let rows = rows?;
            tell(arguments, || table::detection_json(&rows), || table::detection(&rows))
        }
    }
}

fn tell(arguments: &Track, json: impl Fn() -> Value, table: impl Fn() -> String) -> Result<()> {
    if arguments.json {
        print_json(&json())
    } else {
        print(&table())
    }
}
