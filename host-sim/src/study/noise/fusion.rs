//! Thirty passages of one bridge put together: the evidence of each is what it says of the damage near its own answer.
//!
//! ```text
//! passage k, answer x_k:    I_k, s_k: information and score there, the run marginalised    (bound)
//! together:                 (prior + sum_k I_k) x = prior mean + sum_k (I_k x_k + s_k),    0 <= damage <= 0.7
//! ```
//!
//! The score makes up for what the answer's own bounds have cut off: answers that are kept from falling below 0 would
//! have a mean above 0. The stiffness of the whole bridge is one unknown of the bridge, not one of each passage, so that its prior
//! counts once.
//!
//! [`fuse`] is the one place where passages are added; a filter of the core's own, that keeps what it has added and forgets, is put
//! in there.

use anyhow::{Result, bail};
use nalgebra::{DMatrix, SMatrix, SVector};
use rand_core::SeedableRng;
use rand_xoshiro::Xoshiro256PlusPlus;
use spanwatch::bridge::{Damage, MAX_DAMAGE};
use spanwatch::capacity::ELEMENTS;
use spanwatch::wire::message::{Ranges, TrainKind};

use super::bound::{Explaining, Linearised, UNKNOWNS, bound, with_prior};
use super::campaign::{BASIN, Spread, excess, mean};
use super::explain::{identify, observe};
use super::field::Field;
use super::truth::{Drawn, Purpose, Setting, UNKNOWN};
use super::{Nuisance, Point};
use crate::batch;
use crate::evaluate::Case;
use crate::model::BridgeFrame;
use crate::model::reduce::reduce;
use crate::random::{gaussian, unit};

/// Passages that are put together.
pub const PASSAGES: usize = 30;
/// What belongs to the bridge: the damage of each element, and the stiffness of the whole.
const KEPT: usize = ELEMENTS + 1;
/// Slowest and fastest train of mixed traffic, km/h.
const SPEEDS_KMH: [f64; 2] = [60.0, 270.0];
/// The trains of mixed traffic, one after the other.
const TRAINS: [(TrainKind, usize); 3] = [
    (TrainKind::Inspection2Dof, 1),
    (TrainKind::Inspection2Dof, 16),
    (TrainKind::Shinkansen3d, 16),
];
/// Seed of the timetable of mixed traffic.
const TIMETABLE: u64 = 30;
/// Sweeps over the unknowns that settle the bounded solution.
const SWEEPS: usize = 20_000;

/// What rolls over the bridge.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Traffic {
    /// The case's own train, each time.
    Same,
    /// Three trains in turn at speeds by chance.
    Mixed,
}

impl Traffic {
    /// As tables call it.
    pub fn name(self) -> &'static str {
        match self {
            Self::Same => "same",
            Self::Mixed => "mixed",
        }
    }

    /// The passages of a case's bridge.
    pub fn passages(self, case: Case) -> Vec<Case> {
        let mut rng = Xoshiro256PlusPlus::seed_from_u64(TIMETABLE);
        (0..PASSAGES)
            .map(|k| match self {
                Self::Same => case,
                Self::Mixed => {
                    let (train, cars) = TRAINS[k % TRAINS.len()];
                    let [slow, fast] = SPEEDS_KMH;
                    Case {
                        train,
                        cars,
                        speed_kmh: slow + (fast - slow) * unit(&mut rng),
                        ..case
                    }
                }
            })
            .collect()
    }
}

/// What one passage says of the bridge.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Evidence {
    /// Information about damage and stiffness.
    pub information: SMatrix<f64, KEPT, KEPT>,
    /// That information times the damage and stiffness that it points to.
    pub vector: SVector<f64, KEPT>,
}

/// What several passages say together.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Fused {
    /// Damage of each element.
    pub damage: Damage<f64>,
    /// Its standard deviation.
    pub std: Damage<f64>,
}

/// Adds what passages say. `stiffness` is the standard deviation of the whole bridge's, as known before; 0: it is the model's.
pub fn fuse(passages: &[Evidence], stiffness: f64) -> Fused {
    let mut information = SMatrix::<f64, KEPT, KEPT>::zeros();
    let mut vector = SVector::<f64, KEPT>::zeros();
    for passage in passages {
        information += passage.information;
        vector += passage.vector;
    }
    if stiffness > 0.0 {
        information[(ELEMENTS, ELEMENTS)] += stiffness.powi(-2);
        vector[ELEMENTS] += stiffness.powi(-2);
    } else {
        // Nothing is coupled to a stiffness that is held.
        information[(ELEMENTS, ELEMENTS)] = 1.0;
        vector[ELEMENTS] = 1.0;
    }
    let best = bounded_minimum(&information, &vector);
    let mut wide = SMatrix::<f64, UNKNOWNS, UNKNOWNS>::zeros();
    wide.fixed_view_mut::<KEPT, KEPT>(0, 0).copy_from(&information);
    Fused {
        damage: std::array::from_fn(|e| best[e]),
        std: bound(&wide),
    }
}

