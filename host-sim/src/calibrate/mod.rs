//! Learning the track from healthy passages, and the bridge under it: what damage is measured against afterwards.
//!
//! ```text
//! minimise  sum_p |r_p|^2_W + sum_p own_p^T P own_p + c^T C^-1 c / level + priors        over shared and own unknowns (linear.rs)
//! level <- (c^T C^-1 c + tr(C^-1 Cov(c))) / n                                            the prior's own level, by expectation
//! ```
//!
//! `C` is the covariance that a standard spectrum gives the profile's coefficients; how rough this track is beside that is
//! estimated along with it. A Gauss-Newton step is one linearisation of each passage and one solution for what they share.
//!
//! **Where the runs begin.** Each passage's run is first identified as if the track were smooth and the bridge whole: that fits the
//! passage to a fraction of a period, which is all that is asked of it.
//!
//! **What is left out.** A passage that is explained far worse than the rest is none of the same train, track or sensors. It is
//! left out, with the reason, and the others are solved again.
//!
//! **The reference.** Each later passage is explained with the profile as it was learnt, and what is wrong with that is wrong in all of
//! them. With `A` the information of all passages of a kind of train, losses `d` and what else is shared `s`,
//!
//! ```text
//! G = A_dd^-1 A_ds            what an error of the shared unknowns does to the losses
//! B = G (Cov(s) + D) G^T      summed over the kinds of train: no mixture of them has more
//! ```
//!
//! is the variance that no number of passages averages away. `D` is what the rails may change between this and the next calibration
//! without its being seen: waves of the spectrum's shape below [`SHORT_M`], of an RMS that is chosen ([`DRIFT_M`]). It is most of `B`: sixty
//! passages of sixteen cars leave 0.1 to 0.3 points of an element of girder50 open, while a change of the rails by a hundredth of a millimetre
//! may pass for 1 to 5. The logger's own test of the track sees such a change only if all cars weigh the same; with 2 % of the
//! passengers' weight from car to car it sees several hundredths ([`Calibration::unseen_m`]).

pub mod known;
pub(crate) mod linear;
mod recorded;

use std::path::Path;

use anyhow::{Context, Result, anyhow, bail};
use nalgebra::{DMatrix, DVector, SMatrix};
use spanwatch::bridge::ReducedBridge;
use spanwatch::capacity::{CHANNELS, ELEMENTS};
use spanwatch::identify::Identification;
use spanwatch::interaction::{Direction, Run};
use spanwatch::track::blob;
use spanwatch::track::learnt::{LearntTrack, UNLEARNT, Unexplained, speed_band};
use spanwatch::track::profile::{Knots, Stretch};
use spanwatch::track::watch::unseen;
use spanwatch::wire::fingerprint;
use spanwatch::wire::message::TrainKind;

use crate::batch::each;
use crate::identification::Observed;
use crate::model::to_blob;
use crate::track::Spectrum;
use crate::track::prior::{covariance_of_waves, precision};
use linear::{COEFFICIENTS, Linear, Passing, SHARED_DAMPING, SHARED_STIFFNESS, Shared};

