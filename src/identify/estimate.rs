//! What a Gaussian about the elements' flexibilities says of their losses, and how surely.
//!
//! ```text
//! x_e = 1 / (1 - d_e) - 1                      flexibility gained by element e, 0 <= x_e <= 0.7 / 0.3
//! f(x) = x^T A x / 2 - b^T x                   minus the logarithm of the likelihood (Information: A and b)
//! damage        the minimum of f within the bounds
//! std           (1 - d_e)^2 (A^-1)_ee^1/2      of the unbounded problem
//! low, high     95 % of A^-1 b and (A^-1)_ee^1/2, Feldman and Cousins (interval.rs)
//! significance  (2 (min f with x_e = 0 - min f))^1/2, both minima within the bounds
//! ```
//!
//! **Why the significance decides and not `damage / std`.** The deviation of one element is what is left when all the others
//! may take any value. With a change that touches the whole bridge alike (its temperature) among the unknowns, or an element in
//! the mirror image of another's place, that is large: a loss here is as good as a gain of stiffness everywhere else. But
//! no element gains stiffness. The significance asks what would have to be true if element `e` were whole, the others being free to
//! lose stiffness instead, but not to gain it, and how many deviations the passages are away from that. Of two mirror
//! images it rejects neither, since each can stand in for the other; of one loss under an unknown temperature it rejects at
//! once that nothing has happened in that element, although its deviation is as large. It is the square root of a likelihood
//! ratio, and equals `x_e / std(x_e)` where no bound and no other element is touched.
//!
//! That no element gains stiffness also tests the model. Unbounded, a wrong speed, entry time or train is fitted best by
//! elements that gain and others that lose; the `contradiction`, `(2 (min f within the bounds - min f))^1/2`, says by how many
//! deviations the evidence asks for a gain. Beyond [`CONTRADICTION`] nothing is certain.
//!
//! The interval is that of the deviation, and as wide: it may reach down to 0 for an element that is certainly not whole. It
//! holds the true loss 95 % of the time, and says how much may be lost; the significance says whether anything is.
//!
//! What is less than [`RESOLUTION`] of the evidence is not counted in favour of an element's damage, since rounding could
//! have made it: two explanations that differ by so little are the same.
//!
//! An element of which nothing is known (or that only sums with others are known of) has `std` 1 and the interval `0 .. 0.7`.
//! Its significance follows from its definition and is 0 if nothing is known of it.
//!
//! Cost: a minimum within bounds ([`super::quadratic`]) for the estimate and one more for each element that has a loss;
//! about 4 kB of stack.

use nalgebra::SVector;

use super::interval::confidence;
use super::quadratic::{Minimum, Quadratic};
use super::unknowns::{flexibility, loss};
use crate::bridge::{Damage, MAX_DAMAGE};
use crate::capacity::ELEMENTS;
use crate::math;

/// An element is damaged beyond doubt if its damage exceeds this, a change worth an inspection, ...
pub const ALARM_DAMAGE: f32 = 0.05;
/// ... and this many standard deviations. With ten elements and 200 trains a day, Gaussian errors would exceed it by
/// chance once in five years.
pub const ALARM_DEVIATIONS: f32 = 5.0;
/// Beyond this the model is not of this bridge or of this train: it can only be made to fit if elements gain stiffness. The square
/// is at most a chi-square of as many degrees of freedom as there are elements, which exceeds 30 for ten of them once in a thousand
/// passages.
pub const CONTRADICTION: f32 = 5.5;
/// Two explanations can be told apart if they are this many deviations apart.
pub const TOLD_APART: f32 = 3.0;
/// Part of `x_e^2 A_ee`, summed over the elements, that rounding of the sums may make of a difference: ten times what `f32` leaves
/// of a sum of a few hundred passages.
pub const RESOLUTION: f32 = 1e-6;
/// Standard deviation of the damage of an element of which nothing is known: more than any damage.
const UNKNOWN: f32 = 1.0;
/// An element takes part in a joint stand-in if its flexibility grows by this part of the most that one's does.
const TAKES_PART: f32 = 0.25;

