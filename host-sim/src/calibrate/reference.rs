//! The reference: what the logger needs of a calibration, and how far it can be wrong.
//!
//! Each later passage is explained with the profile as it was learnt, and what is wrong with that is wrong in all of them. With `A` the
//! information of all passages of a kind of train, losses `d` and what else is shared `s`,
//!
//! ```text
//! G = A_dd^-1 A_ds            what an error of the shared unknowns does to the losses
//! B = G (Cov(s) + D) G^T      summed over the kinds of train: no mixture of them has more
//! ```
//!
//! is the variance that no number of passages averages away. `D` is what the rails may change between this and the next calibration
//! without its being seen: waves of the spectrum's shape below [`SHORT_M`], of an RMS that is chosen ([`DRIFT_M`](super::DRIFT_M)). It is most
//! of `B`: sixty passages of sixteen cars leave 0.1 to 0.3 points of an element of girder50 open, while a change of the rails by a
//! hundredth of a millimetre may pass for 1 to 5.

use anyhow::{Result, bail};
use nalgebra::{DMatrix, SMatrix};
use spanwatch::capacity::{CHANNELS, ELEMENTS};
use spanwatch::track::learnt::{LearntTrack, Unexplained, speed_band};
use spanwatch::track::profile::Knots;
use spanwatch::wire::message::TrainKind;

use super::joint::{Candidate, DAMAGE_PRIOR, Joint, Solved};
use super::linear::{COEFFICIENTS, Linear};
use super::{Options, fine_knots};
use crate::batch::each;
use crate::track::Spectrum;
use crate::track::prior::covariance_of_waves;

/// Standard deviation that each loss has at least: less than any that matters, and the covariance keeps its factor.
const LEAST_FLOOR: f64 = 1e-4;
/// Waves in which the rails drift unseen, m: longer ones move wheels too slowly to matter.
const SHORT_M: f64 = 20.0;

/// Whether the B-spline lies where the fine knots are.
fn is_on_bridge(knots: &Knots<f64>, k: usize) -> bool {
    let (Some(fine), Some([from, to])) = (fine_knots(knots), knots.support(k)) else {
        return false;
    };
    // Half a span for rounding.
    let [first, last] = [-0.5, f64::from(fine.spans) + 0.5].map(|spans| fine.from_m + spans * fine.spacing_m);
    first < from && to < last
}

/// Covariance of the coefficients on rails of the spectrum's waves below [`SHORT_M`], 1 m RMS on the bridge.
pub(super) fn short_waves(knots: &Knots<f64>) -> DMatrix<f64> {
    let mut short = covariance_of_waves(Spectrum::Fra6, [Spectrum::Fra6.waves_m()[0], SHORT_M], knots);
    // From the beginning of the bridge to its end; coefficients are heights for waves of many spans.
    let fine: Vec<f64> = (0..knots.coefficients())
        .filter(|&k| is_on_bridge(knots, k))
        .map(|k| short[(k, k)])
        .collect();
    short /= fine.iter().sum::<f64>() / fine.len().max(1) as f64;
    short
}

/// What damage is measured against from now on.
pub(super) struct Reference {
    /// For the logger.
    pub(super) learnt: LearntTrack,
    /// Standard deviation of each element's loss that no number of later passages goes below.
    pub(super) floor: [f64; ELEMENTS],
    /// What each passage leaves unexplained when it is monitored with that.
    pub(super) unexplained: Vec<f32>,
}

impl Joint {
    /// The reference that the passages make.
    pub(super) fn reference(
        &self,
        candidates: &[(usize, Candidate<'_>)],
        solved: &Solved,
        options: &Options,
    ) -> Result<Reference> {
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
        // In the logger's unknowns, the flexibilities x = 1 / (1 - d) - 1: dx = dd / (1 - d)^2.
        let scale = self.shared.damage.map(|loss| (1.0 - loss).powi(-2));
        let flexibility = SMatrix::<f64, ELEMENTS, ELEMENTS>::from_fn(|i, j| scale[i] * floor[(i, j)] * scale[j]);
        let Some(factor) = flexibility.cholesky() else {
            bail!("the reference is no covariance: the passages contradict themselves");
        };
        let lower = factor.l();
        learnt.spread = SMatrix::from_fn(|i, j| lower[(i, j)] as f32);
        Ok(Reference {
            learnt,
            floor: deviations(&floor),
            unexplained: monitored.iter().map(|found| found.unexplained).collect(),
        })
    }

    /// `B`: the covariance of the losses that what is left unknown of the shared unknowns makes, their `covariance`, and a drift of the
    /// rails of this RMS.
    pub(super) fn floor(
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
pub(super) fn unseen_m(passages: &[Linear], short: &DMatrix<f64>, part: f64) -> f64 {
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

pub(super) fn deviations(covariance: &SMatrix<f64, ELEMENTS, ELEMENTS>) -> [f64; ELEMENTS] {
    std::array::from_fn(|e| covariance[(e, e)].max(0.0).sqrt())
}

/// The floor and the part of a channel's noise, by passages' mean squares and what was left of them: the line through them, by least squares
/// of relative errors, neither below zero.
pub(super) fn noise(pairs: &[[f64; 2]]) -> Unexplained {
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
