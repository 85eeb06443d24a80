//! From raw counts to passages: the part of the logger that runs at every sample.
//!
//! | step | file | does |
//! |---|---|---|
//! | [`conditioning`] | counts of one channel | acceleration or displacement; finds saturated and stuck samples |
//! | [`detector`] | accelerations of all channels | offset, quiet level, "something rolls over the bridge" |
//! | [`bracket`] | the level while it moves | when the strong motion began and ended |
//! | [`samples`] | accelerations of a passage | keeps them |
//! | [`stream`] | blocks of counts | the three above, gaps, the samples from before the beginning; gives a [`Passage`] |
//!
//! Everything is decided sample by sample, so the size of the blocks in which samples arrive cannot matter, and memory is
//! constant. A sample that cannot be believed is kept as not-a-number: it has its place in time and no value.

pub mod bracket;
pub mod conditioning;
pub mod detector;
pub mod samples;
pub mod stream;

use crate::capacity::CHANNELS;
use crate::wire::message::Quality;

pub use stream::Stream;

/// What became of a passage's samples.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kept {
    /// All are there.
    Whole,
    /// There were more than the memory holds.
    TooLong,
    /// The memory still held an earlier passage.
    Busy,
}

/// A passage that has ended. The train's motion, with the time before it that was kept, is `start_sample..end_sample`;
/// the kept samples begin at `first_sample`, no later, and end before `next_sample`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Passage {
    /// Index in the stream of the first kept sample.
    pub first_sample: u64,
    /// Index of the first sample of the passage.
    pub start_sample: u64,
    /// Index one past its last sample.
    pub end_sample: u64,
    /// Index of the first sample of the strong motion; its last is the passage's.
    pub strong_sample: u64,
    /// Index one past the last kept sample: quiet has come back.
    pub next_sample: u64,
    /// Largest value of each channel, m/s² (m).
    pub peak: [f32; CHANNELS],
    /// Mean square of the strongest acceleration, (m/s²)².
    pub mean_square: f32,
    /// What was wrong with the samples between first motion and quiet.
    pub quality: Quality,
    /// What became of the samples.
    pub kept: Kept,
}

impl Passage {
    /// Rows of the strong motion among the kept samples.
    pub fn strong(&self) -> core::ops::Range<usize> {
        let row = |sample: u64| sample.saturating_sub(self.first_sample) as usize;
        row(self.strong_sample)..row(self.end_sample)
    }
}
