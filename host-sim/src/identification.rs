//! Identification of a whole recording on this computer, without a logger's trigger and memory.

use anyhow::{Context, Result, bail};
use rand_core::SeedableRng;
use rand_xoshiro::Xoshiro128PlusPlus;
use spanwatch::bridge::{Damage, ReducedBridge};
use spanwatch::identify::refine::Stop;
use spanwatch::identify::{CodeSearch, DamageCode, Hybrid, PaperGa, Problem, paper_ga};
use spanwatch::interaction::Observation;

use crate::replay::Prepared;
use crate::terminal;

/// How to search.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Method {
    /// The paper's genetic algorithm.
    PaperGa,
    /// The logger's own search: a small genetic search, then Gauss-Newton.
    Hybrid,
}

/// What a search found.
#[derive(Debug, Clone, PartialEq)]
pub struct Found {
    /// Fraction of bending stiffness lost by each element.
    pub damage: Damage<f32>,
    /// Standard deviation of each; the paper's search gives none.
    pub std: Option<Damage<f32>>,
    /// The damage to the nearest 10 %.
    pub code: DamageCode,
    /// Misfit, (m/s²)².
    pub objective: f32,
    /// Forward solves.
    pub forward_solves: u32,
    /// Generations of the genetic search.
    pub generations: u32,
    /// Whether the search reached its goal, not just the end of its budget.
    pub converged: bool,
    /// Elements that are damaged beyond doubt, bit `e` for element `e` from 0.
    pub certain: u16,
    /// Whether any damage explains the recording.
    pub explained: bool,
}

/// A recording as a search sees it.
pub struct Case {
    /// The bridge.
    pub bridge: ReducedBridge<f32>,
    /// Train, sensors and recorder.
    pub observation: Observation<f32>,
    /// Accelerations without offset, m/s², channel after channel within a sample; not-a-number where there is none.
    pub samples: Vec<f32>,
}

impl Case {
    /// The whole of a recording.
    ///
    /// # Errors
    /// The recording does not say which bridge, which train, how fast and when.
    pub fn of(prepared: &Prepared) -> Result<Self> {
        let name = prepared.path.display();
        let missing = prepared.missing_keys();
        if !missing.is_empty() {
            bail!(
                "{name}: to identify damage the recording's TOML must give {}; this version does not estimate them",
                missing.join(", ")
            );
        }
        let (Some(bridge), Some(traffic)) = (&prepared.bridge, &prepared.configuration.traffic) else {
            bail!("{name}: bridge and train are not known");
        };
        let bridge = bridge.cast::<f32>();
        let observation = prepared
            .configuration
            .observe(traffic, &bridge, 0)
            .with_context(|| name.to_string())?;
        let samples = samples(prepared);
        let duration_s = prepared.recording.duration_s();
        if !(0.0..duration_s).contains(&traffic.entry_time_s) {
            bail!(
                "{name}: the train enters at {} s of file time, but the recording ends at {} s; check entry_time_s",
                traffic.entry_time_s + prepared.recording.start_s,
                duration_s + prepared.recording.start_s
            );
        }
        let crossing_s =
            f64::from(observation.train.length_m() + bridge.path.length_m()) / f64::from(traffic.speed_mps);
        if traffic.entry_time_s + crossing_s > duration_s {
            bail!(
                "{name}: the recording is shorter than the passage: the last axle leaves the bridge at {:.2} s of file \
                 time, the recording ends at {:.2} s",
                traffic.entry_time_s + crossing_s + prepared.recording.start_s,
                duration_s + prepared.recording.start_s
            );
        }
        Ok(Self {
            bridge,
            observation,
            samples,
        })
    }

    /// The problem to be searched.
    pub fn problem(&self) -> Problem<'_> {
        Problem {
            bridge: &self.bridge,
            observation: &self.observation,
            samples: &self.samples,
        }
    }

    /// Searches.
    pub fn identify(&self, method: Method, seed: u64) -> Result<Found> {
        let problem = self.problem();
        match method {
            Method::Hybrid => self.hybrid(&problem, seed),
            Method::PaperGa => self.paper_ga(&problem, seed),
        }
    }

    fn hybrid(&self, problem: &Problem<'_>, seed: u64) -> Result<Found> {
        let mut search = Hybrid::new(seed);
        let bar = terminal::progress(0, "searching");
        let found = loop {
            if let Some(found) = search.advance(problem)? {
                break found;
            }
            bar.tick();
        };
        bar.finish_and_clear();
        Ok(Found {
            damage: found.damage,
            std: Some(found.std),
            code: found.code,
            objective: found.objective,
            forward_solves: found.forward_solves,
            generations: found.generations,
            converged: found.stop != Stop::Budget,
            certain: found.certain(),
            explained: found.explained(),
        })
    }

    fn paper_ga(&self, problem: &Problem<'_>, seed: u64) -> Result<Found> {
        let mut search = PaperGa::new(Xoshiro128PlusPlus::seed_from_u64(seed), paper_ga::LIMIT);
        let bar = terminal::progress(u64::from(paper_ga::MAX_GENERATIONS), "generations");
        let mut forward_solves = 0;
        while let Some(code) = search.ask() {
            search.tell(problem.misfit(&code.damage())?);
            forward_solves += 1;
            bar.set_position(search.generations().into());
        }
        bar.finish_and_clear();
        let (code, objective) = search.best();
        Ok(Found {
            damage: code.damage(),
            std: None,
            code,
            objective,
            forward_solves,
            generations: search.generations(),
            converged: search.converged(),
            certain: 0,
            explained: true,
        })
    }

    /// The passage simulated with `damage`, m/s², as many samples as were recorded, channel after channel.
    pub fn simulate(&self, damage: &Damage<f32>) -> Result<Vec<f32>> {
        let problem = self.problem();
        let mut simulation = problem.simulate(damage)?;
        let channels = self.observation.places.len();
        let rows = problem.recorded().len();
        Ok((0..rows)
            .flat_map(|_| simulation.sample().into_iter().take(channels))
            .collect())
    }
}

/// The recording's counts as a logger reads them, gaps filled with nothing, the mean before the train subtracted.
fn samples(prepared: &Prepared) -> Vec<f32> {
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
                    samples[sample + c] = count as f32 * channel.lsb_mps2;
                }
            }
        }
    }
    let before = recording.entry_in_stream_s().unwrap_or(0.0) * recording.rate_hz();
    for c in 0..channels.len() {
        let of_channel = || samples.iter().skip(c).step_by(channels.len());
        let quiet: Vec<f32> = of_channel()
            .take(before.max(0.0) as usize)
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
