//! The samples of one passage in three quarters of their memory.
//!
//! A sample keeps its sign, its exponent and 16 of its 24 significant bits: it is wrong by one part in 65,000 at most, a hundredth of what
//! the model itself is. What is not a number stays that.

use heapless::Vec;

use crate::capacity::{CHANNELS, PASSAGE_SAMPLES};

/// Samples of one passage, m/s² (m) without offset, channel after channel within a sample.
#[derive(Debug, Clone)]
pub struct PassageSamples {
    /// Sign, exponent and the first 7 bits behind the point.
    high: Vec<u16, PASSAGE_SAMPLES>,
    /// The next 8 bits.
    low: Vec<u8, PASSAGE_SAMPLES>,
}

impl PassageSamples {
    /// None yet.
    pub const fn new() -> Self {
        Self {
            high: Vec::new(),
            low: Vec::new(),
        }
    }

    /// Keeps a sample; whether there was room for it.
    pub fn push(&mut self, sample: f32) -> bool {
        let bits = sample.to_bits();
        // To the nearest; of two that are equally near the even one.
        let rounded = bits.wrapping_add(0x7f + (bits >> 8 & 1));
        self.low.push((rounded >> 8) as u8).is_ok() && self.high.push((rounded >> 16) as u16).is_ok()
    }

    /// Forgets all.
    pub fn clear(&mut self) {
        self.high.clear();
        self.low.clear();
    }
}

impl Default for PassageSamples {
    fn default() -> Self {
        Self::new()
    }
}

/// Samples of a passage, wherever they are.
#[derive(Debug, Clone, Copy)]
pub enum Samples<'a> {
    /// As they are, on the PC.
    Plain(&'a [f32]),
    /// In the memory of the logger.
    Kept(&'a PassageSamples),
}

impl<'a> Samples<'a> {
    /// How many there are, counted over all channels.
    pub fn len(&self) -> usize {
        match self {
            Self::Plain(samples) => samples.len(),
            Self::Kept(samples) => samples.low.len(),
        }
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The sample in that place.
    pub fn get(&self, place: usize) -> Option<f32> {
        match self {
            Self::Plain(samples) => samples.get(place).copied(),
            Self::Kept(samples) => {
                let (&high, &low) = (samples.high.get(place)?, samples.low.get(place)?);
                Some(f32::from_bits(u32::from(high) << 16 | u32::from(low) << 8))
            }
        }
    }

    /// One row for each moment, of so many channels; not a number behind them.
    pub fn rows(self, channels: usize) -> impl ExactSizeIterator<Item = [f32; CHANNELS]> + use<'a> {
        let channels = channels.clamp(1, CHANNELS);
        (0..self.len() / channels).map(move |row| {
            core::array::from_fn(|c| match self.get(row * channels + c) {
                Some(sample) if c < channels => sample,
                _ => f32::NAN,
            })
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_sample_comes_back_to_one_part_in_65000() {
        let mut kept = PassageSamples::new();
        let samples: [f32; 9] = [0.0, 1.0, -1.000_01, 3.3e-7, -9.87, 0.1, 1e9, -2.5e-3, f32::NAN];
        for &sample in &samples {
            assert!(kept.push(sample));
        }
        for (row, expected) in Samples::Kept(&kept).rows(3).zip(samples.chunks(3)) {
            for (value, &expected) in row.into_iter().zip(expected) {
                let near = (value - expected).abs() <= expected.abs() / 65_000.0;
                assert!(near || value.is_nan() && expected.is_nan(), "{value} {expected}");
            }
        }
        assert_eq!(Samples::Kept(&kept).get(9), None);
    }

    #[test]
    fn what_has_no_room_is_refused() {
        let mut kept = PassageSamples::new();
        assert!((0..PASSAGE_SAMPLES).all(|_| kept.push(1.0)));
        assert!(!kept.push(1.0));
        assert_eq!(Samples::Kept(&kept).len(), PASSAGE_SAMPLES);
    }

    #[test]
    fn a_row_has_no_more_channels_than_were_recorded() {
        let rows: Vec<_, 4> = Samples::Plain(&[1.0, 2.0, 3.0, 4.0, 5.0]).rows(2).collect();
        assert_eq!(rows.len(), 2);
        assert!(rows[1][0] == 3.0 && rows[1][1] == 4.0 && rows[1][2].is_nan());
    }
}
