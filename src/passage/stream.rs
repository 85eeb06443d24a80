//! Blocks of raw counts in, passages out.

use heapless::{Deque, Vec};

use super::bracket::Bracket;
use super::conditioning::{Conditioner, Fault, stuck_run};
use super::detector::{Detector, Thresholds};
use super::samples::{PassageSamples, Samples};
use super::{Kept, Passage};
use crate::capacity::{CHANNELS, LEAD_VALUES};
use crate::slot::Slot;
use crate::wire::message::{Channel, Configuration, Quality, Quantity};

/// Passages that may end within one block.
const ENDED: usize = 4;

/// Why a block of samples is refused.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum BlockError {
    /// It does not make whole samples of the configured channels, or there are none.
    Uneven,
    /// It lies before samples that have come, and is not the last block once more: the sender has lost count.
    Past,
}

/// A passage that has begun.
#[derive(Debug, Clone, Copy)]
struct Open {
    first_sample: u64,
    bracket: Bracket,
    peak: [f32; CHANNELS],
    sum_of_squares: [f32; CHANNELS],
    samples: u32,
    quality: Quality,
    kept: Kept,
}

/// State of the stream of samples. It holds the samples of one passage, from its beginning until [`Stream::release`].
#[derive(Debug, Clone)]
pub struct Stream {
    channels: Vec<Channel, CHANNELS>,
    thresholds: Thresholds,
    lead_samples: usize,
    stuck_run: u32,
    /// Samples that may be missing within a passage: one second.
    longest_gap: u64,
    /// Index of the next sample; none before the first.
    next: Option<u64>,
    taken: u64,
    conditioners: [Conditioner; CHANNELS],
    detector: Detector,
    /// The latest samples, from before a passage, m/s² (m) with their offset.
    lead: Deque<f32, LEAD_VALUES>,
    open: Slot<Open>,
    ended: Deque<Passage, ENDED>,
    /// Samples of the open passage or of one that has ended and is held.
    samples: PassageSamples,
    held: bool,
    /// How often they have been cleared for another passage.
    clearings: u32,
    quality: Quality,
}

impl Stream {
    /// A stream without channels: it takes nothing until it is [configured](Self::configure).
    pub const fn new() -> Self {
        Self {
            channels: Vec::new(),
            thresholds: Thresholds::NONE,
            lead_samples: 0,
            stuck_run: 0,
            longest_gap: 0,
            next: None,
            taken: 0,
            conditioners: [Conditioner::NEW; CHANNELS],
            detector: Detector::NEW,
            lead: Deque::new(),
            open: Slot::Empty,
            ended: Deque::new(),
            samples: PassageSamples::new(),
            held: false,
            clearings: 0,
            quality: Quality::NONE,
        }
    }

    /// Starts afresh with a configuration that has been checked.
    pub fn configure(&mut self, configuration: &Configuration) {
        let rate = configuration.sample_rate_hz;
        let lead = (configuration.trigger.lead_s * rate) as usize;
        self.channels = configuration.channels.clone();
        self.thresholds = Thresholds::new(&configuration.trigger, rate);
        self.lead_samples = lead.min(LEAD_VALUES / self.channels.len().max(1));
        self.stuck_run = stuck_run(rate);
        self.longest_gap = rate as u64;
        self.next = None;
        self.taken = 0;
        self.conditioners = [Conditioner::NEW; CHANNELS];
        self.detector = Detector::NEW;
        self.lead.clear();
        self.open = Slot::Empty;
        self.ended.clear();
        self.clear();
        self.held = false;
        self.quality = Quality::NONE;
    }

    /// Samples taken in, of each channel.
    pub fn taken(&self) -> u64 {
        self.taken
    }

    /// What was wrong with samples so far.
    pub fn quality(&self) -> Quality {
        self.quality
    }

    /// The next passage that has ended.
    pub fn next_passage(&mut self) -> Option<Passage> {
        self.ended.pop_front()
    }

