//! The misfit of a damage pattern: simulated against recorded acceleration, in the recorder's band.
//!
//! ```text
//! OBJ = 1 / (n c) sum_i sum_c (f_ic - f*_ic)^2        [(m/s^2)^2], n samples of c channels   (paper's Eq. 46)
//! ```

use crate::bridge::{Damage, ReducedBridge};
use crate::capacity::MODES;
use crate::interaction::{Observation, SetupError, Simulation};

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
        self.samples.chunks_exact(self.observation.places.len().max(1))
    }

    /// The simulated passage for a damage pattern: one forward solve, as an endless row of samples.
    pub fn simulate(&self, damage: &Damage<f32>) -> Result<Simulation<f32, MODES>, SetupError> {
        Simulation::new(self.bridge, damage, self.observation)
    }

    /// Misfit of a damage pattern, (m/s²)²: one forward solve. Samples without a value do not count.
    pub fn misfit(&self, damage: &Damage<f32>) -> Result<f32, SetupError> {
        let mut simulation = self.simulate(damage)?;
        let mut sum = 0.0;
        for recorded in self.recorded() {
            for (f, simulated) in recorded.iter().zip(simulation.sample()) {
                // A simulation that is not a number, though, must not pass for a perfect one.
                if !f.is_nan() {
                    sum += (f - simulated) * (f - simulated);
                }
            }
        }
        Ok(sum / self.count())
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
