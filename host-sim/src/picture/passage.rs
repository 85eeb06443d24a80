//! A recorded passage and what was identified from it.

use std::path::Path;

use anyhow::Result;
use spanwatch::wire::message::Quantity;

use super::{DamageBars, History, RivalBars, identification};
use crate::identification::{Found, Observed};
use crate::replay::Prepared;

/// Draws what was `found` into the SVG file at `path`: each channel measured and fitted, then the damage by element, beside
/// the `truth` where that is known.
///
/// # Errors
/// If the passage cannot be simulated or the file not be written.
pub fn passage(
    path: &Path,
    title: &str,
    subtitle: &str,
    prepared: &Prepared,
    observed: &Observed,
    found: &Found,
    truth: Option<&[f64]>,
) -> Result<()> {
    let recording = &prepared.recording;
    let fitted = observed.simulate_hypothesis(&found.hypothesis(&observed.observation))?;
    let channels = &recording.channels;
    let histories: Vec<(String, [Vec<f64>; 2])> = (channels.iter().enumerate())
        .map(|(c, channel)| {
            let label = (channel.node).map_or_else(|| channel.column.clone(), |node| format!("node {node}"));
            let scale = match channel.unit.quantity() {
                Quantity::Acceleration => 1.0,
                Quantity::Displacement => 1e3,
            };
            let of_channel = |values: &[f32]| -> Vec<f64> {
                let values = values.iter().skip(c).step_by(channels.len());
                values.map(|&value| scale * f64::from(value)).collect()
            };
            (label, [of_channel(&observed.samples), of_channel(&fitted)])
        })
        .collect();
    let histories: Vec<History<'_>> = (histories.iter().zip(channels))
        .map(|((label, [measured, fitted]), channel)| History {
            label,
            quantity: channel.unit.quantity(),
            start_s: recording.start_s + observed.first_sample as f64 * recording.interval_s,
            interval_s: recording.interval_s,
            measured,
            fitted,
        })
        .collect();
    let elements = observed.bridge.elements;
    let each = |values: &[f32]| -> Vec<f64> { values.iter().take(elements).map(|&value| value.into()).collect() };
    let damage = each(&found.damage());
    let ends = (found.identification).map(|found| [each(&found.estimate.low), each(&found.estimate.high)]);
    let rival = (found.identification.and_then(|found| found.rival)).map(|rival| (rival, each(&rival.damage)));
    let bars = DamageBars {
        damage: &damage,
        interval: ends.as_ref().map(|ends| [&ends[0][..], &ends[1][..]]),
        rival: rival.as_ref().map(|(rival, damage)| RivalBars {
            damage,
            whole: rival.whole + 1,
            loses_by: rival.loses_by.into(),
        }),
        truth,
    };
    identification(path, title, subtitle, &histories, &bars)
}
