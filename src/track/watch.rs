//! Whether the track is still the one that was learnt.
//!
//! A track that has changed leaves more of every passage unexplained. With `z` the logarithm of what is left over what is expected
//! to be, in the deviations that the healthy passages had ([`LearntTrack::misfit`]), these say that it has:
//!
//! ```text
//! z > t (1 + 1/n)^1/2                           in three passages one after another: the sudden, large change
//! m > t (v + 1/n)^1/2,  m <- m + q (z - m)      running mean of the last twenty, q = 1/20: the small one
//! v <- (1 - q)^2 v + q^2                        its variance, near q / (2 - q) after twenty passages
//! ```
//!
//! `n` is the number of passages that the track was learnt from and `t` a quantile of Student's distribution of `n - 1` degrees of freedom.
//!
//! **Where the limits come from.** The logarithms `x` of healthy passages are taken to be Gaussian and independent, with a mean and a
//! deviation of which only the estimates of `n` passages are known, `z = (x - mean) / deviation`. A sum `sum_i w_i x_i` less the estimated
//! mean (`sum_i w_i <= 1`) has the variance `sum_i w_i^2 + 1/n` at most in units of the true one, and that over the estimated
//! deviation is Student's (the predictive distribution: Gelman et al., Bayesian Data Analysis, 2014, section 3.2). A single passage is
//! `w = 1`. For `t` the probability is that of the other alarms, one in `200 * 365 * 1000`: one false alarm of each kind in a thousand years
//! at 200 passages a day, over all calibrations. `t` follows from the normal quantile by Wallace's formula (Annals of Mathematical Statistics
//! 30, 1959), which is never too small here: by a quarter too large for `n = 5`, by 2 % for 11, by less than 0.3 % from 21 on.
//!
//! A passage beyond the first limit is not believed, though one alone does not mean a change: it may be a train of another kind. One that is
//! not explained at all, or only by elements that gain stiffness, counts as beyond. None of these enters the mean, which one of them
//! would carry away. What leaves less than is expected is welcome, but counts for no more than what is as much too large.
//!
//! A small change is seen after passages that it was in were believed: what the evidence has gathered of late is given up then
//! ([`Evidence::forget_recent`](crate::identify::evidence::Evidence::forget_recent)). The test's memory is kept with the evidence.
//!
//! Cost: 24 bytes.

use serde::{Deserialize, Serialize};

use super::learnt::LearntTrack;
use crate::math::{self, Real};

/// Normal quantile that one in `200 * 365 * 1000` exceeds: see [`FALSE_ALARM`](crate::identify::evidence).
const QUANTILE: f32 = 5.557;
/// Part by which the running mean follows a passage.
const FOLLOWS: f32 = 1.0 / 20.0;
/// Passages beyond the limit, one after another, that mean a change.
const STRIKES: u8 = 3;

/// What a passage says of the track.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Finding {
    /// It is the one that was learnt.
    Same,
    /// Not of this passage.
    Another,
    /// This passage has shown that it has changed.
    Changed {
        /// Number of the passage from which on it seems to have been another one.
        since: u32,
        /// Whether passages were believed meanwhile.
        creeping: bool,
    },
}

/// Memory of the test. As bytes it is without the numbers of passages, which its logger counts anew after a restart.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct Watch {
    mean: f32,
    variance: f32,
    strikes: u8,
    /// The first of these strikes.
    #[serde(skip)]
    struck: u32,
    /// The passage with which the mean rose above zero for the last time.
    #[serde(skip)]
    risen: u32,
    changed: bool,
}

impl Watch {
    /// No passage yet.
    pub const NEW: Self = Self {
        mean: 0.0,
        variance: 0.0,
        strikes: 0,
        struck: 0,
        risen: 0,
        changed: false,
    };

    /// Whether its numbers can have come of passages.
    pub fn is_sound(&self) -> bool {
        self.mean.is_finite() && (0.0..=1.0).contains(&self.variance)
    }

    /// Whether the track has changed.
    pub fn has_changed(&self) -> bool {
        self.changed
    }

    /// Running mean of `z`.
    pub fn mean(&self) -> f32 {
        self.mean
    }

    /// Passages are numbered anew; those that were before the first are 0.
    pub fn renumber(&mut self) {
        (self.struck, self.risen) = (0, 0);
    }

    /// Takes the `z` of passage number `passage`; none: it was not explained.
    pub fn judge(&mut self, learnt: &LearntTrack, passage: u32, z: Option<f32>) -> Finding {
        if !learnt.is_learnt() {
            return Finding::Same;
        }
        let limits = Limits::of(learnt.passages);
        // What is no number is beyond, too.
        let within = z.filter(|&z| z <= limits.single);
        match within {
            Some(z) => {
                self.strikes = 0;
                let before = self.mean;
                self.mean += FOLLOWS * (z.max(-limits.single) - before);
                self.variance = (1.0 - FOLLOWS) * (1.0 - FOLLOWS) * self.variance + FOLLOWS * FOLLOWS;
                if before <= 0.0 && self.mean > 0.0 {
                    self.risen = passage;
                }
            }
            None => {
                if self.strikes == 0 {
                    self.struck = passage;
                }
                self.strikes = self.strikes.saturating_add(1);
            }
        }
        let struck = self.strikes >= STRIKES;
        if !self.changed && (struck || self.mean > limits.mean(self.variance)) {
            self.changed = true;
            return Finding::Changed {
                since: if struck { self.struck } else { self.risen },
                creeping: !struck,
            };
        }
        if self.changed || within.is_none() {
            Finding::Another
        } else {
            Finding::Same
        }
    }
}

/// The limits of both tests.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Limits {
    student: f32,
    inverse: f32,
    single: f32,
}

impl Limits {
    fn of(passages: u16) -> Self {
        let n = f32::from(passages).max(2.0);
        let freedom = n - 1.0;
        let z = QUANTILE * (8.0 * freedom + 3.0) / (8.0 * freedom + 1.0);
        let student = math::sqrt(freedom * (z * z / freedom).exp_m1_exact());
        let inverse = 1.0 / n;
        Self {
            student,
            inverse,
            single: student * math::sqrt(1.0 + inverse),
        }
    }

    fn mean(&self, variance: f32) -> f32 {
        self.student * math::sqrt(variance + self.inverse)
    }
}

/// Part by which what is left may be more than expected for long before that is seen.
pub fn unseen(learnt: &LearntTrack) -> f32 {
    let settled = FOLLOWS / (2.0 - FOLLOWS);
    (Limits::of(learnt.passages).mean(settled) * learnt.scatter).exp_m1_exact()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_are_those_of_students_distribution_and_never_too_small() {
        // Upper tail 1 / (200 * 365 * 1000) by its incomplete beta function, 30 digits; and by how much ours may exceed it.
        for (passages, exact, too_large) in [
            (5, 121.636, 0.27),
            (6, 58.5934, 0.14),
            (8, 26.5700, 0.06),
            (11, 15.3851, 0.02),
            (21, 8.769_95, 0.003),
            (31, 7.437_83, 0.0012),
            (61, 6.387_90, 3e-4),
            (201, 5.786_61, 2e-4),
            (1001, 5.601_91, 2e-4),
        ] {
            let excess = Limits::of(passages).student / exact - 1.0;
            assert!((-1e-4..too_large).contains(&excess), "{passages}: {excess}");
        }
    }
}
