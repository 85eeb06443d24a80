//! Energy: bridge and car store what gravity and the locomotive give, no more and no less.
//!
//! With `u_i = phi_i . q + r` the rail under contact `i`, `s_i = du_i/dx` its slope (that of bridge and track), `F_i` the force
//! on the rail and no damper anywhere, a car at constant speed `v` obeys
//!
//! ```text
//! E = 1/2 (q'^2 + w^2 q^2) + 1/2 sum_d m_d y_d'^2 + 1/2 sum_springs k e^2 + 1/2 sum_i m_i (du_i/dt)^2
//! dE/dt = sum_i -W_i du_i/dt - F_i v s_i
//! ```
//!
//! the work of the weights, and that of the locomotive that pushes each wheel up the slope against the force it presses
//! with. So it is for the full ("convective") derivatives. The paper takes `du/dt = phi . q'` and `u'' = phi . q''`, which
//! leaves out what an unsprung mass feels of slope and curve; its equations then obey, on a smooth track,
//!
//! ```text
//! E = .. + 1/2 sum_i m_i (phi_i . q')^2
//! dE/dt = sum_i -W_i phi_i . q' - f_i v s_i + m_i v (phi_i . q') (phi_i' . q')            f_i the spring's force
//! ```
//!
//! whose last term is work of nobody: what the approximation makes up or loses.
//!
//! Where a wheel rolls from the abutment onto the girder's turned end, the rail has a kink: the push there is sudden, and gives
//! the wheelset what the kink changes in `1/2 m (du/dt)^2`. Steps are such that wheels meet kinks at the end of a step, so that all
//! is evaluated on both sides of it. Powers are summed by the trapezoidal rule.

use anyhow::{Context, Result};
use spanwatch::interaction::{Kinematics, Modes, Run, Scheme};
use spanwatch::track::{Smooth, Track};
use spanwatch::train::stock::{self, SPATIAL_DOFS};

use super::beam::{SpatialCar, alone};
use super::compare::largest;
use super::{Row, Topic};
use crate::crossing::{Crossing, SpatialModes, State};
use crate::model::eigen::Wanted;
use crate::model::modal::ModalModel;
use crate::model::{self, Structure};
use crate::track::{Spectrum, Stretch, generate};

/// The topic.
pub const TOPIC: Topic = Topic {
    title: "Energy of bridge and car",
    about: "All dampers taken out of bridge and car; average acceleration at 0.1 ms, 20 m/s. Expected: the work of the \
            weights and of the locomotive that pushes the wheels along the sloping rail, from the first wheel's entry on; \
            found: what bridge, springs, bodies and wheelsets store more than then, both at the time when that is most. The \
            difference is the largest at any time. With the paper's kinematics the work of the terms that it leaves out is \
            counted too; they are no force's, and 'left out' says how much they come to. Irregular track: FRA class 1, seed \
            1, in all three motions of the wheelsets.",
    rows,
};

const SPEED_MPS: f64 = 20.0;
const STEP_S: f64 = 1e-4;
/// Modes of the bridges.
const MODES: usize = 20;
/// A wheel nearer than this to an end is on it, m.
const ON_THE_END: f64 = 1e-6;

/// A side of an instant: just before it, or just after.
#[derive(Clone, Copy, PartialEq)]
enum Side {
    Before,
    After,
}

/// Energy and powers at one side of an instant.
struct Books {
    stored: f64,
    /// Of weights and locomotive.
    power: f64,
    /// Of the terms that the paper's kinematics leaves out.
    left_out: f64,
}

struct Ledger<'a> {
    model: &'a ModalModel,
    modes: SpatialModes<MODES>,
    car: &'a SpatialCar,
    track: &'a dyn Track<f64>,
    kinematics: Kinematics,
}

/// What a passage's books say, by the largest work.
struct Balance {
    work: Vec<f64>,
    stored: Vec<f64>,
    left_out: Vec<f64>,
}

