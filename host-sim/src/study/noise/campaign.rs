//! Many identifications of each setting, on all processors, and what they amount to.
//!
//! What is counted, in a row of `N` seeds (`d` found, `t` true damage of an element, `b` its bound):
//!
//! - **RMSE** of an element `sqrt(mean (d - t)^2)` over the seeds; the row's over seeds and elements.
//! - **ratio** of the RMSE to the bound, both as root mean squares over the elements whose bound is below [`JUDGED`].
//! - **coverage**: part of the 95 % intervals that hold the true damage, over seeds and elements.
//! - **excess**: by how much the answer's sum of squares (in variances of the noise) is above that of the truth. The least-squares
//!   answer lies below the truth: by 1 for each unknown, on average. More than [`BASIN`] above it is not noise: an answer five standard
//!   deviations worse than one that the search could have given. It is then *in a wrong basin* if an element is more than [`FAR`]
//!   bounds off, else *short* of the right one's bottom. *Rivals* are as far off, but explain the recording as well as the truth
//!   does: no search can tell them from it. Where the model does not have all of the truth, rivals are what that costs.
//! - **false alarms**: identifications that call an element damaged beyond doubt which is whole; **missed**: damaged elements
//!   that are not called so.

use std::time::Instant;

use anyhow::{Result, bail};
use spanwatch::bridge::Damage;
use spanwatch::capacity::ELEMENTS;

use super::bound::{Explaining, bound_of};
use super::explain::{Answer, identify, observe};
use super::field::Field;
use super::truth::{Drawn, Recorded, Setting};
use super::{Nuisance, Point};
use crate::batch;
use crate::evaluate::{Case, median_and_worst};
use crate::model::BridgeFrame;
use crate::model::reduce::reduce;

/// Bounds below this are held against estimates: above it they are hardly better than saying nothing.
pub const JUDGED: f64 = 0.10;
/// Sum of squares above that of the truth, in variances of the noise, that is no accident: five standard deviations.
pub const BASIN: f64 = 25.0;
/// An element is far off if its error exceeds so many bounds.
pub const FAR: f64 = 5.0;

/// What is to be run.
#[derive(Debug, Clone)]
pub struct Plan {
    /// Cases.
    pub cases: Vec<Case>,
    /// What every element has lost besides its case's damage, as [`Setting::wear`].
    pub wear: f64,
    /// Parts of each channel's RMS.
    pub noise: Vec<f64>,
    /// Sets of sensors.
    pub sensors: Vec<Vec<u16>>,
    /// What is known.
    pub nuisance: Vec<Nuisance>,
    /// What of the truth the model does not have.
    pub fields: Vec<Field>,
    /// Identifications of each; their seeds are 1, 2, ..
    pub seeds: u32,
}

impl Plan {
    /// The settings, one a row of the table.
    pub fn settings(&self) -> Vec<Setting> {
        let mut settings = vec![];
        for &noise in &self.noise {
            for nodes in &self.sensors {
                for &nuisance in &self.nuisance {
                    for &case in &self.cases {
                        for &field in &self.fields {
                            let nodes = nodes.clone();
                            settings.push(Setting {
                                case,
                                wear: self.wear,
                                noise,
                                nodes,
                                nuisance,
                                field,
                            });
                        }
                    }
                }
            }
        }
        settings
    }

    /// Identifications in all.
    pub fn identifications(&self) -> u64 {
        self.settings().len() as u64 * u64::from(self.seeds)
    }
}

/// One identification beside the truth.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Outcome {
    /// What is true.
    pub truth: Point,
    /// What was found.
    pub answer: Answer,
    /// Sum of squares of the answer less that of the truth, in variances of the noise.
    pub excess: f64,
    /// Time of the identification, s.
    pub seconds: f64,
}

/// All identifications of a setting.
#[derive(Debug, Clone, PartialEq)]
pub struct Row {
    /// The setting.
    pub setting: Setting,
    /// The bound of each element's damage.
    pub bound: Damage<f64>,
    /// One a seed.
    pub outcomes: Vec<Outcome>,
}