/// The smallest `x^T A x / 2 - b^T x` with each damage within its bounds: one unknown after the other, until none moves.
fn bounded_minimum(a: &SMatrix<f64, KEPT, KEPT>, b: &SVector<f64, KEPT>) -> SVector<f64, KEPT> {
    const STILL: f64 = 1e-12;
    let mut x = SVector::<f64, KEPT>::zeros();
    x[ELEMENTS] = 1.0;
    for _ in 0..SWEEPS {
        let mut moved = 0.0_f64;
        for e in 0..KEPT {
            let rest = b[e] - a.row(e).dot(&x.transpose()) + a[(e, e)] * x[e];
            let mut next = rest / a[(e, e)].max(f64::MIN_POSITIVE);
            if e < ELEMENTS {
                next = next.clamp(0.0, MAX_DAMAGE);
            }
            moved = moved.max((next - x[e]).abs());
            x[e] = next;
        }
        if moved < STILL {
            break;
        }
    }
    x
}

/// What a passage says of the bridge near `at`, the run marginalised, which is drawn towards what was expected of it.
fn evidence(linearised: &Linearised, at: &Point, drawn: &Drawn) -> Evidence {
    let mut information = linearised.information;
    let run_only = Ranges {
        stiffness: 0.0,
        ..drawn.ranges
    };
    with_prior(&mut information, &run_only);
    let mut score = linearised.score;
    let (expected, found) = (&drawn.guess, &at.run);
    let pulls = [
        (drawn.ranges.speed, expected.speed_mps / found.speed_mps - 1.0),
        (drawn.ranges.entry_s, expected.entry_time_s - found.entry_time_s),
        (drawn.ranges.load, expected.load_factor / found.load_factor - 1.0),
    ];
    for (k, (range, off)) in pulls.into_iter().enumerate() {
        if range > 0.0 {
            score[KEPT + k] += off / f64::from(range).powi(2);
        }
    }
    let run: Vec<usize> = (KEPT..UNKNOWNS).filter(|&u| information[(u, u)] > 0.0).collect();
    let inner = DMatrix::from_fn(run.len(), run.len(), |i, j| information[(run[i], run[j])]);
    let across = DMatrix::from_fn(KEPT, run.len(), |i, j| information[(i, run[j])]);
    let run_score = DMatrix::from_fn(run.len(), 1, |i, _| score[run[i]]);
    let (mut kept, mut kept_score) = (
        information.fixed_view::<KEPT, KEPT>(0, 0).into_owned(),
        score.fixed_rows::<KEPT>(0).into_owned(),
    );
    if let Some(factor) = inner.cholesky() {
        kept -= &across * factor.solve(&across.transpose());
        kept_score -= (&across * factor.solve(&run_score)).column(0);
    }
    let mut place = SVector::<f64, KEPT>::zeros();
    place.rows_mut(0, ELEMENTS).copy_from_slice(&at.damage);
    place[ELEMENTS] = at.stiffness;
    Evidence {
        information: kept,
        vector: kept * place + kept_score,
    }
}

/// Thirty passages put together, many times.
#[derive(Debug, Clone, PartialEq)]
pub struct Row {
    /// The bridge's case, its sensors, noise and what is known.
    pub setting: Setting,
    /// What rolls.
    pub traffic: Traffic,
    /// The bound of the damage from all passages together.
    pub bound: Damage<f64>,
    /// One a seed.
    pub fused: Vec<Fused>,
    /// Passages, of all seeds, whose answer explains them worse than the truth does by [`BASIN`]: what they say is wrong, and spoils
    /// what they are put together with.
    pub wrong: usize,
}

impl Row {
    /// RMSE of each element.
    pub fn rmse(&self) -> Damage<f64> {
        let truth = self.setting.draw(0).truth.damage;
        std::array::from_fn(|e| mean(self.fused.iter().map(|fused| (fused.damage[e] - truth[e]).powi(2))).sqrt())
    }

