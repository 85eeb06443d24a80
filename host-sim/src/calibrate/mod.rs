//! Learning the track from healthy passages, and the bridge under it: what damage is measured against afterwards.
//!
//! | file | does |
//! |---|---|
//! | [`linear`] | one passage, linearised: what it says of everything that all share |
//! | `joint` | what they all say together: profile, stiffness, damping |
//! | `reference` | what the logger needs of that, and how far it can be wrong |
//! | [`known`] | how well the profile is known where |
//!
//! **Where the runs begin.** Each passage's run is first identified as if the track were smooth and the bridge whole: that fits the
//! passage to a fraction of a period, which is all that is asked of it.
//!
//! **What is left out.** A passage that is explained far worse than the rest is none of the same train, track or sensors. It is
//! left out, with the reason, and the others are solved again.

mod joint;
pub mod known;
pub(crate) mod linear;
mod recorded;
mod reference;

use std::path::Path;

use anyhow::{Context, Result, anyhow, bail};
use nalgebra::DMatrix;
use spanwatch::bridge::ReducedBridge;
use spanwatch::capacity::{CHANNELS, ELEMENTS};
use spanwatch::identify::Identification;
use spanwatch::identify::hybrid::UNEXPLAINED;
use spanwatch::identify::objective::Squares;
use spanwatch::interaction::{Direction, Run};
use spanwatch::track::blob;
use spanwatch::track::learnt::{LearntTrack, UNLEARNT, Unexplained};
use spanwatch::track::profile::{Knots, Stretch};
use spanwatch::track::watch::unseen;
use spanwatch::wire::fingerprint;
use spanwatch::wire::message::TrainKind;

use crate::batch::each;
use crate::identification::Observed;
use crate::model::to_blob;
use joint::{Candidate, Joint, MOST_STEPS};
use linear::{COEFFICIENTS, Passing, SHARED_DAMPING, SHARED_STIFFNESS};
use reference::{Reference, deviations, noise, unseen_m};

/// A passage is left out if what it leaves unexplained is so many robust deviations above the others' median.
const OUTLYING: f64 = 6.0;
/// The robust deviation is at least this: a passage a fifth worse than the rest is none the worse for it.
const LEAST_SCATTER: f64 = 0.05;
/// What the rails are taken to change unseen, RMS, m: about what a busy line wears in a month, if it wears unevenly.
pub const DRIFT_M: f64 = 5e-6;
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
pub const FINE_M: f64 = 0.385;
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

/// The stretch of fine knots.
pub fn fine_knots(knots: &Knots<f64>) -> Option<&Stretch<f64>> {
    knots.stretches().get(1)
}

/// Span on the bridge where it is longer than it should be, m: the bridge is too long for the logger's memory.
pub fn coarse_m(knots: &Knots<f64>) -> Option<f64> {
    let span_m = fine_knots(knots)?.spacing_m;
    (span_m > FINE_M).then_some(span_m)
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
    /// What the floor would be if the rails changed by that.
    pub floor_unseen: [f64; ELEMENTS],
    /// Of each passage, in the order in which they were given.
    pub passages: Vec<Outcome>,
    /// Gauss-Newton steps that it took, those to learn that passages must be left out among them.
    pub steps: usize,
    /// Whether the last of them changed hardly anything.
    pub settled: bool,
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
        match alone(passage, &passages[..i]).and_then(|()| begin(passage, found)) {
            Ok(candidate) => candidates.push((i, candidate)),
            Err(reason) => outcomes[i] = Outcome::LeftOut(reason),
        }
    }
    progress(1, turns);
    let mut joint = Joint::new(&knots, options)?;
    let mut steps = 0;
    let solved = loop {
        if candidates.len() < FEWEST {
            return Err(too_few(candidates.len(), passages, &outcomes));
        }
        let solved = joint.solve(&mut candidates, &|done| progress(1 + done, turns))?;
        steps += solved.steps;
        // One that is far off hides others behind it: asked again until there is none.
        let squares: Vec<[Squares; 2]> = (solved.passages.iter())
            .map(|passage| [passage.power, passage.residuals])
            .collect();
        let outlying = outlying(&squares);
        if outlying.is_empty() {
            let left = median(&solved.unexplained);
            if left > UNEXPLAINED.into() {
                bail!(
                    "the passages contradict each other: half of them leave more than {:.0} % of their power unexplained on any track; check \
                     train, cars, speed and sensors of each, and that all are of the same rails and bridge",
                    100.0 * left
                );
            }
            break solved;
        }
        for &c in outlying.iter().rev() {
            let (i, _) = candidates.remove(c);
            outcomes[i] = Outcome::LeftOut(format!(
                "{:.1} % of its power is unexplained, of the others' {:.1} % (median), and more than theirs lets expect of it: another train, a wrong speed, a sensor at fault, or other rails or another bridge by then",
                100.0 * solved.unexplained[c],
                100.0 * median(&solved.unexplained)
            ));
        }
    };
    progress(turns - 1, turns);

    let Reference {
        learnt,
        floor,
        unexplained,
    } = joint.reference(&candidates, &solved, options)?;
    for ((i, candidate), unexplained) in candidates.iter().zip(unexplained) {
        outcomes[*i] = Outcome::Used {
            run: candidate.passing.run,
            unexplained: [candidate.smooth, unexplained],
        };
    }
    progress(turns, turns);
    let unseen_m = unseen_m(&solved.passages, &joint.short, unseen(&learnt).into());
    let floor_of = |covariance: &DMatrix<f64>, drift_m: f64| {
        let floor = joint.floor(&candidates, &solved, covariance, drift_m)?;
        Ok::<_, anyhow::Error>(deviations(&floor))
    };
    let floor_learnt = floor_of(&solved.covariance, 0.0)?;
    let floor_unseen = floor_of(&solved.covariance, unseen_m)?;
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
        floor_unseen,
        floors_twice,
        passages: outcomes,
        steps,
        settled: solved.settled,
        knots,
    })
}

