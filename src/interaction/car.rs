//! A car's own step: its unknowns are eliminated with matrices that are computed once.
//!
//! With the predictors `y~ = y + h y' + h^2 (1/2 - beta) y''`, `y~' = y' + h/2 y''`, and `b` the unknown accelerations at the
//! end of the step, spring `s` exerts `f~_s = s . (k y~ + c y~')` and a little more for `b`. What the rails prescribe
//! at contact `i` without the bridge's unknown accelerations is `g~_i = k u~_i + c u~_i'`; with them, `u_i''` changes by
//! `w_i`, and the spring's foot by `eta_i w_i`, `eta = beta h^2 k + h c / 2`:
//!
//! ```text
//! A = M + sum_s eta_s s s^T                                      over all springs
//! b = b~ + sum_j r_j w_j,   A b~ = -sum_s s f~_s + sum_i s_i g~_i,   r_j = A^-1 s_j eta_j
//! F_i = F~_i - sum_j Z_ij w_j,   Z_ij = (m_i + eta_i) delta_ij - eta_i s_i . r_j     impedance, symmetric
//! F~_i = -W_i - m_i u~_i'' + f~_i - g~_i + eta_i s_i . b~
//! ```

use core::ops::Range;

use nalgebra::{Cholesky, SMatrix, SVector};

use super::run::SetupError;
use super::scheme::Scheme;
use crate::math::{Real, add_scaled, dot};
use crate::train::{Car, Spring};

/// What the rails do to a contact at the end of a step, the bridge's unknown accelerations aside.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Lead<T: Real> {
    /// Place, m (rad).
    pub place: T,
    /// Rate, m/s.
    pub rate: T,
    /// Acceleration, m/s².
    pub acceleration: T,
}

impl<T: Real> Lead<T> {
    /// Rails that do not move.
    pub fn still() -> Self {
        Self {
            place: T::zero(),
            rate: T::zero(),
            acceleration: T::zero(),
        }
    }
}

/// A kind of car, ready for steps of one length.
#[derive(Debug, Clone, PartialEq)]
pub struct CarSteps<T: Real, const D: usize, const C: usize> {
    /// `A^-1`, a row each; it is symmetric.
    inverse: [[T; D]; D],
    /// `eta` of each contact.
    eta: [T; C],
    /// `r` of each contact.
    response: [[T; D]; C],
    /// `Z`.
    pub(super) impedance: [[T; C]; C],
    /// Distance from the first wheelset to the last, m.
    pub(super) length_m: T,
    h: T,
    beta_h2: T,
}

/// Places of a car's degrees of freedom and their rates.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CarState<T: Real, const D: usize> {
    pub(super) position: [T; D],
    pub(super) velocity: [T; D],
    pub(super) acceleration: [T; D],
}

impl<T: Real, const D: usize> CarState<T, D> {
    /// A car at rest in its static balance.
    pub const AT_REST: Self = Self {
        position: [T::ZERO; D],
        velocity: [T::ZERO; D],
        acceleration: [T::ZERO; D],
    };

    /// `self += factor other`.
    pub(super) fn add_scaled(&mut self, factor: T, other: &Self) {
        add_scaled(&mut self.position, factor, &other.position);
        add_scaled(&mut self.velocity, factor, &other.velocity);
        add_scaled(&mut self.acceleration, factor, &other.acceleration);
    }

    /// `factor self`.
    pub(super) fn scaled(&self, factor: T) -> Self {
        let mut scaled = Self::AT_REST;
        scaled.add_scaled(factor, self);
        scaled
    }

    /// Place of each degree of freedom, m (rad) from static balance.
    pub fn position(&self) -> &[T] {
        self.position.as_slice()
    }

    /// Its rate, m/s.
    pub fn velocity(&self) -> &[T] {
        self.velocity.as_slice()
    }

    /// Its acceleration, m/s².
    pub fn acceleration(&self) -> &[T] {
        self.acceleration.as_slice()
    }
}

