//! Speed and entry time of a train that nobody announced: where the search begins.
//!
//! Over a passage the energy of the motion grows from nothing to its whole. The times at which it has reached 5, 15, .. 95 % of
//! it say when the train came and how fast it was, whatever the phase of each vibration, so they are compared with those of
//! the bridge's model under the same train at one speed after the other:
//!
//! ```text
//! E(t) = sum over acceleration channels and samples up to t of f^2, less what the sensors' noise adds
//! J(v) = mean_k (T_k - t_k(v) - s)^2 / sigma^2 + (ln(E / E(v)) / 2)^2 / load^2 + s^2 / rise^2
//! s    = mean_k (T_k - t_k(v)): so much later than first thought has the train entered
//! ```
//!
//! `T_k`, `E` of the recording, `t_k`, `E(v)` of the simulation; `sigma` is 0.05 s and 3 % of `T_10 - T_1`, `load` 0.3, `rise` 0.15 s. The
//! energy's amount helps, because an acceleration grows with the square of the speed or so. A bridge that is softer than its
//! model, damaged or warm, resonates at other speeds; so each speed is tried with the model and with a softer one.
//!
//! The duration of the strong motion alone would not do: after a short train the free vibration, 2 % damped at 3.5 Hz, outlasts
//! it by seconds. Way over duration is 13 to 98 % of the speed; its beginning, though, is 0.12 to 0.7 s after the entry.
//!
//! How far off the guess may be was measured on 496 simulated passages (`tests/first_guess.rs`): 3 speeds lie outside
//! [`speed_range`], no entry outside [`ENTRY_RANGE_S`]. Nine in ten speeds are within 20 % for one car, 10 % for two, 8 % for four or
//! eight and 5 % for sixteen, nine in ten entries within 0.2 s, 0.3 s for sixteen cars. What is left is not noise but damage: a bridge
//! softer than its model resonates at other speeds. The rail was smooth in all of them.
//!
//! Cost: a forward solve for each call of [`FirstGuess::advance`], 30 to 140 in all if the speed is unknown, else one; 2 KiB of stack.

use crate::bridge::{Damage, ReducedBridge};
use crate::capacity::{CHANNELS, ELEMENTS, MODES};
use crate::interaction::{Hypothesis, Observation, SetupError, Simulation};
use crate::math;
use crate::wire::message::{Quantity, Ranges, Traffic};

/// Speeds between which a train's lies, m/s: 20 and 400 km/h.
pub const LOWEST_SPEED_MPS: f32 = 20.0 / 3.6;
/// See [`LOWEST_SPEED_MPS`].
pub const HIGHEST_SPEED_MPS: f32 = 400.0 / 3.6;
/// How far a guessed entry time may be off, s.
pub const ENTRY_RANGE_S: f32 = 0.6;
/// How far the load may be off, as a part of it, where nobody knows: an empty train and a full one.
pub const LOAD_RANGE: f32 = 0.3;
/// The strong motion begins so long after the entry, s, as a rule: the level has to rise.
pub const RISE_S: f32 = 0.17;
/// Deviation of that, s.
const RISE_DEVIATION_S: f32 = 0.15;

/// How far a guessed speed may be off, as a part of it, for a train that takes `crossing_s` from entry to exit: 16 % of it, and a
/// quarter of a second of that time.
pub fn speed_range(crossing_s: f32) -> f32 {
    (0.16 + 0.25 / crossing_s).min(Ranges::WIDEST.speed)
}

