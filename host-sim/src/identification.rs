//! Searching a passage on this computer, without a logger's trigger and memory: a recording's or a simulated one.

use std::collections::HashMap;
use std::sync::{Mutex, PoisonError};

use anyhow::{Context, Result, bail};
use rand_core::SeedableRng;
use rand_xoshiro::Xoshiro128PlusPlus;
use spanwatch::bridge::{Damage, ReducedBridge};
use spanwatch::capacity::ELEMENTS;
use spanwatch::guess::{self, FirstGuess, Progress, Unknown};
use spanwatch::identify::free_vibration::{
    Compared, FreeVibration, SEARCHED, expected, first_free_sample, free_vibration,
};
use spanwatch::identify::refine::Stop;
use spanwatch::identify::{CodeSearch, DamageCode, Hybrid, Identification, MicroGa, PaperGa, Pass, Problem};
use spanwatch::interaction::simulation::{Recorder, Sensor};
use spanwatch::interaction::{Hypothesis, Observation, SetupError};
use spanwatch::passage::samples::Samples;
use spanwatch::passage::{Passage, Stream};
use spanwatch::track::learnt::{LearntTrack, UNLEARNT};
use spanwatch::train::PlanarTrain;
use spanwatch::wire::message::{Quantity, Ranges};

use crate::model::reduce::reduce;
use crate::model::{BridgeFrame, Structure};
use crate::replay::Prepared;
use crate::simulate::{Scenario, simulate};
use crate::train::TrainName;

/// Forward solves that the small genetic search may take when it is alone.
const MICRO_BUDGET: u32 = 4000;

/// What is taken of a recording from before the first axle enters, s.
pub const BEFORE_S: f64 = 1.5;
/// What is taken of it from after the last axle has left, s: a free vibration at 3.5 Hz and 2 % damping loses nine tenths.
pub const AFTER_S: f64 = 5.0;

/// Deviations of the speed and the entry that a passage is given to end later than it seems, before the bridge counts as free.
const LATER: f32 = 3.0;

/// How to search.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Method {
    /// The paper's genetic algorithm.
    PaperGa,
    /// The logger's small genetic search alone.
    MicroGa,
    /// The logger's own search: the small genetic search, then Gauss-Newton.
    Hybrid,
}

impl Method {
    /// As it is called on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::PaperGa => "paper-ga",
            Self::MicroGa => "micro-ga",
            Self::Hybrid => "hybrid",
        }
    }
}

/// What a search found.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Found {
    /// The damage to the nearest 10 %.
    pub code: DamageCode,
    /// Misfit, (m/s²)²: of the damage itself for [`Method::Hybrid`], else of the code.
    pub objective: f32,
    /// Forward solves that the search took, a derivative at its true cost.
    pub forward_solves: u32,
    /// Generations until the search ended.
    pub generations: u32,
    /// Generation in which the code appeared.
    pub best_since: u32,
    /// Whether the search reached its goal, not just the end of its budget.
    pub converged: bool,
    /// What the logger's search found; a genetic search alone gives a code only.
    pub identification: Option<Identification>,
}

impl Found {
    /// Fraction of bending stiffness lost by each element.
    pub fn damage(&self) -> Damage<f32> {
        self.identification
            .map_or_else(|| self.code.damage(), |found| found.estimate.damage)
    }

    /// What it says of the passage that is observed. A genetic search alone takes the run as it is expected.
    pub fn hypothesis(&self, observation: &Observation<f32>) -> Hypothesis<f32> {
        match &self.identification {
            Some(found) => found.hypothesis(),
            None => Hypothesis {
                damage: self.code.damage(),
                ..observation.expected()
            },
        }
    }
}

/// Misfits of the codes of one passage that are known already.
pub type Known = Mutex<HashMap<DamageCode, f32>>;

