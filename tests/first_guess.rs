//! Promises of the first guess: where nobody gives speed and entry time, the true ones lie within the range that comes with the
//! guess, for both trains, 1 to 16 cars, 60 to 300 km/h, sensors anywhere, 2 to 10 % noise, a damaged or softer bridge, another
//! load. With that guess the search finds the run and the damage, or says that it does not explain the passage. A logger that is told no entry time takes every passage for its train's.

use std::path::Path;

use host_sim::identification::Observed;
use host_sim::model::Structure;
use host_sim::replay;
use host_sim::simulate::{Scenario, simulate};
use host_sim::train::TrainName;
use rayon::prelude::*;
use spanwatch::bridge::blob;
use spanwatch::capacity::MODEL_BLOB_BYTES;
use spanwatch::guess::{FirstGuess, Progress, Unknown};
use spanwatch::identify::{Identification, Pass, Problem};
use spanwatch::logger::Logger;
use spanwatch::passage::{Kept, Stream};
use spanwatch::wire::message::{
    Channel, Configuration, Event, Memory, Quantity, Reason, Traffic, TrainKind, Trigger, Verdict,
};

const LSB_MPS2: f32 = 2.338e-6;
const LEAD_S: f64 = 3.0;

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
    /// Solver steps.
    steps: u64,
}

impl Outcome {
    /// How far off the guess is, as a part of the range: 1 at its border.
    fn off(&self) -> f64 {
        let speed = ((1.0 + self.speed).recip() - 1.0).abs() / self.speed_range;
        speed.max(self.entry_s.abs() / self.entry_range_s)
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
    let mut first_guess = FirstGuess::new(observation, samples, found.strong(), unknown);
    let mut pass = Box::new(Pass::new());
    let guess = loop {
        let problem = Problem {
            bridge: &observed.bridge,
            track: &observed.track,
            observation,
            samples,
            free_vibration: None,
        };
        match first_guess.advance(&problem, &mut pass).expect("simulates") {
            Progress::More => {}
            Progress::Found(guess) => break guess,
            Progress::NotThisTrain => panic!("{cars} cars at {speed_kmh} km/h: not this train"),
        }
    };
    let solve = samples.len() / world.nodes.len() * observation.recorder.steps_per_sample as usize;
    guess.tell(observation);
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
        attempts: (first_guess.solver_steps() / solve as u64) as u32,
        steps: first_guess.solver_steps(),
    }
}

/// Smallest, 5 %, median, 95 % and largest.
fn spread(values: impl Iterator<Item = f64>) -> [f64; 5] {
    let mut values: Vec<f64> = values.collect();
    values.sort_by(f64::total_cmp);
    let last = values.len() - 1;
    [0.0, 0.05, 0.5, 0.95, 1.0].map(|part| (1e3 * values[(part * last as f64).round() as usize]).round() / 1e3)
}

/// One passage to be tried.
type Case = (TrainKind, usize, f64, &'static World);

/// All passages that the promise speaks of.
fn cases() -> Vec<Case> {
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
    cases
}

/// The guesses of some of the passages.
fn outcomes(numbers: &[usize]) -> Vec<Outcome> {
    let bridge = Structure::new(host_sim::model::shipped("girder50").expect("shipped")).expect("stands");
    let cases = cases();
    (numbers.par_iter())
        .map(|&number| {
            let (train, cars, speed_kmh, world) = cases[number];
            outcome(&bridge, train, cars, speed_kmh, world, number as u64)
        })
        .collect()
}

#[test]
fn the_truth_lies_within_the_range_of_the_guess() {
    // Of all passages those whose guess is farthest off, as a part of its range. The first three lie outside: element 5 has softened a
    // bridge that resonates at another speed than its model then.
    const HARDEST: [usize; 7] = [76, 324, 289, 36, 284, 48, 212];
    const OUTSIDE: usize = 3;
    // And some as they come; 83 is no divisor of any list's length.
    const EVERY: usize = 83;
    let others = (0..cases().len()).step_by(EVERY);
    let numbers: Vec<usize> = HARDEST.into_iter().chain(others).collect();
    let outcomes = outcomes(&numbers);
    let outside: Vec<usize> = (numbers.iter().zip(&outcomes))
        .filter(|(_, outcome)| outcome.off() > 1.0)
        .map(|(&number, _)| number)
        .collect();
    println!("{outside:?} of {numbers:?}");
    assert!(
        outside.iter().all(|number| HARDEST[..OUTSIDE].contains(number)),
        "{outside:?}"
    );
}

#[test]
#[ignore = "all 496 passages take minutes"]
fn of_all_passages_three_lie_outside_the_range_of_the_guess() {
    const OUTSIDE: usize = 3;
    let cases = cases();
    let numbers: Vec<usize> = (0..cases.len()).collect();
    let outcomes = outcomes(&numbers);
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
        println!("    million steps {:?}", spread(of().map(|o| o.steps as f64 / 1e6)));
    }
    let mut worst: Vec<usize> = numbers;
    worst.sort_by(|&a, &b| outcomes[b].off().total_cmp(&outcomes[a].off()));
    for &number in &worst[..24] {
        let (train, cars, speed_kmh, world) = cases[number];
        println!(
            "{number}: {:.2} of the range, {train:?}, {cars}, {speed_kmh} km/h, nodes {:?}, damage {:?} {}: {:?}",
            outcomes[number].off(),
            world.nodes,
            world.damage,
            world.stiffness_factor,
            outcomes[number]
        );
    }
    let outside = outcomes.iter().filter(|outcome| outcome.off() > 1.0).count();
    println!("{outside} of {} outside", outcomes.len());
    assert!(outcomes.len() == 496 && outside <= OUTSIDE);
}

