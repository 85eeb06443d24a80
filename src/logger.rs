//! The logger: samples in, passage reports and alerts out. The same in the firmware and on a PC.
//!
//! ```text
//! push(counts) -> stream -> passage -> identification, a slice at each poll() -> decision -> next_event()
//! ```
//!
//! An alert is raised when an element's loss of stiffness is beyond doubt
//! ([`Estimate::is_certain`](crate::identify::estimate::Estimate::is_certain)). While one passage is being identified
//! the next one is found and reported, but its samples are not kept: there is memory for one.

mod delivery;
mod rails;
mod room;

use core::fmt;

use heapless::{Deque, Vec};
use serde::{Deserialize, Serialize};

use crate::bridge::{BlobError, ReducedBridge, blob};
use crate::capacity::CARS;
use crate::guess::{self, FirstGuess, Progress, Unknown};
use crate::identify::estimate::{CONTRADICTION, Estimate};
use crate::identify::evidence::{Change, Evidence, EvidenceError, Forgetting};
use crate::identify::hybrid::HIDDEN;
use crate::identify::refine::Stop;
use crate::identify::{Hybrid, Identification, Problem};
use crate::interaction::simulation::{Recorder, Sensor};
use crate::interaction::{Direction, Observation, Run, Scheme, SetupError};
use crate::math::level_db;
use crate::passage::stream::BlockError;
use crate::passage::{Kept, Passage, Stream};
use crate::slot::Slot;
use crate::track::blob::TrackError;
use crate::track::learnt::LearntTrack;
use crate::track::watch::Finding;
use crate::train::PlanarTrain;
use crate::wire::fingerprint;
use crate::wire::message::{
    Alert, Channel, Configuration, Event, Fit, Memory, PassageReport, Quality, Quantity, Ranges, Reason, RivalReport,
    TrackReport, TrackState, Traffic, Trigger, Verdict,
};

use delivery::{Deliveries, Strange};
use rails::Rails;
use room::Room;

pub use delivery::Item;

/// Part of a passage's samples that may be missing, saturated or stuck for it to be identified all the same.
const BAD_SAMPLES: f32 = 0.05;
/// Events that wait for [`Logger::next_event`]: all that one block of samples or one slice of work can cause.
const EVENTS: usize = 6;
/// Fastest sampling that makes sense, Hz.
const HIGHEST_RATE_HZ: f32 = 100_000.0;
/// Fewest samples in the trigger's window: with less one sample could be all of its level.
const WINDOW_SAMPLES: f32 = 8.0;
/// Fewest samples that it takes to begin and to end a passage, two of them for rounding: so no block of samples holds the ends of more than
/// the stream has room for, with one that a gap before it has ended.
const BEGIN_AND_END_SAMPLES: f32 = 27.0;
/// Longest time of the trigger that makes sense, s; its largest ratio; and the accelerations between which a count or a quiet
/// level can lie, m/s².
const LONGEST_TRIGGER_S: f32 = 300.0;
const LARGEST_RATIO: f32 = 1000.0;
const ACCELERATIONS_MPS2: core::ops::RangeInclusive<f32> = 1e-9..=1e3;
/// Fastest train that makes sense, m/s.
const HIGHEST_SPEED_MPS: f32 = 200.0;
/// Strongest brake that makes sense, m/s².
const HIGHEST_ACCELERATION_MPS2: f32 = 5.0;
/// Displacements that one count can stand for, m.
const DISPLACEMENTS_M: core::ops::RangeInclusive<f32> = 1e-12..=1.0;

/// What is wrong with a configuration.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum ConfigurationError {
    /// The sample rate is not 1 Hz to 100 kHz.
    Rate,
    /// There is no channel.
    Channels,
    /// No channel measures an acceleration.
    NoAcceleration,
    /// A channel's count stands for no acceleration (displacement), or its range is empty.
    Scale,
    /// A time, ratio or level of the trigger is not positive or absurd, it ends above where it begins, or its window, or its beginning
    /// and end, hold too few samples.
    Trigger,
    /// The anti-alias filter's cut-off is not positive.
    Antialias,
    /// A memory is shorter than a passage, or the recent one not the shorter.
    Memory,
    /// Cars, speed (up to 200 m/s), entry time or load factor of the train make no sense.
    Traffic,
    /// How far off speed, entry time, load or stiffness may be is negative, not finite or too far.
    Ranges,
}

