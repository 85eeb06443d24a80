//! What all passages say together: Gauss-Newton for the profile and the bridge, with the prior's own level.
//!
//! ```text
//! minimise  sum_p |r_p|^2_W + sum_p own_p^T P own_p + c^T C^-1 c / level + priors        over shared and own unknowns (linear.rs)
//! level = argmax  sum_i ln(l / (s_i + l)) + b_i^2 / (s_i + l),  l = 1 / level               the prior's own level
//! ```
//!
//! `C` is the covariance that a standard spectrum gives the profile's coefficients; how rough this track is beside that is the level of
//! the largest likelihood, the coefficients marginalised: with `C = L L^T`, `s_i` and `b_i` are the eigenvalues of `L^T S L`, `S` what the
//! passages say of the coefficients, and their right-hand side in its eigenvectors. A Gauss-Newton step is one linearisation of each
//! passage and one solution for what they share.

use anyhow::{Context, Result, bail};
use nalgebra::{DMatrix, DVector, SymmetricEigen};
use spanwatch::capacity::ELEMENTS;
use spanwatch::track::profile::Knots;

use super::linear::{COEFFICIENTS, Linear, Passing, SHARED_DAMPING, SHARED_STIFFNESS, Shared};
use super::reference::short_waves;
use super::{Options, Passage};
use crate::batch::each;
use crate::track::Spectrum;
use crate::track::prior::covariance;

/// Standard deviations, beforehand, of the logarithms of stiffness and damping: a model may be off by a tenth, and of the damping only
/// its size is known.
const STIFFNESS_PRIOR: f64 = 0.1;
const DAMPING_PRIOR: f64 = 0.7;
/// The same where both were learnt before: what a season may do to them.
const STIFFNESS_SINCE: f64 = 0.003;
const DAMPING_SINCE: f64 = 0.1;
/// That of an element's loss, where the bridge need not be healthy.
pub(super) const DAMAGE_PRIOR: f64 = 0.3;
/// Gauss-Newton steps at most; ...
pub(super) const MOST_STEPS: usize = 12;
/// ... they end before a step that would take less than this part of what is left.
const SETTLED: f64 = 1e-3;
/// What is wrong where a matrix has no factor.
const CONTRADICTION: &str = "the passages contradict themselves; check trains, speeds and sensors";
/// Levels that are believed: beside FRA class 6 the worst standard class has 36.
const LEVELS: [f64; 2] = [0.01, 100.0];
/// The track is taken for one of the spectrum until a step takes less than this part of what is left: a level that is sought while the
/// runs are still wrong makes waves that lead them astray.
const NEAR: f64 = 0.05;
/// The level has settled when it changes by no more than a tenth.
const LEVEL_SETTLED: f64 = 0.1;
/// They are tried a twentieth apart.
const NEXT_LEVEL: f64 = 1.05;

/// What is known of a passage while it is learnt from.
pub(super) struct Candidate<'a> {
    pub(super) passage: &'a Passage,
    pub(super) passing: Passing,
    pub(super) smooth: f32,
}

/// The joint solution.
pub(super) struct Joint {
    pub(super) knots: Knots<f32>,
    /// Lower factor of the prior covariance of the coefficients at level 1, ...
    lower: DMatrix<f64>,
    /// ... and its inverse.
    precision: DMatrix<f64>,
    /// The same of waves below [`SHORT_M`], 1 m RMS on the bridge.
    pub(super) short: DMatrix<f64>,
    pub(super) level: f64,
    pub(super) healthy: bool,
    /// Stiffness and damping beforehand: logarithm and its standard deviation.
    pub(super) bridge: [[f64; 2]; 2],
    pub(super) shared: Shared,
}

/// What a solution leaves.
pub(super) struct Solved {
    pub(super) covariance: DMatrix<f64>,
    pub(super) passages: Vec<Linear>,
    pub(super) unexplained: Vec<f64>,
    pub(super) steps: usize,
    pub(super) settled: bool,
}

