//! Promises of the first guess: where nobody gives speed and entry time, the true ones lie within the range that comes with the
//! guess, for both trains, 1 to 16 cars, 60 to 300 km/h, sensors anywhere, 2 to 10 % noise, a damaged or softer bridge, another
//! load. A logger that is told no entry time takes every passage for its train's.

use std::path::Path;

use host_sim::identification::Observed;
use host_sim::model::{self, Structure};
use host_sim::replay;
use host_sim::simulate::{Scenario, simulate};
use host_sim::train::TrainName;
use rayon::prelude::*;
use spanwatch::guess::{FirstGuess, Progress, Unknown};
use spanwatch::logger::Logger;
use spanwatch::passage::{Kept, Stream};
use spanwatch::wire::message::{
    Channel, Configuration, Event, Memory, Quantity, Reason, Traffic, TrainKind, Trigger, Verdict,
};

const LSB_MPS2: f32 = 2.338e-6;
const LEAD_S: f64 = 3.0;

/// Every seventh of the 496 passages is tried here, seven being no divisor of any list's length. Of all of them 3 lie outside.
const EVERY: usize = 7;
/// How many may lie outside: a bridge that element 5 has softened resonates at another speed than its model.
const OUTSIDE: usize = 1;

/// What is hidden from the guess besides the run: sensors' nodes, noise, damage, stiffness, load.
struct World {
    nodes: &'static [u16],
    noise: f64,
    damage: &'static [(usize, f64)],
    stiffness_factor: f64,
    load_factor: f64,
}

const WORLDS: [World; 5] = [
    World {
        nodes: &[6],
        noise: 0.02,
        damage: &[],
        stiffness_factor: 1.0,
        load_factor: 1.0,
    },
    World {
        nodes: &[3, 6, 9],
        noise: 0.05,
        damage: &[(1, 0.21), (5, 0.41)],
        stiffness_factor: 1.0,
        load_factor: 0.8,
    },
    World {
        nodes: &[3],
        noise: 0.1,
        damage: &[],
        stiffness_factor: 0.9,
        load_factor: 1.3,
    },
    World {
        nodes: &[9],
        noise: 0.1,
        damage: &[(8, 0.3)],
        stiffness_factor: 0.95,
        load_factor: 1.0,
    },
    World {
        nodes: &[3, 6, 9],
        noise: 0.05,
        damage: &[],
        stiffness_factor: 1.05,
        load_factor: 1.0,
    },
];

/// A guess beside the truth.
#[derive(Debug, Clone, Copy)]
struct Outcome {
    cars: usize,
    /// Guessed speed as a part of the true one, less one; and the range, as a part of the guess.
    speed: f64,
    speed_range: f64,
    entry_s: f64,
    entry_range_s: f64,
    /// Way over duration of the strong motion as a part of the true speed; the strong motion's beginning after the entry, s.
    plain_speed: f64,
    rise_s: f64,
    attempts: u32,
}

impl Outcome {
    /// Whether the truth lies within the range.
    fn inside(&self) -> bool {
        let truth = (1.0 + self.speed).recip() - 1.0;
        truth.abs() <= self.speed_range && self.entry_s.abs() <= self.entry_range_s
    }
}

