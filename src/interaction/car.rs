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

use nalgebra::{Cholesky, SMatrix, SVector};

use super::run::SetupError;
use super::scheme::Scheme;
use crate::math::Real;
use crate::train::Car;

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
    /// `A^-1`.
    inverse: SMatrix<T, D, D>,
    /// `eta` of each contact.
    eta: [T; C],
    /// `r` of each contact, a column each.
    response: SMatrix<T, D, C>,
    /// `Z`.
    pub impedance: SMatrix<T, C, C>,
    h: T,
    beta_h2: T,
}

/// Places of a car's degrees of freedom and their rates.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CarState<T: Real, const D: usize> {
    position: SVector<T, D>,
    velocity: SVector<T, D>,
    acceleration: SVector<T, D>,
}

impl<T: Real, const D: usize> CarState<T, D> {
    /// A car at rest in its static balance.
    pub fn at_rest() -> Self {
        let zero = SVector::zeros();
        Self {
            position: zero,
            velocity: zero,
            acceleration: zero,
        }
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
        let eta = |stiffness: T, damping: T| beta_h2 * stiffness + T::of(0.5) * h * damping;
        if !car.inertia.iter().all(|&mass| mass > T::zero()) {
            return Err(SetupError::Masses);
        }
        let mut stiffness = SMatrix::<T, D, D>::zeros();
        let mut matrix = SMatrix::<T, D, D>::from_diagonal(&SVector::from(car.inertia));
        for spring in car.all_springs() {
            let lever = SVector::from(spring.lever);
            matrix.ger(eta(spring.stiffness, spring.damping), &lever, &lever, T::one());
            stiffness.ger(spring.stiffness, &lever, &lever, T::one());
        }
        if let Some(limit) = scheme.stability_limit::<T>() {
            // Gershgorin's bound of M^-1/2 K M^-1/2.
            let root = SVector::<T, D>::from(car.inertia).map(|mass| mass.sqrt());
            for r in 0..D {
                let bound = (0..D).fold(T::zero(), |sum, c| sum + stiffness[(r, c)].abs() / (root[r] * root[c]));
                if bound * h * h > limit * limit {
                    return Err(SetupError::TooStiff);
                }
            }
        }
        let inverse = Cholesky::new(matrix).ok_or(SetupError::NotFinite)?.inverse();
        let mut steps = Self {
            inverse,
            eta: [T::zero(); C],
            response: SMatrix::zeros(),
            impedance: SMatrix::zeros(),
            h,
            beta_h2,
        };
        for (i, contact) in car.contacts.iter().enumerate() {
            steps.eta[i] = eta(contact.spring.stiffness, contact.spring.damping);
            let column = product(&inverse, &SVector::from(contact.spring.lever)) * steps.eta[i];
            steps.response.set_column(i, &column);
        }
        for (i, contact) in car.contacts.iter().enumerate() {
            for j in 0..car.contacts.len() {
                let own = if i == j {
                    contact.unsprung + steps.eta[i]
                } else {
                    T::zero()
                };
                let lever = SVector::from(contact.spring.lever);
                steps.impedance[(i, j)] = own - steps.eta[i] * lever.dot(&steps.response.column(j));
            }
        }
        Ok(steps)
    }

    /// Predicts `state`, and gives it the accelerations `b~` that it has if the bridge does not accelerate. Fills in `loads`, the
    /// contact forces `F~` without those of the static loads.
    pub fn predict(&self, car: &Car<T, D, C>, state: &mut CarState<T, D>, leads: &[Lead<T>; C], loads: &mut [T; C]) {
        let (h, half_h) = (self.h, T::of(0.5) * self.h);
        state.position += state.velocity * h + state.acceleration * (half_h * h - self.beta_h2);
        state.velocity += state.acceleration * half_h;

        let mut force = SVector::<T, D>::zeros();
        for spring in &car.springs {
            let lever = SVector::from(spring.lever);
            let pull = spring.stiffness * lever.dot(&state.position) + spring.damping * lever.dot(&state.velocity);
            force.axpy(-pull, &lever, T::one());
        }
        for ((contact, lead), load) in car.contacts.iter().zip(leads).zip(loads.iter_mut()) {
            let spring = &contact.spring;
            let lever = SVector::from(spring.lever);
            *load = spring.stiffness * (lever.dot(&state.position) - lead.place)
                + spring.damping * (lever.dot(&state.velocity) - lead.rate);
            force.axpy(-*load, &lever, T::one());
        }
        state.acceleration = product(&self.inverse, &force);
        for (((contact, lead), load), &eta) in car.contacts.iter().zip(leads).zip(loads).zip(&self.eta) {
            let lever = SVector::from(contact.spring.lever);
            *load += eta * lever.dot(&state.acceleration) - contact.unsprung * lead.acceleration;
        }
    }

    /// Ends the step that [`Self::predict`] began: `w` is what the bridge's accelerations add to those of the rails.
    pub fn correct(&self, contacts: usize, state: &mut CarState<T, D>, w: &[T; C]) {
        for (response, &w) in self.response.column_iter().zip(w).take(contacts) {
            state.acceleration.axpy(w, &response, T::one());
        }
        state.position.axpy(self.beta_h2, &state.acceleration, T::one());
        state.velocity.axpy(T::of(0.5) * self.h, &state.acceleration, T::one());
    }
}

/// `matrix vector`, column by column, so that no kernel fuses it.
fn product<T: Real, const R: usize, const N: usize>(
    matrix: &SMatrix<T, R, N>,
    vector: &SVector<T, N>,
) -> SVector<T, R> {
    let mut sum = SVector::<T, R>::zeros();
    for (column, &factor) in matrix.column_iter().zip(vector.iter()) {
        sum.axpy(factor, &column, T::one());
    }
    sum
}
