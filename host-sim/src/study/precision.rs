//! What single precision costs: the logger's simulation in `f32` against the same steps in `f64`.
//!
//! `f32` simulates from the bytes of the model that a logger gets, `f64` from the model before it was rounded to them. So the
//! difference holds all that single precision does: to the model, to the modes of the damaged bridge, to the cars, to
//! where the wheels are and to every step. Cases: two bridges, two trains, 1, 4 and 16 cars, three
//! speeds, a healthy and a damaged bridge; the recorder's low-pass at 40 Hz, 200 samples a second, steps of the default.
//!
//! Two things make the difference. Rounding at every step leaves about 1 µm/s² of noise, whatever the passage. And the way of
//! a step, `v h`, is rounded once, so that a train is up to 3e-8 of its way off, more the longer it is; at 270 km/h
//! `v h` is exact. A slow 3D car shakes girder50 by 10 mm/s² only, of which 1 µm/s² is 1e-4.

use std::fmt::Write as _;

use anyhow::{Context, Result};
use spanwatch::bridge::ReducedBridge;
use spanwatch::capacity::MODES;
use spanwatch::interaction::simulation::{Recorder, Sensor};
use spanwatch::interaction::{Observation, Run, Scheme, Simulation};
use spanwatch::math::Real;
use spanwatch::track::profile::Profile;
use spanwatch::train::PlanarTrain;
use spanwatch::wire::message::{Quantity, TrainKind};

use super::relative_rms;
use crate::model::{self, reduce::reduce};

/// What the difference must stay below, as a part of the signal.
pub const LIMIT: f64 = 1e-4;
/// A difference below this is small whatever the signal, m/s²: a three hundredth of a count of 16 bits over 2 g to either side.
pub const FLOOR_MPS2: f64 = 2e-6;
/// Samples a second, and the recorder's cut-off.
const RATE_HZ: f64 = 200.0;
const ANTIALIAS_HZ: f64 = 40.0;
/// The bridges, each with the nodes that are observed; the pier of twospan is node 6.
pub const BRIDGES: [(&str, [u16; 3]); 2] = [("girder50", [3, 6, 9]), ("twospan", [3, 5, 8])];
/// The trains.
pub const TRAINS: [(TrainKind, &str); 2] = [
    (TrainKind::Inspection2Dof, "inspection-2dof"),
    (TrainKind::Shinkansen3d, "shinkansen-3d"),
];
/// Their cars.
pub const CARS: [usize; 3] = [1, 4, 16];
/// Their speeds, km/h.
pub const SPEEDS_KMH: [f64; 3] = [60.0, 120.0, 270.0];
/// Damage of the damaged bridge: elements from 1, and what they lose (the paper's case 4).
const DAMAGED: [(usize, f64); 2] = [(1, 0.21), (5, 0.41)];
/// Time before the first wheelset enters and after the last has left, s.
const LEAD_S: f64 = 1.0;
const TAIL_S: f64 = 2.0;

/// The differences of one bridge, train and number of cars, at each of [`SPEEDS_KMH`], healthy and damaged.
#[derive(Debug, Clone, PartialEq)]
pub struct Row {
    /// The bridge.
    pub bridge: &'static str,
    /// The train.
    pub train: &'static str,
    /// Its cars.
    pub cars: usize,
    /// Healthy and damaged, at each speed.
    pub differences: [[Difference; 2]; SPEEDS_KMH.len()],
}

/// How far two signals differ.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Difference {
    /// RMS of the difference over that of the signal.
    pub relative: f64,
    /// RMS of the difference, m/s².
    pub rms_mps2: f64,
}

impl Difference {
    /// Whether it is below [`LIMIT`] or, where a passage hardly shakes the bridge, below [`FLOOR_MPS2`].
    pub fn is_small(&self) -> bool {
        self.relative < LIMIT || self.rms_mps2 < FLOOR_MPS2
    }
}

fn rms(channels: &[Vec<f64>]) -> f64 {
    let (count, squares) =
        (channels.iter().flatten()).fold((0.0, 0.0), |(count, squares), a| (count + 1.0, squares + a * a));
    (squares / count).sqrt()
}