impl fmt::Display for ConfigurationError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Rate => "the sample rate must be 1 Hz to 100 kHz",
            Self::Channels => "there must be at least one channel",
            Self::NoAcceleration => {
                "at least one channel must measure an acceleration: passages are found by it, a displacement is too slow for that"
            }
            Self::Scale => "each channel needs a positive acceleration or displacement per count and a positive full scale",
            Self::Trigger => {
                "the trigger's times (up to 300 s), ratios (up to 1000) and floor must be positive, on_ratio above 1, off_ratio \
                 not above it, its window must hold 8 samples at least, and on_duration and off_duration together 27: record faster"
            }
            Self::Antialias => "the anti-alias filter's cut-off must be positive",
            Self::Memory => {
                "a memory must be one passage at least, or 0 to forget nothing, and the recent one the shorter of the two"
            }
            Self::Traffic => {
                "the train must have 1 to 16 cars, a speed up to 200 m/s, a finite entry time, a positive load factor"
            }
            Self::Ranges => {
                "the ranges must be 0 (held) or positive: speed up to 0.5, entry_s up to 10 s, load up to 0.9, stiffness up to 0.3"
            }
        })
    }
}

impl core::error::Error for ConfigurationError {}

impl Configuration {
    /// Refuses what makes no sense.
    pub fn check(&self) -> Result<(), ConfigurationError> {
        let positive = |value: f32| value > 0.0 && value.is_finite();
        if !(1.0..=HIGHEST_RATE_HZ).contains(&self.sample_rate_hz) {
            return Err(ConfigurationError::Rate);
        }
        if self.channels.is_empty() {
            return Err(ConfigurationError::Channels);
        }
        let lsb_makes_sense = |c: &Channel| match c.quantity {
            Quantity::Acceleration => ACCELERATIONS_MPS2.contains(&c.lsb),
            Quantity::Displacement => DISPLACEMENTS_M.contains(&c.lsb),
        };
        if !self
            .channels
            .iter()
            .all(|c| lsb_makes_sense(c) && c.full_scale_counts > 0)
        {
            return Err(ConfigurationError::Scale);
        }
        if !self.channels.iter().any(|c| c.quantity == Quantity::Acceleration) {
            return Err(ConfigurationError::NoAcceleration);
        }
        let Trigger {
            window_s,
            on_ratio,
            on_duration_s,
            off_ratio,
            off_duration_s,
            floor_mps2,
            lead_s,
        } = self.trigger;
        let believable = [window_s, on_duration_s, off_duration_s]
            .into_iter()
            .all(|time| positive(time) && time <= LONGEST_TRIGGER_S)
            && (0.0..=LONGEST_TRIGGER_S).contains(&lead_s)
            && on_ratio > 1.0
            && on_ratio <= LARGEST_RATIO
            && positive(off_ratio)
            && off_ratio <= on_ratio
            && ACCELERATIONS_MPS2.contains(&floor_mps2)
            && window_s * self.sample_rate_hz >= WINDOW_SAMPLES
            && (on_duration_s + off_duration_s) * self.sample_rate_hz >= BEGIN_AND_END_SAMPLES;
        if !believable {
            return Err(ConfigurationError::Trigger);
        }
        if Forgetting::new(self.memory.long_passages, self.memory.recent_passages).is_err() {
            return Err(ConfigurationError::Memory);
        }
        if self.antialias_hz.is_some_and(|hz| !positive(hz)) {
            return Err(ConfigurationError::Antialias);
        }
        let makes_sense = |traffic: &Traffic| {
            (1..=CARS).contains(&usize::from(traffic.cars))
                && (traffic.speed_mps).is_none_or(|speed| positive(speed) && speed <= HIGHEST_SPEED_MPS)
                && traffic.acceleration_mps2.abs() <= HIGHEST_ACCELERATION_MPS2
                && traffic.entry_time_s.is_none_or(f64::is_finite)
                && positive(traffic.load_factor)
        };
        if !self.traffic.as_ref().is_none_or(makes_sense) {
            return Err(ConfigurationError::Traffic);
        }
        let within = |Ranges {
                          speed,
                          entry_s,
                          load,
                          stiffness,
                      }: &Ranges| {
            (0.0..=Ranges::WIDEST.speed).contains(speed)
                && (0.0..=Ranges::WIDEST.entry_s).contains(entry_s)
                && (0.0..=Ranges::WIDEST.load).contains(load)
                && (0.0..=Ranges::WIDEST.stiffness).contains(stiffness)
        };
        if !self.traffic.as_ref().is_none_or(|traffic| within(&traffic.ranges)) {
            return Err(ConfigurationError::Ranges);
        }
        Ok(())
    }