/// Parts of the energy whose times are compared.
const PARTS: usize = 10;
/// Steps of time in which the energy's growth is kept.
const BINS: usize = 512;
/// Ratio of each speed that is tried to the one before.
const COARSE: f32 = 1.04;
/// Steps to both sides of the best speed that are tried then, as parts of it.
const FINE: [f32; 2] = [0.02, 0.01];
/// The bridge as its model has it, and a softer one: 5 % less in frequency.
const UNDAMAGED: Damage<f32> = [0.0; ELEMENTS];
const SOFT: Damage<f32> = [0.1; ELEMENTS];
/// Deviation of the times that are compared: s, and as a part of their span.
const DEVIATION_S: f32 = 0.05;
const DEVIATION_PART: f32 = 0.03;
/// The samples are still so long before the strong motion, s.
const STILL_S: f32 = 0.5;
/// No strong motion outlasts its train by more than this many times the first mode's `1 / (2 xi omega)`: at a tenth of its
/// peak it is over, after 4.6 of them; damping may be half of what the model says.
const OUTLASTS: f32 = 9.0;
/// The strong motion may end before the last axle has left: by this part of its duration and this time, s.
const SHORTER_PART: f32 = 0.1;
const SHORTER_S: f32 = 0.5;

/// What of a run is to be guessed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Unknown {
    /// The speed.
    pub speed: bool,
    /// The entry time.
    pub entry: bool,
}

impl Unknown {
    /// What nobody has said of `traffic`; none if nothing has to be guessed.
    pub fn of(traffic: &Traffic) -> Option<Self> {
        let (speed, entry) = (traffic.speed_mps.is_none(), traffic.entry_time_s.is_none());
        (speed || entry).then_some(Self { speed, entry })
    }
}

/// What a call of [`FirstGuess::advance`] came to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Progress {
    /// There is more to try.
    More,
    /// The observation holds the guess, and how far off it may be.
    Found,
    /// At no speed does this train leave the bridge within the passage.
    NotThisTrain,
}

/// When the energy of a motion had grown to each part of its whole.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Growth {
    /// Rows.
    at: [f32; PARTS],
    /// The whole, (m/s²)² summed over rows and channels.
    energy: f32,
}

/// A run that has been tried.
#[derive(Debug, Clone, Copy)]
struct Tried {
    speed_mps: f32,
    soft: bool,
    entry_time_s: f32,
    misfit: f32,
}

/// What is tried next.
#[derive(Debug, Clone, Copy)]
enum Next {
    /// A speed, on the softer bridge or on the model.
    Coarse(f32, bool),
    /// That step of [`FINE`], to the faster or to the slower side.
    Fine(usize, bool),
}

/// State of a guess.
#[derive(Debug, Clone)]
pub struct FirstGuess {
    unknown: Unknown,
    recorded: Growth,
    /// Of the passage's samples, s.
    duration_s: f32,
    /// Of its strong motion, s.
    strong_s: f32,
    /// As it is known, or first thought to be.
    entry_time_s: f32,
    best: Option<Tried>,
    next: Next,
}

impl FirstGuess {
    /// A guess of what is `unknown` of the run of `observation`, whose samples these are, channel after channel, the rows `strong` of
    /// them in strong motion ([`Passage::strong`](crate::passage::Passage::strong)).
    pub fn new(
        observation: &Observation<f32>,
        samples: &[f32],
        strong: core::ops::Range<usize>,
        unknown: Unknown,
    ) -> Self {
        let rate = observation.recorder.sample_rate_hz;
        let channels = observation.recorder.sensors.len().max(1);
        let rows = samples.len() / channels;
        let still = strong.start.saturating_sub((STILL_S * rate) as usize);
        let each_row = || samples.chunks_exact(channels).map(|row| energy(observation, row, row));
        // Before the train there is nothing but noise, and a click there is not the train's energy.
        let noise = each_row().take(still).fold(0.0, |sum, energy| sum + energy) / still.max(1) as f32;
        let mut bins = Bins::new(rows);
        for (row, energy) in each_row().enumerate().skip(still) {
            bins.push(row, energy - noise);
        }
        Self {
            unknown,
            recorded: bins.growth(),
            duration_s: rows as f32 / rate,
            strong_s: strong.len() as f32 / rate,
            entry_time_s: match unknown.entry {
                true => (strong.start as f32 / rate - RISE_S).max(0.0),
                false => observation.run.entry_time_s,
            },
            best: None,
            next: match unknown.speed {
                true => Next::Coarse(LOWEST_SPEED_MPS, false),
                false => Next::Coarse(observation.run.speed_mps, false),
            },
        }
    }