impl Ledger<'_> {
    fn books(&self, state: State<'_>, car: [&[f64]; 2], front_m: f64, side: Side) -> Books {
        let [y, yd] = car;
        let along = |shape: &[f64; MODES], modal: &[f64]| -> f64 {
            modal.iter().zip(shape.iter()).map(|(q, phi)| q * phi).sum()
        };
        let stretched = |lever: &[f64; SPATIAL_DOFS]| lever.iter().zip(y).map(|(s, y)| s * y).sum::<f64>();
        let length_m = self.modes.length_m();
        let mut books = Books {
            stored: 0.0,
            power: 0.0,
            left_out: 0.0,
        };
        for ((q, qd), w2) in state.position.iter().zip(state.velocity).zip(&self.model.omega_squared) {
            books.stored += 0.5 * (qd * qd + w2 * q * q);
        }
        for (mass, yd) in self.car.inertia.iter().zip(yd) {
            books.stored += 0.5 * mass * yd * yd;
        }
        for spring in &self.car.springs {
            books.stored += 0.5 * spring.stiffness * stretched(&spring.lever).powi(2);
        }
        let v = SPEED_MPS;
        for contact in &self.car.contacts {
            let x = front_m - contact.behind_m;
            let on = match side {
                Side::Before => x > ON_THE_END && x < length_m + ON_THE_END,
                Side::After => x > -ON_THE_END && x < length_m - ON_THE_END,
            };
            let shape = |order| {
                if on {
                    self.modes.shape(contact.motion, order, x)
                } else {
                    [0.0; MODES]
                }
            };
            let [phi, turn, bend] = [shape(0), shape(1), shape(2)];
            let rough = self.track.at(contact.motion, x);
            let place = along(&phi, state.position) + rough.value;
            let slope = along(&turn, state.position) + rough.slope;
            let still_rate = along(&phi, state.velocity);
            let twist = along(&turn, state.velocity);
            let spring = contact.spring.stiffness * (stretched(&contact.spring.lever) - place);
            books.stored += 0.5 * spring * spring / contact.spring.stiffness;
            let (mass, weight) = (contact.unsprung, contact.load_n);
            match self.kinematics {
                Kinematics::Convective => {
                    let rate = still_rate + v * slope;
                    let acceleration = along(&phi, state.acceleration)
                        + 2.0 * v * twist
                        + v * v * (along(&bend, state.position) + rough.curvature);
                    let on_rail = -weight - mass * acceleration + spring;
                    books.stored += 0.5 * mass * rate * rate;
                    books.power += -weight * rate - on_rail * v * slope;
                }
                Kinematics::Paper => {
                    books.stored += 0.5 * mass * still_rate * still_rate;
                    books.power += -weight * still_rate - spring * v * slope;
                    books.left_out += mass * v * still_rate * twist;
                }
            }
        }
        books
    }
}

/// Takes every damper out of a car.
fn undamped(mut car: SpatialCar) -> SpatialCar {
    for spring in &mut car.springs {
        spring.damping = 0.0;
    }
    for contact in &mut car.contacts {
        contact.spring.damping = 0.0;
    }
    car
}

