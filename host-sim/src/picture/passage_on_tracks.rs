//! A passage, measured and fitted on a smooth track and on the learnt one.

use std::path::Path;

use anyhow::Result;
use plotters::style::Color;
use plotters::style::text_anchor::HPos;
use spanwatch::identify::Identification;
use spanwatch::wire::message::Quantity;

use super::canvas::{BLUE, BODY, INK, LEFT, Mark, PALE, SMALL, SOFT, Svg, TITLE, VERMILION, ticks};
use super::{FITTED, FITTED_OPACITY, MEASURED};
use crate::calibrate::{Calibration, Passage};
use crate::identification::Observed;
use crate::output;

/// Draws it into the SVG file at `path`; the bridge is taken to be whole on both.
///
/// # Errors
/// If the passage cannot be simulated or the file not be written.
pub fn passage_on_tracks(path: &Path, passage: &Passage, calibration: &Calibration, seed: u64) -> Result<()> {
    const HEAD: f64 = 76.0;
    const CAPTION: f64 = 32.0;
    const MAIN: f64 = 150.0;
    const LEAVES: f64 = 84.0;
    const AXIS: f64 = 58.0;
    let whole = |observed: &Observed| -> Result<(Identification, Vec<f32>)> {
        let mut whole = observed.clone();
        whole.bridge.elements = 0;
        let found = whole.identify(seed)?;
        let fitted = whole.simulate_hypothesis(&found.hypothesis())?;
        Ok((found, fitted))
    };
    let observed = &passage.observed;
    let (on_smooth, smooth) = whole(observed)?;
    let (on_learnt, learnt) = whole(&observed.with_track(&calibration.learnt))?;

    let recorder = &observed.observation.recorder;
    let channels = recorder.sensors.len();
    let interval_s = f64::from(recorder.sample_rate_hz).recip();
    let time = |i: usize| (observed.first_sample as f64 + i as f64) * interval_s;
    let rows = observed.samples.len() / channels;
    let times = (time(0), time(rows.max(2) - 1));
    let along = ticks(times.0, times.1, 10);
    let row = 2.0 * CAPTION + MAIN + LEAVES;
    let svg = Svg::draw(HEAD + row * channels as f64 + AXIS, |canvas| {
        canvas.text(&passage.name, LEFT, 30.0, TITLE, INK, HPos::Left)?;
        let subtitle = format!(
            "{:.1} km/h; a whole bridge leaves {:.2} % of the power unexplained on a smooth track, {:.2} % on the learnt one",
            3.6 * on_learnt.run.speed_mps,
            100.0 * on_smooth.unexplained,
            100.0 * on_learnt.unexplained
        );
        canvas.text(&subtitle, LEFT, 56.0, BODY, SOFT, HPos::Left)?;
        for (c, sensor) in recorder.sensors.iter().enumerate() {
            let (scale, unit, what) = match sensor.quantity {
                Quantity::Acceleration => (1.0, "m/s²", "acceleration"),
                Quantity::Displacement => (1e3, "mm", "displacement"),
            };
            let of_channel = |values: &[f32]| -> Vec<f64> {
                let values = values.iter().skip(c).step_by(channels);
                values.map(|&value| scale * f64::from(value)).collect()
            };
            let [measured, smooth, learnt] = [&observed.samples, &smooth, &learnt].map(|values| of_channel(values));
            let points = |values: &mut dyn Iterator<Item = f64>| -> Vec<(f64, f64)> {
                (values.enumerate().map(|(i, value)| (time(i), value)))
                    .filter(|(_, value)| value.is_finite())
                    .collect()
            };
            let less = |fitted: &[f64]| points(&mut measured.iter().zip(fitted).map(|(m, f)| m - f));
            let peak = |points: &[(f64, f64)]| points.iter().fold(1e-9_f64, |peak, (_, value)| peak.max(value.abs()));
            let (measured_points, learnt_points) = (
                points(&mut measured.iter().copied()),
                points(&mut learnt.iter().copied()),
            );
            let (left_smooth, left_learnt) = (less(&smooth), less(&learnt));

            let top = HEAD + row * c as f64 + CAPTION;
            let label = format!("node {}: {what}", sensor.place + 1);
            canvas.text(&label, LEFT, top - 14.0, BODY, INK, HPos::Left)?;
            if c == 0 {
                let marks = [
                    (Mark::Line(INK.to_rgba(), MEASURED), "measured"),
                    (
                        Mark::Line(VERMILION.mix(FITTED_OPACITY), FITTED),
                        "fitted on the learnt track",
                    ),
                ];
                canvas.legend(top - 14.0, &marks)?;
            }
            let reach = 1.08 * peak(&measured_points).max(peak(&learnt_points));
            let panel = canvas.panel(top, MAIN, times, (-reach, reach));
            panel.grid(&along, &ticks(-reach, reach, 6))?;
            panel.y_label(unit)?;
            panel.line(&measured_points, INK, MEASURED)?;
            panel.line(&learnt_points, VERMILION.mix(FITTED_OPACITY), FITTED)?;

            let below = top + MAIN + CAPTION;
            canvas.text("measured minus fitted", LEFT, below - 14.0, SMALL, SOFT, HPos::Left)?;
            if c == 0 {
                let marks = [
                    (Mark::Line(PALE.to_rgba(), 1.6), "on a smooth track"),
                    (Mark::Line(BLUE.to_rgba(), 1.0), "on the learnt track"),
                ];
                canvas.legend(below - 14.0, &marks)?;
            }
            let reach = 1.08 * peak(&left_smooth).max(peak(&left_learnt));
            let panel = canvas.panel(below, LEAVES, times, (-reach, reach));
            panel.grid(&along, &ticks(-reach, reach, 4))?;
            panel.y_label(unit)?;
            panel.line(&left_smooth, PALE, 1.6)?;
            panel.line(&left_learnt, BLUE, 1.0)?;
            if c + 1 == channels {
                panel.x_axis(&along, "time from the recording's first row, s")?;
            }
        }
        Ok(())
    })?;
    output::write(&[(path, svg.as_bytes())])
}
