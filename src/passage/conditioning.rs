//! One channel's counts: to acceleration or displacement, and whether they can be believed.

use crate::wire::message::{Channel, Quality};

/// A channel whose counts do not change for this long, s, ...
const STUCK_S: f32 = 0.1;
/// ... and at least so many samples, is stuck.
const STUCK_SAMPLES: f32 = 8.0;

/// State of one channel.
#[derive(Debug, Clone, Copy)]
pub struct Conditioner {
    last: Option<i32>,
    /// Samples in a row that repeated the one before.
    repeats: u32,
}

/// Fault of a sample.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Fault {
    /// It never came.
    Missing,
    /// It lies at the end of the sensor's range.
    Saturated,
    /// It repeats the ones before for suspiciously long.
    Stuck,
}

impl Fault {
    /// Counts this fault.
    pub fn count(self, quality: &mut Quality) {
        let count = match self {
            Self::Missing => &mut quality.missing,
            Self::Saturated => &mut quality.saturated,
            Self::Stuck => &mut quality.stuck,
        };
        *count = count.saturating_add(1);
    }
}

/// Samples in a row that may be equal at a rate of `rate_hz`.
pub fn stuck_run(rate_hz: f32) -> u32 {
    (STUCK_S * rate_hz).max(STUCK_SAMPLES) as u32
}

impl Conditioner {
    /// A channel that has seen nothing.
    pub const NEW: Self = Self { last: None, repeats: 0 };

    /// What `counts` measure, m/s² (m), or what is wrong with them; `stuck_run` from [`stuck_run`].
    pub fn push(&mut self, channel: &Channel, stuck_run: u32, counts: i32) -> Result<f32, Fault> {
        let same = self.last == Some(counts);
        self.repeats = if same { self.repeats.saturating_add(1) } else { 0 };
        self.last = Some(counts);
        if counts.unsigned_abs() >= channel.full_scale_counts.unsigned_abs() {
            return Err(Fault::Saturated);
        }
        if self.repeats >= stuck_run {
            return Err(Fault::Stuck);
        }
        Ok(counts as f32 * channel.lsb)
    }

    /// A sample that never came.
    pub fn skip(&mut self) -> Fault {
        self.last = None;
        self.repeats = 0;
        Fault::Missing
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const CHANNEL: Channel = Channel {
        node: 6,
        quantity: crate::wire::message::Quantity::Acceleration,
        lsb: 0.5,
        full_scale_counts: 100,
    };

    #[test]
    fn counts_become_acceleration_and_both_ends_of_the_range_are_saturated() {
        let mut conditioner = Conditioner::NEW;
        assert_eq!(conditioner.push(&CHANNEL, 8, -7), Ok(-3.5));
        assert_eq!(conditioner.push(&CHANNEL, 8, 99), Ok(49.5));
        for counts in [100, -100, i32::MAX, i32::MIN] {
            assert_eq!(conditioner.push(&CHANNEL, 8, counts), Err(Fault::Saturated));
        }
    }

    #[test]
    fn a_sensor_that_repeats_itself_is_stuck_until_it_moves() {
        let mut conditioner = Conditioner::NEW;
        let run = stuck_run(200.0);
        assert_eq!(run, 20);
        let stuck = (0..50)
            .filter(|_| conditioner.push(&CHANNEL, run, 3) == Err(Fault::Stuck))
            .count();
        assert_eq!(stuck, 30);
        assert_eq!(conditioner.push(&CHANNEL, run, 4), Ok(2.0));
    }
}
