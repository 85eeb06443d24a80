//! The truss rdso45m under its test train: deflection and acceleration of the joints L4, its first frequencies.
//!
//! Axles are constant forces, the track is smooth, damping is declared: 0.015 at the first two modes. Time 0 is that at
//! which the first axle is over the joints L0; the path of the wheels begins [`APPROACH_M`] before.

use std::fmt::Write as _;

use anyhow::{Context, Result};
use spanwatch::interaction::{Run, Scheme};

use super::{LEAST_PART, largest, low_passed, thinned};
use crate::crossing::Crossing;
use crate::model::eigen::{Wanted, frequency_hz, natural_modes};
use crate::model::influence::InfluenceLine;
use crate::model::modal::ModalModel;
use crate::model::structure::SensorRow;
use crate::model::{Structure, participation, shipped};
use crate::picture::chart::{Axis, Curve, Look, Plot};
use crate::train::{SpatialTrain, TrainName};
use crate::validate::compare::rms;

/// Speeds, km/h.
pub const SPEEDS_KMH: [f64; 2] = [40.0, 70.0];
/// The path of the wheels begins so far before the joints L0, m.
pub const APPROACH_M: f64 = 0.6;
/// The damping ratio of the bridge's file.
pub const DAMPING: f64 = 0.015;
/// Ratios whose effect is told.
pub const OTHER_DAMPING: [f64; 2] = [0.01, 0.02];
/// Modes up to this frequency are stepped.
pub const UP_TO_HZ: f64 = 60.0;
/// Limits that show how little hangs on it.
pub const LIMITS_HZ: [f64; 6] = [6.0, 12.0, 20.0, 40.0, 60.0, 90.0];
/// The recorder's cut-off, Hz.
pub const CUTOFF_HZ: f64 = 40.0;
/// Step of the solver, s, and steps a sample: 200 samples a second.
const STEP_S: f64 = 2.5e-3;
const STEPS_A_SAMPLE: usize = 2;
/// Time before the first axle reaches L0 and after the last has left, s.
const LEAD_S: f64 = 1.0;
const TAIL_S: f64 = 4.0;
/// Sensors of the joints L4 of truss R (y = 0) and truss L (y = 5.28 m).
const SENSORS: [u16; 2] = [4, 11];
/// Steps in which the train is moved for the worst static place, m.
const SEARCH_M: f64 = 0.02;
/// Frequencies in the table; modes in which members do little else than turn are left out, as nothing else moves.
const TABLED: usize = 12;
const MEMBERS_ONLY: f64 = 0.5;

/// Bridge and train.
#[derive(Debug, Clone)]
pub struct Truss {
    /// The bridge in finite elements.
    pub structure: Structure,
    /// The test train.
    pub train: SpatialTrain,
}

/// One joint during a passage, a value a step.
#[derive(Debug, Clone, PartialEq)]
pub struct Joint {
    /// Deflection, mm, positive up.
    pub deflection_mm: Vec<f64>,
    /// Acceleration, m/s², positive up.
    pub raw_mps2: Vec<f64>,
    /// The same below [`CUTOFF_HZ`].
    pub recorded_mps2: Vec<f64>,
}

/// A passage.
#[derive(Debug, Clone, PartialEq)]
pub struct Passage {
    /// Speed, km/h.
    pub speed_kmh: f64,
    /// Joint L4 of truss R and of truss L.
    pub joints: [Joint; 2],
}

/// A deflection, mm, and when, s, or where, m.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Peak {
    /// The largest deflection, downwards and so negative, mm.
    pub deflection_mm: f64,
    /// Its time, s after the first axle has reached L0; of a standing train the way of that axle from there, m.
    pub at: f64,
}

impl Truss {
    /// The bridge and the train that ship.
    ///
    /// # Errors
    /// If they do not build.
    pub fn new() -> Result<Self> {
        Ok(Self {
            structure: Structure::new(shipped("rdso45m")?)?,
            train: TrainName::parse("rdso-test")?.train(None)?,
        })
    }

    /// The modes up to a frequency by which wheels move the joints L4.
    ///
    /// # Errors
    /// If the bridge cannot stand.
    pub fn modes(&self, up_to_hz: f64) -> Result<ModalModel> {
        let all = ModalModel::new(&self.structure, &[], Wanted::UpToHz(up_to_hz))?;
        Ok(all.moved_by_wheels(&SENSORS, LEAST_PART))
    }

    /// The rows of the joints L4.
    ///
    /// # Errors
    /// If the bridge has no such sensor.
    pub fn sensors(&self) -> Result<[&SensorRow; 2]> {
        let find = |number| self.structure.sensors.iter().find(|sensor| sensor.number == number);
        Ok([
            find(SENSORS[0]).context("a sensor at R.L4")?,
            find(SENSORS[1]).context("a sensor at L.L4")?,
        ])
    }

