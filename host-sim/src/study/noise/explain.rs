//! The one place where the campaign meets the search: a recording in, an answer out.

use anyhow::Result;
use spanwatch::bridge::{Damage, MAX_DAMAGE, ReducedBridge};
use spanwatch::capacity::ELEMENTS;
use spanwatch::identify::Hybrid;
use spanwatch::interaction::Run;
use spanwatch::math::Real;

use super::Point;
use super::truth::{Drawn, Recorded, Setting};
use crate::identification::Observed;
use crate::simulate::Scenario;

/// Standard deviations to either side that hold 95 % of a Gaussian.
const NINETY_FIVE: f64 = 1.96;

/// What a search made of a recording.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Answer {
    /// Damage, run and stiffness as found.
    pub found: Point,
    /// Lower end of the 95 % interval of each element's damage.
    pub low: Damage<f64>,
    /// Upper end.
    pub high: Damage<f64>,
    /// Elements that are damaged beyond doubt, bit `e` for element `e` from 0.
    pub certain: u16,
    /// Whether the damage explains the recording at all.
    pub explained: bool,
    /// Forward solves.
    pub forward_solves: u32,
}

/// A recording as the search sees it: the logger's model, the first guess of the run and how far off it may be.
///
/// # Errors
/// If the logger does not know the train or the sensors' places.
pub fn observe(bridge: &ReducedBridge<f32>, setting: &Setting, drawn: &Drawn, recorded: &Recorded) -> Result<Observed> {
    // The search is told the case's train and sensors; how the truth is solved is not its business.
    let scenario: Scenario = setting.scenario();
    let mut observed = Observed::of(bridge.clone(), &scenario, recorded.samples.clone())?;
    observed.observation.run = cast(&drawn.guess);
    observed.observation.ranges = drawn.ranges;
    Ok(observed)
}

/// Identifies: today's search holds the run at its first guess and the stiffness at the model's, and its interval is 1.96
/// standard deviations, cut off at the ends of what damage can be. A search that estimates these and has intervals of its own is put
/// in here.
///
/// # Errors
/// If the passage cannot be simulated.
pub fn identify(observed: &Observed, seed: u64) -> Result<Answer> {
    let problem = observed.problem();
    let mut search = Hybrid::new(seed);
    let found = loop {
        if let Some(found) = search.advance(&problem)? {
            break found;
        }
    };
    let damage = found.damage.map(f64::from);
    let end = |sign: f64| -> Damage<f64> {
        std::array::from_fn(|e| (damage[e] + sign * NINETY_FIVE * f64::from(found.std[e])).clamp(0.0, MAX_DAMAGE))
    };
    Ok(Answer {
        found: Point {
            damage,
            run: cast(&observed.observation.run),
            stiffness: 1.0,
        },
        low: end(-1.0),
        high: end(1.0),
        certain: found.certain(),
        explained: found.explained(),
        forward_solves: found.forward_solves,
    })
}

/// A run in the other precision.
fn cast<T: Real, U: Real>(run: &Run<T>) -> Run<U> {
    let to = |value: T| U::of(value.into());
    Run {
        speed_mps: to(run.speed_mps),
        acceleration_mps2: to(run.acceleration_mps2),
        entry_time_s: to(run.entry_time_s),
        load_factor: to(run.load_factor),
        direction: run.direction,
        kinematics: run.kinematics,
    }
}

impl Answer {
    /// Whether the interval of element `e` (from 0) holds a damage.
    pub fn covers(&self, e: usize, damage: f64) -> bool {
        // The search's numbers are f32.
        const ROUNDING: f64 = 1e-6;
        self.low[e] - ROUNDING <= damage && damage <= self.high[e] + ROUNDING
    }

    /// Whether element `e` (from 0) is damaged beyond doubt.
    pub fn is_certain(&self, e: usize) -> bool {
        e < ELEMENTS && self.certain >> e & 1 == 1
    }
}
