//! The truth of the campaign: passages that the model which explains them has not made.
//!
//! | | truth | explained with |
//! |---|---|---|
//! | modes of the damaged bridge | [`MODES`], from the finite elements | 8, from the logger's reduced model |
//! | step | [`STEP_S`] | 2.5 ms |
//! | cars | in space, all their degrees of freedom | in the vertical plane |
//! | arithmetic | `f64` | `f32` |
//! | sensor | white noise, then whole counts of its converter | |
//!
//! Both pass the recorder's filter (40 Hz) and are sampled at 200 Hz. Where speed, entry time, load and stiffness are unknown,
//! the explaining model is told a first guess that is off the truth, drawn from the ranges that it is told, too.

use anyhow::Result;
use rand_core::{Rng, SeedableRng};
use rand_xoshiro::Xoshiro256PlusPlus;
use spanwatch::interaction::Run;
use spanwatch::interaction::simulation::LONGEST_STEP_S;
use spanwatch::wire::message::Ranges;

use super::field::Field;
use super::{Nuisance, Point};
use crate::evaluate::{Case, Signal};
use crate::model::{BridgeFrame, Structure};
use crate::random::{gaussian, unit};
use crate::recording::{Channel, DEFAULT_LSB_MPS2, Unit};
use crate::simulate::{Scenario, simulate_train};
use crate::validate::compare::rms;

/// Modes of the truth.
pub const MODES: usize = 12;
/// Step of the truth, s: half of the logger's.
pub const STEP_S: f64 = LONGEST_STEP_S / 2.0;
/// How far off the truth the first guess is where it is not known: evenly up to this part of the speed, this time of the
/// entry and this part of the load (issue 4's ranges). The stiffness of the whole bridge is Gaussian, its standard deviation 1 %: what a
/// first frequency known to half a per cent leaves, and what a change of temperature by some 20 K does to steel and concrete.
pub const UNKNOWN: Ranges = Ranges {
    speed: 0.05,
    entry_s: 0.3,
    load: 0.2,
    stiffness: 0.01,
};

/// One row of the campaign: what passes, what records it, what is known.
#[derive(Debug, Clone, PartialEq)]
pub struct Setting {
    /// Bridge, damage, train and speed.
    pub case: Case,
    /// Part of what is left of its stiffness that every element has lost besides. With it no element's damage lies at a bound of
    /// what an estimate can be, so that bound and interval can be judged for themselves.
    pub wear: f64,
    /// White noise, as a part of each channel's RMS.
    pub noise: f64,
    /// Sensors, by their nodes.
    pub nodes: Vec<u16>,
    /// Whether run and stiffness are known.
    pub nuisance: Nuisance,
    /// What of the truth the model does not have.
    pub field: Field,
}

impl Setting {
    /// The passage as the truth solves it.
    pub fn scenario(&self) -> Scenario {
        let scenario = self.case.scenario(Signal::Raw).recorded();
        let worn = |loss: &f64| 1.0 - (1.0 - loss) * (1.0 - self.wear);
        Scenario {
            damage: scenario.damage.iter().map(worn).collect(),
            modes: MODES,
            step_s: STEP_S,
            nodes: self.nodes.clone(),
            ..scenario
        }
    }

    /// The truth, the first guess and the ranges of one seed.
    pub fn draw(&self, seed: u64) -> Drawn {
        let scenario = self.scenario();
        let known = Drawn {
            seed,
            truth: Point {
                damage: std::array::from_fn(|e| scenario.damage[e]),
                run: scenario.run(),
                stiffness: 1.0,
            },
            guess: scenario.run(),
            ranges: Ranges::HELD,
        };
        if self.nuisance == Nuisance::Known {
            return known;
        }
        let mut rng = self.generator(seed, Purpose::Nuisance);
        let mut even = |half: f32| f64::from(half) * (2.0 * unit(&mut rng) - 1.0);
        let mut truth = known.truth;
        let mut guess = known.guess;
        // Speed and load that are expected are the case's own; but the bound depends on the speed, so that the case keeps
        // its true speed and the expected one is drawn.
        guess.speed_mps = truth.run.speed_mps / (1.0 + even(UNKNOWN.speed));
        truth.run.load_factor = guess.load_factor * (1.0 + even(UNKNOWN.load));
        // A train does not enter at the moment of a sample.
        truth.run.entry_time_s += even(0.5) * scenario.sample_interval_s();
        guess.entry_time_s = truth.run.entry_time_s + even(UNKNOWN.entry_s);
        truth.stiffness = 1.0 + f64::from(UNKNOWN.stiffness) * gaussian(&mut rng);
        Drawn {
            truth,
            guess,
            ranges: UNKNOWN,
            ..known
        }
    }

