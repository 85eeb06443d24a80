//! What each kind of measurement adds: accelerations while the train runs, the free vibration after it as samples or as natural
//! frequencies and damping ratios, displacements.
//!
//! ```text
//! I = sum_c sum_i J_ic J_ic^T / sigma_c^2  +  G^T C^-1 G  +  diag(1 / prior^2)
//! bound_e = sqrt((I^-1)_ee)                                                          (Cramer and Rao)
//! ```
//!
//! `J` are the program's own derivatives of the samples, in `f64`; a source takes those of its sensors and its time. `G` are the
//! derivatives of the tail's natural frequencies (and damping ratios) by damage and stiffness, and `C` is their covariance at best:
//! the inverse of what the tail's samples say of them when the amplitude and phase of each mode at each sensor, and each sensor's
//! offset, may be anything. That these may be anything is what makes frequencies a summary that loses: the samples know from which
//! motion the train has left the bridge.
//!
//! Beside the bounds stand identifications of recordings that another model has made ([`truth`](super::noise::truth)).

use anyhow::{Context, Result, bail};
use nalgebra::{DMatrix, SMatrix};
use rand_core::Rng;
use serde_json::{Value, json};
use spanwatch::bridge::modes::FrequencySlopes;
use spanwatch::bridge::{Damage, ReducedBridge};
use spanwatch::capacity::{CHANNELS, ELEMENTS, MODES};
use spanwatch::identify::free_vibration::{SEARCHED, TAIL_MODES, expected, first_free_sample};
use spanwatch::interaction::sensitivity::{STIFFNESS, wanted};
use spanwatch::interaction::simulation::{Recorder, Sensor};
use spanwatch::interaction::{Hypothesis, Observation, Sensitivities};
use spanwatch::slot::Slot;
use spanwatch::track::profile::Profile;
use spanwatch::train::PlanarTrain;
use spanwatch::wire::message::{Quantity, Ranges};

use super::noise::Nuisance;
use super::noise::bound::{UNKNOWNS, bound, prior, with_prior};
use super::noise::campaign::{JUDGED, Spread};
use super::noise::explain::identify;
use super::noise::field::Field;
use super::noise::truth::{Drawn, Purpose, Recorded, Setting};
use crate::batch;
use crate::evaluate::{Case, aligned};
use crate::identification::Observed;
use crate::model::reduce::reduce;
use crate::model::{BridgeFrame, Structure};
use crate::random::gaussian;
use crate::recording::{Channel, Unit};
use crate::simulate::{Scenario, simulate};
use crate::train::TrainName;

/// What is measured, and where: all that sources are made of.
const SENSORS: [(u16, Quantity); 4] = [
    (3, Quantity::Acceleration),
    (6, Quantity::Acceleration),
    (9, Quantity::Acceleration),
    (6, Quantity::Displacement),
];
/// Noise of the accelerations, and of a displacement where it is a part: of the sensor's RMS over the record with the shorter tail.
pub const NOISE: f64 = 0.05;
/// Noise of a displacement where it is not, m.
pub const DISPLACEMENT_NOISE_M: f64 = 2e-5;
/// Time after the last axle has left, s: as the other studies have it, and a longer one.
pub const TAILS_S: [f64; 2] = [2.0, 10.0];
/// A frequency whose standard deviation is a larger part of it is not given, nor a mode whose damping is not known to this part.
const GIVEN: [f64; 2] = [0.02, 0.5];

type Information = SMatrix<f64, UNKNOWNS, UNKNOWNS>;

/// Noise of a displacement.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Displacement {
    /// None is measured.
    None,
    /// [`DISPLACEMENT_NOISE_M`].
    Absolute,
    /// [`NOISE`].
    Part,
}

/// What is taken of the time after the train has left.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum After {
    /// Nothing.
    Nothing,
    /// The samples.
    Samples,
    /// The natural frequencies; with the flag the damping ratios, too.
    Frequencies(bool),
}

/// A set of measurements.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Source {
    /// As the table calls it.
    pub name: &'static str,
    /// Nodes with an accelerometer.
    pub accelerations: &'static [u16],
    /// Displacement of node 6.
    pub displacement: Displacement,
    /// What of the tail is taken.
    pub after: After,
    /// How long that is, an index of [`TAILS_S`].
    pub tail: usize,
}

