//! The irregularity of a track along it: vertical, lateral, cross-level, one below the other.

use std::path::Path;

use anyhow::Result;
use plotters::style::text_anchor::HPos;
use spanwatch::track::{Motion, Track};

use super::canvas::{BLUE, BODY, INK, LEFT, SOFT, Svg, TITLE, ticks};
use crate::output;
use crate::track::Profile;
use crate::track::summary::{scale, summary};

/// Points of a curve: three a pixel.
const POINTS: usize = 3000;

/// Draws a track into the SVG file at `path`, all rows at one scale.
pub fn irregularity(path: &Path, title: &str, track: &Profile) -> Result<()> {
    const HEAD: f64 = 56.0;
    const ROW: f64 = 170.0;
    const CAPTION: f64 = 34.0;
    const AXIS: f64 = 62.0;
    let rows = [
        ("vertical: mean height of the rails", Motion::Vertical),
        ("lateral: mean of the rails, to the left", Motion::Lateral),
        ("cross-level: left rail above the right one", Motion::Roll),
    ];
    let x = &track.rails().x_m;
    let (first, last) = (x[0], x[x.len() - 1]);
    let along = ticks(first, last, 10);
    let millimetres = |motion, x| 1e3 * scale(motion) * Track::<f64>::at(track, motion, x).value;
    let reach = (rows.iter())
        .flat_map(|&(_, motion)| summary(track, motion).extremes)
        .fold(0.0_f64, |reach, extreme| reach.max(1e3 * extreme.value.abs()));
    let reach = if reach > 0.0 { 1.08 * reach } else { 1.0 };

    let svg = Svg::draw(HEAD + rows.len() as f64 * (CAPTION + ROW) + AXIS, |canvas| {
        canvas.text(title, LEFT, 30.0, TITLE, INK, HPos::Left)?;
        for (k, &(label, motion)) in rows.iter().enumerate() {
            let top = HEAD + k as f64 * (CAPTION + ROW) + CAPTION;
            let rms = format!("{label}, {:.3} mm rms", 1e3 * summary(track, motion).rms_m);
            canvas.text(&rms, LEFT, top - 13.0, BODY, INK, HPos::Left)?;
            let panel = canvas.panel(top, ROW, (first, last), (-reach, reach));
            panel.grid(&along, &ticks(-reach, reach, 4))?;
            panel.y_label("mm")?;
            panel.line(&[(first, 0.0), (last, 0.0)], SOFT, 1.0)?;
            let points: Vec<(f64, f64)> = (0..=POINTS)
                .map(|i| first + i as f64 / POINTS as f64 * (last - first))
                .map(|x| (x, millimetres(motion, x)))
                .collect();
            panel.line(&points, BLUE, 1.2)?;
            if k + 1 == rows.len() {
                panel.x_axis(&along, "distance from node 1, m")?;
            }
        }
        Ok(())
    })?;
    output::write(&[(path, svg.as_bytes())])
}
