//! The truth of the campaigns: a viaduct with a track of its own, and an endless row of passages over it.
//!
//! Everything follows from the viaduct's seed and a passage's number: whoever asks for a passage gets the same one, with whatever has become of
//! bridge and track by then. It is solved as [`noise::truth`](crate::study::noise::truth) solves it (12 modes from the finite elements, half
//! the logger's step, cars in space, `f64`, white noise, whole counts), on a track of all the spectrum's waves, mean height of the rails only.
//!
//! | | true | what is told |
//! |---|---|---|
//! | speed | by chance ([`Stock::speeds_kmh`]), or always the same | off by up to 2 %, evenly |
//! | entry | at no sample's moment | off by up to 0.1 s |
//! | load of the train | off by up to 5 % | 1 |
//! | masses of each car | off by a Gaussian 2 % | equal |
//! | stiffness of the whole bridge, if it varies | off by a Gaussian part | 1 |
//!
//! A change of the track is another track of the same spectrum, its line between both ends taken off, brought to an RMS ([`Change`]) from
//! [`CHANGE_FROM_M`] to the bridge's end and to nothing at either end.

use anyhow::Result;
use rand_core::{Rng, SeedableRng};
use rand_xoshiro::Xoshiro256PlusPlus;
use spanwatch::bridge::{Damage, ReducedBridge};
use spanwatch::capacity::{CHANNELS, ELEMENTS};
use spanwatch::interaction::Run;
use spanwatch::wire::message::{Channel, Configuration, Memory, Quantity, Ranges, TrainKind, Trigger};

use crate::identification::Observed;
use crate::model::reduce::reduce;
use crate::model::{BridgeFrame, Structure};
use crate::random::{gaussian, unit};
use crate::recording::{DEFAULT_FULL_SCALE_COUNTS, DEFAULT_LSB_MPS2};
use crate::simulate::{Scenario, simulate_train};
use crate::study::noise::field::{MASS_ERROR, uneven};
use crate::study::noise::truth::{MODES, STEP_S, acceleration_mps2, count};
use crate::track::{Profile, Rails, Spectrum, Stretch, generate};
use crate::train::TrainName;
use crate::validate::compare::rms;

/// Nodes with a sensor; what fewer sensors see is a part of the same passage.
pub const SENSORS: [u16; CHANNELS] = [3, 6, 9];
/// White noise, as a part of each channel's RMS.
pub const NOISE: f64 = 0.05;
/// What is told of a run is off by so much at most. The stiffness's is [`Setting::temperature`].
pub const ANNOUNCED: Ranges = Ranges {
    speed: 0.02,
    entry_s: 0.1,
    load: 0.05,
    stiffness: 0.0,
};
/// Time before the first axle enters, s: one second, and 0.6 s of quiet by which a logger finds the passage's beginning.
pub const LEAD_S: f64 = 1.6;
/// Time after the last axle has left, s.
pub const TAIL_S: f64 = 2.0;
/// Where the track begins and how far behind node 1 it ends, m: 3 s before the bridge at 270 km/h, a car's length and more behind it.
const TRACK_M: [f64; 2] = [-250.0, 90.0];
/// Where a change of the track begins, m, ...
pub const CHANGE_FROM_M: f64 = -20.0;
/// ... and the length at either end over which it comes and goes, m.
const CHANGE_TAPER_M: f64 = 5.0;

/// A kind of train of the timetable.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Stock {
    /// Sixteen 15-DOF cars.
    Sixteen,
    /// One inspection car.
    Inspection,
}

impl Stock {
    /// Kind of the cars, and how many.
    pub fn cars(self) -> (TrainKind, usize) {
        match self {
            Self::Sixteen => (TrainKind::Shinkansen3d, 16),
            Self::Inspection => (TrainKind::Inspection2Dof, 1),
        }
    }

    /// Slowest and fastest speed, km/h.
    pub fn speeds_kmh(self) -> [f64; 2] {
        match self {
            Self::Sixteen => [205.0, 270.0],
            Self::Inspection => [60.0, 120.0],
        }
    }