    /// Solves a passage on the modes of `model`.
    ///
    /// # Errors
    /// If it cannot be solved.
    pub fn pass(&self, model: &ModalModel, speed_kmh: f64) -> Result<Passage> {
        let speed_mps = speed_kmh / 3.6;
        let crossing = Crossing {
            model,
            train: &self.train,
            run: Run {
                entry_time_s: LEAD_S - APPROACH_M / speed_mps,
                ..Run::at(speed_mps)
            },
            track: None,
            scheme: Scheme::Exact,
            step_s: STEP_S,
        };
        let duration_s = LEAD_S + (model.length_m() + self.train.length_m()) / speed_mps + TAIL_S;
        let watched = crossing.watch((duration_s / STEP_S) as usize, &rows(model)?)?;
        let joint = |k: usize| {
            let watched: &crate::crossing::Watched = &watched[k];
            Joint {
                deflection_mm: watched.displacement_m.iter().map(|u| 1e3 * u).collect(),
                raw_mps2: watched.acceleration_mps2.clone(),
                recorded_mps2: low_passed(&watched.acceleration_mps2, CUTOFF_HZ, STEP_S),
            }
        };
        Ok(Passage {
            speed_kmh,
            joints: [joint(0), joint(1)],
        })
    }

    /// Largest deflection under the standing train at its worst place, by an influence line.
    pub fn standing(&self, line: &InfluenceLine) -> Peak {
        let way_m = self.train.length_m() + self.structure.length_m();
        let places = (0..=(way_m / SEARCH_M) as usize).map(|i| i as f64 * SEARCH_M);
        let worst = places
            .map(|front_m| (1e3 * line.under(&self.train, front_m), front_m - APPROACH_M))
            .min_by(|a, b| a.0.total_cmp(&b.0))
            .unwrap_or((0.0, 0.0));
        Peak {
            deflection_mm: worst.0,
            at: worst.1,
        }
    }
}

/// The rows of the joints L4 in the modes of a model.
///
/// # Errors
/// If the model has no such sensor.
pub fn rows(model: &ModalModel) -> Result<[&[f64]; 2]> {
    let find = |number| (model.sensors.iter()).find(|sensor| sensor.number == number);
    Ok([
        find(SENSORS[0]).context("a sensor at R.L4")?.row.as_slice(),
        find(SENSORS[1]).context("a sensor at L.L4")?.row.as_slice(),
    ])
}

/// Time of a step, s after the first axle has reached L0.
pub fn time_s(step: usize) -> f64 {
    step as f64 * STEP_S - LEAD_S
}

impl Joint {
    /// The largest deflection.
    pub fn peak(&self) -> Peak {
        let lowest = (self.deflection_mm.iter().enumerate()).min_by(|a, b| a.1.total_cmp(b.1));
        let (step, &deflection_mm) = lowest.unwrap_or((0, &0.0));
        Peak {
            deflection_mm,
            at: time_s(step),
        }
    }
}

/// The same modes with another damping ratio.
pub fn damped(model: &ModalModel, ratio: f64) -> ModalModel {
    let mut model = model.clone();
    model.damping.iter_mut().for_each(|damping| *damping *= ratio / DAMPING);
    model
}

/// Everything that is written.
#[derive(Debug, Clone)]
pub struct Prediction {
    /// Passages at [`SPEEDS_KMH`].
    pub passages: Vec<Passage>,
    /// Under the standing train, joint L4 of truss R, at each step of the passages.
    pub standing_mm: Vec<Vec<f64>>,
    /// The tables of the page.
    pub tables: String,
}

/// Makes the prediction.
///
/// # Errors
/// If something of it cannot be solved.
pub fn predict() -> Result<Prediction> {
    let truss = Truss::new()?;
    let model = truss.modes(UP_TO_HZ)?;
    let line = InfluenceLine::exact(&truss.structure, &truss.sensors()?[0].row)?;
    let passages = (SPEEDS_KMH.iter())
        .map(|&speed| truss.pass(&model, speed))
        .collect::<Result<Vec<_>>>()?;
    let standing_mm = (passages.iter())
        .map(|passage| {
            let steps = passage.joints[0].deflection_mm.len();
            let front_m = |step| time_s(step) * passage.speed_kmh / 3.6 + APPROACH_M;
            (0..steps)
                .map(|step| 1e3 * line.under(&truss.train, front_m(step)))
                .collect()
        })
        .collect();
    let tables = [
        frequencies(&truss, &line)?,
        peaks(&truss, &line, &passages)?,
        dampings(&truss, &model)?,
        convergence(&truss, &line)?,
    ];
    Ok(Prediction {
        passages,
        standing_mm,
        tables: tables.join("\n"),
    })
}

