//! Is something rolling over the bridge? A running level against the quiet one, with two thresholds and two durations.
//!
//! For each channel, with `x` the acceleration and exponential means `<.>` over the times named:
//!
//! ```text
//! level^2 = <(x - <x>_drift)^2>_window          quiet^2 = <level^2>_rise where it is above, <level^2>_fall where below
//! ratio^2 = max over channels of level^2 / max(quiet, floor)^2
//! ```
//!
//! Motion begins when the ratio stays above `on_ratio` for `on_duration` and ends when it stays below `off_ratio` for
//! `off_duration`: a click is too short to begin it (and until then one sample is worth at most a quarter of what it takes),
//! a beat of the free vibration too short to end it. The quiet level rises slowly, so that a train that comes nearer does
//! not pass for its own background, and falls fast, so that the end of a passage does not hide the next train. It stands
//! still from the first sample above `on_ratio`, and so does the offset, the mean that is taken from a passage's samples. A
//! change of the surroundings that outlasts any train ends the motion too, and everything is learnt anew.
//!
//! Displacements are not looked at: they drift with the sun, and move no sooner than the accelerations. Only their offset is
//! learnt here ([`Detector::rest`]), while the accelerations are at rest.

use crate::capacity::CHANNELS;
use crate::math;
use crate::wire::message::Trigger;

/// Time constant of the offset, s.
const OFFSET_S: f32 = 5.0;
/// Time constant of the mean that is taken from the level, s: slower than any bridge, faster than a sensor's drift.
const DRIFT_S: f32 = 1.0;
/// Time constants of the quiet level, s.
const QUIET_RISE_S: f32 = 60.0;
const QUIET_FALL_S: f32 = 5.0;
/// No motion is seen before the quiet level has been learnt, as a plain mean, for this long, s.
const LEARN_S: f32 = 0.5;
/// Part of the level that begins a motion which one sample can make up.
const CLICK: f32 = 0.25;
/// Motion that lasts longer, s, is no train: 16 cars at 20 km/h take 80 s.
const LONGEST_S: f32 = 300.0;

/// The trigger, its times in samples.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Thresholds {
    window: f32,
    on_squared: f32,
    on_samples: u32,
    off_squared: f32,
    off_samples: u32,
    floor_squared: f32,
    offset: f32,
    drift: f32,
    rise: f32,
    fall: f32,
    learn: u32,
    longest: u32,
}

impl Thresholds {
    /// For a stream without channels.
    pub const NONE: Self = Self {
        window: 0.0,
        on_squared: 0.0,
        on_samples: 0,
        off_squared: 0.0,
        off_samples: 0,
        floor_squared: 0.0,
        offset: 0.0,
        drift: 0.0,
        rise: 0.0,
        fall: 0.0,
        learn: 0,
        longest: 0,
    };

    /// The trigger for `rate_hz` samples a second.
    pub fn new(trigger: &Trigger, rate_hz: f32) -> Self {
        let samples = |seconds: f32| (seconds * rate_hz).max(1.0);
        Self {
            window: samples(trigger.window_s),
            on_squared: trigger.on_ratio * trigger.on_ratio,
            on_samples: samples(trigger.on_duration_s) as u32,
            off_squared: trigger.off_ratio * trigger.off_ratio,
            off_samples: samples(trigger.off_duration_s) as u32,
            floor_squared: trigger.floor_mps2 * trigger.floor_mps2,
            offset: samples(OFFSET_S),
            drift: samples(DRIFT_S),
            rise: samples(QUIET_RISE_S),
            fall: samples(QUIET_FALL_S),
            learn: samples(LEARN_S) as u32,
            longest: samples(LONGEST_S) as u32,
        }
    }

    /// Samples that the level must be high for to begin a motion; at least 1.
    pub fn on_samples(&self) -> u32 {
        self.on_samples
    }

    /// Square of the ratio below which a motion may end.
    pub fn off_squared(&self) -> f32 {
        self.off_squared
    }
}

/// Levels of one channel.
#[derive(Debug, Clone, Copy)]
struct Levels {
    offset: f32,
    drift: f32,
    level_squared: f32,
    quiet_squared: f32,
}

/// What the detector makes of a sample.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Seen {
    /// Whether something moves.
    pub moving: bool,
    /// Square of the ratio of level to quiet level.
    pub ratio_squared: f32,
}