    /// The speed where all are equal, km/h.
    pub fn equal_kmh(self) -> f64 {
        match self {
            Self::Sixteen => 240.0,
            Self::Inspection => 90.0,
        }
    }
}

/// Which trains pass.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Traffic {
    /// Trains of sixteen cars.
    Sixteen,
    /// Inspection cars.
    Inspection,
    /// Of ten trains six of sixteen cars, then four inspection cars.
    Both,
}

impl Traffic {
    /// As tables call it.
    pub fn name(self) -> &'static str {
        match self {
            Self::Sixteen => "16 cars",
            Self::Inspection => "inspection",
            Self::Both => "both",
        }
    }

    /// The train of passage `index`.
    pub fn stock(self, index: usize) -> Stock {
        match self {
            Self::Sixteen => Stock::Sixteen,
            Self::Inspection => Stock::Inspection,
            Self::Both if index % 10 < 6 => Stock::Sixteen,
            Self::Both => Stock::Inspection,
        }
    }
}

/// How fast trains of a kind are.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Speeds {
    /// Evenly by chance within [`Stock::speeds_kmh`].
    Spread,
    /// All [`Stock::equal_kmh`].
    Equal,
}

impl Speeds {
    /// As tables call it.
    pub fn name(self) -> &'static str {
        match self {
            Self::Spread => "spread",
            Self::Equal => "equal",
        }
    }
}

/// What is true of all viaducts of a row of the table.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Setting {
    /// The track's spectrum.
    pub class: Spectrum,
    /// Which trains pass.
    pub traffic: Traffic,
    /// How fast.
    pub speeds: Speeds,
    /// Whether each car's masses are off.
    pub uneven: bool,
    /// Standard deviation of the stiffness of the whole bridge from passage to passage, as a part of it.
    pub temperature: f32,
    /// How the track changes, if it does.
    pub change: Change,
}

impl Setting {
    /// How far off what is told may be.
    pub fn ranges(&self) -> Ranges {
        Ranges {
            stiffness: self.temperature,
            ..ANNOUNCED
        }
    }
}

/// How a track changes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Change {
    /// RMS of the change, m.
    pub rms_m: f64,
    /// Its longest wave, m; the spectrum has none that are longer.
    pub longest_m: f64,
}

impl Change {
    /// What is asked of a logger to see, in all waves of the spectrum.
    pub const HALF_A_MILLIMETRE: Self = Self {
        rms_m: 0.5e-3,
        longest_m: f64::INFINITY,
    };
}

/// What has become of bridge and track by a passage.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct State {
    /// Fraction of bending stiffness lost by each element.
    pub damage: Damage<f64>,
    /// Whether the track has changed.
    pub changed: bool,
}

impl State {
    /// As at the beginning.
    pub const HEALTHY: Self = Self {
        damage: [0.0; ELEMENTS],
        changed: false,
    };

    /// Element `e` (from 0) has lost a fraction of its stiffness.
    pub fn damaged(e: usize, loss: f64) -> Self {
        let mut state = Self::HEALTHY;
        state.damage[e] = loss;
        state
    }
}

/// A viaduct of one seed.
#[derive(Debug, Clone)]
pub struct Viaduct {
    /// What it has in common with others.
    pub setting: Setting,
    /// Its seed.
    pub seed: u64,
    structure: Structure,
    /// The model that explains.
    pub model: ReducedBridge<f64>,
    logger: ReducedBridge<f32>,
    /// Its track before and after a change.
    tracks: [Profile; 2],
}

/// What random numbers are for.
#[derive(Debug, Clone, Copy)]
enum Purpose {
    Track,
    Change,
    Run,
    Masses,
    Noise,
}

