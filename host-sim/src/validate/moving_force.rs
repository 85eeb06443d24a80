//! A constant force that moves over a beam: Fryba's closed form.

use std::f64::consts::PI;

use anyhow::Result;
use spanwatch::interaction::{Kinematics, Run, Scheme};

use super::beam::{self, Beam};
use super::compare::lowest;
use super::{Row, Topic};
use crate::crossing::Crossing;

/// The topic.
pub const TOPIC: Topic = Topic {
    title: "A moving force",
    about: "1000 N at 10 m/s over a beam of 25 m, E I = 2.1e7 N m², 78.5 kg/m, no damping; twenty elements, their twenty \
            lowest modes, steps of 0.1 ms. The series: w = 2 P / (m L) sum_k sin(k pi x / L) (sin(k W t) - k W / w_k sin(w_k \
            t)) / (w_k² - k² W²), W = pi v / L. The static deflection would be 15.50099 mm.",
    rows,
};

const BEAM: Beam = Beam {
    length_m: 25.0,
    bending_stiffness_nm2: 2.1e7,
    mass_kgpm: 78.5,
    damping_ratio: 0.0,
};
const LOAD_N: f64 = 1000.0;
const SPEED_MPS: f64 = 10.0;
const STEP_S: f64 = 1e-4;
/// Terms of the series: the hundredth is 1e-8 of the first.
const TERMS: usize = 99;

/// Mid-span displacement by the series, m.
fn series(t: f64) -> f64 {
    let term = |k: usize| {
        let (w, drive) = (BEAM.omega(k), k as f64 * PI * SPEED_MPS / BEAM.length_m);
        (k as f64 * PI / 2.0).sin() * ((drive * t).sin() - drive / w * (w * t).sin()) / (w * w - drive * drive)
    };
    -2.0 * LOAD_N / (BEAM.mass_kgpm * BEAM.length_m) * (1..=TERMS).map(term).sum::<f64>()
}

fn rows() -> Result<Vec<Row>> {
    const PUBLISHED: &str = "Fryba, published maximum";
    const TRUNCATED: &str = "1 / k⁴ of the odd modes above the twentieth: 2e-5 in all";
    let model = BEAM.modes(20, 20)?;
    let train = beam::alone(beam::force(LOAD_N))?;
    let deflection = |kinematics| {
        let crossing = Crossing {
            model: &model,
            train: &train,
            run: Run {
                kinematics,
                ..Run::at(SPEED_MPS)
            },
            track: None,
            scheme: Scheme::Exact,
            step_s: STEP_S,
        };
        let history = crossing.history(11, BEAM.length_m / SPEED_MPS);
        history.map(|history| history.displacement_m)
    };
    let found = deflection(Kinematics::Paper)?;
    let (at, deepest_m) = lowest(&found);
    let expected: Vec<f64> = (1..=found.len()).map(|n| series(n as f64 * STEP_S)).collect();
    Ok(vec![
        Row::new("largest deflection", PUBLISHED)
            .numbers(18.15945, -1e3 * deepest_m)
            .shown("mm", 5)
            .within(3e-5, TRUNCATED),
        Row::new("time of it", PUBLISHED)
            .numbers(1.32675, (at + 1.0) * STEP_S)
            .shown("s", 5)
            .within(1e-4, "the maximum is flat: 1 µm deep within 1 ms"),
        Row::new("deflection at all times", "Fryba (1999), chapter 1, 99 terms")
            .everywhere(&expected, &found)
            .times(1e3)
            .shown("mm", 5)
            .within(3e-5, TRUNCATED),
        Row::new(
            "the same with convective kinematics",
            "a force does not feel how the rail moves",
        )
        .everywhere(&found, &deflection(Kinematics::Convective)?)
        .times(1e3)
        .shown("mm", 5)
        .within(0.0, "the same operations"),
    ])
}
