//! The viaduct viaduct24 under 16 cars of shinkansen-3d at 270 km/h on a rough track: accelerations and spectra at the
//! points of the paper's Figs 4 and 5.
//!
//! The viaduct's dimensions and the track are declared by this project, and what the paper measured is printed in its
//! figures only: so this is plausible at best, and not validated.

use std::f64::consts::TAU;
use std::fmt::Write as _;

use anyhow::{Context, Result};
use spanwatch::interaction::{Run, Scheme};
use spanwatch::train::Train;
use spanwatch::train::stock::{self, PITCH_M};

use super::{LEAST_PART, largest, low_passed, thinned};
use crate::crossing::Crossing;
use crate::model::eigen::Wanted;
use crate::model::modal::ModalModel;
use crate::model::{Structure, shipped};
use crate::picture::chart::{Axis, Curve, Look, Plot};
use crate::track::{Profile, Spectrum, Stretch, generate};
use crate::train::SpatialTrain;
use crate::validate::compare::rms;

/// The train.
pub const CARS: usize = 16;
/// Its speed, m/s: 270 km/h.
pub const SPEED_MPS: f64 = 75.0;
/// The track's spectrum.
pub const SPECTRUM: Spectrum = Spectrum::Fra6;
/// The track's seed.
pub const SEED: u64 = 1;
/// Other seeds, for the spread.
pub const OTHER_SEEDS: std::ops::RangeInclusive<u64> = 2..=5;
/// Modes up to this frequency are stepped.
pub const UP_TO_HZ: f64 = 80.0;
/// Limits that show how much hangs on it.
pub const LIMITS_HZ: [f64; 4] = [45.0, 60.0, 80.0, 110.0];
/// Bands in which maxima are told, Hz.
pub const BANDS_HZ: [f64; 2] = [40.0, 100.0];
/// Sensors of the paper's figures: its Fig. 4, points 1 to 3 vertical, and Fig. 5, point 3 horizontal.
pub const SENSORS: [(u16, &str); 4] = [
    (1, "point 1, vertical"),
    (2, "point 2, vertical"),
    (3, "point 3, vertical"),
    (6, "point 3, horizontal"),
];
/// Step of the solver, s; every second is drawn.
pub const STEP_S: f64 = 1e-3;
const STEPS_A_SAMPLE: usize = 2;
/// Time before the first wheelset enters and after the last has left, s.
const LEAD_S: f64 = 0.5;
const TAIL_S: f64 = 1.0;
/// Spacing of spectral lines, Hz, and the last of them.
const LINE_HZ: f64 = 0.1;
const LAST_HZ: f64 = 100.0;

/// Viaduct and train.
#[derive(Debug, Clone)]
pub struct Viaduct {
    /// The bridge in finite elements.
    pub structure: Structure,
    /// The train.
    pub train: SpatialTrain,
}

impl Viaduct {
    /// The viaduct that ships, and the paper's train.
    ///
    /// # Errors
    /// If it does not build.
    pub fn new() -> Result<Self> {
        Ok(Self {
            structure: Structure::new(shipped("viaduct24")?)?,
            train: Train::uniform(stock::shinkansen(), CARS, PITCH_M).context("a train of 16 cars")?,
        })
    }

    /// The modes up to a frequency by which wheels move the points.
    ///
    /// # Errors
    /// If the bridge cannot stand.
    pub fn modes(&self, up_to_hz: f64) -> Result<ModalModel> {
        let all = ModalModel::new(&self.structure, &[], Wanted::UpToHz(up_to_hz))?;
        Ok(all.moved_by_wheels(&SENSORS.map(|(number, _)| number), LEAST_PART))
    }

    /// The track of a seed, from 140 m before the viaduct to behind it.
    ///
    /// # Errors
    /// If there is no such track.
    pub fn track(&self, seed: u64) -> Result<Profile> {
        let length_m = self.structure.length_m();
        generate(
            SPECTRUM,
            seed,
            &Stretch {
                to_m: length_m + 20.0,
                ..Stretch::default()
            },
        )
    }

