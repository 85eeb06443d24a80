//! A passage made by the computer: the interaction solved in `f64`, raw or through a recorder's chain, with noise.
//!
//! ```text
//! damage -> modes of the damaged bridge -> interaction, a step at a time -> low-pass -> every n-th step -> noise
//! ```
//!
//! The samples are those of the half-open time from 0 to the end of the tail; the first axle enters after the lead.

use anyhow::{Context, Result, bail};
use rand_core::SeedableRng;
use rand_xoshiro::Xoshiro256PlusPlus;
use spanwatch::bridge::MAX_DAMAGE;
use spanwatch::capacity::{CHANNELS, ELEMENTS};
use spanwatch::interaction::{Direction, Kinematics, Run, Scheme};
use spanwatch::math::Real;
use spanwatch::recorder::{AntiAlias, AntiAliasState};
use spanwatch::track::Track;
use spanwatch::wire::message::{Quantity, TrainKind};

use crate::crossing::{Crossing, MAX_MODES};
use crate::model::Structure;
use crate::model::eigen::Wanted;
use crate::model::modal::ModalModel;
use crate::random::gaussian;
use crate::recording::description::MAX_SPEED_KMH;
use crate::track::Profile;
use crate::train::{SpatialTrain, TrainName};

/// Most solver steps of one passage: a minute's work. A passage that needs more has a slip in its speed or step.
pub const MAX_STEPS: f64 = 2e7;
/// Stiffest bridge, as a part of its model's stiffness.
pub const MAX_STIFFNESS: f64 = 2.0;
/// The report of progress comes every so many samples.
const REPORT_SAMPLES: usize = 1024;
/// A duration that is a whole number of intervals but for this part of one ends there.
const WHOLE: f64 = 1e-6;

/// Everything about a passage that is to be simulated.
#[derive(Debug, Clone)]
pub struct Scenario {
    /// What rolls.
    pub train: TrainName,
    /// Number of cars; none where the train's file says it.
    pub cars: Option<usize>,
    /// Speed as the train enters, km/h.
    pub speed_kmh: f64,
    /// Change of the speed, m/s².
    pub acceleration_mps2: f64,
    /// The end that it enters by.
    pub direction: Direction,
    /// Irregularity of the track; none: smooth.
    pub track: Option<Profile>,
    /// Fraction of stiffness lost by each element or group of elements; those beyond the list are whole.
    pub damage: Vec<f64>,
    /// Stiffness of the whole bridge (of all elements or groups), as a part of its model's; the damage counts from there.
    pub stiffness_factor: f64,
    /// Bridge nodes that are observed.
    pub nodes: Vec<u16>,
    /// What is observed there.
    pub quantity: Quantity,
    /// Modes of the damaged bridge.
    pub modes: usize,
    /// Instead of a number of modes: all up to this frequency, Hz.
    pub up_to_hz: Option<f64>,
    /// Step of the solver, s.
    pub step_s: f64,
    /// Samples a second; none: every step.
    pub rate_hz: Option<f64>,
    /// Cut-off of the recorder's filter, Hz; none: no filter.
    pub antialias_hz: Option<f64>,
    /// White noise, as a part of each channel's RMS.
    pub noise: f64,
    /// Seed of the noise.
    pub seed: u64,
    /// Scales the static wheel loads.
    pub load_factor: f64,
    /// Time before the first axle enters, s.
    pub lead_s: f64,
    /// Time after the last axle has left, s.
    pub tail_s: f64,
    /// How the rail's motion under a wheel is taken.
    pub kinematics: Kinematics,
    /// How time is stepped.
    pub scheme: Scheme,
}

impl Scenario {
    /// One inspection car over a healthy bridge at 60 km/h, seen at mid-span of ten elements, raw.
    pub fn inspection_car() -> Self {
        Self {
            train: TrainName::Known(TrainKind::Inspection2Dof),
            cars: Some(1),
            speed_kmh: 60.0,
            acceleration_mps2: 0.0,
            direction: Direction::Forward,
            track: None,
            damage: vec![0.0; ELEMENTS],
            stiffness_factor: 1.0,
            nodes: vec![6],
            quantity: Quantity::Acceleration,
            modes: 8,
            up_to_hz: None,
            step_s: 1e-3,
            rate_hz: None,
            antialias_hz: None,
            noise: 0.0,
            seed: 1,
            load_factor: 1.0,
            lead_s: 1.0,
            tail_s: 2.0,
            kinematics: Kinematics::Paper,
            scheme: Scheme::AverageAcceleration,
        }
    }

    /// The recorder's chain of the design: 40 Hz low-pass, 200 samples a second.
    pub fn recorded(self) -> Self {
        Self {
            rate_hz: Some(200.0),
            antialias_hz: Some(40.0),
            scheme: Scheme::Exact,
            ..self
        }
    }

    /// Time between samples, s.
    pub fn sample_interval_s(&self) -> f64 {
        self.rate_hz.map_or(self.step_s, f64::recip)
    }

