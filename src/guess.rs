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
//! The guess simulates nothing itself: it *asks* for a [`Pass`] and is *told* ([`growth`](crate::identify::growth)), so that it works in
//! the same bounded slices as the search, a few milliseconds of the logger each, in the same memory.
//!
//! Cost: 30 to 140 forward solves in all if the speed is unknown, else one, a million solver steps at most; 112 bytes of state, 2 KiB of stack when it begins.

use crate::bridge::{Damage, ReducedBridge};
use crate::capacity::ELEMENTS;
use crate::identify::growth::{Bins, Growth, PARTS, energy};
use crate::identify::pass::Found;
use crate::identify::{Pass, Problem};
use crate::interaction::{Hypothesis, Observation, Run, SetupError};
use crate::math;
use crate::passage::samples::Samples;
use crate::wire::message::{Ranges, Traffic};

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

/// How the train has run, as a first guess.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Guess {
    /// The run; what was not unknown of it is as it was.
    pub run: Run<f32>,
    /// How far off it may be.
    pub ranges: Ranges,
}

impl Guess {
    /// Tells an observation.
    pub fn tell(&self, observation: &mut Observation<f32>) {
        observation.run = self.run;
        observation.ranges = self.ranges;
    }
}

/// What a call of [`FirstGuess::advance`] came to.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Progress {
    /// There is more to do.
    More,
    /// This is the guess.
    Found(Guess),
    /// At no speed does this train leave the bridge within the passage.
    NotThisTrain,
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
    /// The speed that a pass is trying, and whether on the softer bridge.
    trying: Option<(f32, bool)>,
    /// Cost so far, tenths of a solver step.
    tenths: u64,
}

impl FirstGuess {
    /// A guess of what is `unknown` of the run of `observation`, whose samples these are, channel after channel, the rows `strong` of
    /// them in strong motion ([`Passage::strong`](crate::passage::Passage::strong)).
    pub fn new(
        observation: &Observation<f32>,
        samples: Samples<'_>,
        strong: core::ops::Range<usize>,
        unknown: Unknown,
    ) -> Self {
        let rate = observation.recorder.sample_rate_hz;
        let channels = observation.recorder.sensors.len().max(1);
        let rows = samples.len() / channels;
        let still = strong.start.saturating_sub((STILL_S * rate) as usize);
        let each_row = || samples.rows(channels).map(|row| energy(observation, &row, &row));
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
            trying: None,
            tenths: 0,
        }
    }

    /// Steps of the solver so far.
    pub fn solver_steps(&self) -> u64 {
        self.tenths / 10
    }

    /// Does one slice of the work, in the memory of `pass`. The problem is the same in every call, and its run what it was in
    /// [`FirstGuess::new`].
    ///
    /// # Errors
    /// If the passage cannot be simulated.
    pub fn advance(&mut self, problem: &Problem<'_>, pass: &mut Pass) -> Result<Progress, SetupError> {
        if let Some((speed_mps, soft)) = self.trying {
            let over = pass.advance(problem);
            self.tenths = self.tenths.saturating_add(pass.take_cost());
            if !over {
                return Ok(Progress::More);
            }
            if let Found::Growth(simulated) = pass.found() {
                let tried = self.compare(problem, &simulated, speed_mps, soft);
                if tried.misfit.is_finite() && self.best.is_none_or(|best| tried.misfit < best.misfit) {
                    self.best = Some(tried);
                }
            }
        }
        loop {
            self.trying = self.next_run(problem.bridge, problem.observation);
            let Some((speed_mps, soft)) = self.trying else {
                return Ok(self.conclude(problem));
            };
            // A speed at which the train would stop on its way is passed over, unless it is the one that is given.
            match self.begin(problem, pass, speed_mps, soft) {
                Err(error) if !self.unknown.speed => return Err(error),
                Err(_) => {}
                Ok(()) => return Ok(Progress::More),
            }
        }
    }

    fn begin(&self, problem: &Problem<'_>, pass: &mut Pass, speed_mps: f32, soft: bool) -> Result<(), SetupError> {
        let expected = problem.observation.expected();
        let hypothesis = Hypothesis {
            damage: if soft { SOFT } else { UNDAMAGED },
            run: Run {
                speed_mps,
                entry_time_s: self.entry_time_s,
                ..expected.run
            },
            ..expected
        };
        pass.grow(problem, &hypothesis)
    }

    fn conclude(&self, problem: &Problem<'_>) -> Progress {
        let (bridge, observation) = (problem.bridge, problem.observation);
        let Some(best) = self.best else {
            return Progress::NotThisTrain;
        };
        let mut ranges = observation.ranges;
        if self.unknown.speed {
            let crossing_s = self.crossing_s(bridge, observation, best.speed_mps).unwrap_or(0.0);
            ranges.speed = speed_range(crossing_s);
        }
        if self.unknown.entry {
            ranges.entry_s = ENTRY_RANGE_S;
        }
        let run = Run {
            speed_mps: best.speed_mps,
            entry_time_s: best.entry_time_s,
            ..observation.run
        };
        Progress::Found(Guess { run, ranges })
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

    /// What was recorded beside the simulation at a speed.
    fn compare(&self, problem: &Problem<'_>, simulated: &Growth, speed_mps: f32, soft: bool) -> Tried {
        let rate = problem.observation.recorder.sample_rate_hz;
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
        let load = 0.5 * math::ln(energy(&self.recorded) / energy(simulated)) / LOAD_RANGE;
        let rise = shift_s / RISE_DEVIATION_S;
        Tried {
            speed_mps,
            soft,
            entry_time_s: self.entry_time_s + shift_s,
            misfit: square / (deviation_s * deviation_s) + load * load + rise * rise,
        }
    }
}
