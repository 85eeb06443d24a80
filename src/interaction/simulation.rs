//! What a recorder would show of an interaction: filtered and sampled accelerations.

use super::run::{Run, SetupError};
use super::scheme::Scheme;
use super::solver::{PlanarInteraction, TrainSteps};
use crate::bridge::{Damage, ModalBridge, ReducedBridge};
use crate::capacity::{CAR_DOFS, CAR_KINDS, CHANNELS, CONTACTS};
use crate::math::Real;
use crate::recorder::{AntiAlias, AntiAliasState};
use crate::train::PlanarTrain;
use crate::train::track::Smooth;

/// Sensors and recorder of a passage.
#[derive(Debug, Clone, PartialEq)]
pub struct Recorder<T: Real> {
    /// Sensor places of the bridge model, a channel each.
    pub places: heapless::Vec<usize, CHANNELS>,
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
    /// Sensors and recorder.
    pub recorder: Recorder<T>,
}

impl<T: Real> Observation<T> {
    /// An observation of `train`, stepped by `scheme`.
    ///
    /// # Errors
    /// [`SetupError`] says why the cars cannot be stepped.
    pub fn new(train: PlanarTrain<T>, run: Run<T>, recorder: Recorder<T>, scheme: Scheme) -> Result<Self, SetupError> {
        let step_s = (recorder.sample_rate_hz * T::of(f64::from(recorder.steps_per_sample))).recip();
        Ok(Self {
            cars: TrainSteps::new(train, scheme, step_s)?,
            run,
            recorder,
        })
    }
}

/// An interaction behind the recorder's chain: an endless row of samples.
#[derive(Debug, Clone)]
pub struct Simulation<'a, T: Real, const M: usize> {
    interaction: PlanarInteraction<'a, T, M>,
    filter: AntiAlias<T>,
    states: [AntiAliasState<T>; CHANNELS],
    steps_per_sample: u32,
    channels: usize,
    started: bool,
}

impl<'a, T: Real, const M: usize> Simulation<'a, T, M> {
    /// The simulation of `bridge` with `damage` under what is `observed`.
    pub fn new(
        bridge: &ReducedBridge<T>,
        damage: &Damage<T>,
        observed: &'a Observation<T>,
    ) -> Result<Self, SetupError> {
        let recorder = &observed.recorder;
        if recorder.places.iter().any(|&place| place >= bridge.sensor_count) {
            return Err(SetupError::NoSuchSensor);
        }
        let modal = ModalBridge::new(bridge, damage, &recorder.places);
        Ok(Self {
            interaction: PlanarInteraction::new(modal, Smooth, &observed.cars, observed.run)?,
            filter: AntiAlias::new(recorder.antialias_hz, observed.cars.step_s()),
            states: [AntiAliasState::default(); CHANNELS],
            steps_per_sample: recorder.steps_per_sample,
            channels: recorder.places.len(),
            started: false,
        })
    }

    /// The next sample of all channels, m/s²; the first is that of time 0.
    pub fn sample(&mut self) -> [T; CHANNELS] {
        let mut sample = [T::zero(); CHANNELS];
        if self.started {
            for _ in 0..self.steps_per_sample {
                self.interaction.step();
                for (channel, (value, state)) in sample.iter_mut().zip(&mut self.states).take(self.channels).enumerate()
                {
                    *value = self.filter.apply(state, self.interaction.acceleration_mps2(channel));
                }
            }
        }
        self.started = true;
        sample
    }
}