    /// How the train runs; the first axle enters after the lead.
    pub fn run<T: Real>(&self) -> Run<T> {
        Run {
            speed_mps: T::of(self.speed_kmh / 3.6),
            acceleration_mps2: T::of(self.acceleration_mps2),
            entry_time_s: T::of(self.lead_s),
            load_factor: T::of(self.load_factor),
            direction: self.direction,
            kinematics: self.kinematics,
        }
    }

    /// The modes that are wanted.
    fn wanted(&self) -> Wanted {
        self.up_to_hz.map_or(Wanted::Count(self.modes), Wanted::UpToHz)
    }

    /// Fraction of the model's stiffness that each of so many elements lacks; negative where it is stiffer.
    fn loss(&self, elements: usize) -> Vec<f64> {
        if self.stiffness_factor == 1.0 {
            // To the bit.
            return self.damage.clone();
        }
        let damage = self.damage.iter().copied().chain(std::iter::repeat(0.0));
        damage
            .take(elements)
            .map(|damage| 1.0 - self.stiffness_factor * (1.0 - damage))
            .collect()
    }

    /// Solver steps from one sample to the next.
    fn steps_per_sample(&self) -> Result<u32> {
        let steps = self.sample_interval_s() / self.step_s;
        let whole = steps.round();
        if (steps - whole).abs() > 1e-6 * whole || whole < 1.0 {
            bail!(
                "--step-s {} does not divide the time between samples, {:.6} s; take a step that does",
                self.step_s,
                self.sample_interval_s()
            );
        }
        Ok(whole as u32)
    }

    /// Everything that can be said without solving.
    fn check(&self, bridge: &Structure) -> Result<()> {
        let groups = bridge.bridge.frame.groups.len();
        let positive = [
            ("--speed-kmh", self.speed_kmh),
            ("--step-s", self.step_s),
            ("--load-factor", self.load_factor),
            ("--stiffness-factor", self.stiffness_factor),
            ("--rate-hz", self.rate_hz.unwrap_or(1.0)),
            ("--antialias-hz", self.antialias_hz.unwrap_or(1.0)),
            ("--up-to-hz", self.up_to_hz.unwrap_or(1.0)),
        ];
        if let Some((name, value)) = positive
            .into_iter()
            .find(|(_, value)| !(value.is_finite() && *value > 0.0))
        {
            bail!("{name} must be a positive number, not {value}");
        }
        let not_negative = [
            ("--lead-s", self.lead_s),
            ("--tail-s", self.tail_s),
            ("--noise", self.noise),
        ];
        if let Some((name, value)) = not_negative
            .into_iter()
            .find(|(_, value)| !(value.is_finite() && *value >= 0.0))
        {
            bail!("{name} must be zero or positive, not {value}");
        }
        if self.speed_kmh > MAX_SPEED_KMH {
            bail!(
                "--speed-kmh must be at most {MAX_SPEED_KMH} km/h, not {}",
                self.speed_kmh
            );
        }
        if let Some(e) = self.damage.iter().skip(groups).position(|&loss| loss != 0.0) {
            bail!(
                "--damage names element {}, but bridge \"{}\" has elements 1 to {groups}",
                groups + e + 1,
                bridge.bridge.name
            );
        }
        if let Some(e) = self.damage.iter().position(|loss| !(0.0..=MAX_DAMAGE).contains(loss)) {
            bail!(
                "--damage of element {} must be 0 to {MAX_DAMAGE}, not {}",
                e + 1,
                self.damage[e]
            );
        }
        if !(1.0 - MAX_DAMAGE..=MAX_STIFFNESS).contains(&self.stiffness_factor) {
            bail!(
                "--stiffness-factor must be {:.1} to {MAX_STIFFNESS}, not {}",
                1.0 - MAX_DAMAGE,
                self.stiffness_factor
            );
        }
        if self.nodes.is_empty() || self.nodes.len() > CHANNELS {
            bail!("--nodes must name 1 to {CHANNELS} nodes, not {}", self.nodes.len());
        }
        if let Some((_, node)) = (self.nodes.iter().enumerate()).find(|&(i, node)| self.nodes[..i].contains(node)) {
            bail!("--nodes names node {node} twice");
        }
        let most = bridge.mass().nrows().min(MAX_MODES);
        if !(1..=most).contains(&self.modes) {
            bail!(
                "--modes must be 1 to {most} for bridge \"{}\", not {}",
                bridge.bridge.name,
                self.modes
            );
        }
        if !self.acceleration_mps2.is_finite() {
            bail!(
                "--acceleration-mps2 must be a finite number, not {}",
                self.acceleration_mps2
            );
        }
        if let Some(cutoff) = self.antialias_hz
            && cutoff * self.step_s >= 0.5
        {
            bail!("--antialias-hz {cutoff} needs steps shorter than {:.6} s", 0.5 / cutoff);
        }
        Ok(())
    }
}