/// Runs a plan on all processors. `done` is called after every identification.
///
/// # Errors
/// If there is nothing to do, or a passage cannot be solved.
pub fn run(bridge: &BridgeFrame, plan: &Plan, done: &(dyn Fn() + Sync)) -> Result<Vec<Row>> {
    let settings = plan.settings();
    if settings.is_empty() || plan.seeds == 0 {
        bail!("nothing to evaluate: give at least one case, noise, set of sensors and seed");
    }
    let model = reduce(bridge)?;
    let logger = model.cast::<f32>();
    // All that the seeds of a setting share: the model in f64, its bound, and the passage, where it is the same each time.
    let prepared = batch::each(&settings, |setting| -> Result<_> {
        let explaining = Explaining::new(&model, setting)?;
        let ideal = Setting {
            field: Field::NONE,
            nuisance: Nuisance::Known,
            ..setting.clone()
        };
        let nominal = ideal.draw(0);
        let clean = ideal.clean(bridge, &nominal)?;
        let ranges = setting.draw(0).ranges;
        let sigma = setting.sigma(&clean);
        let bound = bound_of(&explaining, &nominal.truth, clean[0].len(), &sigma, &ranges)?;
        Ok((explaining, clean, bound))
    })
    .into_iter()
    .collect::<Result<Vec<_>>>()?;
    let jobs: Vec<(usize, u64)> = (0..settings.len())
        .flat_map(|s| (1..=u64::from(plan.seeds)).map(move |seed| (s, seed)))
        .collect();
    let outcomes = batch::each(&jobs, |&(s, seed)| -> Result<Outcome> {
        let (setting, (explaining, nominal, _)) = (&settings[s], &prepared[s]);
        let drawn = setting.draw(seed);
        let recorded = if setting.nuisance == Nuisance::Known && setting.field == Field::NONE {
            setting.record(nominal, seed)
        } else {
            setting.record(&setting.clean(bridge, &drawn)?, seed)
        };
        let observed = observe(&logger, setting, &drawn, &recorded)?;
        let start = Instant::now();
        let answer = identify(&observed, seed)?;
        let seconds = start.elapsed().as_secs_f64();
        done();
        Ok(Outcome {
            truth: drawn.truth,
            answer,
            excess: excess(explaining, &drawn, &answer, &recorded)?,
            seconds,
        })
    })
    .into_iter()
    .collect::<Result<Vec<_>>>()?;
    Ok((settings.into_iter().zip(&prepared))
        .zip(outcomes.chunks(plan.seeds as usize))
        .map(|((setting, (_, _, bound)), outcomes)| Row {
            setting,
            bound: *bound,
            outcomes: outcomes.to_vec(),
        })
        .collect())
}

/// By how much the answer explains a recording worse than the truth does, in variances of the noise.
pub(super) fn excess(explaining: &Explaining, drawn: &Drawn, answer: &Answer, recorded: &Recorded) -> Result<f64> {
    let of = |at: &Point| explaining.chi_square(at, &recorded.samples, &recorded.sigma);
    Ok(of(&answer.found)? - of(&drawn.truth)?)
}

/// What a search's end is worth.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum End {
    /// Near the truth, and as good an explanation.
    Right,
    /// Near the truth, but a worse explanation than it.
    Short,
    /// Far from the truth, and a worse explanation.
    WrongBasin,
    /// Far from the truth, but as good an explanation.
    Rival,
}

impl Outcome {
    /// Error of element `e`.
    pub fn error(&self, e: usize) -> f64 {
        self.answer.found.damage[e] - self.truth.damage[e]
    }

    /// How the search ended, by the bounds of its row.
    pub fn end(&self, bound: &Damage<f64>) -> End {
        let far = (0..ELEMENTS).any(|e| self.error(e).abs() > FAR * bound[e]);
        // Not a number is no explanation.
        match (self.excess <= BASIN, far) {
            (true, false) => End::Right,
            (true, true) => End::Rival,
            (false, false) => End::Short,
            (false, true) => End::WrongBasin,
        }
    }
}

/// Over all elements, the median and the worst element.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Spread {
    /// Root mean square over the elements.
    pub rms: f64,
    /// Median element.
    pub median: f64,
    /// Worst element.
    pub worst: f64,
}