/// Standard deviations, beforehand, of the logarithms of stiffness and damping: a model may be off by a tenth, and of the damping only
/// its size is known.
const STIFFNESS_PRIOR: f64 = 0.1;
const DAMPING_PRIOR: f64 = 0.7;
/// The same where both were learnt before: what a season may do to them.
const STIFFNESS_SINCE: f64 = 0.003;
const DAMPING_SINCE: f64 = 0.1;
/// That of an element's loss, where the bridge need not be healthy.
const DAMAGE_PRIOR: f64 = 0.3;
/// Gauss-Newton steps at most; ...
const MOST_STEPS: usize = 12;
/// ... they end before a step that would take less than this part of what is left.
const SETTLED: f64 = 1e-3;
/// The level is sought until it moves by less than this part of it, ...
const LEVEL_SETTLED: f64 = 0.01;
/// ... in so many turns at most.
const MOST_TURNS: usize = 100;
/// A passage is left out if what it leaves unexplained is so many robust deviations above the others' median.
const OUTLYING: f64 = 6.0;
/// The robust deviation is at least this: a passage a fifth worse than the rest is none the worse for it.
const LEAST_SCATTER: f64 = 0.05;
/// Standard deviation that each loss has at least: less than any that matters, and the covariance keeps its factor.
const LEAST_FLOOR: f64 = 1e-4;
/// What the rails are taken to change unseen, RMS, m: about what a busy line wears in a month, if it wears unevenly.
pub const DRIFT_M: f64 = 5e-6;
/// Waves in which they do, m: longer ones move wheels too slowly to matter.
const SHORT_M: f64 = 20.0;
/// Fewest passages that can be called a reference.
const FEWEST: usize = 5;
/// Part of its samples that a passage may lack.
const BAD_SAMPLES: f32 = 0.05;
/// Spans on the approach, and the length of one, m: a car is brought into its swing over 90 m, and its springs pass nothing on of waves
/// that are too short for ten metres between knots.
const APPROACH: u16 = 9;
const APPROACH_M: f64 = 10.0;
/// Span on the bridge, m, if there is memory for it: a quarter of the shortest wave of the standard spectra. Half of that wave leaves the curvature
/// under the wheels so wrong that elements seem off by 5 to 15 points; a third has, beside the wave, one of half its length, which an inspection
/// car at 67 to 86 km/h brings to girder50's third frequency: 0.4 to 1.1 % of the power stay unexplained, with a quarter 0.26 to 0.28 % (the
/// noise is 0.25 %).
const FINE_M: f64 = 0.385;
/// The fine spans reach so far beyond either end of the bridge, m.
const BEYOND_M: f64 = 1.0;
/// Fine spans: all that the logger has memory for beside the others.
const FINE_SPANS: u16 = 135;
/// Spans behind the bridge, as long as a car together, and the length of one, m.
const BEHIND: u16 = 4;
const BEHIND_M: f64 = 6.0;

/// The knots of a profile for a bridge of this length.
pub fn knots(length_m: f64) -> Option<Knots<f64>> {
    let spans = (((length_m + 2.0 * BEYOND_M) / FINE_M).ceil() as u16).min(FINE_SPANS);
    let fine_m = (length_m + 2.0 * BEYOND_M) / f64::from(spans);
    let stretch = |from_m, spacing_m, spans| Stretch {
        from_m,
        spacing_m,
        spans,
    };
    Knots::new(&[
        stretch(-BEYOND_M - f64::from(APPROACH) * APPROACH_M, APPROACH_M, APPROACH),
        stretch(-BEYOND_M, fine_m, spans),
        stretch(length_m + BEYOND_M, BEHIND_M, BEHIND),
    ])
}

/// A passage to learn from.
#[derive(Debug, Clone)]
pub struct Passage {
    /// What to call it.
    pub name: String,
    /// Which train.
    pub train: TrainKind,
    /// The passage.
    pub observed: Observed,
}

/// How to learn.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Options {
    /// The bridge is as healthy as it is taken to be: its elements' losses are held at nothing. Else they are unknowns, too.
    pub healthy: bool,
    /// Stiffness and damping of the whole bridge, as parts of its model's, if they are known from before.
    pub before: Option<[f64; 2]>,
    /// What the rails may change afterwards without its being seen, RMS, m.
    pub drift_m: f64,
    /// Seed of the searches.
    pub seed: u64,
}