impl Joint {
    pub(super) fn new(knots: &Knots<f64>, options: &Options) -> Result<Self> {
        let short = short_waves(knots);
        let factor = covariance(Spectrum::Fra6, knots).cholesky();
        let factor = factor.context("a spectrum that these knots can hold")?;
        let Some(rounded) = knots.cast() else {
            bail!("the profile's knots do not join");
        };
        Ok(Self {
            knots: rounded,
            lower: factor.l(),
            precision: factor.inverse(),
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
    pub(super) fn solve(
        &mut self,
        candidates: &mut [(usize, Candidate<'_>)],
        progress: &(dyn Fn(usize) + Sync),
    ) -> Result<Solved> {
        let (mut steps, mut near) = (0, false);
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
            let before = self.level;
            if near {
                self.level = self.likeliest(&passages)?;
            }
            let (step, covariance) = self.step(&passages, 1.0)?;
            let promised = promise(&passages, &step);
            let settled = near && promised < SETTLED && (self.level / before).ln().abs() < LEVEL_SETTLED;
            near |= promised < NEAR;
            if steps == MOST_STEPS || settled {
                return Ok(Solved {
                    covariance,
                    passages,
                    unexplained,
                    steps,
                    settled,
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

    /// The step to the minimum of the linear model, and the covariance about it, if each passage counts so many `times`.
    pub(super) fn step(&self, passages: &[Linear], times: f64) -> Result<(DVector<f64>, DMatrix<f64>)> {
        let (mut information, mut gradient) = self.equations(passages, times);
        let n = self.shared.coefficients.len();
        let precision = &self.precision / self.level;
        let mut tail = gradient.rows_mut(COEFFICIENTS, n);
        tail -= &precision * DVector::from_row_slice(&self.shared.coefficients);
        let mut block = information.view_mut((COEFFICIENTS, COEFFICIENTS), (n, n));
        block += precision;
        let factor = information.cholesky().context(CONTRADICTION)?;
        let step = factor.solve(&gradient);
        let mut covariance = factor.inverse();
        if self.healthy {
            for e in 0..ELEMENTS {
                covariance[(e, e)] = 0.0;
            }
        }
        Ok((step, covariance))
    }

    /// What passages that count so many `times` say of what they share, with what is known of the bridge beforehand.
    fn equations(&self, passages: &[Linear], times: f64) -> (DMatrix<f64>, DVector<f64>) {
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
        if self.healthy {
            for e in 0..ELEMENTS {
                information.row_mut(e).fill(0.0);
                information.column_mut(e).fill(0.0);
                information[(e, e)] = 1.0;
                gradient[e] = 0.0;
            }
        }
        (information, gradient)
    }

    /// The level of the prior by which the passages are likeliest.
    fn likeliest(&self, passages: &[Linear]) -> Result<f64> {
        let (information, gradient) = self.equations(passages, 1.0);
        let coefficients = DVector::from_row_slice(&self.shared.coefficients);
        let n = coefficients.len();
        let others = information.view((0, 0), (COEFFICIENTS, COEFFICIENTS)).into_owned();
        let across = information.view((0, COEFFICIENTS), (COEFFICIENTS, n)).into_owned();
        let factor = others.cholesky().context(CONTRADICTION)?;
        let said = information.view((COEFFICIENTS, COEFFICIENTS), (n, n)) - across.tr_mul(&factor.solve(&across));
        let pull = gradient.rows(COEFFICIENTS, n)
            - across.tr_mul(&factor.solve(&gradient.rows(0, COEFFICIENTS).into_owned()))
            + &said * coefficients;
        let eigen = SymmetricEigen::new(self.lower.tr_mul(&said) * &self.lower);
        let pulls = eigen.eigenvectors.tr_mul(&self.lower.tr_mul(&pull));
        let likelihood = |level: f64| {
            let l = level.recip();
            let each = eigen.eigenvalues.iter().zip(&pulls);
            each.map(|(s, b)| {
                let both = s.max(0.0) + l;
                (l / both).ln() + b * b / both
            })
            .sum::<f64>()
        };
        let levels = std::iter::successors(Some(LEVELS[0]), |level| Some(level * NEXT_LEVEL));
        let best = levels
            .take_while(|&level| level <= LEVELS[1])
            .map(|level| (level, likelihood(level)))
            .max_by(|a, b| a.1.total_cmp(&b.1));
        best.map(|(level, _)| level).context("no level")
    }
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
