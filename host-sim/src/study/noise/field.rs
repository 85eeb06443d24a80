//! What the model does not know of a real bridge: each switched on alone, or all together.
//!
//! | | what is true | what the model takes it for |
//! |---|---|---|
//! | track | irregularity of FRA class 6, the best, by chance | smooth |
//! | stiffness | each element's `E I` off by a Gaussian error, its standard deviation [`STIFFNESS_ERROR`] | equal elements |
//! | masses | each car's masses, inertias and static loads off by a Gaussian factor, standard deviation [`MASS_ERROR`] | equal cars |
//!
//! The springs of a car keep their stiffness. An element whose stiffness is off by `x` looks damaged by `-x (1 - d)`: of an
//! error of 1 % no method that has this model can see less than a point.

use anyhow::Result;
use spanwatch::train::Place;

use super::truth::{Purpose, Setting};
use crate::model::BridgeFrame;
use crate::random::gaussian;
use crate::track::{Profile, Spectrum, Stretch, generate};
use crate::train::SpatialTrain;
use rand_core::Rng;

/// Standard deviation of an element's stiffness, as a part of it.
pub const STIFFNESS_ERROR: f64 = 0.01;
/// Standard deviation of a car's masses, as a part of them.
pub const MASS_ERROR: f64 = 0.02;

/// What of the truth the model does not have.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Field {
    /// The irregularity of the track.
    pub track: bool,
    /// Errors of the elements' stiffnesses.
    pub stiffness: bool,
    /// Errors of the cars' masses.
    pub masses: bool,
}

impl Field {
    /// Nothing: the model has all but the noise.
    pub const NONE: Self = Self {
        track: false,
        stiffness: false,
        masses: false,
    };

    /// Nothing, each alone, all together.
    pub const ALL: [Self; 5] = [
        Self::NONE,
        Self {
            track: true,
            ..Self::NONE
        },
        Self {
            stiffness: true,
            ..Self::NONE
        },
        Self {
            masses: true,
            ..Self::NONE
        },
        Self {
            track: true,
            stiffness: true,
            masses: true,
        },
    ];

    /// As tables call it.
    pub fn name(self) -> &'static str {
        match (self.track, self.stiffness, self.masses) {
            (false, false, false) => "none",
            (true, false, false) => "track",
            (false, true, false) => "stiffness",
            (false, false, true) => "masses",
            (true, true, true) => "all",
            _ => "several",
        }
    }

    /// The irregularity of the seed; none where the track is smooth. On a bridge that moves in bending only nothing but the mean
    /// height of the rails matters.
    ///
    /// # Errors
    /// None for the stretch that is asked for.
    pub fn track(self, setting: &Setting, seed: u64) -> Result<Option<Profile>> {
        let stretch = Stretch {
            vertical_only: true,
            ..Stretch::default()
        };
        let seed = setting.generator(seed, Purpose::Track).next_u64();
        (self.track)
            .then(|| generate(Spectrum::Fra6, seed, &stretch))
            .transpose()
    }

    /// The true bridge: as the model has it, but for the stiffness of the whole, and of each element.
    pub fn bridge(self, setting: &Setting, seed: u64, model: &BridgeFrame, overall: f64) -> BridgeFrame {
        let mut rng = setting.generator(seed, Purpose::Stiffness);
        let factors: Vec<f64> = (model.frame.groups.iter())
            .map(|_| match self.stiffness {
                true => overall * (1.0 + STIFFNESS_ERROR * gaussian(&mut rng)),
                false => overall,
            })
            .collect();
        let mut bridge = model.clone();
        for beam in &mut bridge.frame.beams {
            let factor = beam.group.map_or(overall, |group| factors[group]);
            beam.section.bending_nm2 = beam.section.bending_nm2.map(|stiffness| stiffness * factor);
        }
        bridge
    }

    /// The true train.
    pub fn train(self, setting: &Setting, seed: u64, model: SpatialTrain) -> SpatialTrain {
        if !self.masses {
            return model;
        }
        uneven(&model, MASS_ERROR, &mut setting.generator(seed, Purpose::Masses))
    }
}

/// A train of which each car's masses, inertias and static loads are off by a Gaussian factor of that standard deviation.
pub fn uneven(model: &SpatialTrain, deviation: f64, rng: &mut impl Rng) -> SpatialTrain {
    let mut train = SpatialTrain {
        kinds: Default::default(),
        cars: Default::default(),
    };
    for place in &model.cars {
        let mut car = model.kinds[place.kind].clone();
        let factor = 1.0 + deviation * gaussian(rng);
        car.inertia.iter_mut().for_each(|inertia| *inertia *= factor);
        for contact in &mut car.contacts {
            contact.load_n *= factor;
            contact.unsprung *= factor;
        }
        let kind = train.kinds.len();
        // There is room for as many kinds as cars.
        let _ = train.kinds.push(car);
        let _ = train.cars.push(Place {
            kind,
            behind_m: place.behind_m,
        });
    }
    train
}