    /// Samples of the passage that was given last with [`Kept::Whole`].
    pub fn passage_samples(&self) -> Samples<'_> {
        Samples::Kept(&self.samples)
    }

    /// The samples of the passage that ended are no longer needed; until then later ones are not kept. They stay until the next
    /// passage needs their room, and [`Self::clearings`] rises.
    pub fn release(&mut self) {
        self.held = false;
    }

    /// How often the room for a passage's samples has been cleared.
    pub fn clearings(&self) -> u32 {
        self.clearings
    }

    fn clear(&mut self) {
        self.samples.clear();
        self.clearings = self.clearings.wrapping_add(1);
    }

    /// Takes a block of counts, channel after channel within a sample, of which the first sample has index
    /// `first_sample` in the stream. The last block may come twice: samples that have come are passed over.
    pub fn push(&mut self, first_sample: u64, counts: &[i32]) -> Result<(), BlockError> {
        let channels = self.channels.len();
        if channels == 0 || !counts.len().is_multiple_of(channels) {
            return Err(BlockError::Uneven);
        }
        if counts.is_empty() {
            // It says nothing of where the stream stands: a gap is known by the samples behind it.
            return Ok(());
        }
        let expected = self.next.unwrap_or(first_sample);
        let rows = (counts.len() / channels) as u64;
        let Some(end) = first_sample.checked_add(rows).filter(|&end| end >= expected) else {
            return Err(BlockError::Past);
        };
        let gap = first_sample.saturating_sub(expected);
        if gap > self.longest_gap {
            // Too long to be part of a passage.
            let lost = u32::try_from(gap).unwrap_or(u32::MAX).saturating_mul(channels as u32);
            self.quality.missing = self.quality.missing.saturating_add(lost);
            self.interrupt();
        } else {
            for index in expected..first_sample {
                self.sample(index, None);
            }
        }
        for (index, row) in (first_sample..end).zip(counts.chunks_exact(channels)) {
            if index >= expected {
                self.sample(index, Some(row));
                self.next = Some(index + 1);
                self.taken = self.taken.saturating_add(1);
            }
        }
        Ok(())
    }

    /// Closes a passage that is open, as at the end of the stream.
    pub fn interrupt(&mut self) {
        self.detector.interrupt();
        self.lead.clear();
        self.close(self.next.unwrap_or(0));
    }

    /// Takes one sample of all channels, or one that never came.
    fn sample(&mut self, index: u64, counts: Option<&[i32]>) {
        let mut values = [f32::NAN; CHANNELS];
        let mut levels = [f32::NAN; CHANNELS];
        let mut faults = Quality::NONE;
        let channels = self.channels.iter().zip(&mut self.conditioners);
        for (c, ((channel, conditioner), (value, level))) in
            channels.zip(values.iter_mut().zip(&mut levels)).enumerate()
        {
            let read = match counts.and_then(|row| row.get(c)) {
                Some(&counts) => conditioner.push(channel, self.stuck_run, counts),
                None => Err(conditioner.skip()),
            };
            match read {
                Ok(read) => (*value, *level) = (read, read),
                Err(fault) => {
                    fault.count(&mut self.quality);
                    fault.count(&mut faults);
                    if fault == Fault::Saturated {
                        // It moves at least so much.
                        *level = channel.full_scale_counts as f32 * channel.lsb;
                    }
                }
            }
            if channel.quantity == Quantity::Displacement {
                // The detector's levels are accelerations; a displacement drifts with the sun and says nothing sooner.
                *level = f32::NAN;
            }
        }
        let count = self.channels.len();
        let (values, levels) = (values.get(..count).unwrap_or(&[]), levels.get(..count).unwrap_or(&[]));
        let seen = self.detector.push(&self.thresholds, levels);
        for (c, (channel, &value)) in self.channels.iter().zip(values).enumerate() {
            if channel.quantity == Quantity::Displacement && !value.is_nan() {
                self.detector.rest(&self.thresholds, c, value);
            }
        }
        if !seen.moving {
            self.close(index);
            self.remember(values);
            return;
        }
        if self.open.as_ref().is_none() {
            self.begin(index, seen.ratio_squared);
        }
        if let Some(open) = self.open.as_mut() {
            let kept = if open.kept == Kept::Whole {
                Some(&mut self.samples)
            } else {
                None
            };
            open.push(index, seen.ratio_squared, values, &self.detector, faults, kept);
        }
    }

    /// A passage begins at sample `index`, with that squared ratio of levels.
    fn begin(&mut self, index: u64, ratio_squared: f32) {
        let channels = self.channels.len().max(1);
        let first_sample = index.saturating_sub((self.lead.len() / channels) as u64);
        let mut kept = Kept::Busy;
        if !self.held {
            kept = Kept::Whole;
            self.clear();
            for (value, c) in self.lead.iter().zip((0..channels).cycle()) {
                if !self.samples.push(value - self.detector.offset(c)) {
                    kept = Kept::TooLong;
                }
            }
        }
        // The level rose above the threshold a while ago; the first wheel's blow may be the strongest.
        let onset = index.saturating_sub(u64::from(self.thresholds.on_samples() - 1));
        let mut bracket = Bracket::new(self.thresholds.off_squared());
        bracket.push(onset, ratio_squared);
        let mut peak = [0.0_f32; CHANNELS];
        for (value, c) in self.lead.iter().zip((0..channels).cycle()) {
            if let Some(peak) = peak.get_mut(c) {
                *peak = peak.max((value - self.detector.offset(c)).abs());
            }
        }
        self.open = Slot::Full(Open {
            first_sample,
            bracket,
            peak,
            sum_of_squares: [0.0; CHANNELS],
            samples: 0,
            quality: Quality::NONE,
            kept,
        });
    }

    /// The passage that is open, if one is, ends before sample `next`.
    fn close(&mut self, next: u64) {
        let Some(open) = self.open.take() else { return };
        let passage = open.close(next, self.lead_samples as u64, &self.channels);
        self.lead.clear();
        self.held |= passage.kept == Kept::Whole;
        // Whoever feeds the stream takes its passages after every block; no block is long enough for more of them.
        let _ = self.ended.push_back(passage);
    }

    /// Keeps a sample from before a passage, and forgets the oldest.
    fn remember(&mut self, values: &[f32]) {
        if self.lead_samples == 0 {
            return;
        }
        if self.lead.len() + values.len() > self.lead_samples * values.len() {
            for _ in values {
                self.lead.pop_front();
            }
        }
        for &value in values {
            // There is room: the oldest sample has just gone.
            let _ = self.lead.push_back(value);
        }
    }
}