/// State of the detector.
#[derive(Debug, Clone, Copy)]
pub struct Detector {
    channels: [Levels; CHANNELS],
    /// Offsets of the channels that are not looked at, m.
    rest: [f32; CHANNELS],
    learnt: u32,
    /// Samples in a row above the upper threshold.
    above: u32,
    /// Samples in a row below the lower threshold, while moving.
    below: u32,
    /// Samples since the motion began.
    moved: u32,
    moving: bool,
}

impl Detector {
    /// A detector that has learnt nothing.
    pub const NEW: Self = Self {
        channels: [Levels {
            offset: 0.0,
            drift: 0.0,
            level_squared: 0.0,
            quiet_squared: 0.0,
        }; CHANNELS],
        rest: [0.0; CHANNELS],
        learnt: 0,
        above: 0,
        below: 0,
        moved: 0,
        moving: false,
    };

    /// Offset of a channel, m/s² (m): it stands still while something moves.
    pub fn offset(&self, channel: usize) -> f32 {
        let levels = self.channels.get(channel).map_or(0.0, |levels| levels.offset);
        // One of the two is 0: a channel is looked at or it is not.
        levels + self.rest.get(channel).copied().unwrap_or(0.0)
    }

    /// Takes the value of a channel that [`Self::push`] was not given, m: its offset is learnt while the others are at rest.
    pub fn rest(&mut self, thresholds: &Thresholds, channel: usize, x: f32) {
        if self.moving || self.above > 0 {
            return;
        }
        let weight = thresholds.offset.min(self.learnt.max(1) as f32).recip();
        if let Some(offset) = self.rest.get_mut(channel) {
            *offset += weight * (x - *offset);
        }
    }

    /// Ends a motion at once, as after a gap.
    pub fn interrupt(&mut self) {
        self.moving = false;
        self.above = 0;
        for levels in &mut self.channels {
            levels.level_squared = 0.0;
        }
    }

    /// Takes the accelerations of one sample, m/s², a channel each; not-a-number where there is none.
    pub fn push(&mut self, thresholds: &Thresholds, values: &[f32]) -> Seen {
        self.learnt = self.learnt.saturating_add(1);
        let at_rest = !self.moving && self.above == 0;
        let mut ratio_squared = 0.0_f32;
        for (levels, &x) in self.channels.iter_mut().zip(values) {
            let reference = levels.quiet_squared.max(thresholds.floor_squared);
            let limit = match self.moving || self.learnt <= thresholds.learn {
                true => f32::INFINITY,
                false => math::sqrt(CLICK * thresholds.window * thresholds.on_squared * reference),
            };
            // A channel that says nothing does not move: its level dies away.
            let x = if x.is_nan() { levels.drift } else { x };
            levels.push(thresholds, x, limit, at_rest, self.learnt);
            ratio_squared = ratio_squared.max(levels.level_squared / reference);
        }
        if self.moving {
            self.moved += 1;
            self.below = if ratio_squared < thresholds.off_squared {
                self.below + 1
            } else {
                0
            };
            if self.below >= thresholds.off_samples {
                self.moving = false;
                self.above = 0;
            } else if self.moved >= thresholds.longest {
                *self = Self::NEW;
            }
        } else if self.learnt > thresholds.learn {
            self.above = if ratio_squared > thresholds.on_squared {
                self.above + 1
            } else {
                0
            };
            if self.above >= thresholds.on_samples {
                self.moving = true;
                self.moved = 0;
                self.below = 0;
            }
        }
        Seen {
            moving: self.moving,
            ratio_squared,
        }
    }
}

impl Levels {
    fn push(&mut self, thresholds: &Thresholds, x: f32, limit: f32, at_rest: bool, learnt: u32) {
        // A plain mean until the exponential one has seen enough.
        let weight = |samples: f32| samples.min(learnt as f32).recip();
        let within = |deviation: f32| deviation.min(limit).max(-limit);
        let deviation = within(x - self.drift);
        self.drift += weight(thresholds.drift) * deviation;
        let square = (x - self.drift) * (x - self.drift);
        self.level_squared += weight(thresholds.window) * (square.min(limit * limit) - self.level_squared);
        if at_rest {
            self.offset += weight(thresholds.offset) * within(x - self.offset);
            let above = self.level_squared - self.quiet_squared;
            self.quiet_squared += above
                * if learnt <= thresholds.learn {
                    (learnt as f32).recip()
                } else if above > 0.0 {
                    thresholds.rise.recip()
                } else {
                    thresholds.fall.recip()
                };
        }
    }
}
