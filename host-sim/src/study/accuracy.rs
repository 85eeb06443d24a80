//! What a step of each time integration costs and how far the recorder's signal is off with it.
//!
//! The signal is what a logger keeps: acceleration at nodes 3, 6 and 9 of girder50, element 5 with 11 % of its stiffness
//! lost, through the recorder's low-pass (40 Hz) at 200 samples a second. Its error is
//!
//! ```text
//! sqrt(sum (a - a*)^2 / sum a*^2)     over all samples of the three channels
//! ```
//!
//! against the solution `a*` of [`Scheme::Exact`] in very short steps, which the paper's average acceleration must confirm.
//! Work is counted in multiplications a second of passage, by the formula of the solver
//! ([`spanwatch::interaction::solver`]), with the logger's planar car and the cars that are on the bridge on average.

use std::fmt::Write as _;

use anyhow::{Context, Result};
use spanwatch::capacity::{CAR_DOFS, ELEMENTS, MODES};
use spanwatch::interaction::Scheme;
use spanwatch::interaction::simulation::LONGEST_STEP_S;
use spanwatch::train::PlanarTrain;
use spanwatch::wire::message::TrainKind;

use super::relative_rms;
use crate::model::Structure;
use crate::picture::chart::{Axis, Curve, Look, Plot};
use crate::simulate::{Scenario, simulate};
use crate::track::{Profile, Spectrum, Stretch, generate};
use crate::train::TrainName;

/// The recorder's samples a second.
const RATE_HZ: f64 = 200.0;
/// Steps a sample that are compared: 5, 2.5, 5/3, 1.25, 1, 0.5 and 0.25 ms.
pub const STEPS: [u32; 7] = [1, 2, 3, 4, 5, 10, 20];
/// Steps a sample of the converged solution: 0.025 ms.
pub const CONVERGED_STEPS: u32 = 200;
/// The time integrations and what they are called.
pub const SCHEMES: [(Scheme, &str); 3] = [
    (Scheme::AverageAcceleration, "average acceleration"),
    (Scheme::FoxGoodwin, "Fox-Goodwin"),
    (Scheme::Exact, "exact"),
];
/// An error beyond this is no error of a solution: it has exploded.
const EXPLODED: f64 = 1.0;
/// The seed of the rough track.
const SEED: u64 = 1;
/// What an error has to stay below for the paper's hardest train.
const WANTED: f64 = 0.01;

/// A passage.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Case {
    /// What it is called on the page.
    pub name: &'static str,
    /// The train.
    pub train: TrainKind,
    /// Its cars.
    pub cars: usize,
    /// Its speed, km/h.
    pub speed_kmh: f64,
    /// Whether the track is rough (FRA class 6), or smooth.
    pub rough: bool,
}

/// The passages; the first is the one that the choice was asked for.
pub const CASES: [Case; 5] = [
    Case {
        name: "shinkansen-3d, 16 cars, 270 km/h",
        train: TrainKind::Shinkansen3d,
        cars: 16,
        speed_kmh: 270.0,
        rough: false,
    },
    Case {
        name: "shinkansen-3d, 16 cars, 270 km/h, rough track",
        train: TrainKind::Shinkansen3d,
        cars: 16,
        speed_kmh: 270.0,
        rough: true,
    },
    Case {
        name: "shinkansen-3d, 16 cars, 60 km/h",
        train: TrainKind::Shinkansen3d,
        cars: 16,
        speed_kmh: 60.0,
        rough: false,
    },
    Case {
        name: "inspection-2dof, 16 cars, 270 km/h",
        train: TrainKind::Inspection2Dof,
        cars: 16,
        speed_kmh: 270.0,
        rough: false,
    },
    Case {
        name: "inspection-2dof, 1 car, 60 km/h",
        train: TrainKind::Inspection2Dof,
        cars: 1,
        speed_kmh: 60.0,
        rough: false,
    },
];

/// A scheme on a case: the error at each of [`STEPS`], none where it exploded.
#[derive(Debug, Clone, PartialEq)]
pub struct Row {
    /// The case.
    pub case: Case,
    /// The scheme.
    pub scheme: Scheme,
    /// Relative error of the recorder's signal at each step.
    pub errors: [Option<f64>; STEPS.len()],
}