fn outcome(bridge: &Structure, train: TrainKind, cars: usize, speed_kmh: f64, world: &World, seed: u64) -> Outcome {
    let scenario = Scenario {
        train: TrainName::Known(train),
        cars: Some(cars),
        speed_kmh,
        nodes: world.nodes.to_vec(),
        noise: world.noise,
        seed,
        damage: (1..=10)
            .map(|e| {
                world
                    .damage
                    .iter()
                    .find(|(of, _)| *of == e)
                    .map_or(0.0, |(_, loss)| *loss)
            })
            .collect(),
        stiffness_factor: world.stiffness_factor,
        load_factor: world.load_factor,
        lead_s: LEAD_S,
        tail_s: 12.0,
        ..Scenario::inspection_car()
    }
    .recorded();
    let passage = simulate(bridge, &scenario).expect("simulates");
    let channel = Channel {
        node: 6,
        quantity: Quantity::Acceleration,
        lsb: LSB_MPS2,
        full_scale_counts: i32::MAX,
    };
    let configuration = Configuration {
        sample_rate_hz: 200.0,
        channels: world.nodes.iter().map(|_| channel).collect(),
        trigger: Trigger::default(),
        antialias_hz: Some(40.0),
        traffic: None,
        memory: Memory::default(),
        seed: 1,
    };
    let mut stream = Box::new(Stream::new());
    stream.configure(&configuration);
    for sample in 0..passage.channels[0].len() {
        let counts: Vec<i32> = passage
            .channels
            .iter()
            .map(|c| (c[sample] / f64::from(LSB_MPS2)).round() as i32)
            .collect();
        stream.push(sample as u64, &counts).expect("whole rows");
    }
    stream.interrupt();
    let found = stream.next_passage().expect("a passage");
    assert_eq!(
        (found.kept, stream.next_passage()),
        (Kept::Whole, None),
        "{cars} cars at {speed_kmh} km/h"
    );

    // Train, sensors and recorder; the speed and entry in it are overwritten.
    let shortest = Scenario {
        speed_kmh: 900.0,
        lead_s: 0.0,
        tail_s: 0.0,
        ..scenario
    };
    let mut observed = Observed::simulated(&bridge.bridge, &shortest).expect("simulates");
    observed.observation.run.load_factor = 1.0;
    let (observation, samples) = (&mut observed.observation, stream.passage_samples());
    let unknown = Unknown {
        speed: true,
        entry: true,
    };
    let mut guess = FirstGuess::new(observation, samples, found.strong(), unknown);
    let mut attempts = 0;
    loop {
        match guess
            .advance(&observed.bridge, observation, samples)
            .expect("simulates")
        {
            Progress::More => attempts += 1,
            Progress::Found => break,
            Progress::NotThisTrain => panic!("{cars} cars at {speed_kmh} km/h: not this train"),
        }
    }
    let entry_s = LEAD_S - found.first_sample as f64 / 200.0;
    let way_m = f64::from(observed.bridge.path.length_m() + observation.cars.train().length_m());
    Outcome {
        cars,
        speed: 3.6 * f64::from(observation.run.speed_mps) / speed_kmh - 1.0,
        speed_range: observation.ranges.speed.into(),
        entry_s: f64::from(observation.run.entry_time_s) - entry_s,
        entry_range_s: observation.ranges.entry_s.into(),
        plain_speed: way_m / (found.strong().len() as f64 / 200.0) / (speed_kmh / 3.6),
        rise_s: found.strong().start as f64 / 200.0 - entry_s,
        attempts,
    }
}

/// Smallest, 5 %, median, 95 % and largest.
fn spread(values: impl Iterator<Item = f64>) -> [f64; 5] {
    let mut values: Vec<f64> = values.collect();
    values.sort_by(f64::total_cmp);
    let last = values.len() - 1;
    [0.0, 0.05, 0.5, 0.95, 1.0].map(|part| (1e3 * values[(part * last as f64).round() as usize]).round() / 1e3)
}

