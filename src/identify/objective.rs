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

use crate::bridge::{Damage, ReducedBridge};
use crate::capacity::{CHANNELS, MODES};
use crate::interaction::{Hypothesis, Observation, SetupError, Simulation};

/// Part of a channel's power that counts as its noise at least: the square of what `f32` and the step leave in the
/// solution, 1e-4 of the signal.
pub const EXPLAINED: f32 = 1e-8;

/// A recorded passage and the physics that should explain it.
#[derive(Debug, Clone, Copy)]
pub struct Problem<'a> {
    /// The bridge.
    pub bridge: &'a ReducedBridge<f32>,
    /// Train, sensors and recorder; time 0 is that of the first sample.
    pub observation: &'a Observation<f32>,
    /// What was recorded, m/s² (m), channel after channel within a sample; not-a-number where there is none.
    pub samples: &'a [f32],
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
        for c in 0..CHANNELS {
            sum += self.sum[c] * weights[c];
        }
        sum
    }

    /// Part of `power` that these residuals are, on average over the channels.
    pub fn unexplained(&self, power: &Self) -> f32 {
        let weights = power.weights(power);
        self.weighted(&weights) / power.values()
    }
}

impl<'a> Problem<'a> {
    /// The recorded samples, one slice of channels each.
    pub fn recorded(&self) -> core::slice::ChunksExact<'a, f32> {
        self.samples.chunks_exact(self.channels())
    }

    /// Channels; at least 1.
    pub fn channels(&self) -> usize {
        self.observation.recorder.sensors.len().max(1)
    }

    /// What was recorded.
    pub fn power(&self) -> Squares {
        let mut power = Squares::NONE;
        for recorded in self.recorded() {
            power.add(recorded.iter().copied());
        }
        power
    }

    /// Simulates the passage by a hypothesis: one forward solve, as an endless row of samples.
    pub fn simulate(&self, hypothesis: &Hypothesis<f32>) -> Result<Simulation<f32, MODES>, SetupError> {
        Simulation::new(self.bridge, hypothesis, self.observation)
    }

    /// [`OBJ`](self) of a damage pattern, with the train as it is expected: one forward solve.
    pub fn misfit(&self, damage: &Damage<f32>) -> Result<f32, SetupError> {
        let mut simulation = self.simulate(&Hypothesis {
            damage: *damage,
            ..self.observation.expected()
        })?;
        let mut residuals = Squares::NONE;
        for recorded in self.recorded() {
            residuals.add(residual(recorded, &simulation.sample(self.observation)));
        }
        Ok(residuals.mean())
    }
}

/// Recorded less simulated; not a number where nothing was recorded.
pub fn residual(recorded: &[f32], simulated: &[f32; CHANNELS]) -> [f32; CHANNELS] {
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