/// All that are compared.
pub const SOURCES: [Source; 16] = {
    const fn of(
        name: &'static str,
        accelerations: &'static [u16],
        displacement: Displacement,
        after: After,
        tail: usize,
    ) -> Source {
        Source {
            name,
            accelerations,
            displacement,
            after,
            tail,
        }
    }
    use After::{Frequencies, Nothing, Samples};
    use Displacement::{Absolute, None, Part};
    [
        of("a6 while the train runs", &[6], None, Nothing, 0),
        of("  + samples of 2 s after it", &[6], None, Samples, 0),
        of("  + fn of these 2 s", &[6], None, Frequencies(false), 0),
        of("  + fn and xi of these 2 s", &[6], None, Frequencies(true), 0),
        of("  + samples of 10 s after it", &[6], None, Samples, 1),
        of("  + fn of these 10 s", &[6], None, Frequencies(false), 1),
        of("d6, 0.02 mm", &[], Absolute, Samples, 0),
        of("d6, 5 %", &[], Part, Samples, 0),
        of("a6 and d6, 0.02 mm", &[6], Absolute, Samples, 0),
        of("a6 and d6, 5 %", &[6], Part, Samples, 0),
        of("a3 a9 and d6, 5 %", &[3, 9], Part, Samples, 0),
        of("a3 a6 a9 while the train runs", &[3, 6, 9], None, Nothing, 0),
        of("  + samples of 2 s after it", &[3, 6, 9], None, Samples, 0),
        of("  + fn of these 2 s", &[3, 6, 9], None, Frequencies(false), 0),
        of("a3 a6 a9 and d6, 0.02 mm", &[3, 6, 9], Absolute, Samples, 0),
        of("a3 a6 a9 and d6, 5 %", &[3, 6, 9], Part, Samples, 0),
    ]
};

impl Source {
    /// Its sensors, as places in [`SENSORS`].
    fn sensors(&self) -> Vec<usize> {
        let is_its = |&(node, quantity): &(u16, Quantity)| match quantity {
            Quantity::Acceleration => self.accelerations.contains(&node),
            Quantity::Displacement => self.displacement != Displacement::None,
        };
        (0..SENSORS.len()).filter(|&s| is_its(&SENSORS[s])).collect()
    }

    /// Whether a logger has as many channels.
    pub fn is_recordable(&self) -> bool {
        self.sensors().len() <= CHANNELS
    }
}

/// What is to be compared.
#[derive(Debug, Clone)]
pub struct Plan {
    /// Cases, a table each.
    pub cases: Vec<Case>,
    /// Part of its stiffness that every element has lost besides.
    pub wear: f64,
    /// Identifications of each source; their seeds are 1, 2, ..; 0: the bounds alone.
    pub seeds: u32,
}

/// One source in one case.
#[derive(Debug, Clone, PartialEq)]
pub struct Row {
    /// The case.
    pub case: Case,
    /// The source.
    pub source: Source,
    /// Whether run and stiffness are known.
    pub nuisance: Nuisance,
    /// The bound of each element's damage.
    pub bound: Damage<f64>,
    /// Standard deviation of the bridge's first natural frequency as it follows from all that, as a part of it.
    pub first_frequency: f64,
    /// RMSE of each element's, if anything was identified.
    pub rmse: Option<Damage<f64>>,
}

impl Row {
    /// The largest bound of a damaged element.
    pub fn damaged(&self) -> f64 {
        let damaged = self.case.damage.iter().map(|&(element, _)| self.bound[element - 1]);
        damaged.fold(0.0, f64::max)
    }

    /// RMSE over bound, of the elements whose bound is below [`JUDGED`] together.
    pub fn ratio(&self) -> Option<f64> {
        let rmse = self.rmse?;
        let judged = (0..ELEMENTS).filter(|&e| self.bound[e] < JUDGED);
        let sums = judged.fold([0.0; 2], |[found, bound], e| {
            [found + rmse[e].powi(2), bound + self.bound[e].powi(2)]
        });
        (sums[1] > 0.0).then(|| (sums[0] / sums[1]).sqrt())
    }
}