    /// RMSE over bound: of all elements together, and of the worst.
    pub fn ratio(&self) -> (f64, f64) {
        let rmse = self.rmse();
        let each = (0..ELEMENTS).map(|e| rmse[e] / self.bound[e]);
        (
            Spread::of(&rmse).rms / Spread::of(&self.bound).rms,
            each.fold(0.0, f64::max),
        )
    }

    /// Part of the damages that lie within 1.96 standard deviations.
    pub fn coverage(&self) -> f64 {
        let truth = self.setting.draw(0).truth.damage;
        mean((self.fused.iter()).flat_map(|fused| {
            (0..ELEMENTS).map(move |e| f64::from((fused.damage[e] - truth[e]).abs() <= 1.96 * fused.std[e]))
        }))
    }
}

/// Runs settings with each traffic, `seeds` bridges of thirty passages each, on all processors. `done` is called after every passage.
///
/// # Errors
/// If there is nothing to do, or a passage cannot be solved.
pub fn run(
    bridge: &BridgeFrame,
    settings: &[Setting],
    traffics: &[Traffic],
    seeds: u32,
    done: &(dyn Fn() + Sync),
) -> Result<Vec<Row>> {
    if settings.is_empty() || traffics.is_empty() || seeds == 0 {
        bail!("nothing to evaluate: give at least one case, noise, set of sensors and seed");
    }
    let model = reduce(bridge)?;
    let logger = model.cast::<f32>();
    let mut rows = vec![];
    for setting in settings {
        let stiffness = match setting.nuisance {
            Nuisance::Known => 0.0,
            Nuisance::Unknown => f64::from(UNKNOWN.stiffness),
        };
        for &traffic in traffics {
            let passages: Vec<Setting> = (traffic.passages(setting.case).into_iter())
                .map(|case| Setting {
                    case,
                    field: Field::NONE,
                    ..setting.clone()
                })
                .collect();
            // Equal passages share their bound.
            let different = if traffic == Traffic::Same {
                &passages[..1]
            } else {
                &passages
            };
            let possible = batch::each(different, |passage| -> Result<Evidence> {
                let ideal = Setting {
                    nuisance: Nuisance::Known,
                    ..passage.clone()
                };
                let nominal = Drawn {
                    ranges: passage.draw(0).ranges,
                    ..ideal.draw(0)
                };
                let clean = ideal.clean(bridge, &nominal)?;
                let nothing = vec![0.0; clean[0].len() * clean.len()];
                let explaining = Explaining::new(&model, passage)?;
                let linearised =
                    explaining.linearise(&nominal.truth, &nothing, &passage.sigma(&clean), &nominal.ranges)?;
                Ok(evidence(&linearised, &nominal.truth, &nominal))
            })
            .into_iter()
            .collect::<Result<Vec<_>>>()?;
            let all: Vec<Evidence> = possible.iter().cycle().take(PASSAGES).copied().collect();
            let jobs: Vec<(usize, u64)> = (1..=u64::from(seeds))
                .flat_map(|seed| (0..PASSAGES).map(move |k| (k, seed)))
                .collect();
            let found = batch::each(&jobs, |&(k, seed)| -> Result<(Evidence, bool)> {
                let passage = &passages[k];
                let mut drawn = passage.draw((seed << 8) + k as u64);
                if setting.nuisance == Nuisance::Unknown {
                    // One bridge: what its stiffness is does not change from train to train.
                    let mut rng = setting.generator(seed, Purpose::Stiffness);
                    drawn.truth.stiffness = 1.0 + stiffness * gaussian(&mut rng);
                }
                let recorded = passage.record(&passage.clean(bridge, &drawn)?, drawn.seed);
                let answer = identify(&observe(&logger, passage, &drawn, &recorded)?, drawn.seed)?;
                let explaining = Explaining::new(&model, passage)?;
                let linearised =
                    explaining.linearise(&answer.found, &recorded.samples, &recorded.sigma, &drawn.ranges)?;
                let wrong = excess(&explaining, &drawn, &answer, &recorded)? > BASIN;
                done();
                Ok((evidence(&linearised, &answer.found, &drawn), wrong))
            })
            .into_iter()
            .collect::<Result<Vec<_>>>()?;
            rows.push(Row {
                setting: setting.clone(),
                traffic,
                bound: fuse(&all, stiffness).std,
                wrong: found.iter().filter(|(_, wrong)| *wrong).count(),
                fused: (found.chunks(PASSAGES))
                    .map(|passages| passages.iter().map(|(said, _)| *said).collect::<Vec<_>>())
                    .map(|passages| fuse(&passages, stiffness))
                    .collect(),
            });
        }
    }
    Ok(rows)
}