    /// Random numbers for one purpose: each has its own, so that an error is the same whether others are there or not.
    pub fn generator(&self, seed: u64, purpose: Purpose) -> Xoshiro256PlusPlus {
        let case = 2 * u64::from(self.case.number) + self.case.train as u64;
        Xoshiro256PlusPlus::seed_from_u64((seed << 16) + (case << 8) + purpose as u64)
    }

    /// What the recorder would write of a passage without noise, m/s², a list a sensor.
    ///
    /// # Errors
    /// As [`simulate_train`].
    pub fn clean(&self, bridge: &BridgeFrame, drawn: &Drawn) -> Result<Vec<Vec<f64>>> {
        let mut scenario = self.scenario();
        scenario.lead_s = drawn.truth.run.entry_time_s;
        scenario.load_factor = drawn.truth.run.load_factor;
        scenario.track = self.field.track(self, drawn.seed)?;
        let train = self.field.train(self, drawn.seed, scenario.train.train(scenario.cars)?);
        let bridge = self.field.bridge(self, drawn.seed, bridge, drawn.truth.stiffness);
        Ok(simulate_train(&Structure::new(bridge)?, &scenario, &train, &mut |_, _| ())?.channels)
    }

    /// A recording of a passage: noise and rounding added to what is `clean`.
    pub fn record(&self, clean: &[Vec<f64>], seed: u64) -> Recorded {
        let mut rng = self.generator(seed, Purpose::Noise);
        let sigma = self.sigma(clean);
        let channels = count(clean, &sigma, &mut rng);
        Recorded {
            samples: (0..channels[0].len())
                .flat_map(|i| channels.iter().map(move |channel| acceleration_mps2(channel[i])))
                .collect(),
            sigma,
        }
    }

    /// Standard deviation of each sensor's noise, m/s²; that of rounding, a third of a count, is a thousandth of it.
    pub fn sigma(&self, clean: &[Vec<f64>]) -> Vec<f64> {
        clean.iter().map(|values| self.noise * rms(values)).collect()
    }
}

/// What a converter makes of accelerations without noise, m/s², a list a sensor: counts of those with white noise.
pub fn count(clean: &[Vec<f64>], sigma: &[f64], rng: &mut impl Rng) -> Vec<Vec<i32>> {
    let sensor = Channel::new(String::new(), None, Unit::MetrePerSecondSquared, vec![]);
    (clean.iter().zip(sigma))
        .map(|(values, sigma)| {
            let noisy = values.iter().map(|value| value + sigma * gaussian(rng));
            noisy.map(|value| sensor.count(value)).collect()
        })
        .collect()
}

/// What a count stands for, m/s².
pub fn acceleration_mps2(count: i32) -> f32 {
    (f64::from(count) * f64::from(DEFAULT_LSB_MPS2)) as f32
}

/// What random numbers are for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Purpose {
    /// Noise of the sensors.
    Noise,
    /// Run and stiffness, and their first guess.
    Nuisance,
    /// Irregularity of the track.
    Track,
    /// Errors of the elements' stiffnesses.
    Stiffness,
    /// Errors of the cars' masses.
    Masses,
}

/// What chance has made of a setting.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Drawn {
    /// The seed.
    pub seed: u64,
    /// What is true.
    pub truth: Point,
    /// What the explaining model is told of the run.
    pub guess: Run<f64>,
    /// And how far off that may be.
    pub ranges: Ranges,
}

/// A recording with the noise that it has.
#[derive(Debug, Clone, PartialEq)]
pub struct Recorded {
    /// Accelerations, m/s², sensor after sensor within a sample.
    pub samples: Vec<f32>,
    /// Standard deviation of each sensor's noise, m/s².
    pub sigma: Vec<f64>,
}
