//! The misfit of a damage pattern: simulated against recorded acceleration, in the recorder's band.
//!
//! ```text
//! OBJ = 1 / (n c) sum_i sum_c (f_ic - f*_ic)^2        [(m/s^2)^2], n samples of c channels   (paper's Eq. 46)
//! ```

use crate::bridge::{Damage, ReducedBridge};
use crate::capacity::{CHANNELS, MODES};
use crate::interaction::{Hypothesis, Observation, SetupError, Simulation};

/// Lags of the residuals' correlation that are looked at: a second at 200 Hz, in which the free vibration of a bridge loses a
/// third.
const LAGS: usize = 200;

/// A recorded passage and the physics that should explain it.
#[derive(Debug, Clone, Copy)]
pub struct Problem<'a> {
    /// The bridge.
    pub bridge: &'a ReducedBridge<f32>,
    /// Train, sensors and recorder; time 0 is that of the first sample.
    pub observation: &'a Observation<f32>,
    /// Recorded accelerations, m/s², channel after channel within a sample; not-a-number where there is none.
    pub samples: &'a [f32],
}

impl Problem<'_> {
    /// The recorded samples, one slice of channels each.
    pub fn recorded(&self) -> impl ExactSizeIterator<Item = &[f32]> {
        self.samples
            .chunks_exact(self.observation.recorder.sensors.len().max(1))
    }

    /// The simulated passage for a damage pattern: one forward solve, as an endless row of samples.
    pub fn simulate(&self, damage: &Damage<f32>) -> Result<Simulation<f32, MODES>, SetupError> {
        let hypothesis = Hypothesis {
            damage: *damage,
            ..self.observation.expected()
        };
        Simulation::new(self.bridge, &hypothesis, self.observation)
    }

    // Not inlined, as the next: their frames must not stand on the stack under the refinement's.
    /// Misfit of a damage pattern, (m/s²)²: one forward solve. Samples without a value do not count.
    #[inline(never)]
    pub fn misfit(&self, damage: &Damage<f32>) -> Result<f32, SetupError> {
        let mut simulation = self.simulate(damage)?;
        let mut sum = 0.0;
        for recorded in self.recorded() {
            for (f, simulated) in recorded.iter().zip(simulation.sample(self.observation)) {
                // A simulation that is not a number, though, must not pass for a perfect one.
                if !f.is_nan() {
                    sum += (f - simulated) * (f - simulated);
                }
            }
        }
        Ok(sum / self.count())
    }

    /// How many residuals say as much as one independent one: near 1 for a sensor's noise, many where the bridge moves
    /// otherwise than the model does. One forward solve.
    ///
    /// ```text
    /// tau = 1 + 2 sum_k (rho_k^2 - 1/n),   rho_k = sum_i r_i r_i-k / sum_i r_i^2,   k = 1 .. LAGS
    /// ```
    ///
    /// The variance of the correlation of two series is `(1 + 2 sum_k rho_k rho'_k) / n` (Bartlett 1946). Here one is the residual
    /// and the other what an element's damage does to the record; both are motions of the same bridge, so the same `rho`
    /// is taken for both. `1/n` is what the square of an estimated `rho_k` is on average where the true one is 0.
    #[inline(never)]
    pub fn correlation_time(&self, damage: &Damage<f32>) -> Result<f32, SetupError> {
        let mut simulation = self.simulate(damage)?;
        // The latest residuals of each channel, newest first.
        let mut latest = [[0.0_f32; LAGS]; CHANNELS];
        let mut products = [0.0_f32; LAGS];
        let mut squares = 0.0;
        for recorded in self.recorded() {
            for ((f, simulated), latest) in recorded
                .iter()
                .zip(simulation.sample(self.observation))
                .zip(&mut latest)
            {
                let residual = if f.is_nan() { 0.0 } else { f - simulated };
                squares += residual * residual;
                for (product, earlier) in products.iter_mut().zip(latest.iter()) {
                    *product += residual * earlier;
                }
                latest.copy_within(..LAGS - 1, 1);
                if let Some(newest) = latest.first_mut() {
                    *newest = residual;
                }
            }
        }
        let chance = self.count().recip();
        let sum = products.iter().fold(0.0, |sum, product| {
            let rho = product / squares.max(f32::MIN_POSITIVE);
            sum + rho * rho - chance
        });
        Ok(1.0 + 2.0 * sum.max(0.0))
    }

    /// Mean square of the recording, (m/s²)²: the misfit of saying nothing.
    pub fn mean_square(&self) -> f32 {
        self.values().fold(0.0, |sum, f| sum + f * f) / self.count()
    }

    /// Recorded values, over all channels; at least 1.
    pub fn count(&self) -> f32 {
        self.values().count().max(1) as f32
    }

    fn values(&self) -> impl Iterator<Item = &f32> {
        self.samples.iter().filter(|f| !f.is_nan())
    }
}