impl<T: Real, const D: usize, const C: usize> CarSteps<T, D, C> {
    /// Factorises the matrix of `car`.
    ///
    /// # Errors
    /// If a mass is not positive, or a spring so stiff that the step is not stable.
    pub fn new(car: &Car<T, D, C>, scheme: Scheme, step_s: T) -> Result<Self, SetupError> {
        let h = step_s;
        let beta_h2 = scheme.contact_beta::<T>() * h * h;
        let eta = |spring: &Spring<T, D>| beta_h2 * spring.stiffness + T::of(0.5) * h * spring.damping;
        if !car.inertia.iter().all(|&mass| mass > T::zero()) {
            return Err(SetupError::Masses);
        }
        let mut stiffness = SMatrix::<T, D, D>::zeros();
        let mut matrix = SMatrix::<T, D, D>::from_diagonal(&SVector::from(car.inertia));
        for spring in car.all_springs() {
            let lever = SVector::from(spring.lever);
            matrix.ger(eta(spring), &lever, &lever, T::one());
            stiffness.ger(spring.stiffness, &lever, &lever, T::one());
        }
        if let Some(limit) = scheme.stability_limit::<T>() {
            // Gershgorin's bound of M^-1/2 K M^-1/2.
            let root = car.inertia.map(|mass| mass.sqrt());
            for r in 0..D {
                let bound = (0..D).fold(T::zero(), |sum, c| sum + stiffness[(r, c)].abs() / (root[r] * root[c]));
                if bound * h * h > limit * limit {
                    return Err(SetupError::TooStiff);
                }
            }
        }
        let inverse = Cholesky::new(matrix).ok_or(SetupError::NotFinite)?.inverse();
        let mut steps = Self {
            inverse: core::array::from_fn(|r| core::array::from_fn(|c| inverse[(r, c)])),
            eta: [T::zero(); C],
            response: [[T::zero(); D]; C],
            impedance: [[T::zero(); C]; C],
            length_m: car.length_m(),
            h,
            beta_h2,
        };
        let own = steps.eta.iter_mut().zip(&mut steps.response);
        for (contact, (own_eta, response)) in car.contacts.iter().zip(own) {
            *own_eta = eta(&contact.spring);
            *response = steps.inverse.map(|row| dot(&row, &contact.spring.lever) * *own_eta);
        }
        let rows = steps.eta.iter().zip(&mut steps.impedance);
        for (i, (contact, (&eta, impedance))) in car.contacts.iter().zip(rows).enumerate() {
            for (j, (z, response)) in impedance.iter_mut().zip(&steps.response).enumerate() {
                let own = if i == j { contact.unsprung + eta } else { T::zero() };
                *z = own - eta * dot(&contact.spring.lever, response);
            }
        }
        Ok(steps)
    }

    /// Predicts `state`, and gives it the accelerations `b~` that it has if the bridge does not accelerate. Fills in `loads`, the
    /// contact forces `F~` without those of the static loads.
    pub fn predict(&self, car: &Car<T, D, C>, state: &mut CarState<T, D>, leads: &[Lead<T>; C], loads: &mut [T; C]) {
        let (h, half_h) = (self.h, T::of(0.5) * self.h);
        add_scaled(&mut state.position, h, &state.velocity);
        add_scaled(&mut state.position, half_h * h - self.beta_h2, &state.acceleration);
        add_scaled(&mut state.velocity, half_h, &state.acceleration);

        let mut force = [T::zero(); D];
        for spring in &car.springs {
            let pull = spring.stiffness * dot(&spring.lever, &state.position)
                + spring.damping * dot(&spring.lever, &state.velocity);
            add_scaled(&mut force, -pull, &spring.lever);
        }
        for ((contact, lead), load) in car.contacts.iter().zip(leads).zip(loads.iter_mut()) {
            let spring = &contact.spring;
            *load = spring.stiffness * (dot(&spring.lever, &state.position) - lead.place)
                + spring.damping * (dot(&spring.lever, &state.velocity) - lead.rate);
            add_scaled(&mut force, -*load, &spring.lever);
        }
        for (acceleration, row) in state.acceleration.iter_mut().zip(&self.inverse) {
            *acceleration = dot(row, &force);
        }
        for (((contact, lead), load), &eta) in car.contacts.iter().zip(leads).zip(loads).zip(&self.eta) {
            *load += eta * dot(&contact.spring.lever, &state.acceleration) - contact.unsprung * lead.acceleration;
        }
    }

    /// Adds `sum_ij phi_i Z_ij phi_j^T` to the upper triangle of the bridge's matrix, for the contacts `on` the bridge with
    /// `shapes` under them.
    #[allow(
        clippy::needless_range_loop,
        reason = "iterators cost the logger a tenth more instructions here"
    )]
    pub fn burden<const M: usize>(&self, on: Range<usize>, shapes: &[[T; M]; C], matrix: &mut [[T; M]; M]) {
        for i in on.start.min(C)..on.end.min(C) {
            let mut weighted = [T::zero(); M];
            if on.len() == C {
                // A loop of fixed length becomes straight code; a car with all its contacts is on the bridge for most of its way.
                for (&z, other) in self.impedance[i].iter().zip(shapes) {
                    add_scaled(&mut weighted, z, other);
                }
            } else {
                for j in on.start.min(C)..on.end.min(C) {
                    add_scaled(&mut weighted, self.impedance[i][j], &shapes[j]);
                }
            }
            let shape = &shapes[i];
            for r in 0..M {
                for c in r..M {
                    matrix[r][c] += shape[r] * weighted[c];
                }
            }
        }
    }

    /// Ends the step that [`Self::predict`] began: `w` is what the bridge's accelerations add to those of the rails.
    pub fn correct(&self, contacts: usize, state: &mut CarState<T, D>, w: &[T; C]) {
        for (response, &w) in self.response.iter().zip(w).take(contacts) {
            add_scaled(&mut state.acceleration, w, response);
        }
        add_scaled(&mut state.position, self.beta_h2, &state.acceleration);
        add_scaled(&mut state.velocity, T::of(0.5) * self.h, &state.acceleration);
    }
}
