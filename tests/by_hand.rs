//! A learnt track made by hand, and passages over the true one, for the tests that need both without learning for an hour.

use std::path::Path;

use host_sim::model::{self, Structure};
use host_sim::recording::{Channel, Margins, Recording, Run, Unit};
use host_sim::simulate::{Scenario, simulate};
use host_sim::track::{Profile, Spectrum, Stretch, generate};
use host_sim::train::TrainName;
use nalgebra::SMatrix;
use spanwatch::capacity::CHANNELS;
use spanwatch::track::learnt::{LearntTrack, UNLEARNT, Unexplained};
use spanwatch::wire::message::TrainKind;

use crate::nearest_track;

/// Standard deviation of each element's loss that the reference leaves.
const SPREAD: f32 = 1e-3;
/// Noise of the passages, as a part of each channel's RMS; its square is what is left unexplained.
const NOISE: f64 = 0.05;
const UNEXPLAINED: f32 = 2.5e-3;

/// A straight track of FRA class 6.
pub fn class_6() -> Profile {
    let stretch = Stretch {
        vertical_only: true,
        ..Stretch::default()
    };
    generate(Spectrum::Fra6, 1, &stretch).expect("a track")
}

/// What learning `track` without an error would give, as it is sent: for trains at any speed.
pub fn learnt(track: &Profile) -> Vec<u8> {
    let learnt = LearntTrack {
        spread: SMatrix::identity() * SPREAD,
        unexplained: [Unexplained {
            floor: 0.0,
            part: UNEXPLAINED,
        }; CHANNELS],
        scatter: 0.02,
        passages: 60,
        speeds: [u64::MAX; 2],
        ..UNLEARNT.clone()
    };
    nearest_track::blob(track, learnt)
}

/// Records a passage of `cars` cars at `speed_kmh` over girder50 and its `track`. Speed, entry and load are announced as they are, but not held.
pub fn record(csv_path: &Path, track: &Profile, train: TrainKind, cars: usize, speed_kmh: f64, seed: u64) {
    let girder = model::shipped("girder50").expect("ships");
    let scenario = Scenario {
        train: TrainName::Known(train),
        cars: Some(cars),
        speed_kmh,
        track: Some(track.clone()),
        nodes: vec![3, 6, 9],
        noise: NOISE,
        seed,
        lead_s: 2.5,
        tail_s: 8.0,
        ..Scenario::inspection_car()
    }
    .recorded();
    let passage = simulate(&Structure::new(girder).expect("stands"), &scenario).expect("simulates");
    let rows = passage.channels[0].len();
    let channels = (scenario.nodes.iter().zip(passage.channels))
        .map(|(&node, values)| {
            let column = format!("acc_node{node}_mps2");
            Channel::new(column, Some(node), Unit::MetrePerSecondSquared, values)
        })
        .collect();
    let recording = Recording {
        start_s: 0.0,
        interval_s: passage.interval_s,
        runs: vec![Run {
            first_sample: 0,
            first_row: 0,
            rows,
        }],
        channels,
        bridge: Some("girder50".to_owned()),
        train: Some(scenario.train.clone()),
        cars: scenario.cars,
        speed_kmh: Some(speed_kmh),
        entry_time_s: Some(scenario.lead_s),
        load_factor: Some(scenario.load_factor),
        margins: Margins {
            speed: Some(0.02),
            entry_s: Some(0.1),
            load: Some(0.05),
            stiffness: None,
        },
        antialias_hz: scenario.antialias_hz,
        track: None,
        acceleration_mps2: 0.0,
        direction: scenario.direction,
    };
    recording.write(csv_path, &[]).expect("written");
}