/// Searches. A misfit below `limit`, (m/s²)², ends the paper's search; `step` hears the generation before every forward solve.
pub fn search(
    problem: &Problem<'_>,
    method: Method,
    seed: u64,
    limit: f32,
    known: &Known,
    step: &mut dyn FnMut(u32),
) -> Result<Found> {
    let rng = Xoshiro128PlusPlus::seed_from_u64(seed);
    match method {
        Method::PaperGa => {
            let mut search = PaperGa::new(rng, limit);
            let found = run(problem, &mut search, known, step)?;
            Ok(Found {
                converged: search.converged(),
                ..found
            })
        }
        Method::MicroGa => {
            let mut search = MicroGa::new(rng, MICRO_BUDGET);
            run(problem, &mut search, known, step)
        }
        Method::Hybrid => {
            let found = hybrid(problem, seed, &mut || step(0))?;
            Ok(Found {
                code: found.code,
                objective: found.objective,
                forward_solves: found.forward_solves,
                generations: found.generations,
                best_since: found.generations,
                converged: found.stop != Stop::Budget,
                identification: Some(found),
            })
        }
    }
}

/// Runs the logger's search to its end; `slice` hears of every slice of it.
fn hybrid(problem: &Problem<'_>, seed: u64, slice: &mut dyn FnMut()) -> Result<Identification> {
    let (mut search, mut pass) = (Hybrid::new(seed), Box::new(Pass::new()));
    loop {
        slice();
        if let Some(found) = search.advance(problem, &mut pass)? {
            return Ok(*found);
        }
    }
}

/// Runs a genetic search to its end.
fn run(problem: &Problem<'_>, search: &mut impl CodeSearch, known: &Known, step: &mut dyn FnMut(u32)) -> Result<Found> {
    let known = || known.lock().unwrap_or_else(PoisonError::into_inner);
    let mut forward_solves = 0;
    while let Some(code) = search.ask() {
        step(search.generations());
        // A code that comes again is not solved again, but counts: the search on its own would have to.
        let before = known().get(&code).copied();
        let misfit = match before {
            Some(misfit) => misfit,
            None => problem.misfit(&code.damage())?,
        };
        known().insert(code, misfit);
        forward_solves += 1;
        search.tell(misfit);
    }
    let (code, objective) = search.best();
    let code = code.within(problem.bridge.elements);
    Ok(Found {
        code,
        objective,
        forward_solves,
        generations: search.generations(),
        best_since: search.best_since(),
        converged: false,
        identification: None,
    })
}

/// A passage as a search sees it.
#[derive(Debug, Clone)]
pub struct Observed {
    /// The bridge.
    pub bridge: ReducedBridge<f32>,
    /// What was learnt of the track.
    pub track: LearntTrack,
    /// Train, sensors and recorder.
    pub observation: Observation<f32>,
    /// Accelerations (displacements) without offset, m/s² (m), channel after channel within a sample; not-a-number where there is none.
    pub samples: Vec<f32>,
    /// Index in the recording's stream of the first of them.
    pub first_sample: u64,
    /// What the bridge does after the last of the samples, if that is to be compared, too.
    pub tail: Option<Tail>,
    /// What the user should know of the choice of the passage.
    pub note: Option<String>,
}

/// The free vibration after a train, to be compared in place of the samples of that time.
#[derive(Debug, Clone, PartialEq)]
pub struct Tail {
    /// Natural frequencies and damping ratios.
    pub vibration: FreeVibration,
    /// Whether the damping ratios are compared, too.
    pub damping: bool,
}

impl Observed {
    /// A simulated passage, solved in `f64` as `scenario` says, to be explained with the logger's own steps.
    ///
    /// # Errors
    /// If the scenario cannot be solved, or the logger does not know the bridge or the train.
    pub fn simulated(bridge: &BridgeFrame, scenario: &Scenario) -> Result<Self> {
        let passage = simulate(&Structure::new(bridge.clone())?, scenario)?;
        let samples = (0..passage.channels[0].len())
            .flat_map(|i| passage.channels.iter().map(move |channel| channel[i] as f32))
            .collect();
        Self::of(reduce(bridge)?.cast(), scenario, samples)
    }