/// What was learnt.
#[derive(Debug, Clone)]
pub struct Calibration {
    /// For the logger.
    pub learnt: LearntTrack,
    /// Coefficients of the profile, m, and their knots.
    pub coefficients: Vec<f64>,
    /// The knots.
    pub knots: Knots<f64>,
    /// Covariance of the coefficients, m².
    pub covariance: DMatrix<f64>,
    /// Level of the prior, as a part of FRA class 6's spectrum.
    pub level: f64,
    /// The elements' losses with their deviations, if they were unknowns.
    pub damage: [[f64; 2]; ELEMENTS],
    /// Standard deviations of stiffness and damping, as parts of them.
    pub bridge_std: [f64; 2],
    /// Standard deviation of each element's loss that no number of later passages goes below.
    pub floor: [f64; ELEMENTS],
    /// The part of it that comes from what these passages leave unknown: no drift of the track that is not seen.
    pub floor_learnt: [f64; ELEMENTS],
    /// What both would be, had each of these passages been there twice.
    pub floors_twice: [[f64; ELEMENTS]; 2],
    /// The smallest change of the rails, of waves below 20 m, that the logger's test of the track sees in the long run, RMS, m.
    pub unseen_m: f64,
    /// Of each passage, in the order in which they were given.
    pub passages: Vec<Outcome>,
    /// Gauss-Newton steps that it took.
    pub steps: usize,
}

/// What became of a passage.
#[derive(Debug, Clone, PartialEq)]
pub enum Outcome {
    /// It was learnt from.
    Used {
        /// Its run.
        run: Run<f32>,
        /// Part of its power that was not explained on a smooth track, and that is not explained on the learnt one.
        unexplained: [f32; 2],
    },
    /// It was not, and why.
    LeftOut(String),
}

/// What is known of a passage while it is learnt from.
struct Candidate<'a> {
    passage: &'a Passage,
    passing: Passing,
    smooth: f32,
}

