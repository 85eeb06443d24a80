//! One step of the coupled system: predict, eliminate the cars, solve for the bridge, give the cars theirs.
//!
//! With the predictors `q~ = q + h q' + h^2 (1/2 - beta) q''`, `q~' = q' + h (1 - gamma) q''` (the same for the cars' `y`),
//! and `a`, `b` the unknown accelerations of bridge and car at the end of the step, contact `i` feels from the rail
//!
//! ```text
//! g_i = k u_i + c u_i'  = g~_i + G_i . a,   G_i = (beta h^2 k + gamma h c) phi_i + beta h^2 c v phi_i'
//! u_i'' = u~_i'' + U_i . a,                 U_i = phi_i + 2 gamma h v phi_i' + beta h^2 v^2 phi_i''
//! A b = sum_j s_j (g_j - f~_j),             A = M + gamma h C + beta h^2 K of the car,  f~_j = s_j . (k y~ + c y~')
//! F_i = -W_i - m_i u_i'' + f~_i - g_i + (beta h^2 k + gamma h c) s_i . b
//! ```
//!
//! so that `F_i = F~_i - R_i . a` with `R_i = m_i U_i + G_i - sum_j D_ij G_j` and the constant
//! `D_ij = (beta h^2 k + gamma h c) s_i . A^-1 s_j`, and the bridge's equation is
//!
//! ```text
//! (1 + gamma h C + beta h^2 W) a + sum_i phi_i (R_i . a) = sum_i phi_i F~_i - C q~' - W q~
//! ```
//!
//! Cost of a step with `m` modes and `n` contacts on the bridge, about: `m^3 / 3 + n (2 m^2 + 16 m)` multiplications.

use core::fmt;

use nalgebra::{SMatrix, SVector};
use serde::{Deserialize, Serialize};

use super::contact::Shape;
use crate::bridge::ModalBridge;
use crate::capacity::{CAR_DOFS, CARS, CARS_ON_BRIDGE, CONTACTS};
use crate::math::Real;
use crate::train::Train;

/// Newmark's average acceleration.
const BETA: f64 = 0.25;
const GAMMA: f64 = 0.5;

/// How a train runs over the bridge.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Run<T: Real> {
    /// Speed, m/s.
    pub speed_mps: T,
    /// Time at which the first contact reaches node 1, s.
    pub entry_time_s: T,
    /// Scales the static loads.
    pub load_factor: T,
    /// What moves a wheel besides the rail's own motion.
    pub kinematics: Kinematics,
}

/// How the rail's motion under a rolling wheel is taken.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum Kinematics {
    /// As the paper does (its coupling matrices in Eq. 45 are symmetric): `u' = phi . q'`, `u'' = phi . q''`.
    #[default]
    Paper,
    /// The full derivatives along the wheel's way: the deflected rail is also a slope and a curve to roll over. For one
    /// inspection car on girder50 at 60 km/h this changes the acceleration by 1 % (relative RMS), the displacement by
    /// 0.02 %.
    Convective,
}

/// Why a run cannot be solved.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum SetupError {
    /// Speed, load factor, entry time or step are not positive finite numbers (the entry may be any finite time).
    NotFinite,
    /// More cars than [`CARS`], or none.
    Cars,
    /// More cars touch the bridge at once than [`CARS_ON_BRIDGE`].
    TooManyOnBridge,
    /// A sensor sits where the bridge model has none.
    NoSuchSensor,
}

impl fmt::Display for SetupError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NotFinite => f.write_str("speed, load factor and step must be positive, the entry time finite"),
            Self::Cars => write!(f, "a train has 1 to {CARS} cars"),
            Self::TooManyOnBridge => write!(f, "more than {CARS_ON_BRIDGE} cars would be on the bridge at once"),
            Self::NoSuchSensor => f.write_str("the bridge model has no sensor place at that node"),
        }
    }
}

impl core::error::Error for SetupError {}

/// Bounce and pitch of one car, with their rates.
#[derive(Debug, Clone, Copy)]
struct CarState<T: Real> {
    position: [T; CAR_DOFS],
    velocity: [T; CAR_DOFS],
    acceleration: [T; CAR_DOFS],
}

impl<T: Real> CarState<T> {
    fn at_rest() -> Self {
        let zero = [T::zero(); CAR_DOFS];
        Self {
            position: zero,
            velocity: zero,
            acceleration: zero,
        }
    }
}

/// What a contact on the bridge adds to the step.
#[derive(Debug, Clone, Copy)]
struct Grip<T: Real, const M: usize> {
    shape: Shape<T, M>,
    /// `g~`: spring force from the predicted rail.
    predicted_force: T,
    /// `G`: what the bridge's accelerations add to it.
    influence: SVector<T, M>,
}