    // Not inlined: a train and its steps are copied a few times.
    /// How a passage of `traffic` is to be simulated whose samples begin at `first_sample` of the stream. A speed or entry time that
    /// is not known stands at a value that is no guess: [`FirstGuess`] replaces it.
    #[inline(never)]
    pub fn observe(
        &self,
        traffic: &Traffic,
        bridge: &ReducedBridge<f32>,
        first_sample: u64,
    ) -> Result<Observation<f32>, SetupError> {
        let first_s = first_sample as f64 / f64::from(self.sample_rate_hz);
        let train = PlanarTrain::of_kind(traffic.train, traffic.cars.into()).ok_or(SetupError::Cars)?;
        let run = Run {
            entry_time_s: traffic.entry_time_s.map_or(0.0, |entry_s| (entry_s - first_s) as f32),
            load_factor: traffic.load_factor,
            acceleration_mps2: traffic.acceleration_mps2,
            direction: if traffic.backward {
                Direction::Backward
            } else {
                Direction::Forward
            },
            ..Run::at(traffic.speed_mps.unwrap_or(guess::LOWEST_SPEED_MPS))
        };
        let mut sensors = Vec::new();
        for channel in &self.channels {
            let place = bridge.sensor_at(channel.node).ok_or(SetupError::NoSuchSensor)?;
            let quantity = channel.quantity;
            // There is room for every channel's.
            let _ = sensors.push(Sensor { place, quantity });
        }
        let recorder = Recorder::new(sensors, self.sample_rate_hz, self.antialias_hz);
        let mut observation = Observation::new(train, run, recorder, Scheme::Exact)?;
        observation.ranges = traffic.ranges;
        Ok(observation)
    }
}

/// A passage that is being identified.
#[derive(Debug, Clone)]
struct Work {
    observation: Observation<f32>,
    /// Index of the passage's first sample in the stream.
    first_sample: u64,
    /// What must be guessed before the search.
    guess: Option<FirstGuess>,
    search: Hybrid,
    report: PassageReport,
}

/// State of the logger. Large: it belongs in static memory.
#[derive(Debug, Clone)]
pub struct Logger {
    configuration: Slot<Configuration>,
    /// Of no elements until one is loaded.
    bridge: ReducedBridge<f32>,
    rails: Rails,
    stream: Stream,
    work: Slot<Work>,
    /// Memory for the work, which always has it, or for what is on its way.
    room: Room,
    deliveries: Deliveries,
    /// The last passage that a learnt track did not explain.
    strange: Strange,
    /// What all passages say.
    evidence: Evidence,
    /// The bridge model's [`fingerprint`], by which its evidence is known.
    model_crc: u32,
    events: Deque<Event, EVENTS>,
    passages: u32,
    alerts: u32,
    solver_steps: u64,
}

impl Default for Logger {
    fn default() -> Self {
        Self::new()
    }
}