    /// Samples of any origin, to be explained as a passage of `scenario` by the logger's own model and steps.
    ///
    /// # Errors
    /// If the logger does not know the train, or a sensor sits where the bridge has none.
    pub fn of(bridge: ReducedBridge<f32>, scenario: &Scenario, samples: Vec<f32>) -> Result<Self> {
        let TrainName::Known(kind) = scenario.train else {
            bail!("the logger does not know train \"{}\"", scenario.train.name())
        };
        let cars = scenario.cars.unwrap_or(1);
        let train = PlanarTrain::of_kind(kind, cars).with_context(|| format!("there is no train of {cars} cars"))?;
        let sensors = (scenario.nodes.iter())
            .map(|&node| {
                let place = bridge.sensor_at(node);
                let place = place.with_context(|| format!("the bridge has no node {node}"))?;
                let quantity = scenario.quantity;
                Ok(Sensor { place, quantity })
            })
            .collect::<Result<_>>()?;
        let antialias_hz = scenario.antialias_hz.map(|hz| hz as f32);
        let recorder = Recorder::new(sensors, scenario.sample_interval_s().recip() as f32, antialias_hz);
        Ok(Self {
            bridge,
            track: UNLEARNT.clone(),
            observation: Observation::new(train, scenario.run(), recorder, scenario.scheme)?,
            samples,
            first_sample: 0,
            tail: None,
            note: None,
        })
    }

    /// The passage that a recording describes: from [`BEFORE_S`] before the first axle enters to [`AFTER_S`] after the last one has
    /// left. More quiet time would add samples that say nothing, and make the answer look surer than it is.
    ///
    /// What the recording does not say of speed and entry is [guessed](FirstGuess) from the passage that a logger's trigger finds at
    /// the entry time; without an entry time it is the strongest in the file.
    ///
    /// # Errors
    /// The recording does not say which bridge and train, no passage is found in it, or it ends before the train has left.
    pub fn recorded(prepared: &Prepared) -> Result<Self> {
        let (mut observed, rows) = Self::located(prepared)?;
        observed.samples.truncate(rows * observed.problem().channels());
        Ok(observed)
    }

    /// The passage that a recording describes until the bridge is free, and in place of the samples from there to the recording's
    /// end the natural frequencies that they show; with `damping` the damping ratios, too.
    ///
    /// Where speed and entry are only roughly known, the passage is identified once with all its samples to know when that
    /// was; `seed` is of that search.
    ///
    /// # Errors
    /// As [`Self::recorded`], or no free vibration is found.
    pub fn recorded_with_tail(prepared: &Prepared, damping: bool, seed: u64) -> Result<Self> {
        let (mut observed, rows) = Self::located(prepared)?;
        let first = observed.first_free(rows, seed)?;
        observed.split_tail(first, damping).with_context(|| {
            let (recording, rate) = (&prepared.recording, prepared.recording.rate_hz());
            format!(
                "{}: no free vibration is found after the train, from {:.2} s of file time to its end at {:.2} s; that takes about \
                 a second above the noise, and frequencies within {:.0} to {:.0} % of the model's; without --free-vibration the \
                 samples are compared instead",
                prepared.path.display(),
                recording.start_s + (observed.first_sample as f64 + first as f64) / rate,
                recording.start_s + recording.duration_s(),
                100.0 * SEARCHED[0],
                100.0 * SEARCHED[1],
            )
        })?;
        Ok(observed)
    }

    /// Index of the sample from which the bridge is free. Where speed and entry are only roughly known, the passage is identified
    /// once with its first so many samples of each channel to know that; `seed` is of that search.
    ///
    /// # Errors
    /// If the passage cannot be simulated, or the train does not leave.
    pub fn first_free(&self, rows: usize, seed: u64) -> Result<usize> {
        let mut located = self.observation.clone();
        if located.ranges.speed > 0.0 || located.ranges.entry_s > 0.0 {
            let problem = self.problem();
            let first = self.samples.get(..rows * problem.channels());
            let samples = Samples::Plain(first.unwrap_or(&self.samples));
            let found = hybrid(&Problem { samples, ..problem }, seed, &mut || ())?;
            // What is not explained has not been located either.
            if found.explained() {
                let [_, speed, entry_s, _] = found.std.map(|std| LATER * std);
                located.run = found.run;
                located.ranges = Ranges {
                    speed: speed.min(located.ranges.speed),
                    entry_s: entry_s.min(located.ranges.entry_s),
                    ..located.ranges
                };
            }
        }
        first_free_sample(&self.bridge, &located).context(SetupError::Stops)
    }