/// The bridge with one damage pattern and a train running over it.
///
/// A slow car over one sine mode of a 50 m beam bends it nearly as its standing loads would. A standing train, though, is
/// no run:
///
/// ```
/// use nalgebra::SVector;
/// use spanwatch::bridge::ModalBridge;
/// use spanwatch::interaction::{Interaction, Kinematics, Run, SetupError};
/// use spanwatch::train::Train;
/// use spanwatch::wire::message::TrainKind;
///
/// // m = 5000 kg/m, f1 = 3.5 Hz, mass-normalised: sqrt(2 / (m L)) sin(pi x / L), a node every 5 m, a sensor at mid-span.
/// let norm = (2.0 / (5000.0 * 50.0_f64)).sqrt();
/// let wave = std::f64::consts::PI / 50.0;
/// let position_m = std::array::from_fn(|node| 5.0 * node as f64);
/// let omega_squared = (std::f64::consts::TAU * 3.5).powi(2);
/// let bridge = ModalBridge::<f64, 1> {
///     omega_squared: SVector::from([omega_squared]),
///     damping: SVector::from([2.0 * 0.02 * omega_squared.sqrt()]),
///     position_m,
///     nodes: 11,
///     path: position_m.map(|x| [SVector::from([norm * (wave * x).sin()]), SVector::from([norm * wave * (wave * x).cos()])]),
///     sensors: [SVector::from([norm]); 3],
/// };
/// let train = Train::of_kind(TrainKind::Inspection2Dof, 1).expect("one car");
/// let run = Run { speed_mps: 2.0, entry_time_s: 0.0, load_factor: 1.0, kinematics: Kinematics::Paper };
///
/// let mut solver = Interaction::new(bridge.clone(), train, run, 1e-3)?;
/// let mut lowest_m = 0.0_f64;
/// for _ in 0..34_000 {
///     solver.step();
///     lowest_m = lowest_m.min(solver.displacement_m(0));
/// }
/// // Its two loads at 8.75 m before and behind mid-span.
/// let load_n = train.car.contacts[0].load_n;
/// let standing_m = -2.0 * load_n * norm * norm * (wave * 8.75).cos() / omega_squared;
/// assert!((lowest_m / standing_m - 1.0).abs() < 0.01);
///
/// let standing = Interaction::new(bridge, train, Run { speed_mps: 0.0, ..run }, 1e-3);
/// assert_eq!(standing.err(), Some(SetupError::NotFinite));
/// # Ok::<(), SetupError>(())
/// ```
#[derive(Debug, Clone)]
pub struct Interaction<T: Real, const M: usize> {
    bridge: ModalBridge<T, M>,
    train: Train<T>,
    run: Run<T>,
    step_s: T,
    steps: u32,
    /// `A^-1 s_j` of each contact (rows) of a car.
    compliance: [[T; CAR_DOFS]; CONTACTS],
    /// `1 + gamma h C + beta h^2 W` of each mode.
    effective: SVector<T, M>,
    position: SVector<T, M>,
    velocity: SVector<T, M>,
    acceleration: SVector<T, M>,
    /// States of the cars that touch the bridge, car `c` at place `c % CARS_ON_BRIDGE`.
    cars: [CarState<T>; CARS_ON_BRIDGE],
    /// Cars that have entered the bridge so far.
    entered: usize,
}

impl<T: Real, const M: usize> Interaction<T, M> {
    /// Bridge and train at rest at time 0, to be solved in steps of `step_s`. A train whose entry lies before time 0 stands
    /// where its way has brought it, and its loads appear at once.
    ///
    /// # Errors
    /// [`SetupError`] says which of speed, load factor, times and cars cannot be solved.
    pub fn new(bridge: ModalBridge<T, M>, train: Train<T>, run: Run<T>, step_s: T) -> Result<Self, SetupError> {
        let positive = |value: T| value > T::zero() && value.is_finite();
        if ![run.speed_mps, run.load_factor, step_s].into_iter().all(positive) || !run.entry_time_s.is_finite() {
            return Err(SetupError::NotFinite);
        }
        if !(1..=CARS).contains(&train.cars) {
            return Err(SetupError::Cars);
        }
        let touching = (bridge.length_m() + train.car.length_m()) / train.pitch_m;
        if train.cars > CARS_ON_BRIDGE && touching >= T::of(CARS_ON_BRIDGE as f64) {
            return Err(SetupError::TooManyOnBridge);
        }
        let h = step_s;
        let (beta_h2, gamma_h) = (T::of(BETA) * h * h, T::of(GAMMA) * h);
        let contacts = &train.car.contacts;
        let matrix = SMatrix::<T, CAR_DOFS, CAR_DOFS>::from_fn(|r, c| {
            let inertia = if r == c { train.car.inertia[r] } else { T::zero() };
            contacts.iter().fold(inertia, |sum, contact| {
                let dynamic = beta_h2 * contact.stiffness_npm + gamma_h * contact.damping_nspm;
                sum + dynamic * contact.lever[r] * contact.lever[c]
            })
        });
        let inverse = matrix.cholesky().ok_or(SetupError::NotFinite)?;
        let compliance = contacts.map(|contact| inverse.solve(&SVector::from(contact.lever)).into());
        let effective = bridge
            .omega_squared
            .zip_map(&bridge.damping, |w2, c| T::one() + gamma_h * c + beta_h2 * w2);
        Ok(Self {
            bridge,
            train,
            run,
            step_s,
            steps: 0,
            compliance,
            effective,
            position: SVector::zeros(),
            velocity: SVector::zeros(),
            acceleration: SVector::zeros(),
            cars: [CarState::at_rest(); CARS_ON_BRIDGE],
            entered: 0,
        })
    }

