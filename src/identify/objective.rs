//! The misfit of a hypothesis: simulated against recorded motion, in the recorder's band.
//!
//! ```text
//! OBJ = 1 / (n c) sum_i sum_c (f_ic - f*_ic)^2        n samples of c channels                     (paper's Eq. 46)
//! chi^2 = sum_c w_c sum_i (f_ic - f*_ic)^2,  w_c = 1 / variance of the noise of channel c
//! ```
//!
//! The first is what the paper's search minimises and what is reported. The second weighs each channel by its noise, so that
//! accelerations and displacements, good sensors and poor ones can be told at once. The noise is not known beforehand: its
//! variance is the mean square of what the best hypothesis so far leaves, which makes the minimum that of the
//! likelihood with unknown variances, `sum_c n_c ln(sum_i (f_ic - f*_ic)^2)`.
//!
//! What the bridge did after the train had left can stand for the samples of that time, as natural frequencies (and damping
//! ratios) that are known to a stated deviation: [`Terms`].
//!
//! ```text
//! Q = chi^2 + sum_k ((fn_k - fn*_k) / std_k)^2 [+ the same of xi_k]                                    k the tail's modes
//! ```
//!
//! Their weights are given, not estimated: they count as they stand whatever the samples leave. The genetic search does without them.
//! Its codes are a tenth apart, a frequency is known to a ten-thousandth: of codes it would choose the one whose rounding happens to
//! suit the frequency.

use heapless::Vec;

use super::free_vibration::{Compared, Factors, TAIL_MODES, Term};
use super::quadratic::Quadratic;
use super::unknowns::{Theta, losses};
use crate::bridge::{Damage, ReducedBridge};
use crate::capacity::{CHANNELS, ELEMENTS, MODES, UNKNOWNS};
use crate::interaction::sensitivity::STIFFNESS;
use crate::interaction::{Hypothesis, Observation, SetupError, Simulation};
use crate::passage::samples::Samples;
use crate::track::learnt::LearntTrack;

/// Part of a channel's power that counts as its noise at least: the square of what `f32` and the step leave in the
/// solution, 1e-4 of the signal.
pub const EXPLAINED: f32 = 1e-8;

/// A recorded passage and the physics that should explain it.
#[derive(Debug, Clone, Copy)]
pub struct Problem<'a> {
    /// The bridge.
    pub bridge: &'a ReducedBridge<f32>,
    /// What was learnt of the track.
    pub track: &'a LearntTrack,
    /// Train, sensors and recorder; time 0 is that of the first sample.
    pub observation: &'a Observation<f32>,
    /// What was recorded, m/s² (m), channel after channel within a sample; not-a-number where there is none.
    pub samples: Samples<'a>,
    /// What the bridge did after the last of these samples, if that is to be compared, too.
    pub free_vibration: Option<Compared<'a>>,
}

/// The rows that a free vibration adds to `Q` at one `theta`, in units of their deviations.
///
/// 360 bytes; to be passed by reference.
#[derive(Debug, Clone, PartialEq)]
pub struct Terms {
    /// Of the frequencies, then of the damping ratios.
    pub rows: Vec<Term, { 2 * TAIL_MODES }>,
}

/// Sums of squares over the recorded samples of each channel.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Squares {
    /// Sum of squares.
    pub sum: [f32; CHANNELS],
    /// Samples.
    pub count: [f32; CHANNELS],
}

impl Squares {
    /// Nothing yet.
    pub const NONE: Self = Self {
        sum: [0.0; CHANNELS],
        count: [0.0; CHANNELS],
    };

    /// Residuals of what cannot be.
    pub const HOPELESS: Self = Self {
        sum: [f32::INFINITY; CHANNELS],
        count: [1.0; CHANNELS],
    };

    /// Adds a sample's values; those that are not numbers are passed over.
    pub fn add(&mut self, values: impl IntoIterator<Item = f32>) {
        for ((sum, count), value) in self.sum.iter_mut().zip(&mut self.count).zip(values) {
            if !value.is_nan() {
                *sum += value * value;
                *count += 1.0;
            }
        }
    }

    /// Values, over all channels; at least 1.
    pub fn values(&self) -> f32 {
        self.count.iter().sum::<f32>().max(1.0)
    }

    /// Mean square of channel `c`; 0 if there is none.
    pub fn mean_of(&self, c: usize) -> f32 {
        match (self.sum.get(c), self.count.get(c)) {
            (Some(sum), Some(&count)) if count > 0.0 => sum / count,
            _ => 0.0,
        }
    }

    /// Mean square over all channels: [`OBJ`](self) if these are residuals.
    pub fn mean(&self) -> f32 {
        self.sum.iter().sum::<f32>() / self.values()
    }

    /// Weights with which each of these channels has a mean square of 1, if they are not below [`EXPLAINED`] of `power`'s.
    pub fn weights(&self, power: &Self) -> [f32; CHANNELS] {
        core::array::from_fn(|c| {
            let least = EXPLAINED * power.sum[c];
            if self.count[c] > 0.0 && power.sum[c] > 0.0 {
                self.count[c] / self.sum[c].max(least)
            } else {
                0.0
            }
        })
    }