impl Logger {
    /// A logger without configuration and without a bridge: it takes no samples yet.
    pub const fn new() -> Self {
        Self {
            configuration: Slot::Empty,
            bridge: ReducedBridge::EMPTY,
            rails: Rails::new(),
            stream: Stream::new(),
            work: Slot::Empty,
            room: Room::Empty,
            deliveries: Deliveries::new(),
            strange: Strange::NONE,
            evidence: Evidence::new(Forgetting::NEVER),
            model_crc: 0,
            events: Deque::new(),
            passages: 0,
            alerts: 0,
            solver_steps: 0,
        }
    }

    /// Starts afresh with a configuration; work in progress and evidence are dropped, the bridge model stays.
    pub fn configure(&mut self, configuration: Configuration) -> Result<(), ConfigurationError> {
        configuration.check()?;
        let Memory {
            long_passages,
            recent_passages,
        } = configuration.memory;
        let forgetting = Forgetting::new(long_passages, recent_passages).map_err(|_| ConfigurationError::Memory)?;
        self.evidence = Evidence::new(forgetting);
        self.rails.watch.renumber();
        self.stream.configure(&configuration);
        self.work = Slot::Empty;
        self.events.clear();
        self.passages = 0;
        self.alerts = 0;
        self.solver_steps = 0;
        self.configuration = Slot::Full(configuration);
        Ok(())
    }

    /// Takes another bridge model, as [`blob::write`] makes it. An identification in progress and the evidence are dropped with the old
    /// one. Bytes that were changed on their way leave the old model; a model that is refused leaves none.
    pub fn load(&mut self, model: &[u8]) -> Result<(), BlobError> {
        self.end_work(Verdict::NotIdentified(Reason::Interrupted));
        let before = self.model_crc;
        adopt(model, &mut self.bridge, &mut self.model_crc, &mut self.evidence)?;
        self.rails.follow(&mut self.bridge, before == self.model_crc);
        Ok(())
    }

    /// Takes a track that was learnt with the bridge model that is loaded, as [`track::blob::write()`](crate::track::blob::write())
    /// makes it. An identification in progress is dropped; what is known of the bridge by an earlier track is kept.
    pub fn load_track(&mut self, track: &[u8]) -> Result<(), TrackError> {
        self.end_work(Verdict::NotIdentified(Reason::Interrupted));
        (self.rails).adopt(track, &mut self.bridge, self.model_crc, &mut self.evidence)
    }

    /// Takes the rails for smooth again, and what was found by a learnt track for nothing.
    pub fn forget_track(&mut self) {
        if self.rails.learnt().is_learnt() {
            self.end_work(Verdict::NotIdentified(Reason::Interrupted));
            self.rails.forget(&mut self.bridge);
            self.clear();
        }
    }

    /// Whether a track was learnt, and is still that.
    pub fn track_state(&self) -> TrackState {
        self.rails.state()
    }