/// The first frequencies and what moves in them.
fn frequencies(truss: &Truss, line: &InfluenceLine) -> Result<String> {
    let structure = &truss.structure;
    let modes = natural_modes(&structure.stiffness(&[]), structure.mass())?;
    let model = ModalModel::new(structure, &[], Wanted::UpToHz(UP_TO_HZ))?;
    // Those that move neither path nor sensor are not in it, and bend L4 by nothing.
    let standing = truss.standing(line);
    let row = rows(&model)?[0];
    let mut text = String::from(
        "Frequencies, shares of kinetic energy along (x) and across (y) the track, vertically (z) and in turning members, and \
         share of the largest static deflection of R.L4:\n\n\
         | mode | Hz | damping, % | x, % | y, % | z, % | turning, % | of the deflection, % |\n\
         |---|---|---|---|---|---|---|---|\n",
    );
    let mut listed = 0;
    for (k, &w2) in modes.omega_squared.iter().enumerate() {
        let shares = participation::shares(structure, modes.shapes.column(k)).map(|share| 100.0 * share);
        if shares[3] > 100.0 * MEMBERS_ONLY {
            continue;
        }
        listed += 1;
        if listed > TABLED {
            break;
        }
        let alone = (model.omega_squared.iter()).position(|other| (other / w2 - 1.0).abs() < 1e-9);
        let part = alone.map_or(0.0, |k| {
            let mut only = vec![0.0; row.len()];
            only[k] = row[k];
            let line = InfluenceLine::modal(&model, &only);
            1e3 * line.under(&truss.train, standing.at + APPROACH_M) / standing.deflection_mm
        });
        let [p1, p2] = structure.bridge.damping.rayleigh(&modes.omega_squared);
        let _ = writeln!(
            text,
            "| {} | {:.2} | {:.1} | {:.0} | {:.0} | {:.0} | {:.0} | {:.1} |",
            k + 1,
            frequency_hz(w2),
            100.0 * (p1 + p2 * w2) / (2.0 * w2.sqrt()),
            shares[0],
            shares[1],
            shares[2],
            shares[3],
            100.0 * part
        );
    }
    Ok(text)
}

/// The largest deflections and accelerations.
fn peaks(truss: &Truss, line: &InfluenceLine, passages: &[Passage]) -> Result<String> {
    let mut text = String::from(
        "Largest deflection (time after the first axle has reached L0; for the standing train the place of that axle after \
         L0) and acceleration:\n\n\
         | train | joint | deflection, mm | at | of the standing train's | acceleration below 40 Hz, m/s2: largest | RMS | raw: largest |\n\
         |---|---|---|---|---|---|---|---|\n",
    );
    let lines = [
        line.clone(),
        InfluenceLine::exact(&truss.structure, &truss.sensors()?[1].row)?,
    ];
    let standing = lines.each_ref().map(|line| truss.standing(line));
    for (joint, peak) in ["R.L4", "L.L4"].into_iter().zip(standing) {
        let _ = writeln!(
            text,
            "| standing | {joint} | {:.2} | {:.2} m | 1.000 | - | - | - |",
            peak.deflection_mm, peak.at
        );
    }
    for passage in passages {
        for ((name, joint), standing) in ["R.L4", "L.L4"].into_iter().zip(&passage.joints).zip(standing) {
            let peak = joint.peak();
            let _ = writeln!(
                text,
                "| {} km/h | {name} | {:.2} | {:.2} s | {:.3} | {:.3} | {:.3} | {:.2} |",
                passage.speed_kmh,
                peak.deflection_mm,
                peak.at,
                peak.deflection_mm / standing.deflection_mm,
                largest(&joint.recorded_mps2),
                rms(&joint.recorded_mps2),
                largest(&joint.raw_mps2)
            );
        }
    }
    Ok(text)
}

/// What the declared damping does.
fn dampings(truss: &Truss, model: &ModalModel) -> Result<String> {
    let mut text = String::from(
        "Effect of the damping ratio, joint R.L4:\n\n\
         | km/h | damping ratio | deflection, mm | acceleration below 40 Hz, m/s2: largest | RMS |\n|---|---|---|---|---|\n",
    );
    for speed_kmh in SPEEDS_KMH {
        let [low, high] = OTHER_DAMPING;
        for ratio in [low, DAMPING, high] {
            let passage = truss.pass(&damped(model, ratio), speed_kmh)?;
            let joint = &passage.joints[0];
            let _ = writeln!(
                text,
                "| {speed_kmh} | {ratio} | {:.2} | {:.3} | {:.3} |",
                joint.peak().deflection_mm,
                largest(&joint.recorded_mps2),
                rms(&joint.recorded_mps2)
            );
        }
    }
    Ok(text)
}