    /// Takes the natural frequencies (and damping ratios) of the samples from `first` on in their place; none if there is no free
    /// vibration in them, and then nothing has changed.
    pub fn split_tail(&mut self, first: usize, damping: bool) -> Option<()> {
        let recorder = &self.observation.recorder;
        let rate_hz = recorder.sample_rate_hz;
        let band_hz = recorder.antialias_hz.unwrap_or(0.5 * rate_hz);
        let modes = expected(&self.bridge, &[0.0; ELEMENTS], band_hz, SEARCHED);
        let channels = self.problem().channels();
        let vibration = free_vibration(self.samples.get(first * channels..)?, channels, rate_hz, &modes)?;
        self.samples.truncate(first * channels);
        self.tail = Some(Tail { vibration, damping });
        Some(())
    }

    /// The passage as [`Self::recorded`] has it, but with all samples to the recording's end, and how many of them that takes.
    fn located(prepared: &Prepared) -> Result<(Self, usize)> {
        let name = prepared.path.display();
        let missing = prepared.missing_keys();
        if !missing.is_empty() {
            bail!(
                "{name}: to identify damage the recording's TOML must give {}",
                missing.join(" and ")
            );
        }
        let (Some(bridge), Some(traffic)) = (&prepared.bridge, &prepared.configuration.traffic) else {
            let train = prepared.recording.train.as_ref().map_or("", TrainName::name);
            bail!("{name}: the logger's search does not know train \"{train}\"");
        };
        let (bridge, track) = (bridge.cast::<f32>(), UNLEARNT.clone());
        let start_s = prepared.recording.start_s;
        let duration_s = prepared.recording.duration_s();
        if let Some(entry_s) = traffic.entry_time_s.filter(|entry| !(0.0..duration_s).contains(entry)) {
            bail!(
                "{name}: the train enters at {} s of file time, but the recording ends at {} s; check entry_time_s",
                entry_s + start_s,
                duration_s + start_s
            );
        }
        let mut observation = (prepared.configuration)
            .observe(traffic, &bridge, 0)
            .with_context(|| name.to_string())?;
        let channels = prepared.recording.channels.len();
        let rate = prepared.recording.rate_hz();
        let mut note = None;
        let (all, entry_s) = match traffic.entry_time_s.filter(|_| traffic.speed_mps.is_some()) {
            Some(entry_s) => (samples(prepared, (entry_s * rate) as usize), entry_s),
            None => {
                let (passage, of) = strongest(prepared, traffic.entry_time_s)?;
                if of > 1 {
                    note = Some(format!(
                        "{name}: {of} passages; the strongest, at {:.2} s of file time, is taken; entry_time_s in the TOML names another",
                        passage.start_sample as f64 / rate + start_s
                    ));
                }
                let quiet = passage
                    .strong_sample
                    .saturating_sub((2.0 * f64::from(guess::RISE_S) * rate) as u64);
                let all = samples(prepared, quiet as usize);
                let (first, next) = (passage.first_sample as usize, passage.next_sample as usize);
                let kept = Samples::Plain(&all[first * channels..(next * channels).min(all.len())]);
                // The entry counts from the first sample of the passage until it is known.
                observation.run.entry_time_s -= (first as f64 / rate) as f32;
                let unknown = Unknown {
                    speed: traffic.speed_mps.is_none(),
                    entry: traffic.entry_time_s.is_none(),
                };
                let mut first_guess = FirstGuess::new(&observation, kept, passage.strong(), unknown);
                let mut pass = Box::new(Pass::new());
                let guess = loop {
                    let problem = Problem {
                        bridge: &bridge,
                        track: &track,
                        observation: &observation,
                        samples: kept,
                        free_vibration: None,
                    };
                    match first_guess.advance(&problem, &mut pass)? {
                        Progress::More => {}
                        Progress::Found(guess) => break guess,
                        Progress::NotThisTrain => bail!(
                            "{name}: no speed between 20 and 400 km/h brings this train over the bridge within the passage from \
                             {:.2} s to {:.2} s of file time; check train and cars, and that the recording goes on until the bridge is quiet",
                            passage.start_sample as f64 / rate + start_s,
                            passage.next_sample as f64 / rate + start_s
                        ),
                    }
                };
                guess.tell(&mut observation);
                let guessed = f64::from(guess.run.entry_time_s) + first as f64 / rate;
                (all, traffic.entry_time_s.unwrap_or(guessed))
            }
        };
        observation.run.entry_time_s = entry_s as f32;
        let length_m = observation.cars.train().length_m() + bridge.path.length_m();
        let left_s = |speed_part: f32| {
            let mut run = observation.run;
            run.speed_mps *= speed_part;
            run.time_at_s(length_m).map(f64::from)
        };
        // Held, it must have left; only guessed, it may have left sooner.
        let (Some(soonest), Some(left), Some(latest)) = (
            left_s(1.0 + observation.ranges.speed),
            left_s(1.0),
            left_s(1.0 - observation.ranges.speed).or(left_s(1.0)),
        ) else {
            bail!("{name}: {}", SetupError::Stops)
        };
        // The last sample may come just before the moment at which the last axle leaves.
        let entry_range_s = f64::from(observation.ranges.entry_s);
        if soonest - entry_range_s > duration_s + 2.0 * prepared.recording.interval_s {
            bail!(
                "{name}: the recording is shorter than the passage: the last axle leaves the bridge at {:.2} s of file \
                 time, the recording ends at {:.2} s",
                left + start_s,
                duration_s + start_s
            );
        }
        let first = ((entry_s - entry_range_s - BEFORE_S).max(0.0) * rate) as usize;
        let last = (((latest + entry_range_s + AFTER_S) * rate) as usize).min(all.len() / channels);
        observation.run.entry_time_s = (entry_s - first as f64 / rate) as f32;
        let window = &all[first * channels..last * channels];
        for (c, channel) in prepared.recording.channels.iter().enumerate() {
            let values = || window.iter().skip(c).step_by(channels).filter(|value| !value.is_nan());
            if values().all(|value| Some(value) == values().next()) {
                bail!(
                    "{name}: channel \"{}\" does not move while the train passes: its sensor is dead, or always at the end of its \
                     range; leave it out of the TOML",
                    channel.column
                );
            }
        }
        let lost = window.iter().filter(|value| value.is_nan()).count();
        if lost > 0 {
            let text = format!(
                "{name}: {lost} of {} samples of the passage are missing or saturated and left out",
                window.len()
            );
            note = Some(note.map_or(text.clone(), |note| format!("{note}\nnote: {text}")));
        }
        let observed = Self {
            bridge,
            track,
            observation,
            samples: all[first * channels..].to_vec(),
            first_sample: first as u64,
            tail: None,
            note,
        };
        Ok((observed, last - first))
    }