/// Learns from `passages` of a bridge; `progress` hears how many of how many turns of the work are done.
///
/// # Errors
/// If too few passages are of any use, or they say nothing.
pub fn calibrate(
    passages: &[Passage],
    options: &Options,
    progress: &(dyn Fn(usize, usize) + Sync),
) -> Result<Calibration> {
    let Some(first) = passages.first() else {
        bail!("there is no passage to learn from");
    };
    let sensors = |passage: &Passage| passage.observed.observation.recorder.sensors.clone();
    if let Some(other) = passages.iter().find(|passage| sensors(passage) != sensors(first)) {
        bail!(
            "{} and {} are of different sensors; a track is learnt with those that it will be monitored with, in the same order",
            first.name,
            other.name
        );
    }
    let length_m = f64::from(first.observed.bridge.path.length_m());
    let Some(knots) = knots(length_m) else {
        bail!("a bridge of {length_m} m has no place in a profile of this size");
    };
    let turns = MOST_STEPS + 2;
    progress(0, turns);
    let mut outcomes: Vec<Outcome> = vec![Outcome::LeftOut(String::new()); passages.len()];
    let found = each(passages, |passage| {
        // A bridge without elements: no damage is looked for where the track would be taken for it.
        let mut whole = passage.observed.clone();
        whole.bridge.elements = 0;
        whole.identify(options.seed)
    });
    let mut candidates: Vec<(usize, Candidate<'_>)> = Vec::new();
    for (i, (passage, found)) in passages.iter().zip(found).enumerate() {
        match begin(passage, found) {
            Ok(candidate) => candidates.push((i, candidate)),
            Err(reason) => outcomes[i] = Outcome::LeftOut(reason),
        }
    }
    progress(1, turns);
    let mut joint = Joint::new(&knots, options)?;
    let solved = loop {
        if candidates.len() < FEWEST {
            return Err(too_few(candidates.len(), passages, &outcomes));
        }
        let solved = joint.solve(&mut candidates, &|done| progress(1 + done, turns))?;
        // One that is far off hides others behind it: asked again until there is none.
        let outlying = outlying(&solved.unexplained);
        if outlying.is_empty() {
            break solved;
        }
        for &c in outlying.iter().rev() {
            let (i, _) = candidates.remove(c);
            outcomes[i] = Outcome::LeftOut(format!(
                "{:.1} % of its power is unexplained, of the others' {:.1} %: another train, a wrong speed, or a sensor at fault",
                100.0 * solved.unexplained[c],
                100.0 * median(&solved.unexplained)
            ));
        }
    };
    progress(turns - 1, turns);

    let learnt = joint.learnt(&candidates, &solved, options)?;
    for (i, candidate) in &candidates {
        outcomes[*i] = Outcome::Used {
            run: candidate.passing.run,
            unexplained: [candidate.smooth, 0.0],
        };
    }
    for ((i, _), unexplained) in candidates.iter().zip(&learnt.1) {
        if let Outcome::Used { unexplained: both, .. } = &mut outcomes[*i] {
            both[1] = *unexplained;
        }
    }
    progress(turns, turns);
    let (learnt, _, floor) = learnt;
    let unseen_m = unseen_m(&solved.passages, &joint.short, unseen(&learnt).into());
    let floor_of = |covariance: &DMatrix<f64>, drift_m: f64| {
        let floor = joint.floor(&candidates, &solved, covariance, drift_m)?;
        Ok::<_, anyhow::Error>(deviations(&floor))
    };
    let floor_learnt = floor_of(&solved.covariance, 0.0)?;
    let (_, twice) = joint.step(&solved.passages, 2.0)?;
    let floors_twice = [floor_of(&twice, options.drift_m)?, floor_of(&twice, 0.0)?];
    let deviation = |place: usize| solved.covariance[(place, place)].max(0.0).sqrt();
    let shared = &joint.shared;
    Ok(Calibration {
        learnt,
        coefficients: shared.coefficients.clone(),
        covariance: solved
            .covariance
            .view(
                (COEFFICIENTS, COEFFICIENTS),
                (knots.coefficients(), knots.coefficients()),
            )
            .into_owned(),
        level: joint.level,
        damage: std::array::from_fn(|e| [shared.damage[e], if options.healthy { 0.0 } else { deviation(e) }]),
        bridge_std: [deviation(SHARED_STIFFNESS), deviation(SHARED_DAMPING)],
        floor,
        floor_learnt,
        unseen_m,
        floors_twice,
        passages: outcomes,
        steps: solved.steps,
        knots,
    })
}

/// A passage whose run is roughly known; why it is of no use, if it is of none.
fn begin(passage: &Passage, found: Result<Identification>) -> Result<Candidate<'_>, String> {
    if passage.observed.observation.run.direction == Direction::Backward {
        return Err("its train enters by the last node, where the profile has no approach".to_owned());
    }
    let samples = &passage.observed.samples;
    let missing = samples.iter().filter(|value| value.is_nan()).count();
    if missing as f32 > BAD_SAMPLES * samples.len() as f32 {
        return Err(format!(
            "{:.0} % of its samples are missing or saturated",
            100.0 * missing as f32 / samples.len() as f32
        ));
    }
    let found = found.map_err(|error| format!("it cannot be simulated: {error:#}"))?;
    Ok(Candidate {
        passage,
        passing: Passing {
            run: found.run,
            cars: found.cars,
        },
        smooth: found.unexplained,
    })
}

/// The joint solution.
struct Joint {
    knots: Knots<f32>,
    /// Inverse of the prior covariance of the coefficients at level 1.
    precision: DMatrix<f64>,
    /// The same of waves below [`SHORT_M`], 1 m RMS on the bridge.
    short: DMatrix<f64>,
    level: f64,
    healthy: bool,
    /// Stiffness and damping beforehand: logarithm and its standard deviation.
    bridge: [[f64; 2]; 2],
    shared: Shared,
}

/// What a solution leaves.
struct Solved {
    covariance: DMatrix<f64>,
    passages: Vec<Linear>,
    unexplained: Vec<f64>,
    steps: usize,
}