    /// Accelerations at [`SENSORS`], m/s², a value a step of `step_s` from time 0 on.
    ///
    /// # Errors
    /// If it cannot be solved.
    pub fn pass(&self, model: &ModalModel, track: &Profile, step_s: f64) -> Result<Vec<Vec<f64>>> {
        let rows = SENSORS
            .map(|(number, _)| model.sensors.iter().find(|sensor| sensor.number == number))
            .into_iter()
            .map(|sensor| Ok(sensor.context("a sensor at each point")?.row.as_slice()))
            .collect::<Result<Vec<_>>>()?;
        let crossing = Crossing {
            model,
            train: &self.train,
            run: Run {
                entry_time_s: LEAD_S,
                ..Run::at(SPEED_MPS)
            },
            track: Some(track),
            scheme: Scheme::Exact,
            step_s,
        };
        let duration_s = LEAD_S + (model.length_m() + self.train.length_m()) / SPEED_MPS + TAIL_S;
        let watched = crossing.watch((duration_s / step_s) as usize, &rows)?;
        Ok(watched.into_iter().map(|watched| watched.acceleration_mps2).collect())
    }
}

/// Everything that is written.
#[derive(Debug, Clone)]
pub struct Prediction {
    /// Accelerations at [`SENSORS`] below the upper of [`BANDS_HZ`].
    pub accelerations_mps2: Vec<Vec<f64>>,
    /// Their Fourier amplitudes, m/s, at multiples of 0.1 Hz.
    pub spectra_mps: Vec<Vec<f64>>,
    /// The tables of the page.
    pub tables: String,
}

/// Makes the prediction.
///
/// # Errors
/// If something of it cannot be solved.
pub fn predict() -> Result<Prediction> {
    let viaduct = Viaduct::new()?;
    let model = viaduct.modes(UP_TO_HZ)?;
    let raw = viaduct.pass(&model, &viaduct.track(SEED)?, STEP_S)?;
    let accelerations_mps2: Vec<Vec<f64>> = (raw.iter())
        .map(|signal| low_passed(signal, BANDS_HZ[1], STEP_S))
        .collect();
    let spectra_mps: Vec<Vec<f64>> = accelerations_mps2.iter().map(|signal| spectrum(signal)).collect();
    let others = (OTHER_SEEDS)
        .map(|seed| viaduct.pass(&model, &viaduct.track(seed)?, STEP_S))
        .collect::<Result<Vec<_>>>()?;
    let tables = [
        maxima(&raw, &spectra_mps, &others),
        convergence(&viaduct, &raw, model.omega_squared.len())?,
    ];
    Ok(Prediction {
        accelerations_mps2,
        spectra_mps,
        tables: tables.join("\n"),
    })
}

/// `|integral of a exp(-i w t) dt|` at multiples of [`LINE_HZ`] up to [`LAST_HZ`], m/s.
pub fn spectrum(signal: &[f64]) -> Vec<f64> {
    let lines = (LAST_HZ / LINE_HZ).round() as usize;
    (0..=lines)
        .map(|k| {
            let turn = TAU * k as f64 * LINE_HZ * STEP_S;
            let (mut re, mut im) = (0.0, 0.0);
            for (i, value) in signal.iter().enumerate() {
                let (sin, cos) = (turn * i as f64).sin_cos();
                re += value * cos;
                im -= value * sin;
            }
            f64::hypot(re, im) * STEP_S
        })
        .collect()
}

/// Frequency of the largest line, Hz.
fn peak_hz(spectrum: &[f64]) -> f64 {
    let largest = spectrum.iter().enumerate().max_by(|a, b| a.1.total_cmp(b.1));
    largest.map_or(0.0, |(k, _)| k as f64 * LINE_HZ)
}