/// One passage as all sensors see it, with the derivatives of all.
#[derive(Debug, Clone)]
pub struct Passage {
    bridge: ReducedBridge<f64>,
    damage: Damage<f64>,
    rate_hz: f64,
    band_hz: f64,
    /// Of each sensor: its values to the end of the longer tail, m/s² (m).
    signal: Vec<Vec<f64>>,
    /// Their derivatives, in the order of [`UNKNOWNS`].
    jacobian: Vec<Vec<[f64; UNKNOWNS]>>,
    /// Samples to the end of each tail.
    ends: [usize; 2],
    /// Where the tails begin.
    free: usize,
    ranges: Ranges,
}

impl Passage {
    /// The passage of a setting at its own run, of which so much is known.
    ///
    /// # Errors
    /// If there is no such train, or it does not leave.
    pub fn new(bridge: &ReducedBridge<f64>, setting: &Setting, ranges: Ranges) -> Result<Self> {
        let scenario = setting.scenario();
        let truth = setting.draw(0).truth;
        let train = PlanarTrain::of_kind(setting.case.train, setting.case.cars).context("a train of 1 to 16 cars")?;
        let way_m = bridge.path.length_m() + train.length_m();
        let rate_hz = scenario.sample_interval_s().recip();
        let hypothesis = Hypothesis::new(truth.damage, 1.0, scenario.run::<f64>());
        let left_s = hypothesis.run.time_at_s(way_m).context("the train stops")?;
        let ends = TAILS_S.map(|tail_s| ((left_s + tail_s) * rate_hz).ceil() as usize);
        let (mut signal, mut jacobian) = (vec![], vec![]);
        for chunk in SENSORS.chunks(CHANNELS) {
            let sensors = places(bridge, chunk)?;
            let recorder = Recorder::new(sensors, rate_hz, scenario.antialias_hz);
            let observation = Observation::new(train.clone(), hypothesis.run, recorder, scenario.scheme)?;
            let mut sensitivities = Box::new(Sensitivities::<f64, MODES>::NONE);
            let mut place = Slot::Empty;
            let track = Profile::SMOOTH;
            sensitivities.begin(
                bridge,
                &hypothesis,
                &observation,
                &track,
                &wanted(&[true; UNKNOWNS], 0),
                &mut place,
            )?;
            let simulation = place.as_mut().context("a simulation that has begun")?;
            let at = signal.len();
            signal.resize(at + chunk.len(), vec![]);
            jacobian.resize(at + chunk.len(), vec![]);
            for _ in 0..ends[1] {
                let (sample, rows) = sensitivities.sample(simulation, &observation, &track);
                for c in 0..chunk.len() {
                    signal[at + c].push(sample[c]);
                    jacobian[at + c].push(std::array::from_fn(|unknown| rows[c][unknown]));
                }
            }
        }
        let observed = Observed::of(bridge.cast(), &scenario, vec![])?;
        Ok(Self {
            bridge: bridge.clone(),
            damage: truth.damage,
            rate_hz,
            band_hz: scenario.antialias_hz.unwrap_or(0.5 * rate_hz),
            signal,
            jacobian,
            ends,
            free: first_free_sample(&observed.bridge, &observed.observation).context("the train stops")?,
            ranges,
        })
    }

    /// Standard deviation of each sensor's noise in a source, m/s² (m).
    fn sigma(&self, source: &Source) -> [f64; SENSORS.len()] {
        std::array::from_fn(|s| match (SENSORS[s].1, source.displacement) {
            (Quantity::Displacement, Displacement::Absolute) => DISPLACEMENT_NOISE_M,
            _ => NOISE * rms(&self.signal[s][..self.ends[0]]),
        })
    }