/// A Gaussian about the flexibilities `x` in information form: `matrix` is the inverse of the covariance, `matrix x = vector` at
/// the unbounded estimate. Rows of elements that a bridge does not have are zero. Informations of independent passages add.
pub type Information = Quadratic<ELEMENTS>;

/// The elements' losses. Entries beyond the bridge's elements are zero.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Estimate {
    /// Fraction of bending stiffness lost.
    pub damage: Damage<f32>,
    /// Its standard deviation, all other elements unknown and unbounded; 1 at most.
    pub std: Damage<f32>,
    /// Lower end of the 95 % interval.
    pub low: Damage<f32>,
    /// Upper end of the 95 % interval.
    pub high: Damage<f32>,
    /// Standard deviations by which it is out of the question that the element is whole.
    pub significance: [f32; ELEMENTS],
    /// Deviations by which the evidence contradicts that no element gains stiffness.
    pub contradiction: f32,
}

impl Estimate {
    /// Whether element `e` (from 0) is damaged beyond doubt.
    pub fn is_certain(&self, e: usize) -> bool {
        let sure = |(&damage, &significance): (&f32, &f32)| {
            damage > ALARM_DAMAGE && significance > ALARM_DEVIATIONS && self.contradiction < CONTRADICTION
        };
        self.damage.iter().zip(&self.significance).nth(e).is_some_and(sure)
    }

    /// Bit `e` is set where element `e` (from 0) is damaged beyond doubt.
    pub fn certain(&self) -> u16 {
        bits(|e| self.is_certain(e))
    }

    /// The element (from 0) that is least likely to be whole, and its significance.
    pub fn most_certain(&self) -> (usize, f32) {
        let significance = self.significance.into_iter().enumerate();
        significance.fold((0, 0.0), |most, (e, s)| if s > most.1 { (e, s) } else { most })
    }

    /// The largest loss of a single element that need not have been found certain.
    pub fn hidden(&self, elements: usize) -> f32 {
        (self.std.iter().take(elements))
            .fold(ALARM_DAMAGE, |most, std| most.max(ALARM_DEVIATIONS * std))
            .min(1.0)
    }
}

/// What would have to be true if an element were whole.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Rival {
    /// The losses that explain the passages best then.
    pub damage: Damage<f32>,
    /// By how many standard deviations they explain them worse.
    pub significance: f32,
}

impl Information {
    /// The losses of a bridge of so many elements. If the numbers are none, nothing is known of any element.
    pub fn estimate(&self, elements: usize) -> Estimate {
        let lacks = |e: usize| e >= elements;
        let nothing = Estimate {
            damage: [0.0; ELEMENTS],
            std: core::array::from_fn(|e| if lacks(e) { 0.0 } else { UNKNOWN }),
            low: [0.0; ELEMENTS],
            high: core::array::from_fn(|e| if lacks(e) { 0.0 } else { MAX_DAMAGE as f32 }),
            significance: [0.0; ELEMENTS],
            contradiction: 0.0,
        };
        let upper = self.upper(elements);
        let (Some(best), Some(centre), Some(variances)) = (self.within(&upper), self.centre(), self.variances()) else {
            return nothing;
        };
        let mut estimate = nothing;
        estimate.damage = losses(&best.at);
        // The slope is 0 at the centre, so all of the rise is in the square.
        let held_back = centre - best.at;
        let rise = held_back.dot(&(self.slope(&centre) - self.slope(&best.at)));
        // What is no number is no agreement.
        estimate.contradiction = if rise.is_nan() {
            f32::INFINITY
        } else {
            math::sqrt(rise.max(0.0))
        };
        for e in 0..elements.min(ELEMENTS) {
            if variances[e].is_finite() {
                let deviation = math::sqrt(variances[e]);
                let left = 1.0 - estimate.damage[e];
                estimate.std[e] = (left * left * deviation).min(UNKNOWN);
                let [low, high] = confidence(centre[e], deviation, flexibility(MAX_DAMAGE as f32)).map(loss);
                estimate.low[e] = low;
                estimate.high[e] = high;
            }
            if best.at[e] > 0.0 {
                let mut whole = upper;
                whole[e] = 0.0;
                let rival = self.within(&whole);
                estimate.significance[e] = rival.map_or(0.0, |rival| self.deviations(&best, &rival));
            }
        }
        estimate
    }