impl Joint {
    fn new(knots: &Knots<f64>, options: &Options) -> Result<Self> {
        let mut short = covariance_of_waves(Spectrum::Fra6, [Spectrum::Fra6.waves_m()[0], SHORT_M], knots);
        // From the beginning of the bridge to its end, where the fine knots are; coefficients are heights for waves of many spans.
        let fine: Vec<f64> = (0..knots.coefficients())
            .filter(|&k| knots.support(k).is_some_and(|[from, to]| to - from < SHORT_M / 4.0))
            .map(|k| short[(k, k)])
            .collect();
        short /= fine.iter().sum::<f64>() / fine.len().max(1) as f64;
        let Some(rounded) = knots.cast() else {
            bail!("the profile's knots do not join");
        };
        Ok(Self {
            knots: rounded,
            precision: precision(Spectrum::Fra6, knots)?,
            short,
            level: 1.0,
            healthy: options.healthy,
            bridge: match options.before {
                Some([stiffness, damping]) => [[stiffness.ln(), STIFFNESS_SINCE], [damping.ln(), DAMPING_SINCE]],
                None => [[0.0, STIFFNESS_PRIOR], [0.0, DAMPING_PRIOR]],
            },
            shared: Shared::as_modelled(knots),
        })
    }

    /// Steps until what is left no longer changes.
    fn solve(
        &mut self,
        candidates: &mut [(usize, Candidate<'_>)],
        progress: &(dyn Fn(usize) + Sync),
    ) -> Result<Solved> {
        let mut steps = 0;
        loop {
            let passages = (each(&*candidates, |(_, candidate)| {
                Linear::of(
                    &candidate.passage.observed,
                    &candidate.passing,
                    &self.shared,
                    &self.knots,
                )
            })
            .into_iter())
            .collect::<Result<Vec<_>>>()?;
            let unexplained: Vec<f64> = (passages.iter())
                .map(|passage| passage.residuals.unexplained(&passage.power).into())
                .collect();
            let (step, covariance) = self.at_level(&passages)?;
            let settled = promise(&passages, &step) < SETTLED;
            if steps == MOST_STEPS || settled {
                return Ok(Solved {
                    covariance,
                    passages,
                    unexplained,
                    steps,
                });
            }
            self.shared.step(&step);
            for ((_, candidate), passage) in candidates.iter_mut().zip(&passages) {
                candidate.passing = passage.passing(candidate.passing, &step);
            }
            steps += 1;
            progress(steps);
        }
    }

    /// The step to the minimum of the linear model, and the covariance about it, with the level that the track has by them.
    fn at_level(&mut self, passages: &[Linear]) -> Result<(DVector<f64>, DMatrix<f64>)> {
        let n = self.shared.coefficients.len();
        let coefficients = DVector::from_row_slice(&self.shared.coefficients);
        let mut turns = 0;
        loop {
            let (step, covariance) = self.step(passages, 1.0)?;
            let there = &coefficients + step.rows(COEFFICIENTS, n);
            let spread = covariance.view((COEFFICIENTS, COEFFICIENTS), (n, n));
            let size = there.dot(&(&self.precision * &there)) + (&self.precision * spread).trace();
            let before = std::mem::replace(&mut self.level, size / n as f64);
            turns += 1;
            if (self.level / before).ln().abs() < LEVEL_SETTLED || turns == MOST_TURNS {
                return Ok((step, covariance));
            }
        }
    }

    /// The step to the minimum of the linear model, and the covariance about it, if each passage counts so many `times`.
    fn step(&self, passages: &[Linear], times: f64) -> Result<(DVector<f64>, DMatrix<f64>)> {
        let n = COEFFICIENTS + self.shared.coefficients.len();
        let (mut information, mut gradient) = (DMatrix::zeros(n, n), DVector::zeros(n));
        for passage in passages {
            information += &passage.own.information;
            gradient += &passage.own.gradient;
        }
        information *= times;
        gradient *= times;
        let mut prior = |place: usize, deviation: f64, value: f64| {
            information[(place, place)] += deviation.powi(-2);
            gradient[place] -= value * deviation.powi(-2);
        };
        for (e, &loss) in self.shared.damage.iter().enumerate() {
            prior(e, DAMAGE_PRIOR, loss);
        }
        let now = [
            (SHARED_STIFFNESS, self.shared.stiffness),
            (SHARED_DAMPING, self.shared.damping),
        ];
        for ((place, value), [expected, deviation]) in now.into_iter().zip(self.bridge) {
            prior(place, deviation, value.ln() - expected);
        }
        let precision = &self.precision / self.level;
        let coefficients = DVector::from_row_slice(&self.shared.coefficients);
        let pull = &precision * coefficients;
        let mut block = information.view_mut((COEFFICIENTS, COEFFICIENTS), (n - COEFFICIENTS, n - COEFFICIENTS));
        block += precision;
        let mut tail = gradient.rows_mut(COEFFICIENTS, n - COEFFICIENTS);
        tail -= pull;
        if self.healthy {
            for e in 0..ELEMENTS {
                information.row_mut(e).fill(0.0);
                information.column_mut(e).fill(0.0);
                information[(e, e)] = 1.0;
                gradient[e] = 0.0;
            }
        }
        let Some(factor) = information.cholesky() else {
            bail!("the passages contradict themselves; check trains, speeds and sensors");
        };
        let step = factor.solve(&gradient);
        let mut covariance = factor.inverse();
        if self.healthy {
            for e in 0..ELEMENTS {
                covariance[(e, e)] = 0.0;
            }
        }
        Ok((step, covariance))
    }

    /// What the logger needs, what each passage leaves unexplained when it is monitored with that, and the floor of each element.
    fn learnt(
        &self,
        candidates: &[(usize, Candidate<'_>)],
        solved: &Solved,
        options: &Options,
    ) -> Result<(LearntTrack, Vec<f32>, [f64; ELEMENTS])> {
        let mut learnt = LearntTrack {
            profile: self.shared.profile(&self.knots),
            stiffness: self.shared.stiffness as f32,
            damping: self.shared.damping as f32,
            spread: SMatrix::zeros(),
            unexplained: [Unexplained::default(); CHANNELS],
            scatter: 1.0,
            passages: candidates.len() as u16,
            speeds: [0; 2],
        };
        for (_, candidate) in candidates {
            learnt.speeds[candidate.passage.train as usize] |= 1 << speed_band(candidate.passing.run.speed_mps);
        }
        // As the logger will: each passage once more, with what was learnt.
        let monitored = each(candidates, |(_, candidate)| {
            let observed = candidate.passage.observed.with_track(&learnt);
            observed.identify(options.seed)
        })
        .into_iter()
        .collect::<Result<Vec<_>>>()?;
        let channels = candidates[0].1.passage.observed.problem().channels();
        for (c, unexplained) in learnt.unexplained.iter_mut().enumerate().take(channels) {
            let pairs: Vec<[f64; 2]> = monitored
                .iter()
                .map(|found| found.mean_squares[c].map(f64::from))
                .collect();
            *unexplained = noise(&pairs);
        }
        let ratios: Vec<f64> = monitored
            .iter()
            .map(|found| learnt.misfit(&found.mean_squares).into())
            .collect();
        let mean = ratios.iter().sum::<f64>() / ratios.len() as f64;
        let variance = ratios.iter().map(|ratio| (ratio - mean).powi(2)).sum::<f64>() / (ratios.len() - 1) as f64;
        learnt.scatter = variance.sqrt() as f32;
        for unexplained in &mut learnt.unexplained {
            unexplained.floor *= mean.exp() as f32;
            unexplained.part *= mean.exp() as f32;
        }
        let floor = self.floor(candidates, solved, &solved.covariance, options.drift_m)?;
        let Some(factor) = floor.cholesky() else {
            bail!("the reference is no covariance: the passages contradict themselves");
        };
        let lower = factor.l();
        learnt.spread = SMatrix::from_fn(|i, j| lower[(i, j)] as f32);
        Ok((
            learnt,
            monitored.iter().map(|found| found.unexplained).collect(),
            deviations(&floor),
        ))
    }

    /// `B`: the covariance of the losses that what is left unknown of the shared unknowns makes, their `covariance`, and a drift of the
    /// rails of this RMS.
    fn floor(
        &self,
        candidates: &[(usize, Candidate<'_>)],
        solved: &Solved,
        covariance: &DMatrix<f64>,
        drift_m: f64,
    ) -> Result<SMatrix<f64, ELEMENTS, ELEMENTS>> {
        let n = covariance.nrows();
        let s = n - ELEMENTS;
        let unknown = covariance.view((ELEMENTS, ELEMENTS), (s, s));
        let mut floor = SMatrix::<f64, ELEMENTS, ELEMENTS>::identity() * LEAST_FLOOR.powi(2);
        for kind in [TrainKind::Inspection2Dof, TrainKind::Shinkansen3d] {
            let of_kind: Vec<&Linear> = (candidates.iter().zip(&solved.passages))
                .filter(|((_, candidate), _)| candidate.passage.train == kind)
                .map(|(_, passage)| passage)
                .collect();
            if of_kind.is_empty() {
                continue;
            }
            let mut information = DMatrix::zeros(n, n);
            for passage in &of_kind {
                information += &passage.own.information;
            }
            let mut losses = information.view((0, 0), (ELEMENTS, ELEMENTS)).into_owned();
            for e in 0..ELEMENTS {
                losses[(e, e)] += DAMAGE_PRIOR.powi(-2);
            }
            let Some(factor) = losses.cholesky() else {
                bail!("the passages say nothing of the elements");
            };
            let across = information.view((0, ELEMENTS), (ELEMENTS, s)).into_owned();
            let gain = factor.solve(&across);
            let c = s - (COEFFICIENTS - ELEMENTS);
            let mut error = unknown.into_owned();
            let mut block = error.view_mut((s - c, s - c), (c, c));
            block += &self.short * drift_m.powi(2);
            let bias = &gain * error * gain.transpose();
            floor += SMatrix::<f64, ELEMENTS, ELEMENTS>::from_fn(|i, j| bias[(i, j)]);
        }
        Ok(floor)
    }
}

/// The RMS change of the rails, m, by which what passages leave unexplained grows by `part`, runs and bridge fitted to it.
fn unseen_m(passages: &[Linear], short: &DMatrix<f64>, part: f64) -> f64 {
    let (mut grows, mut values) = (0.0, 0.0);
    for passage in passages {
        let n = passage.own.information.nrows();
        let (others, c) = (COEFFICIENTS, n - COEFFICIENTS);
        let mut bridge = passage.own.information.view((0, 0), (others, others)).into_owned();
        for i in 0..others {
            bridge[(i, i)] += DAMAGE_PRIOR.powi(-2);
        }
        let across = passage.own.information.view((0, others), (others, c));
        let seen = passage.own.information.view((others, others), (c, c)).into_owned();
        let fitted = bridge
            .cholesky()
            .map(|factor| across.transpose() * factor.solve(&across.into_owned()));
        grows += (fitted.map_or(seen.clone(), |fitted| &seen - fitted) * short).trace();
        values += f64::from(passage.power.values());
    }
    (part * values / grows).sqrt()
}

fn deviations(covariance: &SMatrix<f64, ELEMENTS, ELEMENTS>) -> [f64; ELEMENTS] {
    std::array::from_fn(|e| covariance[(e, e)].max(0.0).sqrt())
}

/// So few that nothing is learnt; with one of the reasons, if there are any.
fn too_few(count: usize, passages: &[Passage], outcomes: &[Outcome]) -> anyhow::Error {
    let reason = (passages.iter().zip(outcomes)).find_map(|(passage, outcome)| match outcome {
        Outcome::LeftOut(reason) if !reason.is_empty() => Some(format!(" ({}: {reason})", passage.name)),
        _ => None,
    });
    anyhow!(
        "only {count} of {} passages are of use, and a track is learnt from {FEWEST} at least, better from sixty{}",
        passages.len(),
        reason.unwrap_or_default()
    )
}

/// Part of what is left of the passages that a step takes, by the linear model.
fn promise(passages: &[Linear], step: &DVector<f64>) -> f64 {
    let (mut gain, mut values) = (0.0, 0.0);
    for passage in passages {
        gain += 2.0 * passage.own.gradient.dot(step) - step.dot(&(&passage.own.information * step));
        values += f64::from(passage.power.values());
    }
    gain / values
}

impl Calibration {
    /// For the logger's memory, with the model of the bridge that it was learnt with.
    ///
    /// # Errors
    /// If the numbers have no room in a blob.
    pub fn to_blob(&self, bridge: &ReducedBridge<f64>) -> Result<Vec<u8>> {
        let coefficients: Vec<f32> = self.coefficients.iter().map(|&c| c as f32).collect();
        let mut buffer = [0; blob::TRACK_BLOB_BYTES];
        Ok(blob::write(&self.learnt, &coefficients, bridge_crc(bridge)?, &mut buffer)?.to_vec())
    }
}

/// Reads a track that was learnt with this model of its bridge.
///
/// # Errors
/// If it cannot be read, or is refused.
pub fn read(path: &Path, bridge: &ReducedBridge<f64>) -> Result<LearntTrack> {
    let name = path.display();
    let bytes = std::fs::read(path).with_context(|| format!("cannot read {name}"))?;
    let mut learnt = UNLEARNT.clone();
    blob::read_into(&bytes, bridge_crc(bridge)?, &mut learnt).with_context(|| name.to_string())?;
    Ok(learnt)
}

/// By what a track knows its bridge.
fn bridge_crc(bridge: &ReducedBridge<f64>) -> Result<u32> {
    Ok(fingerprint(&to_blob(bridge)?))
}

/// The places of what is explained far worse than the rest.
fn outlying(unexplained: &[f64]) -> Vec<usize> {
    let logs: Vec<f64> = unexplained.iter().map(|part| part.ln()).collect();
    let middle = median(&logs);
    let distances: Vec<f64> = logs.iter().map(|log| (log - middle).abs()).collect();
    // Of a Gaussian the median distance is 0.6745 deviations.
    let scatter = (median(&distances) / 0.6745).max(LEAST_SCATTER);
    (0..logs.len())
        .filter(|&i| logs[i] - middle > OUTLYING * scatter)
        .collect()
}

fn median(values: &[f64]) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    let n = sorted.len();
    0.5 * (sorted[(n - 1) / 2] + sorted[n / 2])
}

/// The floor and the part of a channel's noise, by passages' mean squares and what was left of them: the line through them, by least squares
/// of relative errors, neither below zero.
fn noise(pairs: &[[f64; 2]]) -> Unexplained {
    // left / left = 1 = floor / left + part power / left
    let [mut ff, mut fp, mut pp, mut f1, mut p1] = [0.0; 5];
    for [power, left] in pairs.iter().filter(|pair| pair[1] > 0.0) {
        let (f, p) = (1.0 / left, power / left);
        ff += f * f;
        fp += f * p;
        pp += p * p;
        f1 += f;
        p1 += p;
    }
    let determinant = ff * pp - fp * fp;
    let (floor, part) = if determinant > 1e-9 * ff * pp {
        ((f1 * pp - p1 * fp) / determinant, (p1 * ff - f1 * fp) / determinant)
    } else {
        (0.0, p1 / pp)
    };
    let (floor, part) = if floor < 0.0 {
        (0.0, p1 / pp)
    } else if part < 0.0 {
        (f1 / ff, 0.0)
    } else {
        (floor, part)
    };
    Unexplained {
        floor: floor as f32,
        part: part as f32,
    }
}