    /// What a source says of all unknowns, what is known before included.
    pub fn information(&self, source: &Source) -> Information {
        let sigma = self.sigma(source);
        let end = match source.after {
            After::Samples => self.ends[source.tail],
            After::Nothing | After::Frequencies(_) => self.free,
        };
        let mut information = Information::zeros();
        for s in source.sensors() {
            for row in &self.jacobian[s][..end] {
                let row = nalgebra::SVector::from(*row);
                information.ger(sigma[s].powi(-2), &row, &row, 1.0);
            }
        }
        if let After::Frequencies(damping) = source.after {
            information += self.tail(source, damping);
        }
        // What is held is no unknown.
        for u in (0..UNKNOWNS).filter(|&u| prior(&self.ranges, u) == Some(0.0)) {
            information.row_mut(u).fill(0.0);
            information.column_mut(u).fill(0.0);
        }
        with_prior(&mut information, &self.ranges);
        information
    }

    /// `G^T C^-1 G`.
    fn tail(&self, source: &Source, damping: bool) -> Information {
        let slopes = FrequencySlopes::<f64, TAIL_MODES>::new(&self.bridge, &self.damage);
        let sigma = self.sigma(source);
        let looked_for = expected(
            &self.bridge.cast(),
            &self.damage.map(|loss| loss as f32),
            self.band_hz as f32,
            SEARCHED,
        );
        let [p1, p2] = self.bridge.rayleigh;
        let modes: Vec<[f64; 2]> = (slopes.omega_squared.iter().take(looked_for.len()))
            .map(|square| square.sqrt())
            .map(|omega| [omega, 0.5 * (p1 / omega + p2 * omega)])
            .collect();
        let mut fisher = DMatrix::<f64>::zeros(2 * modes.len(), 2 * modes.len());
        for s in source.sensors() {
            let tail = &self.signal[s][self.free..self.ends[source.tail]];
            fisher += of_decays(tail, self.rate_hz, &modes) / sigma[s].powi(2);
        }
        // A mode that is not given is not fitted either.
        let given: Vec<usize> = (0..modes.len())
            .filter(|&k| {
                let alone = [0, 1].map(|j| fisher[(2 * k + j, 2 * k + j)].sqrt().recip() / modes[k][j]);
                looked_for[k].distinct && alone[0] < GIVEN[0] && alone[1] < GIVEN[1]
            })
            .collect();
        let kept: Vec<usize> = given.iter().flat_map(|&k| [2 * k, 2 * k + 1]).collect();
        let mut known = DMatrix::from_fn(kept.len(), kept.len(), |i, j| fisher[(kept[i], kept[j])]);
        let mut quantities: Vec<usize> = (0..kept.len()).collect();
        if !damping {
            // The damping ratios are fitted, but not compared.
            quantities.retain(|i| i % 2 == 0);
            let covariance = known.clone().try_inverse().unwrap_or_else(|| known.clone() * 0.0);
            known = DMatrix::from_fn(quantities.len(), quantities.len(), |i, j| {
                covariance[(quantities[i], quantities[j])]
            });
            known = known.clone().try_inverse().unwrap_or(known);
        }
        let slope = DMatrix::from_fn(quantities.len(), UNKNOWNS, |i, u| {
            let k = given[quantities[i] / 2];
            let omega = modes[k][0];
            let by_omega = [1.0, 0.5 * (p2 - p1 / (omega * omega))][quantities[i] % 2];
            by_omega
                * match u {
                    STIFFNESS => 0.5 * omega,
                    e if e < ELEMENTS => 0.5 * slopes.by_damage[k][e] / omega,
                    _ => 0.0,
                }
        });
        let information = slope.transpose() * known * slope;
        Information::from_fn(|i, j| information[(i, j)])
    }

    /// Standard deviation of the first natural frequency, as a part of it, at best.
    pub fn first_frequency(&self, source: &Source) -> f64 {
        let slopes = FrequencySlopes::<f64, 1>::new(&self.bridge, &self.damage);
        let information = self.information(source);
        let free: Vec<usize> = (0..UNKNOWNS).filter(|&u| information[(u, u)] > 0.0).collect();
        let matrix = DMatrix::from_fn(free.len(), free.len(), |i, j| information[(free[i], free[j])]);
        let slope = DMatrix::from_fn(free.len(), 1, |i, _| match free[i] {
            STIFFNESS => 0.5,
            e if e < ELEMENTS => 0.5 * slopes.by_damage[0][e] / slopes.omega_squared[0],
            _ => 0.0,
        });
        matrix.cholesky().map_or(f64::INFINITY, |factor| {
            (slope.transpose() * factor.solve(&slope))[(0, 0)].sqrt()
        })
    }