    /// Writes what all passages say of the bridge into `buffer`; nothing if there is no room.
    pub fn evidence<'b>(&self, buffer: &'b mut [u8]) -> &'b [u8] {
        self.evidence
            .to_bytes(&self.rails.basis(self.model_crc), self.rails.watch, buffer)
            .unwrap_or_default()
    }

    /// Goes on from what [`Self::evidence`] wrote, for the same bridge model, before a restart.
    pub fn restore(&mut self, bytes: &[u8]) -> Result<(), EvidenceError> {
        self.rails.restore(bytes, self.model_crc, &mut self.evidence)
    }

    /// Forgets what all passages say of the bridge.
    pub fn clear(&mut self) {
        self.evidence = Evidence::new(self.evidence.forgetting());
    }

    /// Takes a block of raw counts, channel after channel within a sample, that begins at sample `first_sample` of the
    /// stream. A jump in the index is a gap; the last block once more is passed over.
    pub fn push(&mut self, first_sample: u64, counts: &[i32]) -> Result<(), BlockError> {
        self.stream.push(first_sample, counts)?;
        self.take_passages();
        Ok(())
    }

    /// The stream ends here: closes a passage that is open.
    pub fn finish(&mut self) {
        self.stream.interrupt();
        self.take_passages();
    }

    /// Does one slice of the work that waits; true if there is more.
    pub fn poll(&mut self) -> bool {
        let (Some(work), Some(pass)) = (self.work.as_mut(), self.room.pass()) else {
            return false;
        };
        let problem = Problem {
            bridge: &self.bridge,
            track: self.rails.learnt(),
            observation: &work.observation,
            samples: self.stream.passage_samples(),
            free_vibration: None,
        };
        if let Some(guess) = &mut work.guess {
            let before = guess.solver_steps();
            let progress = guess.advance(&problem, pass);
            let steps = guess.solver_steps().saturating_sub(before);
            self.solver_steps = self.solver_steps.saturating_add(steps);
            match progress {
                Ok(Progress::More) => return true,
                Ok(Progress::Found(guess)) => {
                    guess.tell(&mut work.observation);
                    work.guess = None;
                    return true;
                }
                Ok(Progress::NotThisTrain) => self.end_work(Verdict::NotIdentified(Reason::NotThisTrain)),
                Err(error) => self.end_work(Verdict::NotIdentified(Reason::Setup(error))),
            }
            return false;
        }
        let before = work.search.solver_steps();
        let found = work.search.advance(&problem, pass).map(|found| found.is_some());
        let steps = work.search.solver_steps().saturating_sub(before);
        self.solver_steps = self.solver_steps.saturating_add(steps);
        match found {
            Ok(false) => return true,
            Ok(true) => self.decide(),
            Err(error) => self.end_work(Verdict::NotIdentified(Reason::Setup(error))),
        }
        false
    }

    /// An identification is running.
    pub fn is_busy(&self) -> bool {
        self.work.as_ref().is_some()
    }

    /// The next thing that the base station should know.
    pub fn next_event(&mut self) -> Option<Event> {
        self.events.pop_front()
    }

    /// Samples taken in, of each channel.
    pub fn samples(&self) -> u64 {
        self.stream.taken()
    }

    /// What was wrong with samples so far.
    pub fn quality(&self) -> Quality {
        self.stream.quality()
    }

    /// Passages so far.
    pub fn passages(&self) -> u32 {
        self.passages
    }

    /// Alerts so far.
    pub fn alerts(&self) -> u32 {
        self.alerts
    }

    /// Steps of the interaction solver so far.
    pub fn solver_steps(&self) -> u64 {
        self.solver_steps
    }

    fn take_passages(&mut self) {
        while let Some(passage) = self.stream.next_passage() {
            self.passages = self.passages.saturating_add(1);
            let report = self.describe(&passage);
            match self.observe(&passage) {
                Ok((observation, guess)) => self.begin_work(&passage, observation, guess, report),
                Err(reason) => {
                    if passage.kept == Kept::Whole {
                        self.stream.release();
                        self.remember(report.passage, passage.first_sample, reason);
                    }
                    self.report(report, Verdict::NotIdentified(reason));
                }
            }
        }
    }

    // Not inlined: the work must not stand on the stack longer than it takes to be put into its place.
    #[inline(never)]
    fn begin_work(
        &mut self,
        passage: &Passage,
        observation: Observation<f32>,
        guess: Option<FirstGuess>,
        report: PassageReport,
    ) {
        let Some(configuration) = self.configuration.as_ref() else {
            return;
        };
        self.work = Slot::Full(Work {
            observation,
            first_sample: passage.first_sample,
            guess,
            search: Hybrid::new(configuration.seed),
            report,
        });
        self.room.begin_pass();
    }

    fn describe(&self, passage: &Passage) -> PassageReport {
        let channels = self.configuration.as_ref().map_or(0, |c| c.channels.len());
        PassageReport {
            passage: self.passages,
            start_sample: passage.start_sample,
            end_sample: passage.end_sample,
            peak: passage.peak.iter().take(channels).copied().collect(),
            level_db: level_db(passage.mean_square),
            quality: passage.quality,
            verdict: Verdict::NotIdentified(Reason::NoModel),
        }
    }

    /// How the passage is to be simulated, and what of it must be guessed first, or why it cannot be.
    #[inline(never)]
    fn observe(&self, passage: &Passage) -> Result<(Observation<f32>, Option<FirstGuess>), Reason> {
        let Some(configuration) = self.configuration.as_ref().filter(|_| self.bridge.elements > 0) else {
            return Err(Reason::NoModel);
        };
        let traffic = configuration.traffic.as_ref().ok_or(Reason::NoTraffic)?;
        match passage.kept {
            Kept::Whole => {}
            Kept::TooLong => return Err(Reason::TooLong),
            Kept::Busy => return Err(Reason::Busy),
        }
        let samples = self.stream.passage_samples();
        let rows = samples.len() / configuration.channels.len().max(1);
        if passage.quality.total() as f32 > BAD_SAMPLES * samples.len() as f32 {
            return Err(Reason::BadQuality);
        }
        if self.rails.watch.has_changed() {
            // Nothing could be believed of it; its samples wait for the base station instead.
            return Err(Reason::AnotherTrack);
        }
        let mut observation = configuration
            .observe(traffic, &self.bridge, passage.first_sample)
            .map_err(Reason::Setup)?;
        observation.stiffness = self.rails.learnt().stiffness;
        let duration_s = rows as f32 / configuration.sample_rate_hz;
        if traffic.entry_time_s.is_some() && !(0.0..duration_s).contains(&observation.run.entry_time_s) {
            return Err(Reason::NotThisTrain);
        }
        let guess =
            Unknown::of(traffic).map(|unknown| FirstGuess::new(&observation, samples, passage.strong(), unknown));
        Ok((observation, guess))
    }

    /// Why what the search has found is not believed; also asks whether the track is still the one that was learnt.
    fn doubt(&mut self) -> Option<Reason> {
        let Work { search, report, .. } = self.work.as_ref()?;
        let found = search.result()?;
        if found.stop == Stop::Budget {
            return Some(Reason::OutOfTime);
        }
        let doubt = if !found.explained() {
            Some(Reason::Unexplained)
        } else if found.estimate.contradiction > CONTRADICTION {
            Some(Reason::Implausible)
        } else {
            None
        };
        let Some(learnt) = self.rails.learnt.as_ref() else {
            return doubt;
        };
        let train = self.configuration.as_ref()?.traffic.as_ref()?.train;
        if !learnt.knows(train, &found.run) {
            // The track need not have changed for it.
            return doubt.or(Some(Reason::Uncalibrated));
        }
        let misfit = learnt.misfit(&found.mean_squares);
        let finding = self
            .rails
            .watch
            .judge(learnt, report.passage, doubt.is_none().then_some(misfit));
        if let Finding::Changed { since, creeping } = finding {
            if creeping {
                self.evidence.forget_recent();
            }
            let report = TrackReport {
                passage: report.passage,
                since,
                start_sample: report.start_sample,
                misfit,
                mean_misfit: self.rails.watch.mean(),
            };
            self.emit(Event::Track(report));
        }
        match finding {
            Finding::Same => doubt,
            Finding::Another => doubt.or(Some(Reason::AnotherTrack)),
            Finding::Changed { .. } => Some(Reason::AnotherTrack),
        }
    }

    // Not inlined: an alert must not stand on the stack under the search.
    #[inline(never)]
    fn decide(&mut self) {
        if let Some(reason) = self.doubt() {
            return self.end_work(Verdict::NotIdentified(reason));
        }
        let Some(Work {
            search,
            report,
            first_sample,
            ..
        }) = self.work.as_ref()
        else {
            return;
        };
        let (Some(found), Some(configuration)) = (search.result(), self.configuration.as_ref()) else {
            return;
        };
        let first_s = *first_sample as f64 / f64::from(configuration.sample_rate_hz);
        let learnt = self.rails.learnt();
        let mut change = self.evidence.add(&found.information);
        if self.evidence.outlive(learnt) && change == Change::None {
            change = Change::Sudden;
        }
        let fit = Fit {
            objective: found.objective,
            unexplained: found.unexplained,
            speed_mps: found.run.speed_mps,
            entry_time_s: f64::from(found.run.entry_time_s) + first_s,
            load_factor: found.run.load_factor,
            stiffness: found.stiffness,
            change,
        };
        let elements = self.bridge.elements;
        let (estimate, passages) = believed(found, &self.evidence, self.rails.learnt(), change, elements);
        let certain = estimate.certain();
        if certain == 0 {
            let hidden = estimate.hidden(elements);
            let hidden_permille = permille(&hidden);
            return self.end_work(if hidden > HIDDEN {
                Verdict::Undecided { fit, hidden_permille }
            } else {
                Verdict::Healthy { fit, hidden_permille }
            });
        }
        let permille = |values: &[f32]| values.iter().take(elements).map(permille).collect();
        let alert = Alert {
            bridge: self.bridge.name.clone(),
            passage: report.passage,
            start_sample: report.start_sample,
            damage_permille: permille(&estimate.damage),
            std_permille: permille(&estimate.std),
            low_permille: permille(&estimate.low),
            high_permille: permille(&estimate.high),
            passages,
            rival: found.rival.as_ref().map(|rival| RivalReport {
                whole: rival.whole as u8 + 1,
                damage_permille: permille(&rival.damage),
                loses_by: rival.loses_by,
            }),
            certain,
            objective: found.objective,
            objective_healthy: found.objective_healthy,
            forward_solves: found.forward_solves,
        };
        self.alerts = self.alerts.saturating_add(1);
        self.emit(Event::Alert(alert));
        self.end_work(Verdict::Damaged { fit });
    }

    /// The identification is over; the memory is free for the next passage.
    fn end_work(&mut self, verdict: Verdict) {
        self.stream.release();
        if let Some(work) = self.work.take() {
            if let Verdict::NotIdentified(reason) = verdict {
                self.remember(work.report.passage, work.first_sample, reason);
            }
            self.report(work.report, verdict);
        }
    }

    /// Remembers that the samples which the stream still has are those of a passage that the learnt track did not explain, if it was that.
    fn remember(&mut self, passage: u32, first_sample: u64, reason: Reason) {
        if reason.may_be_the_track() && self.rails.learnt().is_learnt() {
            self.strange = Strange {
                passage,
                first_sample,
                clearings: self.stream.clearings(),
            };
        }
    }

    fn report(&mut self, report: PassageReport, verdict: Verdict) {
        self.emit(Event::Passage(PassageReport { verdict, ..report }));
    }

    fn emit(&mut self, event: Event) {
        // Whoever runs the logger fetches its events after every call; no call causes more of them.
        let _ = self.events.push_back(event);
    }
}