    /// Acceleration at observed sensor `channel`, m/s², positive up.
    pub fn acceleration_mps2(&self, channel: usize) -> T {
        self.bridge.sensors[channel].dot(&self.acceleration)
    }

    /// Displacement at observed sensor `channel`, m, positive up.
    pub fn displacement_m(&self, channel: usize) -> T {
        self.bridge.sensors[channel].dot(&self.position)
    }

    /// Advances by one step.
    pub fn step(&mut self) {
        self.steps += 1;
        let h = self.step_s;
        let (beta_h2, gamma_h) = (T::of(BETA) * h * h, T::of(GAMMA) * h);
        let rest_h2 = T::of(0.5 - BETA) * h * h;
        let rest_h = T::of(1.0 - GAMMA) * h;

        // The bridge, predicted.
        self.position += self.velocity * h + self.acceleration * rest_h2;
        self.velocity += self.acceleration * rest_h;
        let mut force = -(self.bridge.damping.component_mul(&self.velocity)
            + self.bridge.omega_squared.component_mul(&self.position));
        let mut matrix = SMatrix::<T, M, M>::from_diagonal(&self.effective);

        // The cars on it: predicted, and eliminated.
        let speed = self.run.speed_mps;
        let front = T::of(f64::from(self.steps)) * (speed * h) - speed * self.run.entry_time_s;
        let mut grips: [[Option<Grip<T, M>>; CONTACTS]; CARS_ON_BRIDGE] = [[None; CONTACTS]; CARS_ON_BRIDGE];
        let mut aboard = 0..0;
        let (length, car_length) = (self.bridge.length_m(), self.train.car.length_m());
        for car in 0..self.train.cars.min(CARS) {
            let car_front = front - self.train.pitch_m * T::of(car as f64);
            if car_front < T::zero() {
                break;
            }
            // Until its last contact has left: on a bridge shorter than the car, the body swings on while none touches.
            if car_front - car_length > length {
                continue;
            }
            if car >= self.entered {
                self.cars[car % CARS_ON_BRIDGE] = CarState::at_rest();
                self.entered = car + 1;
            }
            let on: [Option<Shape<T, M>>; CONTACTS] =
                core::array::from_fn(|i| self.bridge.shape_at(car_front - self.train.car.contacts[i].behind_m));
            let first = if aboard.is_empty() { car } else { aboard.start };
            aboard = first..car + 1;
            let Some(grip) = grips.get_mut(car - first) else { break };
            self.couple(car, &on, grip, &mut matrix, &mut force);
        }

        if aboard.is_empty() {
            self.acceleration = force.component_div(&self.effective);
        } else {
            solve(&mut matrix, &mut force);
            self.acceleration = force;
        }
        self.position += self.acceleration * beta_h2;
        self.velocity += self.acceleration * gamma_h;

        for (grip, car) in grips.iter().zip(aboard) {
            self.release(car, grip);
        }
    }