    /// Identifies with the logger's search.
    ///
    /// # Errors
    /// If the passage cannot be simulated.
    pub fn identify(&self, seed: u64) -> Result<Identification> {
        hybrid(&self.problem(), seed, &mut || ())
    }

    /// The same passage with what was learnt of the track.
    pub fn with_track(&self, learnt: &LearntTrack) -> Self {
        let mut observed = self.clone();
        observed.track = learnt.clone();
        observed.observation.stiffness = learnt.stiffness;
        observed.bridge = observed.bridge.damped(learnt.damping);
        observed
    }

    /// The problem to be searched.
    pub fn problem(&self) -> Problem<'_> {
        Problem {
            bridge: &self.bridge,
            track: &self.track,
            observation: &self.observation,
            samples: Samples::Plain(&self.samples),
            free_vibration: self.tail.as_ref().map(|tail| Compared {
                vibration: &tail.vibration,
                damping: tail.damping,
            }),
        }
    }

    /// The passage simulated with `damage`, m/s² (m), as many samples as were recorded, channel after channel.
    pub fn simulate(&self, damage: &Damage<f32>) -> Result<Vec<f32>> {
        self.simulate_hypothesis(&Hypothesis {
            damage: *damage,
            ..self.observation.expected()
        })
    }

    /// The same with another run and stiffness, too.
    pub fn simulate_hypothesis(&self, hypothesis: &Hypothesis<f32>) -> Result<Vec<f32>> {
        let problem = self.problem();
        let mut simulation = problem.simulate(hypothesis)?;
        let channels = self.observation.recorder.sensors.len();
        let rows = problem.recorded().len();
        Ok((0..rows)
            .flat_map(|_| {
                simulation
                    .sample(&self.observation, &self.track.profile)
                    .into_iter()
                    .take(channels)
            })
            .collect())
    }
}