/// Train, cars, speed in km/h, sensors' nodes, damage, and whether the search finds it.
type Passage = (TrainKind, usize, f64, &'static [u16], &'static [(usize, f64)], bool);

/// A passage of which the recording tells nothing but train and cars, and what the search finds in it.
fn identified(bridge: &Structure, scenario: &Scenario) -> (Observed, Identification) {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("passage.csv");
    let passage = simulate(bridge, scenario).expect("simulates");
    let mut csv = String::from("time_s");
    let mut toml = format!(
        "bridge = \"girder50\"\ntrain = \"{}\"\ncars = {}\nantialias_hz = 40.0\n",
        scenario.train.name(),
        scenario.cars.unwrap_or(1)
    );
    for node in &scenario.nodes {
        csv += &format!(",node{node}");
        toml += &format!("[[channel]]\ncolumn = \"node{node}\"\nnode = {node}\nunit = \"m/s2\"\n");
    }
    for row in 0..passage.channels[0].len() {
        csv += &format!("\n{:.3}", row as f64 * passage.interval_s);
        for channel in &passage.channels {
            csv += &format!(",{:.8e}", channel[row]);
        }
    }
    std::fs::write(&path, csv + "\n").expect("written");
    std::fs::write(path.with_extension("toml"), toml).expect("written");
    let prepared = replay::prepare(&path, None, 1).expect("a recording");
    let observed = Observed::recorded(&prepared).expect("a passage");
    let found = observed.identify(1).expect("simulates");
    (observed, found)
}

#[test]
fn with_nothing_told_but_the_train_the_search_ends_at_the_truth_or_says_that_it_has_not() {
    // Deviations by which speed, entry, load and damage may be off: one value in a million exceeds them by chance.
    const OFF: f64 = 5.0;
    let bridge = Structure::new(host_sim::model::shipped("girder50").expect("shipped")).expect("stands");
    let (car, shinkansen) = (TrainKind::Inspection2Dof, TrainKind::Shinkansen3d);
    // Such as the first two ended a period of the first mode beside the true entry, or at another speed, as long as the bridge was
    // taken for whole until the train was settled. In the last the first guess of the speed is off by more than its range.
    let passages: [Passage; 3] = [
        (shinkansen, 2, 274.6, &[3, 6, 9], &[(6, 0.25)], true),
        (car, 1, 229.5, &[6], &[(3, 0.35), (8, 0.26)], true),
        (shinkansen, 4, 107.5, &[6], &[(3, 0.34)], false),
    ];
    passages
        .par_iter()
        .enumerate()
        .for_each(|(i, &(train, cars, speed_kmh, nodes, damaged, right))| {
            let mut damage = vec![0.0; 10];
            for &(element, loss) in damaged {
                damage[element - 1] = loss;
            }
            let scenario = Scenario {
                train: TrainName::Known(train),
                cars: Some(cars),
                speed_kmh,
                nodes: nodes.to_vec(),
                noise: 0.035,
                seed: i as u64,
                damage,
                load_factor: 0.9,
                lead_s: LEAD_S + 0.003,
                tail_s: 12.0,
                ..Scenario::inspection_car()
            }
            .recorded();
            let (observed, found) = identified(&bridge, &scenario);
            let entry_s = scenario.lead_s - observed.first_sample as f64 / 200.0;
            let run = found.run;
            let mut off = vec![
                (3.6 * f64::from(run.speed_mps) / speed_kmh - 1.0) / f64::from(found.std[1]),
                (f64::from(run.entry_time_s) - entry_s) / f64::from(found.std[2]),
                (f64::from(run.load_factor) / scenario.load_factor - 1.0) / f64::from(found.std[3]),
            ];
            let estimate = &found.estimate;
            off.extend(
                (estimate.damage.iter().zip(&scenario.damage).zip(&estimate.std))
                    .map(|((&found, truth), &std)| (f64::from(found) - truth) / f64::from(std)),
            );
            println!(
                "{train:?}, {cars} cars, {speed_kmh} km/h: off by {off:.1?} deviations, {} solves",
                found.forward_solves
            );
            assert_eq!(
                found.explained(),
                right,
                "{train:?}, {cars} cars, {speed_kmh} km/h: {found:?}"
            );
            if right {
                assert!(
                    off.iter().all(|off| off.abs() < OFF),
                    "{train:?}, {cars} cars, {speed_kmh} km/h: {off:.1?}"
                );
            } else {
                assert_eq!(found.certain(), 0, "what is not explained is not damage");
            }
        });
}

#[test]
fn a_logger_without_an_entry_time_identifies_every_passage_and_with_one_only_that() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("recordings/case1-60kmh.csv");
    let prepared = replay::prepare(&path, None, 1).expect("a shipped recording");
    let counts = prepared.recording.to_counts();
    let mut buffer = [0; MODEL_BLOB_BYTES];
    let bridge = prepared.bridge.as_ref().expect("a bridge").cast();
    let model: &[u8] = blob::write(&bridge, &mut buffer).expect("fits");
    let verdicts = |rows: usize, change: fn(&mut Traffic)| -> Vec<Verdict> {
        let mut configuration = prepared.configuration.clone();
        change(configuration.traffic.as_mut().expect("a train"));
        let mut logger = Box::new(Logger::new());
        logger.load(model).expect("a model");
        logger.configure(configuration).expect("sound");
        for first_sample in [0, 100_000] {
            logger.push(first_sample, &counts[..rows]).expect("whole rows");
            logger.finish();
            while logger.poll() {}
        }
        let reports = std::iter::from_fn(|| logger.next_event()).filter_map(|event| match event {
            Event::Passage(report) => Some(report.verdict),
            Event::Alert(_) | Event::Track(_) => None,
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