/// Puts a bridge model into its place; another one than before begins an evidence of its own.
fn adopt(
    model: &[u8],
    bridge: &mut ReducedBridge<f32>,
    bridge_crc: &mut u32,
    evidence: &mut Evidence,
) -> Result<(), BlobError> {
    blob::read_into(model, bridge)?;
    let crc = fingerprint(model);
    if crc != *bridge_crc {
        *bridge_crc = crc;
        *evidence = Evidence::new(evidence.forgetting());
    }
    Ok(())
}

/// To the nearest per mille; what is larger than a message can hold becomes the largest that it can.
fn permille(value: &f32) -> u16 {
    (value * 1000.0 + 0.5) as u16
}

/// What is believed of the bridge after a passage, and on how many passages it rests: on all of them, unless there is only this
/// one, it contradicts the others, or it alone shows a damage beyond doubt that is still drowned in them.
fn believed(
    found: &Identification,
    evidence: &Evidence,
    learnt: &LearntTrack,
    change: Change,
    elements: usize,
) -> (Estimate, f32) {
    let passages = evidence.passages();
    if passages <= 1.0 || matches!(change, Change::Outlier | Change::Unusable) {
        return (found.estimate, 1.0);
    }
    let together = evidence.against(learnt).estimate(elements);
    if together.certain() == 0 && found.certain() != 0 {
        (found.estimate, 1.0)
    } else {
        (together, passages)
    }
}