impl Spread {
    /// Of one value an element.
    pub fn of(values: &Damage<f64>) -> Self {
        let (median, worst) = median_and_worst(values.to_vec()).unwrap_or((f64::NAN, f64::NAN));
        Self {
            rms: mean(values.iter().map(|v| v * v)).sqrt(),
            median,
            worst,
        }
    }
}

impl Row {
    /// RMSE of each element.
    pub fn rmse(&self) -> Damage<f64> {
        std::array::from_fn(|e| mean(self.outcomes.iter().map(|outcome| outcome.error(e).powi(2))).sqrt())
    }

    /// Mean error of each element.
    pub fn bias(&self) -> Damage<f64> {
        std::array::from_fn(|e| mean(self.outcomes.iter().map(|outcome| outcome.error(e))))
    }

    /// The RMSE over the elements.
    pub fn error(&self) -> Spread {
        Spread::of(&self.rmse())
    }

    /// The bound over the elements.
    pub fn limit(&self) -> Spread {
        Spread::of(&self.bound)
    }

    /// RMSE over bound, of the elements whose bound is below [`JUDGED`] together, and of the worst of them; none if there is none.
    pub fn ratio(&self) -> Option<(f64, f64)> {
        let rmse = self.rmse();
        let judged: Vec<usize> = (0..ELEMENTS).filter(|&e| self.bound[e] < JUDGED).collect();
        let square = |of: &Damage<f64>| mean(judged.iter().map(|&e| of[e] * of[e]));
        let worst = judged.iter().map(|&e| rmse[e] / self.bound[e]).fold(0.0, f64::max);
        (!judged.is_empty()).then(|| ((square(&rmse) / square(&self.bound)).sqrt(), worst))
    }

    /// Part of the 95 % intervals that hold the true damage: of all elements, and of those that are damaged (none: not a number).
    pub fn coverage(&self) -> (f64, f64) {
        let of = |damaged_only: bool| {
            mean((self.outcomes.iter()).flat_map(|outcome| {
                (0..ELEMENTS)
                    .filter(move |&e| !damaged_only || outcome.truth.damage[e] > 0.0)
                    .map(|e| f64::from(outcome.answer.covers(e, outcome.truth.damage[e])))
            }))
        };
        (of(false), of(true))
    }

    /// Searches that ended so.
    pub fn ended(&self, end: End) -> usize {
        (self.outcomes.iter())
            .filter(|outcome| outcome.end(&self.bound) == end)
            .count()
    }

    /// Identifications with an element beyond doubt that is whole.
    pub fn false_alarms(&self) -> usize {
        let is_false =
            |outcome: &&Outcome| (0..ELEMENTS).any(|e| outcome.answer.is_certain(e) && outcome.truth.damage[e] == 0.0);
        self.outcomes.iter().filter(is_false).count()
    }

    /// Damaged elements that are not beyond doubt, and damaged elements, over all seeds.
    pub fn missed(&self) -> (usize, usize) {
        let damaged = self.outcomes.iter().flat_map(|outcome| {
            (0..ELEMENTS)
                .filter(|&e| outcome.truth.damage[e] > 0.0)
                .map(|e| outcome.answer.is_certain(e))
        });
        damaged.fold((0, 0), |(missed, all), certain| {
            (missed + usize::from(!certain), all + 1)
        })
    }

    /// Identifications in which no damage explains the recording.
    pub fn unexplained(&self) -> usize {
        self.outcomes.iter().filter(|outcome| !outcome.answer.explained).count()
    }

    /// Forward solves, median and worst.
    pub fn solves(&self) -> (u32, u32) {
        median_and_worst(
            (self.outcomes.iter())
                .map(|outcome| outcome.answer.forward_solves)
                .collect(),
        )
        .unwrap_or((0, 0))
    }

    /// Seconds an identification, median and worst.
    pub fn seconds(&self) -> (f64, f64) {
        median_and_worst(self.outcomes.iter().map(|outcome| outcome.seconds).collect()).unwrap_or((0.0, 0.0))
    }
}

/// The mean; not a number of nothing.
pub(in crate::study) fn mean(values: impl Iterator<Item = f64>) -> f64 {
    let (count, sum) = values.fold((0.0, 0.0), |(count, sum), value| (count + 1.0, sum + value));
    sum / count
}