    /// The bound of each element's damage.
    pub fn bound(&self, source: &Source) -> Damage<f64> {
        bound(&self.information(source))
    }
}

/// What a sensor's tail says of each mode's circular frequency and damping ratio (in turn), for noise of 1, when the modes' amplitudes
/// and phases and the offset are unknown, too.
fn of_decays(tail: &[f64], rate_hz: f64, modes: &[[f64; 2]]) -> DMatrix<f64> {
    const STEP: f64 = 1e-5;
    let wave = |[omega, xi]: [f64; 2], i: usize| {
        let t = i as f64 / rate_hz;
        let (sin, cos) = (omega * (1.0 - xi * xi).sqrt() * t).sin_cos();
        [cos, sin].map(|part| (-xi * omega * t).exp() * part)
    };
    let linear = DMatrix::from_fn(tail.len(), 2 * modes.len() + 1, |i, j| match modes.get(j / 2) {
        Some(&mode) => wave(mode, i)[j % 2],
        None => 1.0,
    });
    let factor = linear.clone().qr();
    let onto = |values: &DMatrix<f64>| factor.q().transpose() * values;
    let recorded = DMatrix::from_column_slice(tail.len(), 1, tail);
    let amplitudes = (factor.r().solve_upper_triangular(&onto(&recorded))).unwrap_or_else(|| onto(&recorded) * 0.0);
    let slopes = DMatrix::from_fn(tail.len(), 2 * modes.len(), |i, j| {
        let k = j / 2;
        let moved = |by: f64| {
            let mut mode = modes[k];
            mode[j % 2] *= 1.0 + by;
            let [cos, sin] = wave(mode, i);
            amplitudes[2 * k] * cos + amplitudes[2 * k + 1] * sin
        };
        (moved(STEP) - moved(-STEP)) / (2.0 * STEP * modes[k][j % 2])
    });
    let explained = onto(&slopes);
    slopes.transpose() * &slopes - explained.transpose() * explained
}

fn rms(values: &[f64]) -> f64 {
    (values.iter().map(|v| v * v).sum::<f64>() / values.len() as f64).sqrt()
}

/// Places of sensors, as a recorder has them.
fn places(bridge: &ReducedBridge<f64>, of: &[(u16, Quantity)]) -> Result<heapless::Vec<Sensor, CHANNELS>> {
    (of.iter())
        .map(|&(node, quantity)| {
            let place = bridge.sensor_at(node);
            let place = place.with_context(|| format!("the bridge has no node {node}"))?;
            Ok(Sensor { place, quantity })
        })
        .collect()
}

/// The setting of a case: all accelerations.
pub fn setting(case: Case, wear: f64, nuisance: Nuisance) -> Setting {
    Setting {
        case,
        wear,
        noise: NOISE,
        nodes: vec![3, 6, 9],
        nuisance,
        field: Field::NONE,
    }
}

/// What a recorder would write of a passage without noise, a list for each of [`SENSORS`], to the end of the longer tail.
///
/// # Errors
/// As [`simulate`].
pub fn clean(bridge: &BridgeFrame, setting: &Setting, drawn: &Drawn) -> Result<Vec<Vec<f64>>> {
    let truth = Structure::new(Field::NONE.bridge(setting, drawn.seed, bridge, drawn.truth.stiffness))?;
    let of = |quantity: Quantity| {
        let sensors = SENSORS.iter().filter(|sensor| sensor.1 == quantity);
        let scenario = Scenario {
            quantity,
            nodes: sensors.map(|sensor| sensor.0).collect(),
            lead_s: drawn.truth.run.entry_time_s,
            load_factor: drawn.truth.run.load_factor,
            tail_s: TAILS_S[1],
            ..setting.scenario()
        };
        anyhow::Ok(simulate(&truth, &scenario)?.channels)
    };
    Ok([of(Quantity::Acceleration)?, of(Quantity::Displacement)?].concat())
}