/// Refuses a passage that was there before: it would count twice.
fn alone(passage: &Passage, before: &[Passage]) -> Result<(), String> {
    let samples = &passage.observed.samples;
    match before.iter().find(|other| other.observed.samples == *samples) {
        Some(other) => Err(format!(
            "it is the same passage as {}, and would count twice",
            other.name
        )),
        None => Ok(()),
    }
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

impl Calibration {
    /// For the logger's memory, with the model of the bridge that it was learnt with.
    ///
    /// # Errors
    /// If the numbers have no room in a blob, or no logger would believe them.
    pub fn to_blob(&self, bridge: &ReducedBridge<f64>) -> Result<Vec<u8>> {
        let coefficients: Vec<f32> = self.coefficients.iter().map(|&c| c as f32).collect();
        let mut buffer = [0; blob::TRACK_BLOB_BYTES];
        let crc = bridge_crc(bridge)?;
        let bytes = blob::write(&self.learnt, &coefficients, crc, &mut buffer)?.to_vec();
        // What the logger would refuse is not written.
        blob::read_into(&bytes, crc, &mut UNLEARNT.clone()).with_context(|| {
            let highest_m = coefficients.iter().fold(0.0_f32, |most, height| most.max(height.abs()));
            format!(
                "these passages teach nothing that a logger would take: stiffness {:.3} and damping {:.3} of the model's, rails of {:.1} mm at \
                 most, {:.3} of scatter from passage to passage",
                self.learnt.stiffness,
                self.learnt.damping,
                1e3 * highest_m,
                self.learnt.scatter
            )
        })?;
        Ok(bytes)
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

/// Reads a track whatever its bridge is, and by what it knows that; none if the file is no learnt track.
///
/// # Errors
/// If it cannot be read, or is refused.
pub fn read_of_any_bridge(path: &Path) -> Result<Option<(LearntTrack, u32)>> {
    let name = path.display();
    let bytes = std::fs::read(path).with_context(|| format!("cannot read {name}"))?;
    let Some(crc) = blob::bridge_of(&bytes) else {
        return Ok(None);
    };
    let mut learnt = UNLEARNT.clone();
    blob::read_into(&bytes, crc, &mut learnt).with_context(|| name.to_string())?;
    Ok(Some((learnt, crc)))
}

/// By what a track knows its bridge.
pub fn bridge_crc(bridge: &ReducedBridge<f64>) -> Result<u32> {
    Ok(fingerprint(&to_blob(bridge)?))
}

/// The places of what is explained far worse than the rest lets expect of passages as strong as these: a sensor's own noise is the same in
/// all of them. Of each passage: what was recorded, and what is left of it.
fn outlying(passages: &[[Squares; 2]]) -> Vec<usize> {
    let squares = (0..CHANNELS).map(|c| -> Vec<[f64; 2]> {
        (passages.iter())
            .map(|both| both.map(|squares| squares.mean_of(c).into()))
            .collect()
    });
    let channels: Vec<Vec<[f64; 2]>> = squares.filter(|of| of.iter().any(|[power, _]| *power > 0.0)).collect();
    let expected: Vec<Unexplained> = channels.iter().map(|of| noise(of)).collect();
    let logs: Vec<f64> = (0..passages.len())
        .map(|i| {
            let ratio = |(of, expected): (&Vec<[f64; 2]>, &Unexplained)| {
                let [power, left] = of[i];
                (left / (f64::from(expected.floor) + f64::from(expected.part) * power)).ln()
            };
            channels.iter().zip(&expected).map(ratio).sum::<f64>() / channels.len() as f64
        })
        .collect();
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

#[cfg(test)]
mod tests {
    use rand_core::SeedableRng;
    use rand_xoshiro::Xoshiro256PlusPlus;

    use super::*;
    use crate::random::{gaussian, unit};

    /// Passages of very different strength, by three sensors of constant noise and a model that is a little wrong.
    fn passages(odd: &[(usize, f32)]) -> Vec<[Squares; 2]> {
        let mut rng = Xoshiro256PlusPlus::seed_from_u64(1);
        let mut all: Vec<[Squares; 2]> = (0..20)
            .map(|_| {
                let power = 10.0_f64.powf(3.0 * unit(&mut rng));
                let left = (1e-2 + 1e-4 * power) * (1.0 + 0.03 * gaussian(&mut rng));
                [power, left].map(|mean| Squares {
                    sum: [1800.0 * mean as f32; CHANNELS],
                    count: [1800.0; CHANNELS],
                })
            })
            .collect();
        for &(i, times) in odd {
            all[i][1].sum = all[i][1].sum.map(|sum| times * sum);
        }
        all
    }

    #[test]
    fn a_weak_passage_is_none_the_worse_for_the_sensors_noise_and_one_that_is_explained_worse_is_left_out() {
        let none: [usize; 0] = [];
        assert_eq!(outlying(&passages(&[])), none);
        assert_eq!(outlying(&passages(&[(3, 1.1)])), none);
        assert_eq!(outlying(&passages(&[(3, 2.0), (17, 20.0)])), [3, 17]);
    }
}
