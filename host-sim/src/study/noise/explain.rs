//! The one place where the campaign meets the search: a recording in, an answer out.

use anyhow::Result;
use spanwatch::bridge::{Damage, ReducedBridge};
use spanwatch::capacity::ELEMENTS;
use spanwatch::identify::estimate::Information;
use spanwatch::interaction::Run;
use spanwatch::math::Real;

use super::Point;
use super::truth::{Drawn, Recorded, Setting};
use crate::identification::Observed;
use crate::simulate::Scenario;

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
    /// What it says, for adding passages up.
    pub information: Information,
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

/// Identifies.
///
/// # Errors
/// If the passage cannot be simulated.
pub fn identify(observed: &Observed, seed: u64) -> Result<Answer> {
    let found = observed.identify(seed)?;
    Ok(Answer {
        found: Point {
            damage: found.estimate.damage.map(f64::from),
            run: cast(&found.run),
            stiffness: found.stiffness.into(),
        },
        low: found.estimate.low.map(f64::from),
        high: found.estimate.high.map(f64::from),
        certain: found.certain(),
        explained: found.explained(),
        forward_solves: found.forward_solves,
        information: found.information,
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