/// A recording of a source, as the search sees it: noise and rounding added to what is `clean`.
///
/// # Errors
/// If there is no free vibration in a tail whose frequencies are wanted.
pub fn record(
    bridge: &ReducedBridge<f64>,
    passage: &Passage,
    setting: &Setting,
    drawn: &Drawn,
    clean: &[Vec<f64>],
    source: &Source,
) -> Result<Observed> {
    let (sensors, sigma) = (source.sensors(), passage.sigma(source));
    let rows = passage.ends[source.tail].min(clean[0].len());
    let mut rng = setting.generator(drawn.seed, Purpose::Noise);
    let mut channels = vec![];
    for (s, values) in clean.iter().enumerate() {
        // Each sensor has noise of its own, the same in every source.
        let mut rng = <rand_xoshiro::Xoshiro256PlusPlus as rand_core::SeedableRng>::seed_from_u64(rng.next_u64());
        let unit = match SENSORS[s].1 {
            Quantity::Acceleration => Unit::MetrePerSecondSquared,
            Quantity::Displacement => Unit::Millimetre,
        };
        let sensor = Channel::new(String::new(), None, unit, vec![]);
        let values = values.iter().take(rows);
        let read = values.map(|value| sensor.count(value + sigma[s] * gaussian(&mut rng)) as f32 * sensor.lsb);
        channels.push(read.collect::<Vec<f32>>());
    }
    let samples = (0..rows).flat_map(|i| sensors.iter().map(|&s| channels[s][i]).collect::<Vec<f32>>());
    let recorded = Recorded {
        samples: samples.collect(),
        sigma: vec![],
    };
    let mut observed = super::noise::explain::observe(&bridge.cast(), setting, drawn, &recorded)?;
    let of: Vec<(u16, Quantity)> = sensors.iter().map(|&s| SENSORS[s]).collect();
    observed.observation.recorder.sensors = places(bridge, &of)?;
    if source.after != After::Samples {
        let first = observed.first_free(rows, drawn.seed)?;
        match source.after {
            After::Frequencies(damping) => {
                let found = observed.split_tail(first, damping);
                found.with_context(|| format!("seed {}: no free vibration in \"{}\"", drawn.seed, source.name))?;
            }
            _ => observed.samples.truncate(first * sensors.len()),
        }
    }
    Ok(observed)
}

/// Runs a plan on all processors. `done` is called after every passage that is identified by all sources.
///
/// # Errors
/// If there is nothing to do, or a passage cannot be solved.
pub fn run(bridge: &BridgeFrame, plan: &Plan, done: &(dyn Fn() + Sync)) -> Result<Vec<Row>> {
    if plan.cases.is_empty() {
        bail!("nothing to evaluate: give at least one case");
    }
    let model = reduce(bridge)?;
    let settings: Vec<Setting> = (plan.cases.iter())
        .flat_map(|&case| [Nuisance::Known, Nuisance::Unknown].map(|nuisance| setting(case, plan.wear, nuisance)))
        .collect();
    let passages = batch::each(&settings, |setting| {
        Passage::new(&model, setting, setting.draw(0).ranges)
    });
    let passages = passages.into_iter().collect::<Result<Vec<_>>>()?;
    let jobs: Vec<(usize, u64)> = (0..settings.len())
        .flat_map(|s| (1..=u64::from(plan.seeds)).map(move |seed| (s, seed)))
        .collect();
    let errors = batch::each(&jobs, |&(s, seed)| -> Result<Vec<Damage<f64>>> {
        let (setting, drawn) = (&settings[s], settings[s].draw(seed));
        let clean = clean(bridge, setting, &drawn)?;
        let errors = SOURCES.iter().filter(|source| source.is_recordable()).map(|source| {
            let observed = record(&model, &passages[s], setting, &drawn, &clean, source)?;
            let found = identify(&observed, seed)?.found.damage;
            Ok(std::array::from_fn(|e| found[e] - drawn.truth.damage[e]))
        });
        let errors = errors.collect::<Result<Vec<_>>>();
        done();
        errors
    });
    let errors = errors.into_iter().collect::<Result<Vec<_>>>()?;
    let mut rows = vec![];
    for (s, (setting, passage)) in settings.iter().zip(&passages).enumerate() {
        let of_setting: Vec<&Vec<Damage<f64>>> = (jobs.iter().zip(&errors))
            .filter(|((of, _), _)| *of == s)
            .map(|(_, errors)| errors)
            .collect();
        let mut identified = 0;
        for source in &SOURCES {
            let rmse = source.is_recordable().then(|| {
                let square = |e: usize| {
                    of_setting
                        .iter()
                        .map(|errors| errors[identified][e].powi(2))
                        .sum::<f64>()
                };
                std::array::from_fn(|e| (square(e) / of_setting.len() as f64).sqrt())
            });
            identified += usize::from(source.is_recordable());
            rows.push(Row {
                case: setting.case,
                source: *source,
                nuisance: setting.nuisance,
                bound: passage.bound(source),
                first_frequency: passage.first_frequency(source),
                rmse: rmse.filter(|_| plan.seeds > 0),
            });
        }
    }
    Ok(rows)
}