fn balance(
    model: &ModalModel,
    car: SpatialCar,
    track: Option<&dyn Track<f64>>,
    kinematics: Kinematics,
) -> Result<Balance> {
    let car = undamped(car);
    let ledger = Ledger {
        model,
        modes: SpatialModes::new(model),
        car: &car,
        track: track.unwrap_or(&Smooth),
        kinematics,
    };
    let train = alone(car.clone())?;
    let crossing = Crossing {
        model,
        train: &train,
        run: Run {
            kinematics,
            ..Run::at(SPEED_MPS)
        },
        track,
        scheme: Scheme::AverageAcceleration,
        step_s: STEP_S,
    };
    let steps = ((ledger.modes.length_m() + car.length_m()) / (SPEED_MPS * STEP_S)).round() as usize;
    let mut balance = Balance {
        work: Vec::new(),
        stored: Vec::new(),
        left_out: Vec::new(),
    };
    let mut before: Option<Books> = None;
    let (mut begun, mut work, mut left_out, mut step) = (0.0, 0.0, 0.0, 0);
    crossing.solve(steps, &mut |state| {
        step += 1;
        let Some(moving) = (state.car)(0) else { return };
        let front_m = f64::from(step) * SPEED_MPS * STEP_S;
        let of = |side| ledger.books(state, [moving.position(), moving.velocity()], front_m, side);
        let (arriving, leaving) = (of(Side::Before), of(Side::After));
        match &before {
            None => begun = arriving.stored,
            Some(before) => {
                work += 0.5 * STEP_S * (before.power + arriving.power);
                left_out += 0.5 * STEP_S * (before.left_out + arriving.left_out);
            }
        }
        balance.work.push(work + left_out);
        balance.stored.push(arriving.stored - begun);
        balance.left_out.push(left_out);
        // What a kink gives.
        work += leaving.stored - arriving.stored;
        before = Some(leaving);
    })?;
    Ok(balance)
}

fn rows() -> Result<Vec<Row>> {
    const SOURCE: &str = "first law";
    const TOLERANCE: f64 = 1e-5;
    const REASON: &str = "second order in the step of 0.1 ms";
    let girder = {
        let mut bridge = model::shipped("girder50")?;
        bridge.damping.ratio = 0.0;
        ModalModel::new(&Structure::new(bridge)?, &[], Wanted::Count(8))?
    };
    let truss = {
        let mut bridge = model::shipped("rdso45m")?;
        bridge.damping.ratio = 0.0;
        ModalModel::new(&Structure::new(bridge)?, &[], Wanted::Count(MODES))?
    };
    let rough = generate(
        Spectrum::Fra1,
        1,
        &Stretch {
            to_m: 80.0,
            ..Stretch::default()
        },
    )?;
    let rough: Option<&dyn Track<f64>> = Some(&rough);
    let mut rows = Vec::new();
    for (what, model, car, track, kinematics) in [
        (
            "inspection car, girder50",
            &girder,
            stock::inspection(),
            None,
            Kinematics::Convective,
        ),
        (
            "15-DOF car, girder50",
            &girder,
            stock::shinkansen(),
            None,
            Kinematics::Convective,
        ),
        (
            "15-DOF car, girder50, irregular track",
            &girder,
            stock::shinkansen(),
            rough,
            Kinematics::Convective,
        ),
        (
            "15-DOF car, rdso45m",
            &truss,
            stock::shinkansen(),
            None,
            Kinematics::Convective,
        ),
        (
            "15-DOF car, rdso45m, irregular track",
            &truss,
            stock::shinkansen(),
            rough,
            Kinematics::Convective,
        ),
        (
            "inspection car, girder50, paper's kinematics",
            &girder,
            stock::inspection(),
            None,
            Kinematics::Paper,
        ),
    ] {
        let balance = balance(model, car, track, kinematics)?;
        let most = largest(&balance.stored);
        let at = (balance.stored.iter())
            .position(|energy| energy.abs() == most)
            .context("energy")?;
        let apart: Vec<f64> = (balance.stored.iter().zip(&balance.work))
            .map(|(energy, work)| energy - work)
            .collect();
        let what = match kinematics {
            Kinematics::Convective => what.to_owned(),
            Kinematics::Paper => format!("{what} (left out: {:.1e} of it)", largest(&balance.left_out) / most),
        };
        let mut row = Row::new(what, SOURCE)
            .numbers(balance.work[at], balance.stored[at])
            .shown("J", 3)
            .within(TOLERANCE, REASON);
        row.difference = largest(&apart) / most;
        rows.push(row);
    }
    Ok(rows)
}