/// How the answer depends on the number of modes.
fn convergence(truss: &Truss, line: &InfluenceLine) -> Result<String> {
    let mut text = String::from(
        "Modes up to a frequency, joint R.L4 at 70 km/h (modes: those by which wheels move L4):\n\n\
         | up to, Hz | modes | standing, mm | passing, mm | acceleration below 40 Hz, m/s2: largest | RMS | raw: largest |\n\
         |---|---|---|---|---|---|---|\n",
    );
    for limit in LIMITS_HZ {
        let model = truss.modes(limit)?;
        let passage = truss.pass(&model, SPEEDS_KMH[1])?;
        let joint = &passage.joints[0];
        let standing = truss.standing(&InfluenceLine::modal(&model, rows(&model)?[0]));
        let _ = writeln!(
            text,
            "| {limit} | {} | {:.3} | {:.3} | {:.3} | {:.4} | {:.2} |",
            model.omega_squared.len(),
            standing.deflection_mm,
            joint.peak().deflection_mm,
            largest(&joint.recorded_mps2),
            rms(&joint.recorded_mps2),
            largest(&joint.raw_mps2)
        );
    }
    let _ = writeln!(
        text,
        "| all | {} | {:.3} | | | | |",
        truss.structure.matrices.freedoms(),
        truss.standing(line).deflection_mm
    );
    Ok(text)
}

/// A passage as a table of comma-separated values, 200 rows a second.
pub fn csv(passage: &Passage) -> String {
    let mut text =
        String::from("time_s,R_L4_mm,L_L4_mm,R_L4_raw_mps2,L_L4_raw_mps2,R_L4_below_40hz_mps2,L_L4_below_40hz_mps2\n");
    let [r, l] = &passage.joints;
    for step in (0..r.deflection_mm.len()).step_by(STEPS_A_SAMPLE) {
        let _ = writeln!(
            text,
            "{:.3},{:.4},{:.4},{:.4},{:.4},{:.4},{:.4}",
            time_s(step),
            r.deflection_mm[step],
            l.deflection_mm[step],
            r.raw_mps2[step],
            l.raw_mps2[step],
            r.recorded_mps2[step],
            l.recorded_mps2[step]
        );
    }
    text
}

/// The picture: deflections, then accelerations.
pub fn plots(prediction: &Prediction) -> Vec<Plot> {
    let curve = |label: &str, look: Look, signal: &[f64]| Curve {
        label: label.to_owned(),
        points: (0..)
            .step_by(STEPS_A_SAMPLE)
            .map(time_s)
            .zip(thinned(signal, STEPS_A_SAMPLE))
            .collect(),
        look,
        dots: false,
    };
    let last_s = |passage: &Passage| time_s(passage.joints[0].deflection_mm.len() - 1);
    let mut plots = Vec::new();
    for (passage, standing) in prediction.passages.iter().zip(&prediction.standing_mm) {
        let [r, l] = &passage.joints;
        let deepest = r.peak().deflection_mm.min(l.peak().deflection_mm);
        plots.push(Plot {
            caption: format!("deflection at {} km/h", passage.speed_kmh),
            height: 210.0,
            x: Axis::linear("", (-LEAD_S, last_s(passage))),
            y: Axis::linear("mm", (1.1 * deepest, -0.12 * deepest)),
            curves: vec![
                curve("L4 of truss R", Look::Broad, &r.deflection_mm),
                curve("L4 of truss L", Look::Dashed, &l.deflection_mm),
                curve("R, standing train", Look::Thin, standing),
            ],
            level: None,
            mark: None,
        });
        let reach = 1.1 * largest(&r.recorded_mps2).max(largest(&l.recorded_mps2));
        plots.push(Plot {
            caption: format!("acceleration below 40 Hz at {} km/h", passage.speed_kmh),
            height: 160.0,
            x: Axis::linear(
                "time after the first axle has reached joint L0, s",
                (-LEAD_S, last_s(passage)),
            ),
            y: Axis::linear("m/s²", (-reach, reach)),
            curves: vec![
                curve("L4 of truss R", Look::Blue, &r.recorded_mps2),
                curve("L4 of truss L", Look::Dashed, &l.recorded_mps2),
            ],
            level: None,
            mark: None,
        });
    }
    plots
}
