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
//! `n` is the number of passages that the track was learnt from, `1/n` what their mean is uncertain by, and `t` the quantile of
//! Student's distribution of `n - 1` degrees of freedom (mean and deviation are themselves estimates) that one passage in a thousand years
//! exceeds by chance, at 200 a day. It follows from the normal quantile by Wallace's formula (Annals of Mathematical Statistics 30, 1959).
//!
//! A passage beyond the first limit is not believed, though one alone does not mean a change: it may be a train of another kind. One that is
//! not explained at all, or only by elements that gain stiffness, counts as beyond.
//!
//! Cost: 20 bytes.

use super::learnt::LearntTrack;
use crate::math::{self, Real};

/// Normal quantile that one in `200 * 365 * 1000` exceeds: see [`FALSE_ALARM`](crate::identify::evidence).
const QUANTILE: f32 = 5.55;
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
    Changed,
}

/// Memory of the test.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Watch {
    mean: f32,
    variance: f32,
    strikes: u8,
    changed: bool,
}

impl Watch {
    /// No passage yet.
    pub const NEW: Self = Self {
        mean: 0.0,
        variance: 0.0,
        strikes: 0,
        changed: false,
    };

    /// Whether the track has changed.
    pub fn has_changed(&self) -> bool {
        self.changed
    }

    /// Running mean of `z`.
    pub fn mean(&self) -> f32 {
        self.mean
    }

    /// Takes the `z` of a passage; none: it was not explained.
    pub fn judge(&mut self, learnt: &LearntTrack, z: Option<f32>) -> Finding {
        if !learnt.is_learnt() {
            return Finding::Same;
        }
        let limits = Limits::of(learnt.passages);
        // What is no number is beyond, too.
        let within = z.filter(|&z| z <= limits.single);
        match within {
            Some(z) => {
                self.strikes = 0;
                self.mean += FOLLOWS * (z - self.mean);
                self.variance = (1.0 - FOLLOWS) * (1.0 - FOLLOWS) * self.variance + FOLLOWS * FOLLOWS;
            }
            None => self.strikes = self.strikes.saturating_add(1),
        }
        let moved = self.mean > limits.mean(self.variance);
        if !self.changed && (self.strikes >= STRIKES || moved) {
            self.changed = true;
            return Finding::Changed;
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
    fn quantiles_are_those_of_students_distribution() {
        // Upper tail 1.43e-8 (normal: 5.550), by numerical integration of the density.
        for (passages, exact) in [(11, 15.32), (31, 7.422), (61, 6.377), (1001, 5.594)] {
            let student = Limits::of(passages).student;
            assert!(
                (student / exact - 1.0).abs() < 0.02,
                "{passages}: {student} for {exact}"
            );
        }
    }
}
