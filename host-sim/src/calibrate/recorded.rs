//! Passages to learn from, from recordings.

use anyhow::{Result, bail};
use spanwatch::wire::message::Ranges;

use super::Passage;
use crate::identification::Observed;
use crate::replay::Prepared;
use crate::train::TrainName;

/// How far off is what a recording says of its passage, where its TOML does not say it: a timetable's or a trackside unit's values.
const ROUGHLY: Ranges = Ranges {
    speed: 0.02,
    entry_s: 0.1,
    load: 0.05,
    stiffness: 0.005,
};

/// What a recording says of its run is only roughly right, or as far off as its `[range]` says. What it does not say keeps the range that
/// it has for that.
pub fn roughly(prepared: &mut Prepared) {
    let recording = &prepared.recording;
    let margins = recording.margins;
    let Some(traffic) = &mut prepared.configuration.traffic else {
        return;
    };
    let allow = |range: &mut f32, margin: Option<f64>, given: bool, roughly: f32| {
        if margin.is_none() && given {
            *range = roughly;
        }
    };
    let ranges = &mut traffic.ranges;
    allow(
        &mut ranges.speed,
        margins.speed,
        recording.speed_kmh.is_some(),
        ROUGHLY.speed,
    );
    allow(
        &mut ranges.entry_s,
        margins.entry_s,
        recording.entry_time_s.is_some(),
        ROUGHLY.entry_s,
    );
    allow(
        &mut ranges.load,
        margins.load,
        recording.load_factor.is_some(),
        ROUGHLY.load,
    );
    allow(&mut ranges.stiffness, margins.stiffness, true, ROUGHLY.stiffness);
}

impl Passage {
    /// The passage of a recording. What this says of the run is taken for [roughly] right.
    ///
    /// # Errors
    /// As [`Observed::recorded`].
    pub fn recorded(prepared: &mut Prepared) -> Result<Self> {
        roughly(prepared);
        let name = prepared.path.display().to_string();
        let observed = Observed::recorded(prepared)?;
        let Some(TrainName::Known(train)) = prepared.recording.train else {
            bail!("{name}: its train is none that a logger knows");
        };
        Ok(Self { name, train, observed })
    }
}
