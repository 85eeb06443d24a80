//! What a recorder would show of an interaction: filtered and sampled accelerations.

use super::run::{Run, SetupError};
use super::scheme::Scheme;
use super::solver::{PlanarInteraction, TrainSteps};
use crate::bridge::{Damage, Eigenmodes, ModalBridge, ReducedBridge};
use crate::capacity::{CAR_DOFS, CAR_KINDS, CARS, CHANNELS, CONTACTS, ELEMENTS};
use crate::math::Real;
use crate::recorder::{AntiAlias, AntiAliasState};
use crate::slot::Slot;
use crate::track::profile::Profile;
use crate::train::PlanarTrain;
use crate::wire::message::{Quantity, Ranges};

/// Longest step of the solver, s. With it the error in the recorder's band (40 Hz, 8 modes) is 0.1 % at most; twice the step
/// leaves 0.7 to 1.3 % (docs/accuracy.md).
pub const LONGEST_STEP_S: f64 = 2.5e-3;

/// One sensor of a passage.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Sensor {
    /// Sensor place of the bridge model.
    pub place: usize,
    /// What it measures.
    pub quantity: Quantity,
}

/// Sensors and recorder of a passage.
#[derive(Debug, Clone, PartialEq)]
pub struct Recorder<T: Real> {
    /// A channel each.
    pub sensors: heapless::Vec<Sensor, CHANNELS>,
    /// Samples a second.
    pub sample_rate_hz: T,
    /// Steps of the solver from one sample to the next.
    pub steps_per_sample: u32,
    /// Cut-off of the recorder's filter.
    pub antialias_hz: Option<T>,
}

/// A passage as it is observed: everything about it but the damage.
#[derive(Debug, Clone, PartialEq)]
pub struct Observation<T: Real> {
    /// The train, ready for the solver's steps.
    pub cars: TrainSteps<T, CAR_DOFS, CONTACTS, CAR_KINDS>,
    /// How it runs; the entry time counts from the first sample.
    pub run: Run<T>,
    /// Stiffness of the whole bridge, as a part of its model's.
    pub stiffness: T,
    /// How far off run and stiffness may be.
    pub ranges: Ranges,
    /// Sensors and recorder.
    pub recorder: Recorder<T>,
    /// The recorder's filter at the solver's step.
    pub(super) filter: AntiAlias<T>,
}

impl<T: Real> Recorder<T> {
    /// A recorder, with as many steps of the solver a sample as [`LONGEST_STEP_S`] asks for.
    pub fn new(sensors: heapless::Vec<Sensor, CHANNELS>, sample_rate_hz: T, antialias_hz: Option<T>) -> Self {
        // Adding almost one before the cast rounds up; a rate of exactly 400 Hz needs one step.
        let steps: f64 = (sample_rate_hz * T::of(LONGEST_STEP_S)).recip().into();
        Self {
            sensors,
            sample_rate_hz,
            steps_per_sample: (steps + 0.999) as u32,
            antialias_hz,
        }
    }
}

impl<T: Real> Observation<T> {
    /// Sensor place of each channel.
    pub(super) fn places(&self) -> impl Iterator<Item = usize> + Clone {
        self.recorder.sensors.iter().map(|sensor| sensor.place)
    }

    /// The healthy bridge, and the train as it is expected.
    pub fn expected(&self) -> Hypothesis<T> {
        Hypothesis::new([T::zero(); ELEMENTS], self.stiffness, self.run)
    }

    /// An observation of `train`, stepped by `scheme`.
    ///
    /// # Errors
    /// [`SetupError`] says why the cars cannot be stepped.
    pub fn new(train: PlanarTrain<T>, run: Run<T>, recorder: Recorder<T>, scheme: Scheme) -> Result<Self, SetupError> {
        let step_s = (recorder.sample_rate_hz * T::of(f64::from(recorder.steps_per_sample))).recip();
        Ok(Self {
            cars: TrainSteps::new(train, scheme, step_s)?,
            run,
            stiffness: T::one(),
            ranges: Ranges::HELD,
            filter: AntiAlias::new(recorder.antialias_hz, step_s),
            recorder,
        })
    }
}

/// What is taken for true in a simulation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Hypothesis<T: Real> {
    /// Fraction of stiffness lost by each element.
    pub damage: Damage<T>,
    /// Stiffness of the whole bridge, as a part of the model's.
    pub stiffness: T,
    /// How the train runs.
    pub run: Run<T>,
    /// Static loads of each car, as parts of what its kind says.
    pub cars: [T; CARS],
}