/// Max and RMS in both bands, the strongest frequency, and what other seeds give.
fn maxima(raw: &[Vec<f64>], spectra: &[Vec<f64>], others: &[Vec<Vec<f64>>]) -> String {
    let mut text = format!(
        "Acceleration, m/s2 (Max / RMS over the time that the train is on the viaduct and 1.5 s; {} other seeds: smallest to \
         largest Max):\n\n\
         | point | below 40 Hz | below 100 Hz | other seeds, below 100 Hz | strongest frequency, Hz |\n|---|---|---|---|---|\n",
        others.len()
    );
    for (k, (_, name)) in SENSORS.iter().enumerate() {
        let band = |cutoff| {
            let signal = low_passed(&raw[k], cutoff, STEP_S);
            format!("{:.3} / {:.4}", largest(&signal), rms(&signal))
        };
        let spread = (others.iter()).map(|other| largest(&low_passed(&other[k], BANDS_HZ[1], STEP_S)));
        let (low, high) = spread.fold((f64::INFINITY, 0.0_f64), |(low, high), v| (low.min(v), high.max(v)));
        let _ = writeln!(
            text,
            "| {name} | {} | {} | {low:.3} to {high:.3} | {:.1} |",
            band(BANDS_HZ[0]),
            band(BANDS_HZ[1]),
            peak_hz(&spectra[k])
        );
    }
    text
}

/// How the answer depends on the number of modes.
fn convergence(viaduct: &Viaduct, raw: &[Vec<f64>], modes: usize) -> Result<String> {
    let track = viaduct.track(SEED)?;
    let mut text = String::from(
        "RMS with modes up to a frequency, m/s2, below 40 Hz / below 100 Hz (modes: those by which wheels move the points):\n\n\
         | up to, Hz | modes |",
    );
    for (_, name) in SENSORS {
        let _ = write!(text, " {name} |");
    }
    let _ = writeln!(text, "\n|---|---|{}", "---|".repeat(SENSORS.len()));
    for limit in LIMITS_HZ {
        let (signals, count) = if limit == UP_TO_HZ {
            (raw.to_vec(), modes)
        } else {
            let model = viaduct.modes(limit)?;
            (viaduct.pass(&model, &track, STEP_S)?, model.omega_squared.len())
        };
        let _ = write!(text, "| {limit} | {count} |");
        for signal in &signals {
            let [low, high] = BANDS_HZ.map(|cutoff| rms(&low_passed(signal, cutoff, STEP_S)));
            let _ = write!(text, " {low:.4} / {high:.4} |");
        }
        text.push('\n');
    }
    Ok(text)
}

/// The picture: histories, then spectra.
pub fn plots(prediction: &Prediction) -> Vec<Plot> {
    let curve = |points: Vec<(f64, f64)>| Curve {
        label: String::new(),
        points,
        look: Look::Thin,
        dots: false,
    };
    let mut plots = Vec::new();
    for (k, (_, name)) in SENSORS.iter().enumerate() {
        let signal = &prediction.accelerations_mps2[k];
        let reach = 1.1 * largest(signal);
        let step_s = STEPS_A_SAMPLE as f64 * STEP_S;
        plots.push(Plot {
            caption: format!("{name}: Max {:.3}, RMS {:.4} m/s²", largest(signal), rms(signal)),
            height: 120.0,
            x: Axis::linear(
                if k + 1 == SENSORS.len() {
                    "time after the first wheelset has entered, s"
                } else {
                    ""
                },
                (-LEAD_S, (signal.len() - 1) as f64 * STEP_S - LEAD_S),
            ),
            y: Axis::linear("m/s²", (-reach, reach)),
            curves: vec![curve(
                (thinned(signal, STEPS_A_SAMPLE).enumerate())
                    .map(|(i, value)| (i as f64 * step_s - LEAD_S, value))
                    .collect(),
            )],
            level: None,
            mark: None,
        });
    }
    for (k, (_, name)) in SENSORS.iter().enumerate() {
        let lines = &prediction.spectra_mps[k];
        plots.push(Plot {
            caption: format!("{name}: Fourier amplitude"),
            height: 110.0,
            x: Axis::linear(
                if k + 1 == SENSORS.len() { "frequency, Hz" } else { "" },
                (0.0, LAST_HZ),
            ),
            y: Axis::linear("m/s", (0.0, 1.1 * largest(lines))),
            curves: vec![curve(
                lines
                    .iter()
                    .enumerate()
                    .map(|(i, &value)| (i as f64 * LINE_HZ, value))
                    .collect(),
            )],
            level: None,
            mark: None,
        });
    }
    plots
}