    /// Tries one more run: one forward solve.
    ///
    /// # Errors
    /// If the passage cannot be simulated.
    pub fn advance(
        &mut self,
        bridge: &ReducedBridge<f32>,
        observation: &mut Observation<f32>,
        samples: &[f32],
    ) -> Result<Progress, SetupError> {
        let Some((speed_mps, soft)) = self.next_run(bridge, observation) else {
            return Ok(self.conclude(bridge, observation));
        };
        observation.run.speed_mps = speed_mps;
        observation.run.entry_time_s = self.entry_time_s;
        let tried = self.attempt(bridge, observation, samples, soft)?;
        if self.best.is_none_or(|best| tried.misfit < best.misfit) {
            self.best = Some(tried);
        }
        Ok(Progress::More)
    }

    /// Tells the observation what has been found.
    fn conclude(&self, bridge: &ReducedBridge<f32>, observation: &mut Observation<f32>) -> Progress {
        let Some(best) = self.best else {
            return Progress::NotThisTrain;
        };
        observation.run.speed_mps = best.speed_mps;
        observation.run.entry_time_s = best.entry_time_s;
        if self.unknown.speed {
            let crossing_s = self.crossing_s(bridge, observation, best.speed_mps).unwrap_or(0.0);
            observation.ranges.speed = speed_range(crossing_s);
        }
        if self.unknown.entry {
            observation.ranges.entry_s = ENTRY_RANGE_S;
        }
        Progress::Found
    }

    /// The speed to be tried next, and whether on the softer bridge, if one is left.
    fn next_run(&mut self, bridge: &ReducedBridge<f32>, observation: &Observation<f32>) -> Option<(f32, bool)> {
        loop {
            match self.next {
                Next::Coarse(speed_mps, _) if !self.unknown.speed => {
                    self.next = Next::Fine(FINE.len(), false);
                    return Some((speed_mps, false));
                }
                Next::Coarse(speed_mps, _) if speed_mps > HIGHEST_SPEED_MPS => self.next = Next::Fine(0, false),
                Next::Coarse(speed_mps, soft) => {
                    self.next = match soft {
                        true => Next::Coarse(speed_mps * COARSE, false),
                        false => Next::Coarse(speed_mps, true),
                    };
                    if self.is_possible(bridge, observation, speed_mps) {
                        return Some((speed_mps, soft));
                    }
                }
                Next::Fine(step, faster) => {
                    let part = FINE.get(step)?;
                    self.next = match faster {
                        true => Next::Fine(step + 1, false),
                        false => Next::Fine(step, true),
                    };
                    let best = self.best?;
                    let speed_mps = best.speed_mps * if faster { 1.0 + part } else { 1.0 - part };
                    if (LOWEST_SPEED_MPS..=HIGHEST_SPEED_MPS).contains(&speed_mps) {
                        return Some((speed_mps, best.soft));
                    }
                }
            }
        }
    }

    /// Whether the passage can have been of a train so fast: its last axle leaves before quiet comes back, not long after the end
    /// of the strong motion, nor so long before it that the free vibration would have died.
    fn is_possible(&self, bridge: &ReducedBridge<f32>, observation: &Observation<f32>, speed_mps: f32) -> bool {
        let Some(crossing_s) = self.crossing_s(bridge, observation, speed_mps) else {
            return false;
        };
        let [p1, p2] = bridge.rayleigh;
        let modes = bridge.lambda.iter().take(bridge.basis);
        let first = modes.fold(f32::INFINITY, |least, &squared| least.min(squared));
        let outlasts_s = OUTLASTS / (p1 + p2 * first);
        self.entry_time_s + crossing_s < self.duration_s
            && crossing_s < (1.0 + SHORTER_PART) * self.strong_s + SHORTER_S
            && crossing_s + outlasts_s > self.strong_s
    }