/// All schemes on one case.
#[derive(Debug, Clone, PartialEq)]
pub struct Comparison {
    /// A row for each of [`SCHEMES`].
    pub rows: Vec<Row>,
    /// How far average acceleration in the steps of the converged solution is off it.
    pub confirmed: f64,
}

impl Case {
    fn scenario(&self, scheme: Scheme, steps: u32) -> Result<Scenario> {
        let mut damage = vec![0.0; ELEMENTS];
        damage[4] = 0.11;
        Ok(Scenario {
            train: TrainName::Known(self.train),
            cars: Some(self.cars),
            speed_kmh: self.speed_kmh,
            damage,
            nodes: vec![3, 6, 9],
            modes: MODES,
            track: self.track()?,
            step_s: step_s(steps),
            scheme,
            ..Scenario::inspection_car().recorded()
        })
    }

    fn track(&self) -> Result<Option<Profile>> {
        (self.rough)
            .then(|| generate(Spectrum::Fra6, SEED, &Stretch::default()))
            .transpose()
    }

    fn signal(&self, bridge: &Structure, scheme: Scheme, steps: u32) -> Result<Vec<Vec<f64>>> {
        Ok(simulate(bridge, &self.scenario(scheme, steps)?)?.channels)
    }

    /// Multiplications a second of passage with so many steps a sample.
    ///
    /// # Errors
    /// If there is no such train.
    pub fn multiplications_per_s(&self, length_m: f64, steps: u32) -> Result<f64> {
        let train = PlanarTrain::<f64>::of_kind(self.train, self.cars).context("a train of 1 to 16 cars")?;
        let car = &train.kinds[0];
        let aboard = self.cars as f64 * (length_m + car.length_m()) / (length_m + train.length_m());
        let (m, d) = (MODES as f64, CAR_DOFS as f64);
        let (n, s) = (car.contacts.len() as f64, car.springs.len() as f64);
        let each = n * m * (m / 2.0 + n + 8.0) + d * (d + 3.0 * s + 5.0 * n);
        Ok((m * m * (m - 1.0) / 2.0 + aboard * each) / step_s(steps))
    }
}

/// Length of a step, s.
pub fn step_s(steps: u32) -> f64 {
    (RATE_HZ * f64::from(steps)).recip()
}

/// Compares the schemes on a case, against a solution in `converged` steps a sample.
///
/// # Errors
/// If it cannot be solved.
pub fn compare(bridge: &Structure, case: &Case, converged: u32) -> Result<Comparison> {
    let exact = case.signal(bridge, Scheme::Exact, converged)?;
    let confirmed = relative_rms(&case.signal(bridge, Scheme::AverageAcceleration, converged)?, &exact);
    let mut rows = Vec::new();
    for (scheme, _) in SCHEMES {
        let mut errors = [None; STEPS.len()];
        for (error, &steps) in errors.iter_mut().zip(&STEPS) {
            let found = relative_rms(&case.signal(bridge, scheme, steps)?, &exact);
            *error = (found < EXPLODED).then_some(found);
        }
        rows.push(Row {
            case: *case,
            scheme,
            errors,
        });
    }
    Ok(Comparison { rows, confirmed })
}

/// What a scheme is called.
fn name(scheme: Scheme) -> &'static str {
    (SCHEMES.iter())
        .find(|(known, _)| *known == scheme)
        .map_or("", |(_, name)| name)
}