    /// What would have to be true if element `e` (from 0) of a bridge of so many were whole; none if the numbers are none.
    pub fn rival(&self, elements: usize, e: usize) -> Option<Rival> {
        let mut upper = self.upper(elements);
        let best = self.within(&upper)?;
        *upper.get_mut(e)? = 0.0;
        let rival = self.within(&upper)?;
        Some(Rival {
            damage: losses(&rival.at),
            significance: self.deviations(&best, &rival),
        })
    }

    /// The elements (bits, from 0) that cannot be told apart from element `e`, which has been found to have a loss.
    ///
    /// Such an element can stand in for `e`: with `e` whole, this one free and every other element at most as damaged as it was
    /// found, the passages are explained less than [`TOLD_APART`] deviations worse. If no element can do so alone but
    /// several together, these are given: all that the best explanation with `e` whole makes noticeably softer.
    ///
    /// The correlation in the covariance, which might seem to say the same, is not asked: with an unknown temperature all
    /// elements are correlated, and yet no loss of one can be taken for that of another, since it needs others to gain
    /// stiffness. An element whose loss is certain beyond [`TOLD_APART`] has none that could stand in for it.
    pub fn inseparable(&self, elements: usize, e: usize) -> u16 {
        self.stand_ins(elements, e).unwrap_or(0)
    }

    fn stand_ins(&self, elements: usize, e: usize) -> Option<u16> {
        let upper = self.upper(elements);
        let best = self.within(&upper)?;
        if *best.at.get(e)? <= 0.0 {
            return None;
        }
        let mut whole = upper;
        *whole.get_mut(e)? = 0.0;
        let rival = self.within(&whole)?;
        if self.deviations(&best, &rival) >= TOLD_APART {
            return None;
        }
        let alone = bits(|other| {
            let mut bounds: [f32; ELEMENTS] = core::array::from_fn(|i| best.at[i].min(whole[i]));
            match (bounds.get_mut(other), whole.get(other)) {
                (Some(bound), Some(&free)) if *bound < free => *bound = free,
                _ => return false,
            }
            let swapped = self.within(&bounds);
            swapped.is_some_and(|swapped| self.deviations(&best, &swapped) < TOLD_APART)
        });
        if alone != 0 {
            return Some(alone);
        }
        let growth = rival.at - best.at;
        let most = growth.iter().fold(0.0, |most: f32, &growth| most.max(growth));
        Some(bits(|other| {
            growth.get(other).is_some_and(|&growth| growth > TAKES_PART * most)
        }))
    }

    /// Most that each flexibility can have grown; nothing where nothing is known, so that no loss is invented there.
    fn upper(&self, elements: usize) -> [f32; ELEMENTS] {
        let known = self.known();
        core::array::from_fn(|e| {
            if e < elements && known[e] {
                flexibility(MAX_DAMAGE as f32)
            } else {
                0.0
            }
        })
    }

    /// The minimum between 0 and `upper`.
    fn within(&self, upper: &[f32; ELEMENTS]) -> Option<Minimum<ELEMENTS>> {
        let lower = [0.0; ELEMENTS];
        self.minimum(&lower, upper)
            .or_else(|| self.small_minimum(&lower, upper))
    }

    /// Deviations by which `rival`, of a smaller box, is worse than `best`, less what rounding may have made.
    fn deviations(&self, best: &Minimum<ELEMENTS>, rival: &Minimum<ELEMENTS>) -> f32 {
        let evidence = self.size(&best.at) + self.size(&rival.at);
        let resolution = RESOLUTION.max(best.ridge).max(rival.ridge);
        let rise = self.rise(best, &rival.at) - 0.5 * resolution * evidence;
        if rise > 0.0 { math::sqrt(2.0 * rise) } else { 0.0 }
    }
}

fn losses(flexibility: &SVector<f32, ELEMENTS>) -> Damage<f32> {
    core::array::from_fn(|e| loss(flexibility[e]))
}

/// Bit `e` is set where `is` holds for element `e`.
fn bits(is: impl Fn(usize) -> bool) -> u16 {
    (0..ELEMENTS).filter(|&e| is(e)).fold(0, |bits, e| bits | 1 << e)
}
