//! What a recorder would show of an interaction: filtered and sampled accelerations.

use super::solver::{Interaction, Run, SetupError};
use crate::bridge::{Damage, ModalBridge, ReducedBridge};
use crate::capacity::CHANNELS;
use crate::math::Real;
use crate::recorder::{AntiAlias, AntiAliasState};
use crate::train::Train;

/// A passage as it is observed: everything about it but the damage.
#[derive(Debug, Clone, PartialEq)]
pub struct Observation<T: Real> {
    /// The train.
    pub train: Train<T>,
    /// How it runs; the entry time counts from the first sample.
    pub run: Run<T>,
    /// Sensor places of the bridge model, a channel each.
    pub places: heapless::Vec<usize, CHANNELS>,
    /// Samples a second.
    pub sample_rate_hz: T,
    /// Steps of the solver from one sample to the next.
    pub steps_per_sample: u32,
    /// Cut-off of the recorder's filter.
    pub antialias_hz: Option<T>,
}

impl<T: Real> Observation<T> {
    /// Step of the solver, s.
    pub fn step_s(&self) -> T {
        (self.sample_rate_hz * T::of(f64::from(self.steps_per_sample))).recip()
    }
}

/// An interaction behind the recorder's chain: an endless row of samples.
#[derive(Debug, Clone)]
pub struct Simulation<T: Real, const M: usize> {
    interaction: Interaction<T, M>,
    filter: AntiAlias<T>,
    states: [AntiAliasState<T>; CHANNELS],
    steps_per_sample: u32,
    channels: usize,
    started: bool,
}

impl<T: Real, const M: usize> Simulation<T, M> {
    /// The simulation of `bridge` with `damage` under what is `observed`.
    pub fn new(bridge: &ReducedBridge<T>, damage: &Damage<T>, observed: &Observation<T>) -> Result<Self, SetupError> {
        if observed.places.iter().any(|&place| place >= bridge.sensor_count) {
            return Err(SetupError::NoSuchSensor);
        }
        let modal = ModalBridge::new(bridge, damage, &observed.places);
        let step = observed.step_s();
        Ok(Self {
            interaction: Interaction::new(modal, observed.train, observed.run, step)?,
            filter: AntiAlias::new(observed.antialias_hz, step),
            states: [AntiAliasState::default(); CHANNELS],
            steps_per_sample: observed.steps_per_sample,
            channels: observed.places.len(),
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