impl Default for Stream {
    fn default() -> Self {
        Self::new()
    }
}

impl Open {
    fn push(
        &mut self,
        index: u64,
        ratio_squared: f32,
        values: &[f32],
        detector: &Detector,
        faults: Quality,
        kept: Option<&mut PassageSamples>,
    ) {
        self.bracket.push(index, ratio_squared);
        self.samples = self.samples.saturating_add(1);
        self.quality.add(&faults);
        let mut room = true;
        let mut kept = kept;
        for (c, (&value, (peak, sum))) in values
            .iter()
            .zip(self.peak.iter_mut().zip(&mut self.sum_of_squares))
            .enumerate()
        {
            let x = value - detector.offset(c);
            if !x.is_nan() {
                *peak = peak.max(x.abs());
                *sum += x * x;
            }
            if let Some(samples) = &mut kept {
                room &= samples.push(x);
            }
        }
        if !room {
            self.kept = Kept::TooLong;
        }
    }

    fn close(self, next: u64, lead_samples: u64, channels: &[Channel]) -> Passage {
        let (strong_start, strong_end) = self.bracket.strong().unwrap_or((next, next));
        let sum = (self.sum_of_squares.iter().zip(channels))
            .filter(|(_, channel)| channel.quantity == Quantity::Acceleration)
            .fold(0.0_f32, |most, (&sum, _)| most.max(sum));
        Passage {
            first_sample: self.first_sample,
            strong_sample: strong_start,
            start_sample: strong_start.saturating_sub(lead_samples).max(self.first_sample),
            end_sample: strong_end.saturating_add(1),
            next_sample: next,
            peak: self.peak,
            mean_square: sum / self.samples.max(1) as f32,
            quality: self.quality,
            kept: self.kept,
        }
    }
}
