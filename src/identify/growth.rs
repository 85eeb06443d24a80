//! How the energy of a motion grows over a passage: when it came and how fast, whatever the phase of each vibration.
//!
//! ```text
//! E(t) = sum over acceleration channels and samples up to t of f^2
//! T_k  = the time at which E has first grown to (k + 1/2) / PARTS of its whole,  k = 0 .. PARTS - 1
//! ```
//!
//! Kept in [`BINS`] bins of time, 2 KiB, between whose borders `E` is taken to grow evenly: an error of half a bin, which is a
//! thousandth of the passage.

use crate::interaction::Observation;
use crate::wire::message::Quantity;

/// Parts of the energy whose times are told.
pub const PARTS: usize = 10;
/// Steps of time in which the energy's growth is kept.
pub const BINS: usize = 512;

/// When the energy of a motion had grown to each part of its whole.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Growth {
    /// Rows.
    pub at: [f32; PARTS],
    /// The whole, (m/s²)² summed over rows and channels.
    pub energy: f32,
}

/// Energy by time.
#[derive(Debug, Clone)]
pub struct Bins {
    rows_each: usize,
    energy: [f32; BINS],
}

impl Bins {
    /// For so many rows.
    pub fn new(rows: usize) -> Self {
        Self {
            rows_each: rows.div_ceil(BINS).max(1),
            energy: [0.0; BINS],
        }
    }

    /// Adds the energy of a row.
    pub fn push(&mut self, row: usize, energy: f32) {
        let bin = row.checked_div(self.rows_each);
        if let Some(bin) = bin.and_then(|bin| self.energy.get_mut(bin)) {
            *bin += energy;
        }
    }

    /// When the sum first had grown to each part of the whole. (Where noise was taken away it falls now and then.)
    pub fn growth(&self) -> Growth {
        let whole = self.energy.iter().fold(0.0, |sum, energy| sum + energy);
        let mut at = [0.0; PARTS];
        let mut waiting = at.iter_mut().zip(1_u8..).peekable();
        let mut sum = 0.0;
        for (bin, &energy) in self.energy.iter().enumerate() {
            while let Some((at, part)) = waiting.peek_mut() {
                let wanted = whole * (f32::from(*part) - 0.5) / PARTS as f32 - sum;
                if wanted > energy || energy <= 0.0 {
                    break;
                }
                **at = (bin as f32 + wanted / energy) * self.rows_each as f32;
                waiting.next();
            }
            sum += energy;
        }
        Growth { at, energy: whole }
    }
}

/// Energy of the accelerations among `values`, where there is a recorded one too, (m/s²)².
pub fn energy(observation: &Observation<f32>, recorded: &[f32], values: &[f32]) -> f32 {
    let mut sum = 0.0;
    for ((recorded, value), sensor) in recorded.iter().zip(values).zip(&observation.recorder.sensors) {
        if sensor.quantity == Quantity::Acceleration && !recorded.is_nan() {
            sum += value * value;
        }
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn steady_energy_reaches_its_parts_at_even_times_and_negative_noise_does_not_matter() {
        let mut bins = Bins::new(2 * BINS);
        for row in 0..100 {
            bins.push(row, if row % 4 < 2 { 1e-6 } else { -1e-6 });
        }
        for row in 100..200 {
            bins.push(row, 1.0);
        }
        let growth = bins.growth();
        assert!((growth.energy - 100.0).abs() < 1e-3);
        for (k, at) in growth.at.iter().enumerate() {
            assert!((at - (105.0 + 10.0 * k as f32)).abs() < 0.01, "{growth:?}");
        }
    }
}