#[test]
fn the_truth_lies_within_the_range_of_the_guess() {
    let bridge = Structure::new(model::shipped("girder50").expect("shipped")).expect("stands");
    let mut cases = Vec::new();
    for train in [TrainKind::Inspection2Dof, TrainKind::Shinkansen3d] {
        for cars in [1, 2, 4, 8, 16] {
            for speed_kmh in [60.0, 80.0, 105.0, 120.0, 140.0, 160.0, 200.0, 252.0, 270.0, 300.0] {
                for world in &WORLDS {
                    // Sixteen cars with three sensors are too long for the logger's memory.
                    if cars < 16 || speed_kmh > 65.0 || world.nodes.len() == 1 {
                        cases.push((train, cars, speed_kmh, world));
                    }
                }
            }
        }
    }
    let cases: Vec<_> = cases.into_iter().step_by(EVERY).collect();
    let outcomes: Vec<_> = (cases.par_iter().enumerate())
        .map(|(seed, &(train, cars, speed_kmh, world))| outcome(&bridge, train, cars, speed_kmh, world, seed as u64))
        .collect();
    for cars in [1, 2, 4, 8, 16] {
        let of = || outcomes.iter().filter(|outcome| outcome.cars == cars);
        println!(
            "{cars} cars: speed {:?}, range {:?}",
            spread(of().map(|o| o.speed)),
            spread(of().map(|o| o.speed_range))
        );
        println!(
            "    way / duration {:?}, entry {:?} s",
            spread(of().map(|o| o.plain_speed)),
            spread(of().map(|o| o.entry_s))
        );
        println!(
            "    strong motion {:?} s after the entry",
            spread(of().map(|o| o.rise_s))
        );
        println!("    forward solves {:?}", spread(of().map(|o| f64::from(o.attempts))));
    }
    let outside: Vec<_> = (cases.iter().zip(&outcomes))
        .filter(|(_, outcome)| !outcome.inside())
        .collect();
    for ((train, cars, speed_kmh, world), outcome) in &outside {
        println!(
            "outside: {train:?}, {cars}, {speed_kmh} km/h, nodes {:?}, damage {:?} {}: {outcome:?}",
            world.nodes, world.damage, world.stiffness_factor
        );
    }
    println!("{} of {} outside", outside.len(), outcomes.len());
    assert!(outcomes.len() > 60 && outside.len() <= OUTSIDE);
}

#[test]
fn a_logger_without_an_entry_time_identifies_every_passage_and_with_one_only_that() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("recordings/case1-60kmh.csv");
    let prepared = replay::prepare(&path, None, 1).expect("a shipped recording");
    let counts = prepared.recording.to_counts();
    let verdicts = |rows: usize, change: fn(&mut Traffic)| -> Vec<Verdict> {
        let mut configuration = prepared.configuration.clone();
        change(configuration.traffic.as_mut().expect("a train"));
        let mut logger = Box::new(Logger::new());
        let model = model::to_blob(prepared.bridge.as_ref().expect("a bridge")).expect("room");
        logger.load(&model).expect("a model");
        logger.configure(configuration).expect("sound");
        for first_sample in [0, 100_000] {
            logger.push(first_sample, &counts[..rows]).expect("whole rows");
            logger.finish();
            while logger.poll() {}
        }
        let reports = std::iter::from_fn(|| logger.next_event()).filter_map(|event| match event {
            Event::Passage(report) => Some(report.verdict),
            Event::Alert(_) => None,
        });
        reports.collect()
    };
    let not_this = |verdict: &Verdict| *verdict == Verdict::NotIdentified(Reason::NotThisTrain);
    assert_eq!(
        verdicts(counts.len(), |_| ()).iter().map(not_this).collect::<Vec<_>>(),
        [false, true]
    );
    assert_eq!(
        verdicts(counts.len(), |train| train.entry_time_s = None)
            .iter()
            .map(not_this)
            .collect::<Vec<_>>(),
        [false, false]
    );
    let unknown = verdicts(counts.len(), |train| {
        (train.entry_time_s, train.speed_mps) = (None, None)
    });
    assert_eq!(unknown.iter().map(not_this).collect::<Vec<_>>(), [false, false]);
    // Sixteen cars do not pass in two and a half seconds.
    let too_long = verdicts(700, |train| {
        (train.entry_time_s, train.speed_mps, train.cars) = (None, None, 16)
    });
    assert!(not_this(&too_long[0]), "{too_long:?}");
}