/// All cases.
///
/// # Errors
/// If one cannot be solved.
pub fn rows() -> Result<Vec<Row>> {
    let mut rows = Vec::new();
    for (bridge, nodes) in BRIDGES {
        let wide = reduce(&model::shipped(bridge)?)?;
        let narrow = model::from_blob(&model::to_blob(&wide)?)?;
        let quantity = Quantity::Acceleration;
        let sensors: heapless::Vec<Sensor, 3> = (nodes.iter())
            .map(|node| wide.sensor_node.iter().position(|number| number == node))
            .map(|place| place.map(|place| Sensor { place, quantity }))
            .collect::<Option<_>>()
            .context("a sensor at each node")?;
        for (kind, train) in TRAINS {
            for cars in CARS {
                let mut differences = [[Difference::default(); 2]; SPEEDS_KMH.len()];
                for (difference, speed_kmh) in differences.iter_mut().zip(SPEEDS_KMH) {
                    for (difference, damaged) in difference.iter_mut().zip([false, true]) {
                        let case = Case {
                            kind,
                            cars,
                            speed_kmh,
                            damaged,
                        };
                        let exact = case.signal(&wide, &sensors)?;
                        let relative = relative_rms(&case.signal(&narrow, &sensors)?, &exact);
                        *difference = Difference {
                            relative,
                            rms_mps2: relative * rms(&exact),
                        };
                    }
                }
                rows.push(Row {
                    bridge,
                    train,
                    cars,
                    differences,
                });
            }
        }
    }
    Ok(rows)
}

struct Case {
    kind: TrainKind,
    cars: usize,
    speed_kmh: f64,
    damaged: bool,
}

impl Case {
    /// What the logger's simulation makes of the case, a list a channel.
    fn signal<T: Real>(&self, bridge: &ReducedBridge<T>, sensors: &heapless::Vec<Sensor, 3>) -> Result<Vec<Vec<f64>>> {
        let train = PlanarTrain::<T>::of_kind(self.kind, self.cars).context("a train of 1 to 16 cars")?;
        let speed_mps = self.speed_kmh / 3.6;
        let way_m: f64 = (bridge.path.length_m() + train.length_m()).into();
        let samples = ((LEAD_S + way_m / speed_mps + TAIL_S) * RATE_HZ) as usize;
        let run = Run {
            entry_time_s: T::of(LEAD_S),
            ..Run::at(T::of(speed_mps))
        };
        let recorder = Recorder::new(sensors.clone(), T::of(RATE_HZ), Some(T::of(ANTIALIAS_HZ)));
        let observed = Observation::new(train, run, recorder, Scheme::Exact)?;
        let mut hypothesis = observed.expected();
        for (element, loss) in DAMAGED.into_iter().filter(|_| self.damaged) {
            hypothesis.damage[element - 1] = T::of(loss);
        }
        let track = Profile::SMOOTH;
        let mut simulation = Simulation::<T, MODES>::new(bridge, &hypothesis, &observed, &track)?;
        let mut channels = vec![Vec::with_capacity(samples); sensors.len()];
        for _ in 0..samples {
            for (channel, value) in channels.iter_mut().zip(simulation.sample(&observed, &track)) {
                channel.push(value.into());
            }
        }
        Ok(channels)
    }
}

/// The table of the page.
pub fn table(rows: &[Row]) -> String {
    let mut text = String::from(
        "Difference of f32 and f64, healthy / damaged, in millionths of the signal; where that is more than 100, in brackets \
         its RMS in micrometres per second squared:\n\n| bridge | train | cars |",
    );
    for speed in SPEEDS_KMH {
        let _ = write!(text, " {speed} km/h |");
    }
    let _ = writeln!(text, "\n|---|---|---|{}", "---|".repeat(SPEEDS_KMH.len()));
    for row in rows {
        let _ = write!(text, "| {} | {} | {} |", row.bridge, row.train, row.cars);
        for pair in row.differences {
            let words = pair.map(|difference| {
                let millionths = 1e6 * difference.relative;
                if difference.relative < LIMIT {
                    format!("{millionths:.0}")
                } else {
                    format!("{millionths:.0} ({:.1})", 1e6 * difference.rms_mps2)
                }
            });
            let _ = write!(text, " {} |", words.join(" / "));
        }
        text.push('\n');
    }
    text
}