    /// Time from the first axle's entry to the last one's exit, s; none if the train stops before.
    fn crossing_s(&self, bridge: &ReducedBridge<f32>, observation: &Observation<f32>, speed_mps: f32) -> Option<f32> {
        let mut run = observation.run;
        run.speed_mps = speed_mps;
        run.entry_time_s = 0.0;
        run.time_at_s(bridge.path.length_m() + observation.cars.train().length_m())
    }

    // Not inlined: its frame, with the bins, must not stand on the stack under a search.
    /// The run of `observation` simulated, beside what was recorded.
    #[inline(never)]
    fn attempt(
        &self,
        bridge: &ReducedBridge<f32>,
        observation: &Observation<f32>,
        samples: &[f32],
        soft: bool,
    ) -> Result<Tried, SetupError> {
        let channels = observation.recorder.sensors.len().max(1);
        let hypothesis = Hypothesis {
            damage: if soft { SOFT } else { UNDAMAGED },
            ..observation.expected()
        };
        let mut simulation = Simulation::<f32, MODES>::new(bridge, &hypothesis, observation)?;
        let mut bins = Bins::new(samples.len() / channels);
        for (index, row) in samples.chunks_exact(channels).enumerate() {
            let simulated: [f32; CHANNELS] = simulation.sample(observation);
            bins.push(index, energy(observation, row, &simulated));
        }
        let simulated = bins.growth();
        let rate = observation.recorder.sample_rate_hz;
        let mut late_s = [0.0; PARTS];
        for (late_s, (recorded, simulated)) in late_s.iter_mut().zip(self.recorded.at.iter().zip(&simulated.at)) {
            *late_s = (recorded - simulated) / rate;
        }
        let mean = |values: &[f32; PARTS]| values.iter().fold(0.0, |sum, value| sum + value) / PARTS as f32;
        let shift_s = if self.unknown.entry { mean(&late_s) } else { 0.0 };
        let square = mean(&late_s.map(|late_s| (late_s - shift_s) * (late_s - shift_s)));
        let [first, .., last] = self.recorded.at;
        let deviation_s = DEVIATION_S + DEVIATION_PART * (last - first) / rate;
        let energy = |growth: &Growth| growth.energy.max(f32::MIN_POSITIVE);
        let load = 0.5 * math::ln(energy(&self.recorded) / energy(&simulated)) / LOAD_RANGE;
        let rise = shift_s / RISE_DEVIATION_S;
        Ok(Tried {
            speed_mps: observation.run.speed_mps,
            soft,
            entry_time_s: observation.run.entry_time_s + shift_s,
            misfit: square / (deviation_s * deviation_s) + load * load + rise * rise,
        })
    }
}

/// Energy of the accelerations among `values`, where there is a recorded one too, (m/s²)².
fn energy(observation: &Observation<f32>, recorded: &[f32], values: &[f32]) -> f32 {
    let mut sum = 0.0;
    for ((recorded, value), sensor) in recorded.iter().zip(values).zip(&observation.recorder.sensors) {
        if sensor.quantity == Quantity::Acceleration && !recorded.is_nan() {
            sum += value * value;
        }
    }
    sum
}

/// Energy by time.
struct Bins {
    rows_each: usize,
    energy: [f32; BINS],
}

impl Bins {
    /// For so many rows.
    fn new(rows: usize) -> Self {
        Self {
            rows_each: rows.div_ceil(BINS).max(1),
            energy: [0.0; BINS],
        }
    }

    fn push(&mut self, row: usize, energy: f32) {
        let bin = row.checked_div(self.rows_each);
        if let Some(bin) = bin.and_then(|bin| self.energy.get_mut(bin)) {
            *bin += energy;
        }
    }

    /// When the sum first had grown to each part of the whole. (Where noise was taken away it falls now and then.)
    fn growth(&self) -> Growth {
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
