//! The unknowns of an identification as one vector, and what is known of each beforehand.
//!
//! ```text
//! theta = (x_1 .. x_10, s - 1, v / v0 - 1, t - t0, k / k0 - 1)
//! x_e = 1 / (1 - d_e) - 1    flexibility gained by element e, 0 .. 0.7 / 0.3
//! s   stiffness of the whole bridge, as a part of the model's      v, t, k   speed, entry time (s), load factor;  0: as expected
//! ```
//!
//! The elements' flexibilities stand for their losses `d_e`, because the girder's deflection is linear in the
//! flexibilities (exactly so, if it is statically determinate and at rest): the valley that a descent follows is straight, where
//! in the losses it is bent. Nothing is assumed of them but their bounds. Each of the others has a Gaussian prior about
//! what is expected, of the standard deviation that [`Ranges`](crate::wire::message::Ranges) gives, and is cut off at
//! [`CUT_OFF`] of it; with a range of 0 it is held.
//!
//! The cars' own loads, as parts of what their kind says, are not in `theta`: sixteen more unknowns would double it. They are marginalised
//! ([`Loads`]), with the prior that [`CAR_LOAD`] says.

use nalgebra::SVector;

use crate::bridge::{Damage, MAX_DAMAGE};
use crate::capacity::{CARS, ELEMENTS, UNKNOWNS};
use crate::interaction::sensitivity::{ENTRY, LOAD, SPEED, STIFFNESS};
use crate::interaction::{Hypothesis, Observation};

/// Standard deviations of its prior at which an unknown is cut off.
pub const CUT_OFF: f32 = 3.0;
/// No part may fall below this, whatever its prior says.
const LEAST: f32 = -0.8;

/// `theta`.
pub type Theta = SVector<f32, UNKNOWNS>;

/// Standard deviation of a car's load, as a part of it: passengers.
pub const CAR_LOAD: f32 = 0.02;

/// What each car's load is off by, as a part of it.
pub type Loads = SVector<f32, CARS>;

/// A point where a passage is compared with the physics.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Point {
    /// The unknowns.
    pub theta: Theta,
    /// The cars' loads.
    pub loads: Loads,
}

impl From<Theta> for Point {
    /// With cars that weigh what their kind says.
    fn from(theta: Theta) -> Self {
        Self {
            theta,
            loads: Loads::zeros(),
        }
    }
}

/// Minus twice the logarithm of what is known of the loads beforehand.
pub fn surprise(loads: &Loads) -> f32 {
    loads.dot(loads) / (CAR_LOAD * CAR_LOAD)
}

/// Bounds and priors of the unknowns.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Limits {
    /// Smallest value of each.
    pub lower: [f32; UNKNOWNS],
    /// Largest; one that is equal to the smallest holds the unknown.
    pub upper: [f32; UNKNOWNS],
    /// Inverse variance of the prior about 0.
    pub prior: [f32; UNKNOWNS],
}

impl Limits {
    /// Limits for a bridge of so many elements.
    pub fn new(elements: usize, observation: &Observation<f32>) -> Self {
        let mut limits = Self {
            lower: [0.0; UNKNOWNS],
            upper: [0.0; UNKNOWNS],
            prior: [0.0; UNKNOWNS],
        };
        for upper in limits.upper.iter_mut().take(elements.min(ELEMENTS)) {
            *upper = flexibility(MAX_DAMAGE as f32);
        }
        let ranges = observation.ranges;
        for (unknown, range, least) in [
            (STIFFNESS, ranges.stiffness, LEAST),
            (SPEED, ranges.speed, LEAST),
            (ENTRY, ranges.entry_s, f32::MIN),
            (LOAD, ranges.load, LEAST),
        ] {
            if range > 0.0 {
                limits.lower[unknown] = (-CUT_OFF * range).max(least);
                limits.upper[unknown] = CUT_OFF * range;
                limits.prior[unknown] = 1.0 / (range * range);
            }
        }
        limits
    }

    /// The unknowns that are not held.
    pub fn free(&self) -> [bool; UNKNOWNS] {
        core::array::from_fn(|i| self.lower[i] < self.upper[i])
    }

    /// Holds all elements whole.
    pub fn without_damage(mut self) -> Self {
        for upper in self.upper.iter_mut().take(ELEMENTS) {
            *upper = 0.0;
        }
        self
    }

    /// Holds element `e` whole.
    pub fn with_whole(mut self, e: usize) -> Self {
        if let Some(upper) = self.upper.iter_mut().take(ELEMENTS).nth(e) {
            *upper = 0.0;
        }
        self
    }

    /// The nearest vector within the bounds.
    pub fn nearest(&self, theta: &Theta) -> Theta {
        Theta::from_fn(|i, _| theta[i].max(self.lower[i]).min(self.upper[i]))
    }
}

/// Flexibility gained by an element that has lost the fraction `loss` of its stiffness, in units of the whole one's.
pub fn flexibility(loss: f32) -> f32 {
    1.0 / (1.0 - loss.clamp(0.0, MAX_DAMAGE as f32)) - 1.0
}

/// Fraction of stiffness lost, from the flexibility gained.
pub fn loss(flexibility: f32) -> f32 {
    (flexibility / (1.0 + flexibility)).clamp(0.0, MAX_DAMAGE as f32)
}

/// The elements' losses.
pub fn losses(theta: &Theta) -> Damage<f32> {
    core::array::from_fn(|e| loss(theta[e]))
}

/// `theta` with these losses.
pub fn with_losses(mut theta: Theta, damage: &Damage<f32>) -> Theta {
    for (x, &loss) in theta.iter_mut().zip(damage) {
        *x = flexibility(loss);
    }
    theta
}

/// What a point says of the passage that is observed.
pub fn hypothesis(Point { theta, loads }: &Point, observation: &Observation<f32>) -> Hypothesis<f32> {
    let mut hypothesis = observation.expected();
    for (car, load) in hypothesis.cars.iter_mut().zip(loads) {
        *car += load;
    }
    hypothesis.damage = losses(theta);
    hypothesis.stiffness *= 1.0 + theta[STIFFNESS];
    hypothesis.run.speed_mps *= 1.0 + theta[SPEED];
    hypothesis.run.entry_time_s += theta[ENTRY];
    hypothesis.run.load_factor *= 1.0 + theta[LOAD];
    hypothesis
}

/// Derivative of each quantity that [`Sensitivities`](crate::interaction::Sensitivities) differentiates by, by its entry of `theta`.
pub fn derivatives(theta: &Theta) -> Theta {
    Theta::from_fn(|i, _| match i {
        ENTRY => 1.0,
        STIFFNESS | SPEED | LOAD => 1.0 / (1.0 + theta[i]),
        e => {
            let left = 1.0 - loss(theta[e]);
            left * left
        }
    })
}