impl Viaduct {
    /// The viaduct of a seed.
    ///
    /// # Errors
    /// If the bridge has no model for a logger.
    pub fn new(bridge: &BridgeFrame, setting: &Setting, seed: u64) -> Result<Self> {
        let model = reduce(bridge)?;
        let [_, longest_m] = setting.class.waves_m();
        let track = |purpose, longest_m| {
            let stretch = Stretch {
                from_m: TRACK_M[0],
                to_m: TRACK_M[1],
                longest_m,
                vertical_only: true,
                ..Stretch::default()
            };
            generate(setting.class, generator(seed, 0, purpose).next_u64(), &stretch)
        };
        let before = track(Purpose::Track, longest_m)?;
        let other = track(Purpose::Change, longest_m.min(setting.change.longest_m))?;
        let after = changed(&before, &other, model.path.length_m(), setting.change.rms_m);
        Ok(Self {
            setting: *setting,
            seed,
            structure: Structure::new(bridge.clone())?,
            logger: model.cast(),
            model,
            tracks: [before, after],
        })
    }

    /// The track, as it is in the beginning or after a change.
    pub fn track(&self, changed: bool) -> &Profile {
        &self.tracks[usize::from(changed)]
    }

    /// The passage without noise as it is to be solved, with its true run.
    pub fn scenario(&self, index: usize, state: &State) -> Scenario {
        let mut rng = generator(self.seed, index, Purpose::Run);
        let stock = self.setting.traffic.stock(index);
        let (kind, cars) = stock.cars();
        let [slow, fast] = stock.speeds_kmh();
        let by_chance = slow + (fast - slow) * unit(&mut rng);
        let scenario = Scenario {
            train: TrainName::Known(kind),
            cars: Some(cars),
            speed_kmh: match self.setting.speeds {
                Speeds::Spread => by_chance,
                Speeds::Equal => stock.equal_kmh(),
            },
            track: Some(self.track(state.changed).clone()),
            damage: state.damage.to_vec(),
            nodes: SENSORS.to_vec(),
            tail_s: TAIL_S,
            ..Scenario::inspection_car()
        }
        .recorded();
        Scenario {
            modes: MODES,
            step_s: STEP_S,
            lead_s: LEAD_S + unit(&mut rng) * scenario.sample_interval_s(),
            load_factor: 1.0 + even(&mut rng, ANNOUNCED.load),
            stiffness_factor: 1.0 + f64::from(self.setting.temperature) * gaussian(&mut rng),
            ..scenario
        }
    }

    /// Passage `index` over the viaduct in that state.
    ///
    /// # Errors
    /// As [`simulate_train`].
    pub fn passage(&self, index: usize, state: &State) -> Result<Passage> {
        let scenario = self.scenario(index, state);
        let mut train = scenario.train.train(scenario.cars)?;
        if self.setting.uneven {
            train = uneven(&train, MASS_ERROR, &mut generator(self.seed, index, Purpose::Masses));
        }
        let clean = simulate_train(&self.structure, &scenario, &train, &mut |_, _| ())?.channels;
        let sigma: Vec<f64> = clean.iter().map(|channel| NOISE * rms(channel)).collect();
        let mut rng = generator(self.seed, index, Purpose::Noise);
        let counts = count(&clean, &sigma, &mut rng);
        let run = scenario.run::<f64>();
        // A track is the viaduct's, and large.
        let scenario = Scenario {
            track: None,
            ..scenario
        };
        Ok(Passage {
            index,
            told: Run {
                speed_mps: run.speed_mps / (1.0 + even(&mut rng, ANNOUNCED.speed)),
                entry_time_s: run.entry_time_s + even(&mut rng, ANNOUNCED.entry_s),
                load_factor: 1.0,
                ..run
            },
            ranges: self.setting.ranges(),
            scenario,
            counts,
            sigma,
            logger: self.logger.clone(),
        })
    }
}

/// Evenly up to `half` to either side of 0.
fn even(rng: &mut impl Rng, half: f32) -> f64 {
    f64::from(half) * (2.0 * unit(rng) - 1.0)
}

