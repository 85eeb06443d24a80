//! What a bridge is to the solver: modes, and their shapes under a wheel.

use nalgebra::SVector;

use crate::bridge::ModalBridge;
use crate::math::{Real, entries};
use crate::train::Motion;

/// A bridge as `M` modes, mass-normalised, with their shapes along the way of the wheels.
pub trait Modes<T: Real, const M: usize> {
    /// Squared circular frequency of each mode, rad²/s².
    fn omega_squared(&self) -> &SVector<T, M>;
    /// Damping `2 xi omega` of each mode, 1/s.
    fn damping(&self) -> &SVector<T, M>;
    /// Length of the way, m.
    fn length_m(&self) -> T;
    /// Derivative of order `order` (0, 1 or 2) along the way of what a unit of each mode moves a wheelset by, at `x_m` from the
    /// way's beginning: kg^-1/2 (rad kg^-1/2 in [`Motion::Roll`]) per m^order. Beyond an end, its value there.
    fn shape(&self, motion: Motion, order: u8, x_m: T) -> [T; M];
}

/// Weights of the displacement and slope at the left and at the right end of a beam of length `length`, for the `order`-th
/// derivative of its deflection at the part `s` of it: exact Hermite shapes.
pub fn hermite<T: Real>(order: u8, s: T, length: T) -> [T; 4] {
    let [n2, n3, n4, n6, n12] = [2.0, 3.0, 4.0, 6.0, 12.0].map(T::of);
    let one = T::one();
    let r = length.recip();
    match order {
        0 => {
            let s2 = s * s;
            let rise = s2 * (n3 - n2 * s);
            let left = s - one;
            [one - rise, length * s * left * left, rise, length * s2 * left]
        }
        1 => {
            let fall = n6 * s * (s - one) * r;
            [fall, one + s * (n3 * s - n4), -fall, s * (n3 * s - n2)]
        }
        _ => {
            let bend = (n12 * s - n6) * r * r;
            [bend, (n6 * s - n4) * r, -bend, (n6 * s - n2) * r]
        }
    }
}

impl<T: Real, const M: usize> Modes<T, M> for ModalBridge<T, M> {
    fn omega_squared(&self) -> &SVector<T, M> {
        &self.omega_squared
    }

    fn damping(&self) -> &SVector<T, M> {
        &self.damping
    }

    fn length_m(&self) -> T {
        ModalBridge::length_m(self)
    }

    fn shape(&self, motion: Motion, order: u8, x_m: T) -> [T; M] {
        let Some((span, part, length)) = self.span(x_m).filter(|_| motion == Motion::Vertical) else {
            return [T::zero(); M];
        };
        let Some([left, right]) = self.path.get(span..span + 2).and_then(|ends| ends.first_chunk::<2>()) else {
            return [T::zero(); M];
        };
        let [w1, s1, w2, s2] = hermite(order, part, length);
        let [[left, left_slope], [right, right_slope]] =
            [left, right].map(|[value, slope]| [entries(value), entries(slope)]);
        core::array::from_fn(|k| left[k] * w1 + left_slope[k] * s1 + right[k] * w2 + right_slope[k] * s2)
    }
}