/// The tables of the page: errors, then work.
///
/// # Errors
/// If a case has a train that there is not.
pub fn tables(bridge: &Structure, comparisons: &[Comparison]) -> Result<String> {
    let mut text = String::from("Error of the recorder's signal, %:\n\n| case | scheme |");
    for steps in STEPS {
        let _ = write!(text, " {} ms |", milliseconds(steps));
    }
    let _ = writeln!(text, "\n|---|---|{}", "---|".repeat(STEPS.len()));
    for row in comparisons.iter().flat_map(|comparison| &comparison.rows) {
        let _ = write!(text, "| {} | {} |", row.case.name, name(row.scheme));
        for error in row.errors {
            let _ = match error {
                Some(error) => write!(text, " {} |", percent(error)),
                None => write!(text, " explodes |"),
            };
        }
        text.push('\n');
    }
    let _ = write!(text, "\nWork, million multiplications a second of passage:\n\n| case |");
    for steps in STEPS {
        let _ = write!(text, " {} a second |", RATE_HZ * f64::from(steps));
    }
    let _ = writeln!(text, "\n|---|{}", "---|".repeat(STEPS.len()));
    for case in comparisons.iter().filter_map(|c| c.rows.first()).map(|row| row.case) {
        let _ = write!(text, "| {} |", case.name);
        for steps in STEPS {
            let work = case.multiplications_per_s(bridge.length_m(), steps)?;
            let _ = write!(text, " {:.2} |", 1e-6 * work);
        }
        text.push('\n');
    }
    let _ = writeln!(
        text,
        "\nAverage acceleration in steps of {:.3} ms is off the converged solution by {:.1e} at most.",
        1e3 * step_s(CONVERGED_STEPS),
        comparisons.iter().fold(0.0, |most, c| c.confirmed.max(most))
    );
    Ok(text)
}

/// A step in ms, as on the page.
fn milliseconds(steps: u32) -> String {
    match steps {
        3 => "5/3".to_owned(),
        _ => format!("{}", 1e3 * step_s(steps)),
    }
}

/// Two digits of an error, %.
fn percent(error: f64) -> String {
    let percent = 100.0 * error;
    let decimals = (1.0 - percent.log10().floor()).clamp(1.0, 5.0) as usize;
    format!("{percent:.decimals$}")
}

/// The picture of the page: error over work for the first case, and the worst of all over the steps a second.
///
/// # Errors
/// If a case has a train that there is not.
pub fn plots(bridge: &Structure, comparisons: &[Comparison]) -> Result<Vec<Plot>> {
    let looks = [Look::Blue, Look::Dashed, Look::Broad];
    let default = STEPS.iter().position(|&steps| step_s(steps) <= LONGEST_STEP_S + 1e-9);
    let default = default.context("the default step is among those compared")?;
    let exact = SCHEMES.len() - 1;
    let first = comparisons.first().context("a case")?;
    // Worst over the cases; a scheme that explodes in one is no choice.
    let worst: Vec<Vec<Option<f64>>> = (0..SCHEMES.len())
        .map(|k| {
            let at =
                |i: usize| (comparisons.iter()).try_fold(0.0_f64, |worst, c| Some(worst.max(c.rows[k].errors[i]?)));
            (0..STEPS.len()).map(at).collect()
        })
        .collect();
    let work: Vec<f64> = (STEPS.iter())
        .map(|&steps| first.rows[0].case.multiplications_per_s(bridge.length_m(), steps))
        .collect::<Result<_>>()?;
    let per_s: Vec<f64> = STEPS.iter().map(|&steps| RATE_HZ * f64::from(steps)).collect();
    let errors = |k: usize| first.rows[k].errors.to_vec();
    let plot = |caption: String, label: &str, x: &[f64], errors: &dyn Fn(usize) -> Vec<Option<f64>>| {
        let curve = |k: usize| Curve {
            label: SCHEMES[k].1.to_owned(),
            points: (x.iter().zip(errors(k)))
                .map(|(&x, error)| (x, error.map_or(f64::NAN, |error| 100.0 * error)))
                .collect(),
            look: looks[k],
            dots: true,
        };
        let (low, high) = (x[0], x[x.len() - 1]);
        Plot {
            caption,
            height: 300.0,
            x: Axis::logarithmic(label, (low / 1.15, high * 1.15)),
            y: Axis::logarithmic("error, %", (1e-4, 60.0)),
            curves: (0..SCHEMES.len()).rev().map(curve).collect(),
            level: Some((100.0 * WANTED, "1 %".to_owned())),
            mark: errors(exact)[default].map(|error| (x[default], 100.0 * error, "default, 2.5 ms".to_owned())),
        }
    };
    Ok(vec![
        plot(
            first.rows[0].case.name.to_owned(),
            "multiplications a second of passage",
            &work,
            &errors,
        ),
        plot("the worst of all cases".to_owned(), "steps a second", &per_s, &|k| {
            worst[k].clone()
        }),
    ])
}