/// Random numbers for one purpose in one passage.
fn generator(seed: u64, index: usize, purpose: Purpose) -> Xoshiro256PlusPlus {
    Xoshiro256PlusPlus::seed_from_u64((seed << 32) + ((index as u64) << 8) + purpose as u64)
}

/// The track `before` with a change after the shape of `other`.
fn changed(before: &Profile, other: &Profile, length_m: f64, rms_m: f64) -> Profile {
    let x_m = &before.rails().x_m;
    let within: Vec<usize> = (0..x_m.len())
        .filter(|&i| (CHANGE_FROM_M..=length_m).contains(&x_m[i]))
        .collect();
    let heights = &other.rails().z_m[0];
    let (Some(&first), Some(&last)) = (within.first(), within.last()) else {
        return before.clone();
    };
    let mut change: Vec<f64> = (within.iter())
        .map(|&i| {
            let along = (x_m[i] - x_m[first]) / (x_m[last] - x_m[first]);
            let line = heights[first] + along * (heights[last] - heights[first]);
            let u = ((x_m[i] - x_m[first]).min(x_m[last] - x_m[i]) / CHANGE_TAPER_M).min(1.0);
            u * u * u * (10.0 - u * (15.0 - 6.0 * u)) * (heights[i] - line)
        })
        .collect();
    let scale = rms_m / rms(&change);
    change.iter_mut().for_each(|height| *height *= scale);
    let mut heights = before.rails().z_m[0].clone();
    for (&i, change) in within.iter().zip(change) {
        heights[i] += change;
    }
    Profile::new(Rails::equal(x_m.clone(), heights))
}

/// A passage as the sensors recorded it, and its truth.
#[derive(Debug, Clone)]
pub struct Passage {
    /// Its number.
    pub index: usize,
    /// How it was solved, but for the track: its truth.
    pub scenario: Scenario,
    /// What is told of its run.
    pub told: Run<f64>,
    /// How far off that may be.
    pub ranges: Ranges,
    /// What each of [`SENSORS`] has written.
    pub counts: Vec<Vec<i32>>,
    /// Standard deviation of each one's noise, m/s².
    pub sigma: Vec<f64>,
    logger: ReducedBridge<f32>,
}

impl Passage {
    /// Which of the sensors are at `nodes`.
    pub fn channels(nodes: &[u16]) -> Vec<usize> {
        (nodes.iter())
            .filter_map(|node| SENSORS.iter().position(|sensor| sensor == node))
            .collect()
    }

    /// Kind of the train.
    pub fn train(&self) -> TrainKind {
        match self.scenario.train {
            TrainName::Known(kind) => kind,
            TrainName::File(_) => unreachable!("a timetable has the trains that a logger knows"),
        }
    }

    /// The counts of the sensors at `nodes`, sensor after sensor within a sample.
    pub fn stream(&self, nodes: &[u16]) -> Vec<i32> {
        let channels = Self::channels(nodes);
        (0..self.counts[0].len())
            .flat_map(|i| channels.iter().map(move |&c| self.counts[c][i]))
            .collect()
    }

    /// The passage as the search sees it through the sensors at `nodes`.
    ///
    /// # Errors
    /// If the bridge has no such node.
    pub fn observed(&self, nodes: &[u16]) -> Result<Observed> {
        let samples = self.stream(nodes).into_iter().map(acceleration_mps2).collect();
        let scenario = Scenario {
            nodes: nodes.to_vec(),
            ..self.scenario.clone()
        };
        let mut observed = Observed::of(self.logger.clone(), &scenario, samples)?;
        let run = &mut observed.observation.run;
        run.speed_mps = self.told.speed_mps as f32;
        run.entry_time_s = self.told.entry_time_s as f32;
        run.load_factor = self.told.load_factor as f32;
        observed.observation.ranges = self.ranges;
        Ok(observed)
    }

