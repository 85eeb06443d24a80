//! Thirty passages of one bridge put together by the logger's own [`Evidence`], which never forgets here.
//!
//! The bound is that of all thirty at once. Where run and stiffness are not known, each passage has its own: the whole
//! bridge's stiffness goes with the temperature of the hour.

use anyhow::{Result, bail};
use nalgebra::SMatrix;
use rand_core::SeedableRng;
use rand_xoshiro::Xoshiro256PlusPlus;
use spanwatch::bridge::Damage;
use spanwatch::capacity::ELEMENTS;
use spanwatch::identify::estimate::{Estimate, Information};
use spanwatch::identify::evidence::{Change, Evidence, Forgetting};
use spanwatch::wire::message::TrainKind;

use super::Nuisance;
use super::bound::{Explaining, marginal, with_prior};
use super::campaign::{BASIN, Spread, excess, mean};
use super::explain::{identify, observe};
use super::field::Field;
use super::truth::{Drawn, Setting};
use crate::batch;
use crate::evaluate::Case;
use crate::model::BridgeFrame;
use crate::model::reduce::reduce;
use crate::random::unit;

/// Passages that are put together.
pub const PASSAGES: usize = 30;
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

/// What several passages say together.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Fused {
    /// Losses, deviations, intervals.
    pub estimate: Estimate,
    /// Passages that were left out, because they contradict the others.
    pub left_out: usize,
}

/// Adds what passages say.
pub fn fuse(passages: &[Information]) -> Fused {
    let mut evidence = Evidence::new(Forgetting::NEVER);
    let left_out = passages
        .iter()
        .filter(|passage| evidence.add(passage) != Change::None)
        .count();
    Fused {
        estimate: evidence.estimate(ELEMENTS),
        left_out,
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
        std::array::from_fn(|e| {
            mean(
                self.fused
                    .iter()
                    .map(|fused| (f64::from(fused.estimate.damage[e]) - truth[e]).powi(2)),
            )
            .sqrt()
        })
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

    /// Part of the 95 % intervals that hold the true damage.
    pub fn coverage(&self) -> f64 {
        let truth = self.setting.draw(0).truth.damage;
        let holds = |estimate: &Estimate, e: usize| (estimate.low[e]..=estimate.high[e]).contains(&(truth[e] as f32));
        mean((self.fused.iter()).flat_map(|fused| (0..ELEMENTS).map(move |e| f64::from(holds(&fused.estimate, e)))))
    }

    /// Passages that were left out, of all seeds.
    pub fn left_out(&self) -> usize {
        self.fused.iter().map(|fused| fused.left_out).sum()
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
            let possible = batch::each(different, |passage| -> Result<_> {
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
                let mut information = linearised.information;
                with_prior(&mut information, &nominal.ranges);
                Ok(marginal(&information))
            })
            .into_iter()
            .collect::<Result<Vec<_>>>()?;
            let all: SMatrix<f64, ELEMENTS, ELEMENTS> = possible.iter().cycle().take(PASSAGES).sum();
            let covariance = all.try_inverse().unwrap_or_default();
            let jobs: Vec<(usize, u64)> = (1..=u64::from(seeds))
                .flat_map(|seed| (0..PASSAGES).map(move |k| (k, seed)))
                .collect();
            let found = batch::each(&jobs, |&(k, seed)| -> Result<(Information, bool)> {
                let passage = &passages[k];
                let drawn = passage.draw((seed << 8) + k as u64);
                let recorded = passage.record(&passage.clean(bridge, &drawn)?, drawn.seed);
                let answer = identify(&observe(&logger, passage, &drawn, &recorded)?, drawn.seed)?;
                let wrong = excess(&Explaining::new(&model, passage)?, &drawn, &answer, &recorded)? > BASIN;
                done();
                Ok((answer.information, wrong))
            })
            .into_iter()
            .collect::<Result<Vec<_>>>()?;
            let said: Vec<Information> = found.iter().map(|(said, _)| *said).collect();
            rows.push(Row {
                setting: setting.clone(),
                traffic,
                bound: std::array::from_fn(|e| covariance[(e, e)].sqrt()),
                wrong: found.iter().filter(|(_, wrong)| *wrong).count(),
                fused: said.chunks(PASSAGES).map(fuse).collect(),
            });
        }
    }
    Ok(rows)
}