impl<T: Real> Hypothesis<T> {
    /// With cars that weigh what their kind says.
    pub fn new(damage: Damage<T>, stiffness: T, run: Run<T>) -> Self {
        Self {
            damage,
            stiffness,
            run,
            cars: [T::one(); CARS],
        }
    }
}

/// An interaction behind the recorder's chain: an endless row of samples.
#[derive(Debug, Clone)]
pub struct Simulation<T: Real, const M: usize> {
    pub(super) interaction: PlanarInteraction<T, M>,
    states: [AntiAliasState<T>; CHANNELS],
    started: bool,
}

impl<T: Real, const M: usize> Simulation<T, M> {
    /// The simulation of `bridge` by a hypothesis, under what is `observed` on `track`.
    pub fn new(
        bridge: &ReducedBridge<T>,
        hypothesis: &Hypothesis<T>,
        observed: &Observation<T>,
        track: &Profile<T>,
    ) -> Result<Self, SetupError> {
        let mut place = Slot::Empty;
        Self::begin(bridge, hypothesis, observed, track, &mut place)?;
        place.take().ok_or(SetupError::NotFinite)
    }

    /// The same, put into its place.
    pub fn begin(
        bridge: &ReducedBridge<T>,
        hypothesis: &Hypothesis<T>,
        observed: &Observation<T>,
        track: &Profile<T>,
        place: &mut Slot<Self>,
    ) -> Result<(), SetupError> {
        let modes = Eigenmodes::new(bridge, &hypothesis.damage);
        Self::begin_with(&modes, bridge, hypothesis, observed, track, place)
    }

    // Not inlined: what it is made of must leave the stack.
    /// The same, with the modes of the hypothesis's damage.
    #[inline(never)]
    pub(super) fn begin_with(
        modes: &Eigenmodes<T>,
        bridge: &ReducedBridge<T>,
        hypothesis: &Hypothesis<T>,
        observed: &Observation<T>,
        track: &Profile<T>,
        place: &mut Slot<Self>,
    ) -> Result<(), SetupError> {
        let sensors = &observed.recorder.sensors;
        if sensors.iter().any(|sensor| sensor.place >= bridge.sensor_count) {
            return Err(SetupError::NoSuchSensor);
        }
        if !(hypothesis.stiffness > T::zero() && hypothesis.stiffness.is_finite()) {
            return Err(SetupError::NotFinite);
        }
        let modal = ModalBridge::of(modes, bridge, hypothesis.stiffness, observed.places());
        *place = Slot::Full(Self {
            interaction: PlanarInteraction::new(modal, track, &observed.cars, hypothesis.run)?
                .with_loads(hypothesis.cars),
            states: [AntiAliasState::AT_REST; CHANNELS],
            started: false,
        });
        Ok(())
    }

    /// The next sample of all channels, m/s² (m); the first is that of time 0. `track` is that of the beginning.
    pub fn sample(&mut self, observed: &Observation<T>, track: &Profile<T>) -> [T; CHANNELS] {
        let mut sample = [T::zero(); CHANNELS];
        if self.start() {
            for _ in 0..observed.recorder.steps_per_sample {
                self.interaction.step(&observed.cars, track);
                self.record(observed, &mut sample);
            }
        }
        sample
    }

    /// By what the approach that was stepped last is known; it changes with a sample in which a car's whole approach was stepped.
    pub fn last_approach(&self) -> Option<(usize, T)> {
        self.interaction.last_approach()
    }

    /// Whether the first sample, that of rest, has been given; from then on it has.
    pub(super) fn start(&mut self) -> bool {
        core::mem::replace(&mut self.started, true)
    }

    /// Hands the state after a step to the recorder.
    pub(super) fn record(&mut self, observed: &Observation<T>, sample: &mut [T; CHANNELS]) {
        let channels = observed
            .recorder
            .sensors
            .iter()
            .zip(sample.iter_mut().zip(&mut self.states));
        for (channel, (sensor, (value, state))) in channels.enumerate() {
            let raw = match sensor.quantity {
                Quantity::Acceleration => self.interaction.acceleration_mps2(channel),
                Quantity::Displacement => self.interaction.displacement_m(channel),
            };
            *value = observed.filter.apply(state, raw);
        }
    }
}