    /// What a logger with the sensors at `nodes` is told of it, if its first sample is number `first_sample` of the stream.
    pub fn configuration(&self, nodes: &[u16], first_sample: u64, seed: u64) -> Configuration {
        let rate_hz = self.scenario.sample_interval_s().recip();
        let channel = |&node: &u16| Channel {
            node,
            quantity: Quantity::Acceleration,
            lsb: DEFAULT_LSB_MPS2,
            full_scale_counts: DEFAULT_FULL_SCALE_COUNTS,
        };
        Configuration {
            sample_rate_hz: rate_hz as f32,
            channels: nodes.iter().map(channel).collect(),
            trigger: Trigger::default(),
            antialias_hz: self.scenario.antialias_hz.map(|hz| hz as f32),
            traffic: Some(self.announcement(first_sample)),
            memory: Memory::default(),
            seed,
        }
    }

    /// What a logger is told of the train.
    pub fn announcement(&self, first_sample: u64) -> spanwatch::wire::message::Traffic {
        spanwatch::wire::message::Traffic {
            train: self.train(),
            cars: self.scenario.cars.unwrap_or(1) as u8,
            speed_mps: Some(self.told.speed_mps as f32),
            acceleration_mps2: 0.0,
            backward: false,
            entry_time_s: Some(self.told.entry_time_s + first_sample as f64 * self.scenario.sample_interval_s()),
            load_factor: self.told.load_factor as f32,
            ranges: self.ranges,
        }
    }
}

#[cfg(test)]
mod tests {

    use spanwatch::track::{Motion, Track};

    use super::*;
    use crate::model;

    const SETTING: Setting = Setting {
        class: Spectrum::Fra6,
        traffic: Traffic::Both,
        speeds: Speeds::Spread,
        uneven: true,
        temperature: 0.0,
        change: Change::HALF_A_MILLIMETRE,
    };

    fn viaduct(setting: Setting, seed: u64) -> Viaduct {
        Viaduct::new(&model::shipped("girder50").expect("ships"), &setting, seed).expect("a viaduct")
    }

    #[test]
    fn a_passage_follows_from_seed_and_number_alone() {
        let inspection = Setting {
            traffic: Traffic::Inspection,
            ..SETTING
        };
        let passage = |seed, index| (viaduct(inspection, seed).passage(index, &State::HEALTHY)).expect("solves");
        let [first, again, other, of_other] = [passage(1, 3), passage(1, 3), passage(1, 4), passage(2, 3)];
        assert_eq!(first.counts, again.counts);
        assert_ne!(first.counts[1], other.counts[1]);
        assert_ne!(first.counts[1], of_other.counts[1]);
        assert_ne!(first.told.speed_mps, first.scenario.speed_kmh / 3.6);
    }

    #[test]
    fn a_logger_is_told_the_same_as_the_search() {
        let passage = viaduct(SETTING, 1).passage(6, &State::HEALTHY).expect("solves");
        let nodes = [6];
        let observed = passage.observed(&nodes).expect("a passage");
        let configuration = passage.configuration(&nodes, 0, 1);
        assert_eq!(configuration.check(), Ok(()));
        let traffic = configuration.traffic.expect("a train");
        let told = configuration.observe(&traffic, &observed.bridge, 0).expect("a passage");
        assert_eq!(told, observed.observation);
        // Of three sensors the one at mid-span alone.
        assert_eq!(passage.stream(&nodes), passage.counts[1]);
        assert_eq!(observed.samples.len(), passage.counts[1].len());
    }

    #[test]
    fn a_change_of_the_track_is_half_a_millimetre_and_nowhere_else() {
        let viaduct = viaduct(SETTING, 1);
        let change = |x: f64| {
            let [before, after] = [false, true].map(|changed| viaduct.track(changed).at(Motion::Vertical, x).value);
            after - before
        };
        let heights: Vec<f64> = (0..1400).map(|i| change(CHANGE_FROM_M + 0.05 * f64::from(i))).collect();
        assert!((rms(&heights) / Change::HALF_A_MILLIMETRE.rms_m - 1.0).abs() < 1e-3);
        for x in [-100.0, -21.0, 51.0, 80.0] {
            assert!(change(x).abs() < 1e-6, "{x}");
        }
    }
}
