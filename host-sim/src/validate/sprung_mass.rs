//! A mass on a spring that rolls over a beam, over a ramp in the rail, and as a car.

use anyhow::Result;
use spanwatch::interaction::{Kinematics, Run, Scheme};
use spanwatch::track::{Irregularity, Track};
use spanwatch::train::Motion;

use super::beam::{self, Beam, History};
use super::compare::lowest;
use super::{Row, Topic};
use crate::crossing::Crossing;

/// The topic.
pub const TOPIC: Topic = Topic {
    title: "A sprung mass",
    about: "VBI-2D's check: 5750 kg on 1595 kN/m at 25 m/s over a beam of 25 m, E I = 3.5e10 * 1.3901 N m², 18358 kg/m, no \
            damping; g = 9.81 m/s². The published numbers come out to 6e-5 by average acceleration at 1 ms on twenty modes, \
            and only to 4e-4 at half that step or by the exact scheme: they look like a solution of that step, and that step \
            is taken. The ramp rises straight from 0 at L/3 to 10 mm at L/2. At its two kinks the slope, and with it the \
            damper's force, jumps. The published number is met where the slope is taken as the rail's rise since the last \
            step (so that kinks are a step wide and half a step late), with the paper's kinematics. With the convective one \
            it is missed by five times as much, and with slopes that jump and the exact scheme at 1/6000 s (a step ends on \
            each kink, where the slope is the mean of both sides) by ten times: these rows are within 0.1 %, no better. Yang \
            and Yau's car: the same on a beam of E I = 2.87e9 * 2.90 N m², 2303 kg/m, at 100 km/h, ten modes, the exact \
            scheme at 0.1 ms.",
    rows,
};

const BEAM: Beam = Beam {
    length_m: 25.0,
    bending_stiffness_nm2: 3.5e10 * 1.3901,
    mass_kgpm: 18358.0,
    damping_ratio: 0.0,
};
const SPEED_MPS: f64 = 25.0;
/// The step of the published solution, s.
const STEP_S: f64 = 1e-3;
/// A step that ends on both kinks of the ramp, s.
const FINE_STEP_S: f64 = 1.0 / 6000.0;
/// Where step and kinks are those of the published solution.
const ALIKE: (f64, &str) = (2e-4, "the same step; modes and kinks nearly so");
/// Where they are not.
const UNLIKE: (f64, &str) = (1e-3, "0.1 %: another step, kinks or kinematics");
const VBI: &str = "VBI-2D, analytical solution";

/// A straight rise from nothing to `height_m`, then level: a rail with two kinks.
struct Ramp {
    from_m: f64,
    to_m: f64,
    height_m: f64,
    /// The slope is the rise over so many metres back; zero: the slope itself.
    back_m: f64,
}

impl Ramp {
    fn height_at(&self, x_m: f64) -> f64 {
        self.height_m * (x_m.clamp(self.from_m, self.to_m) - self.from_m) / (self.to_m - self.from_m)
    }

    fn slope_at(&self, x_m: f64) -> f64 {
        /// Places nearer than this to a kink are on it, m; the slope there is the mean of both sides.
        const ON_IT: f64 = 1e-9;
        if self.back_m > 0.0 {
            return (self.height_at(x_m) - self.height_at(x_m - self.back_m)) / self.back_m;
        }
        (self.height_at(x_m + ON_IT) - self.height_at(x_m - ON_IT)) / (2.0 * ON_IT)
    }
}

impl Track<f64> for Ramp {
    fn extent_m(&self) -> Option<[f64; 2]> {
        Some([self.from_m, self.to_m + self.back_m])
    }

    fn at(&self, motion: Motion, x_m: f64) -> Irregularity<f64> {
        if motion != Motion::Vertical {
            return Irregularity::none();
        }
        Irregularity {
            value: self.height_at(x_m),
            slope: self.slope_at(x_m),
            curvature: 0.0,
            curvature_rate: 0.0,
        }
    }
}

fn crossed(
    damping_nspm: f64,
    track: Option<&dyn Track<f64>>,
    kinematics: Kinematics,
    (scheme, step_s): (Scheme, f64),
) -> Result<History> {
    Crossing {
        model: &BEAM.modes(20, 20)?,
        train: &beam::alone(beam::one_wheel(5750.0 * 9.81, 5750.0, 1595e3, damping_nspm))?,
        run: Run {
            kinematics,
            ..Run::at(SPEED_MPS)
        },
        track,
        scheme,
        step_s,
    }
    .history(11, 1.0)
}