    /// Predicts car `car`, whose contacts stand `on` the bridge, and adds it to the bridge's equations.
    fn couple(
        &mut self,
        car: usize,
        on: &[Option<Shape<T, M>>; CONTACTS],
        grips: &mut [Option<Grip<T, M>>; CONTACTS],
        matrix: &mut SMatrix<T, M, M>,
        force: &mut SVector<T, M>,
    ) {
        let h = self.step_s;
        let v = match self.run.kinematics {
            Kinematics::Paper => T::zero(),
            Kinematics::Convective => self.run.speed_mps,
        };
        let (beta_h2, gamma_h) = (T::of(BETA) * h * h, T::of(GAMMA) * h);
        let two = T::of(2.0);
        let contacts = &self.train.car.contacts;

        let state = &mut self.cars[car % CARS_ON_BRIDGE];
        for d in 0..CAR_DOFS {
            state.position[d] += h * (state.velocity[d] + T::of(0.5 - BETA) * h * state.acceleration[d]);
            state.velocity[d] += T::of(1.0 - GAMMA) * h * state.acceleration[d];
        }
        // e~_i = f~_i - g~_i: what each spring would push with if nothing accelerated.
        let mut push = [T::zero(); CONTACTS];
        for (((contact, shape), grip), push) in contacts.iter().zip(on).zip(grips.iter_mut()).zip(&mut push) {
            let (k, c) = (contact.stiffness_npm, contact.damping_nspm);
            let rise = dot(&contact.lever, &state.position);
            let rate = dot(&contact.lever, &state.velocity);
            *push = k * rise + c * rate;
            if let Some(shape) = shape {
                let rail = shape.value.dot(&self.position);
                let rail_rate = shape.value.dot(&self.velocity) + v * shape.slope.dot(&self.position);
                let predicted_force = k * rail + c * rail_rate;
                let influence = shape.value * (beta_h2 * k + gamma_h * c) + shape.slope * (beta_h2 * c * v);
                *push -= predicted_force;
                *grip = Some(Grip {
                    shape: *shape,
                    predicted_force,
                    influence,
                });
            }
        }
        for (i, (contact, grip)) in contacts.iter().zip(grips.iter()).enumerate() {
            let Some(Grip { shape, influence, .. }) = grip else {
                continue;
            };
            let mass = contact.unsprung_kg;
            let rail_acceleration =
                two * v * shape.slope.dot(&self.velocity) + v * v * shape.curvature.dot(&self.position);
            let mut load = push[i] - self.run.load_factor * contact.load_n - mass * rail_acceleration;
            let mut row = shape.value * mass
                + shape.slope * (two * gamma_h * v * mass)
                + shape.curvature * (beta_h2 * v * v * mass)
                + influence;
            let dynamic = beta_h2 * contact.stiffness_npm + gamma_h * contact.damping_nspm;
            for (j, other) in grips.iter().enumerate() {
                let d = dynamic * dot(&contact.lever, &self.compliance[j]);
                load -= d * push[j];
                if let Some(other) = other {
                    row -= other.influence * d;
                }
            }
            *force += shape.value * load;
            matrix.ger(T::one(), &shape.value, &row, T::one());
        }
    }

    /// Gives car `car` its accelerations, the bridge's being known.
    fn release(&mut self, car: usize, grips: &[Option<Grip<T, M>>; CONTACTS]) {
        let h = self.step_s;
        let state = &mut self.cars[car % CARS_ON_BRIDGE];
        let mut acceleration = [T::zero(); CAR_DOFS];
        for ((contact, grip), compliance) in self.train.car.contacts.iter().zip(grips).zip(&self.compliance) {
            let rise = dot(&contact.lever, &state.position);
            let rate = dot(&contact.lever, &state.velocity);
            let rail = grip.map_or(T::zero(), |g| g.predicted_force + g.influence.dot(&self.acceleration));
            let pull = rail - (contact.stiffness_npm * rise + contact.damping_nspm * rate);
            for (a, &s) in acceleration.iter_mut().zip(compliance) {
                *a += s * pull;
            }
        }
        for (d, &a) in acceleration.iter().enumerate() {
            state.position[d] += T::of(BETA) * h * h * a;
            state.velocity[d] += T::of(GAMMA) * h * a;
        }
        state.acceleration = acceleration;
    }
}

fn dot<T: Real, const N: usize>(a: &[T; N], b: &[T; N]) -> T {
    a.iter().zip(b).fold(T::zero(), |sum, (&x, &y)| sum + x * y)
}

/// Solves `matrix x = rhs` in place by elimination without pivoting.
///
/// The matrix is the positive diagonal of the free bridge plus the positive shares of masses, springs and dampers on it;
/// only the convective terms, some per cent of these, are not symmetric. So the pivots stay well above zero.
fn solve<T: Real, const M: usize>(matrix: &mut SMatrix<T, M, M>, rhs: &mut SVector<T, M>) {
    for p in 0..M {
        let inverse = matrix[(p, p)].recip();
        for r in p + 1..M {
            let factor = matrix[(r, p)] * inverse;
            for c in p + 1..M {
                let above = matrix[(p, c)];
                matrix[(r, c)] -= factor * above;
            }
            let above = rhs[p];
            rhs[r] -= factor * above;
        }
    }
    for p in (0..M).rev() {
        let mut value = rhs[p];
        for c in p + 1..M {
            value -= matrix[(p, c)] * rhs[c];
        }
        rhs[p] = value / matrix[(p, p)];
    }
}
