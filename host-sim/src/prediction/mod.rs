//! Predictions: what the bridges that ship would do under trains that run over their originals, written down before
//! anyone compares. `host-sim predict` makes them again; `docs/` has the pages.

pub mod rdso45m;
pub mod viaduct24;

use spanwatch::recorder::{AntiAlias, AntiAliasState};

/// A mode by which wheels move the sensors less than this part of the mode in which they do most is left out: at 0.001
/// joint L4 of the truss sinks by 0.001 % less.
pub const LEAST_PART: f64 = 1e-3;

/// A signal in steps of `step_s` behind a recorder's low-pass (4th-order Butterworth, causal).
pub fn low_passed(signal: &[f64], cutoff_hz: f64, step_s: f64) -> Vec<f64> {
    let (filter, mut state) = (AntiAlias::new(Some(cutoff_hz), step_s), AntiAliasState::AT_REST);
    signal.iter().map(|&value| filter.apply(&mut state, value)).collect()
}

/// Largest absolute value.
pub fn largest(signal: &[f64]) -> f64 {
    signal.iter().fold(0.0, |most, value| most.max(value.abs()))
}

/// Every `every`-th value, from the first on.
fn thinned(signal: &[f64], every: usize) -> impl Iterator<Item = f64> {
    signal.iter().step_by(every).copied()
}