fn rows() -> Result<Vec<Row>> {
    let published = (Scheme::AverageAcceleration, STEP_S);
    let smooth = crossed(0.0, None, Kinematics::Paper, published)?.displacement_m;
    let convective = crossed(0.0, None, Kinematics::Convective, published)?.displacement_m;
    let (at, deepest_m) = lowest(&smooth);
    let mut rows = vec![
        Row::new("smooth rail: largest deflection of mid-span", VBI)
            .numbers(-0.418545, 1e3 * deepest_m)
            .shown("mm", 6)
            .within(ALIKE.0, ALIKE.1),
        Row::new("time of it", VBI)
            .numbers(0.436, (at + 1.0) * STEP_S)
            .shown("s", 4)
            .within(2e-3, "printed to 1 ms"),
        Row::new(
            "the same at all times with convective kinematics",
            "without damper and wheel mass, no difference",
        )
        .everywhere(&smooth, &convective)
        .times(1e3)
        .shown("mm", 6)
        .within(0.0, "the same operations"),
    ];
    for (time_s, expected_mm) in [
        (0.1, -0.0883320),
        (0.2, -0.2592455),
        (0.25, -0.2564307),
        (0.3, -0.2583230),
        (0.4, -0.3978398),
        (0.5, -0.3673284),
        (0.6, -0.3526330),
        (0.75, -0.2400590),
        (0.9, -0.1572262),
        (1.0, 0.0297320),
    ] {
        let found_mm = 1e3 * smooth[(time_s / STEP_S).round() as usize - 1];
        rows.push(
            Row::new(format!("at {time_s} s, by the largest"), VBI)
                .measured_by(expected_mm, found_mm, 0.418545)
                .shown("mm", 7)
                .within(ALIKE.0, ALIKE.1),
        );
    }
    rows.extend(over_the_ramp()?);
    rows.extend(car()?);
    Ok(rows)
}

/// The ramp, without damper and with one.
fn over_the_ramp() -> Result<Vec<Row>> {
    const UNDAMPED: (f64, f64) = (0.0, -0.467210);
    const DAMPED: (f64, f64) = (4e5, -0.462597);
    let stepped = Ramp {
        from_m: BEAM.length_m / 3.0,
        to_m: BEAM.length_m / 2.0,
        height_m: 10e-3,
        back_m: SPEED_MPS * STEP_S,
    };
    let sharp = Ramp { back_m: 0.0, ..stepped };
    let published = (&stepped, Scheme::AverageAcceleration, STEP_S);
    let converged = (&sharp, Scheme::Exact, FINE_STEP_S);
    let (paper, convective) = (Kinematics::Paper, Kinematics::Convective);
    [
        ("ramp: largest deflection", UNDAMPED, paper, published, ALIKE),
        ("ramp and damper 4e5 N s/m", DAMPED, paper, published, ALIKE),
        ("the same, convective kinematics", DAMPED, convective, published, UNLIKE),
        ("ramp, exact scheme", UNDAMPED, paper, converged, UNLIKE),
        (
            "ramp and damper, exact scheme, sharp kinks",
            DAMPED,
            paper,
            converged,
            UNLIKE,
        ),
    ]
    .into_iter()
    .map(
        |(what, (damping_nspm, expected_mm), kinematics, (ramp, scheme, step_s), (tolerance, reason))| {
            let found = crossed(damping_nspm, Some(ramp), kinematics, (scheme, step_s))?;
            let (_, deepest_m) = lowest(&found.displacement_m);
            Ok(Row::new(what, VBI)
                .numbers(expected_mm, 1e3 * deepest_m)
                .shown("mm", 6)
                .within(tolerance, reason))
        },
    )
    .collect()
}

/// Yang and Yau's car.
fn car() -> Result<Vec<Row>> {
    const SOURCE: &str = "Yang and Yau, ten modes";
    const STEP_S: f64 = 1e-4;
    let beam = Beam {
        length_m: 25.0,
        bending_stiffness_nm2: 2.87e9 * 2.90,
        mass_kgpm: 2303.0,
        damping_ratio: 0.0,
    };
    let found = Crossing {
        model: &beam.modes(20, 10)?,
        train: &beam::alone(beam::one_wheel(5750.0 * 9.81, 5750.0, 1595e3, 0.0))?,
        run: Run::at(100.0 / 3.6),
        track: None,
        scheme: Scheme::Exact,
        step_s: STEP_S,
    }
    .history(11, 0.9)?;
    let mut rows = Vec::new();
    for (what, history, expected_mm, expected_s) in [
        ("Yang and Yau: mid-span", &found.displacement_m, 2.407549, 0.3709),
        ("Yang and Yau: body of the car", &found.bounce_m, 2.589922, 0.4248),
    ] {
        let (at, deepest_m) = lowest(history);
        rows.push(
            Row::new(format!("{what}, largest, down"), SOURCE)
                .numbers(expected_mm, -1e3 * deepest_m)
                .shown("mm", 6)
                .within(1e-4, "converged in step; the reference's own step is not printed"),
        );
        rows.push(
            Row::new(format!("{what}, time of it"), SOURCE)
                .numbers(expected_s, (at + 1.0) * STEP_S)
                .shown("s", 4)
                .within(1e-3, "0.4 ms of a flat extreme"),
        );
    }
    Ok(rows)
}