/// The strongest passage of a recording, by its peak acceleration, and how many there are; with an entry time, in the recording's
/// stream, that which contains it.
fn strongest(prepared: &Prepared, entry_s: Option<f64>) -> Result<(Passage, usize)> {
    let name = prepared.path.display();
    let recording = &prepared.recording;
    let channels = recording.channels.len();
    let counts = recording.to_counts();
    let mut stream = Box::new(Stream::new());
    stream.configure(&prepared.configuration);
    let mut found = Vec::new();
    let mut take = |stream: &mut Stream| {
        found.extend(std::iter::from_fn(|| stream.next_passage()));
        stream.release();
    };
    for run in &recording.runs {
        for row in 0..run.rows {
            let at = (run.first_row + row) * channels;
            let pushed = stream.push(run.first_sample + row as u64, &counts[at..at + channels]);
            pushed
                .ok()
                .with_context(|| format!("{name}: its rows do not follow each other"))?;
            take(&mut stream);
        }
    }
    stream.interrupt();
    take(&mut stream);
    let count = found.len();
    let peak = |passage: &Passage| {
        let accelerations = passage.peak.iter().zip(&recording.channels);
        accelerations
            .filter(|(_, channel)| channel.unit.quantity() == Quantity::Acceleration)
            .fold(0.0_f32, |most, (&peak, _)| most.max(peak))
    };
    let rate = recording.rate_hz();
    if let Some(entry_s) = entry_s {
        let contains =
            |passage: &Passage| (passage.first_sample..passage.next_sample).contains(&((entry_s * rate) as u64));
        let Some(passage) = found.into_iter().find(contains) else {
            bail!(
                "{name}: no passage is found at {} s of file time, so the speed cannot be estimated; check entry_time_s, or give \
                 speed_kmh",
                entry_s + recording.start_s
            );
        };
        return Ok((passage, 1));
    }
    match found.into_iter().max_by(|a, b| peak(a).total_cmp(&peak(b))) {
        Some(passage) => Ok((passage, count)),
        None => bail!(
            "{name}: no passage is found in it, so the entry time cannot be estimated; give entry_time_s, or check the channels' \
             units and that the file begins half a second before the train"
        ),
    }
}

/// The recording's counts as a logger reads them, gaps filled with nothing, the mean of the first `quiet_rows` subtracted.
fn samples(prepared: &Prepared, quiet_rows: usize) -> Vec<f32> {
    let recording = &prepared.recording;
    let channels = &recording.channels;
    let last = recording
        .runs
        .last()
        .map_or(0, |run| run.first_sample + run.rows as u64);
    let mut samples = vec![f32::NAN; last as usize * channels.len()];
    for run in &recording.runs {
        for row in 0..run.rows {
            let sample = (run.first_sample as usize + row) * channels.len();
            for (c, channel) in channels.iter().enumerate() {
                let count = channel.count(channel.values[run.first_row + row]);
                if count.abs() < channel.full_scale_counts {
                    samples[sample + c] = count as f32 * channel.lsb;
                }
            }
        }
    }
    for c in 0..channels.len() {
        let of_channel = || samples.iter().skip(c).step_by(channels.len());
        let quiet: Vec<f32> = of_channel()
            .take(quiet_rows)
            .copied()
            .filter(|value| !value.is_nan())
            .collect();
        let offset = quiet.iter().sum::<f32>() / quiet.len().max(1) as f32;
        for value in samples.iter_mut().skip(c).step_by(channels.len()) {
            *value -= offset;
        }
    }
    samples
}