    /// The weighted sum.
    pub fn weighted(&self, weights: &[f32; CHANNELS]) -> f32 {
        let mut sum = 0.0;
        for (square, weight) in self.sum.iter().zip(weights) {
            sum += square * weight;
        }
        sum
    }

    /// Part of `power` that these residuals are, on average over the channels.
    pub fn unexplained(&self, power: &Self) -> f32 {
        let weights = power.weights(power);
        self.weighted(&weights) / power.values()
    }
}

impl Terms {
    /// No free vibration is compared.
    pub const NONE: Self = Self { rows: Vec::new() };

    /// Their sum of squares.
    pub fn squares(&self) -> f32 {
        self.rows.iter().map(|row| row.residual * row.residual).sum()
    }

    /// Adds `part` of `S^T S` and `S^T (s + S from)` to the normal equations of the unknowns that are `free`: for a step from the
    /// terms' own `theta`, `from` is 0; for `theta` itself, it is that `theta`.
    pub fn add_to(&self, normal: &mut Quadratic<UNKNOWNS>, free: &[bool; UNKNOWNS], part: f32, from: &Theta) {
        for term in &self.rows {
            let mut row = Theta::zeros();
            for (slope, &by) in row.iter_mut().zip(&term.by_flexibility) {
                *slope = by;
            }
            row[STIFFNESS] = term.by_stiffness;
            for (slope, &free) in row.iter_mut().zip(free) {
                if !free {
                    *slope = 0.0;
                }
            }
            let residual = term.residual + row.dot(from);
            for j in 0..=STIFFNESS {
                if row[j] == 0.0 {
                    continue;
                }
                let left = part * row[j];
                normal.vector[j] += left * residual;
                for i in 0..=STIFFNESS {
                    normal.matrix[(i, j)] += left * row[i];
                }
            }
        }
    }
}

// How a train runs does not move the bridge's own frequencies: these columns are zero.
const _: () = assert!(STIFFNESS == ELEMENTS && STIFFNESS < UNKNOWNS);

impl<'a> Problem<'a> {
    /// The recorded samples, a row for each moment.
    pub fn recorded(&self) -> impl ExactSizeIterator<Item = [f32; CHANNELS]> + use<'a> {
        self.samples.rows(self.channels())
    }

    /// Channels; at least 1.
    pub fn channels(&self) -> usize {
        self.observation.recorder.sensors.len().max(1)
    }

    /// How many cars' loads are to be sought. Where the track is not known, what it makes of the cars' motion hides them; of a single car
    /// the load is that of the train.
    pub fn weighable(&self) -> usize {
        match self.observation.cars.train().cars.len() {
            cars if cars > 1 && self.track.is_learnt() => cars,
            _ => 0,
        }
    }

    /// What was recorded.
    pub fn power(&self) -> Squares {
        let mut power = Squares::NONE;
        for recorded in self.recorded() {
            power.add(recorded);
        }
        power
    }

    /// Simulates the passage by a hypothesis: one forward solve, as an endless row of samples.
    pub fn simulate(&self, hypothesis: &Hypothesis<f32>) -> Result<Simulation<f32, MODES>, SetupError> {
        Simulation::new(self.bridge, hypothesis, self.observation, &self.track.profile)
    }

    /// What the free vibration says of `theta`: an eigenproblem for each kind of quantity, a thousandth of a forward solve.
    // Not inlined: the eigenproblem's 7 KB need not stand on the stack of who asks.
    #[inline(never)]
    pub fn terms(&self, theta: &Theta) -> Terms {
        let mut terms = Terms::NONE;
        let Some(Compared { vibration, damping }) = self.free_vibration else {
            return terms;
        };
        let (damage, factors) = (
            losses(theta),
            Factors {
                stiffness: self.observation.stiffness * (1.0 + theta[STIFFNESS]),
                ..Factors::default()
            },
        );
        // There is room for every mode, twice.
        let _ = terms
            .rows
            .extend_from_slice(&vibration.frequency_terms(self.bridge, &damage, factors));
        if damping {
            let _ = terms
                .rows
                .extend_from_slice(&vibration.damping_terms(self.bridge, &damage, factors));
        }
        terms
    }

    /// [`OBJ`](self) of a damage pattern, with the train as it is expected: one forward solve.
    pub fn misfit(&self, damage: &Damage<f32>) -> Result<f32, SetupError> {
        let mut simulation = self.simulate(&Hypothesis {
            damage: *damage,
            ..self.observation.expected()
        })?;
        let mut residuals = Squares::NONE;
        for recorded in self.recorded() {
            residuals.add(residual(
                &recorded,
                &simulation.sample(self.observation, &self.track.profile),
            ));
        }
        Ok(residuals.mean())
    }
}

/// Recorded less simulated; not a number where nothing was recorded.
pub fn residual(recorded: &[f32; CHANNELS], simulated: &[f32; CHANNELS]) -> [f32; CHANNELS] {
    let mut residual = [f32::NAN; CHANNELS];
    for ((residual, f), simulated) in residual.iter_mut().zip(recorded).zip(simulated) {
        // A simulation that is not a number must not pass for a perfect one.
        *residual = if simulated.is_nan() && !f.is_nan() {
            f32::INFINITY
        } else {
            f - simulated
        };
    }
    residual
}