/// A simulated passage.
#[derive(Debug, Clone)]
pub struct Passage {
    /// Time between samples, s; the first sample is at 0, the train enters at [`Scenario::lead_s`].
    pub interval_s: f64,
    /// One list of values a node, m/s² (m).
    pub channels: Vec<Vec<f64>>,
}

/// Solves a scenario.
///
/// # Errors
/// One sentence that names the flag of `host-sim simulate` whose value cannot be.
pub fn simulate(bridge: &Structure, scenario: &Scenario) -> Result<Passage> {
    simulate_reporting(bridge, scenario, &mut |_, _| ())
}

/// Solves a scenario and says from time to time how many of how many samples are done.
///
/// # Errors
/// As [`simulate`].
pub fn simulate_reporting(
    bridge: &Structure,
    scenario: &Scenario,
    report: &mut dyn FnMut(usize, usize),
) -> Result<Passage> {
    let train = scenario.train.train(scenario.cars)?;
    simulate_train(bridge, scenario, &train, report)
}

/// Solves a scenario under a train that may differ from the one it names.
///
/// # Errors
/// As [`simulate`].
pub fn simulate_train(
    bridge: &Structure,
    scenario: &Scenario,
    train: &SpatialTrain,
    report: &mut dyn FnMut(usize, usize),
) -> Result<Passage> {
    scenario.check(bridge)?;
    let model = ModalModel::new(
        bridge,
        &scenario.loss(bridge.bridge.frame.groups.len()),
        scenario.wanted(),
    )?;
    let rows = (scenario.nodes.iter())
        .map(|&node| {
            let sensor = model.sensors.iter().find(|sensor| sensor.number == node);
            sensor.map(|sensor| sensor.row.as_slice()).with_context(|| {
                format!(
                    "bridge \"{}\" has no node {node}; its nodes are 1 to {}",
                    model.name,
                    model.sensors.len()
                )
            })
        })
        .collect::<Result<Vec<&[f64]>>>()?;
    let run = scenario.run::<f64>();
    let steps_per_sample = scenario.steps_per_sample()?;
    let filter = AntiAlias::new(scenario.antialias_hz, scenario.step_s);
    let mut states = vec![AntiAliasState::AT_REST; rows.len()];

    let length_m = model.length_m() + train.length_m();
    let left_s = run
        .time_at_s(length_m)
        .context("the train stops before it has left the bridge; check --speed-kmh and --acceleration-mps2")?;
    let duration_s = left_s + scenario.tail_s;
    let intervals = duration_s / scenario.sample_interval_s();
    let steps = intervals * f64::from(steps_per_sample);
    if steps.is_nan() || steps > MAX_STEPS {
        bail!(
            "this passage lasts {duration_s:.0} s, which is {:.1e} steps of {} s, more than the {MAX_STEPS:.0e} that are \
             solved here; check --speed-kmh, --lead-s, --tail-s and --step-s",
            steps,
            scenario.step_s
        );
    }
    let samples = (intervals - WHOLE).ceil().max(1.0) as usize;
    // The first sample is that of time 0, before the first step.
    let mut channels = vec![vec![0.0]; rows.len()];
    let mut step = 0;
    let crossing = Crossing {
        model: &model,
        train,
        run,
        track: (scenario.track.as_ref()).map(|profile| profile as &dyn Track<f64>),
        scheme: scenario.scheme,
        step_s: scenario.step_s,
    };
    crossing.solve((samples - 1) * steps_per_sample as usize, &mut |state| {
        step += 1;
        let modal = match scenario.quantity {
            Quantity::Acceleration => state.acceleration,
            Quantity::Displacement => state.position,
        };
        let is_sample = step % steps_per_sample as usize == 0;
        for ((row, filter_state), channel) in rows.iter().zip(&mut states).zip(&mut channels) {
            let value: f64 = row.iter().zip(modal).map(|(row, q)| row * q).sum();
            let filtered = filter.apply(filter_state, value);
            if is_sample {
                channel.push(filtered);
            }
        }
        if step % (REPORT_SAMPLES * steps_per_sample as usize) == 0 {
            report(step / steps_per_sample as usize, samples);
        }
    })?;
    add_noise(&mut channels, scenario.noise, scenario.seed);
    Ok(Passage {
        interval_s: scenario.sample_interval_s(),
        channels,
    })
}

/// Adds white Gaussian noise, its standard deviation a part of each channel's RMS.
fn add_noise(channels: &mut [Vec<f64>], part: f64, seed: u64) {
    if part == 0.0 {
        return;
    }
    let mut rng = Xoshiro256PlusPlus::seed_from_u64(seed);
    for channel in channels {
        let mean_square = channel.iter().map(|v| v * v).sum::<f64>() / channel.len() as f64;
        let sigma = part * mean_square.sqrt();
        for value in channel {
            *value += sigma * gaussian(&mut rng);
        }
    }
}