/// What is printed under the tables.
const LEGEND: &str = "\
bounds of the damage, points: median element / worst element / worst damaged element. fn1: of the bridge's first natural frequency,
ten-thousandths, as it follows from all that is measured and the model. known, unknown: speed, entry time, load and
stiffness of the whole bridge. RMSE: of identifications, over the bound, both root mean squares over the elements whose bound is below 10
points (none: there is no such element, or the logger has not so many channels).
a6: acceleration of node 6, d6: its displacement, with the noise that is named; accelerations have 5 % of their RMS.
";

/// The rows as tables in Markdown, one a case.
pub fn table(rows: &[Row]) -> String {
    let mut text = String::new();
    let points = |row: &Row| {
        let spread = Spread::of(&row.bound);
        [spread.median, spread.worst, row.damaged()]
            .map(|part| format!("{:.2}", 100.0 * part))
            .join(" / ")
    };
    let ratio = |row: &Row| {
        row.ratio()
            .map_or_else(|| "none".to_owned(), |ratio| format!("{ratio:.2}"))
    };
    for group in rows.chunk_by(|a, b| a.case == b.case) {
        let case = group[0].case;
        let (known, unknown): (Vec<&Row>, Vec<&Row>) = group.iter().partition(|row| row.nuisance == Nuisance::Known);
        let frequency = |row: &Row| format!("{:.2}", 1e4 * row.first_frequency);
        let heads = ["source", "known", "fn1", "RMSE", "unknown", "fn1", "RMSE"].map(String::from);
        let mut lines = vec![heads];
        for (known, unknown) in known.into_iter().zip(unknown) {
            // Markdown drops leading blanks.
            let name = known.source.name.replacen("  ", "… ", 1);
            let [a, b, c] = [points(known), frequency(known), ratio(known)];
            let [d, e, f] = [points(unknown), frequency(unknown), ratio(unknown)];
            lines.push([name, a, b, c, d, e, f]);
        }
        let table = if group.iter().any(|row| row.rmse.is_some()) {
            aligned(lines)
        } else {
            aligned(lines.into_iter().map(|[s, a, b, _, d, e, _]| [s, a, b, d, e]).collect())
        };
        text += &format!(
            "{}, case {}, {} cars, {:.0} km/h\n\n{}\n",
            TrainName::Known(case.train).name(),
            case.number,
            case.cars,
            case.speed_kmh,
            table
        );
    }
    text + LEGEND
}

/// The rows as JSON, one object a row.
pub fn json(rows: &[Row]) -> Value {
    let row = |row: &Row| {
        json!({
            "case": row.case.number,
            "train": TrainName::Known(row.case.train).name(),
            "source": row.source.name.trim(),
            "accelerations": row.source.accelerations,
            "nuisance": row.nuisance.name(),
            "bound": row.bound,
            "first_frequency_std": row.first_frequency,
            "rmse": row.rmse,
            "ratio": row.ratio(),
        })
    };
    rows.iter().map(row).collect()
}
