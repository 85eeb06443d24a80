//! The irregularity of a track along it: vertical, lateral, cross-level, one below the other. And one as it was learnt from trains.

use std::path::Path;

use anyhow::Result;
use plotters::style::Color;
use plotters::style::text_anchor::HPos;
use spanwatch::track::{Motion, Track};

use super::canvas::{BLUE, BODY, Canvas, INK, LEFT, Mark, SKY, SOFT, Svg, TITLE, VERMILION, ticks};
use crate::calibrate::Calibration;
use crate::calibrate::known::{HALF_WAVE_M, ShortWaves, short_waves_of};
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

/// What is shown of a learnt track before the bridge and behind it, besides the whole, m.
const AROUND_M: [f64; 2] = [10.0, 5.0];
/// Next to its ends a profile is forced to be level, and not shown, m.
const MARGIN_M: f64 = 15.0;
/// The band is magnified so that its median on the bridge takes one part in so many of the height.
const SEEN: f64 = 3.0;
/// Deviations that a band reaches to either side.
const BAND: f64 = 2.0;

/// Draws a learnt track into the SVG file at `path`, over a bridge of `length_m` from node 1: its short waves with the band in which they
/// lie, all along and at the bridge, and how wide that is; beside the `truth` where that is known.
pub fn learnt(
    path: &Path,
    title: &str,
    calibration: &Calibration,
    length_m: f64,
    truth: Option<&Profile>,
) -> Result<()> {
    const HEAD: f64 = 76.0;
    const CAPTION: f64 = 40.0;
    const ROW: f64 = 190.0;
    const AXIS: f64 = 62.0;
    let short = calibration.short_waves();
    let places: Vec<f64> = short.iter().map(|at| at.x_m).collect();
    let truth = truth.map(|truth| short_waves_of(truth, &places));
    let near = [-AROUND_M[0], length_m + AROUND_M[1]];
    let whole = [places[0] + MARGIN_M, places[places.len() - 1] - MARGIN_M];
    let all = || {
        short
            .iter()
            .map(|at| 1e3 * at.height_m)
            .chain(truth.iter().flatten().map(|height| 1e3 * height))
    };
    let reach = 1.08 * all().fold(1e-3, |reach: f64, height| reach.max(height.abs()));
    let svg = Svg::draw(HEAD + 3.0 * (CAPTION + ROW + AXIS), |canvas| {
        canvas.text(title, LEFT, 30.0, TITLE, INK, HPos::Left)?;
        let subtitle = format!(
            "Mean height of the rails, waves shorter than {HALF_WAVE_M:.0} m; learnt from {} passages",
            calibration.learnt.passages
        );
        canvas.text(&subtitle, LEFT, 56.0, BODY, SOFT, HPos::Left)?;
        for (k, (caption, ends)) in [("all along", whole), ("at the bridge", near)].into_iter().enumerate() {
            let top = HEAD + k as f64 * (CAPTION + ROW + AXIS) + CAPTION;
            canvas.text(caption, LEFT, top - 14.0, BODY, INK, HPos::Left)?;
            let mut marks = vec![
                (Mark::Line(BLUE.to_rgba(), 1.4), "learnt"),
                (Mark::Box(SKY), "± 2 standard deviations"),
            ];
            if truth.is_some() {
                marks.push((Mark::Dashed(VERMILION.to_rgba(), 1.4), "true"));
            }
            if k == 0 {
                canvas.legend(top - 14.0, &marks)?;
            }
            let panel = Panel {
                canvas,
                top,
                height: ROW,
                ends,
                reach,
                length_m,
            };
            panel.draw(&short, truth.as_deref(), &|at| 1e3 * at.height_m, 0.0, "mm")?;
        }
        let top = HEAD + 2.0 * (CAPTION + ROW + AXIS) + CAPTION;
        let caption = match &truth {
            Some(_) => "at the bridge, less what was learnt: the band and the truth in it",
            None => "at the bridge, less what was learnt: the band",
        };
        canvas.text(caption, LEFT, top - 14.0, BODY, INK, HPos::Left)?;
        // Beside the bridge the band is as wide as tracks are; what is known on it shall be seen.
        let mut widths: Vec<f64> = (short.iter())
            .filter(|at| (0.0..=length_m).contains(&at.x_m))
            .map(|at| 1e6 * BAND * at.deviation_m)
            .collect();
        widths.sort_by(f64::total_cmp);
        let reach = SEEN * widths.get(widths.len() / 2).copied().unwrap_or(1.0).max(1e-3);
        let panel = Panel {
            canvas,
            top,
            height: ROW,
            ends: near,
            reach,
            length_m,
        };
        panel.draw(&short, truth.as_deref(), &|_| 0.0, 1.0, "µm")
    })?;
    output::write(&[(path, svg.as_bytes())])
}

/// A panel of a learnt track.
struct Panel<'c, 'a> {
    canvas: &'c Canvas<'a>,
    top: f64,
    height: f64,
    /// Places at its ends, m.
    ends: [f64; 2],
    /// Largest height on the axis.
    reach: f64,
    length_m: f64,
}

impl Panel<'_, '_> {
    /// The curve of `centre`, mm; with `apart` = 1 all heights are taken less the learnt ones, and shown in µm.
    fn draw(
        &self,
        short: &[ShortWaves],
        truth: Option<&[f64]>,
        centre: &dyn Fn(&ShortWaves) -> f64,
        apart: f64,
        unit: &str,
    ) -> Result<()> {
        let [low, high] = self.ends;
        let scale = if apart > 0.0 { 1e6 } else { 1e3 };
        let along = ticks(low, high, 12);
        let panel = self
            .canvas
            .panel(self.top, self.height, (low, high), (-self.reach, self.reach));
        panel.grid(&along, &ticks(-self.reach, self.reach, 4))?;
        panel.y_label(unit)?;
        let inside: Vec<(usize, &ShortWaves)> = (short.iter().enumerate())
            .filter(|(_, at)| (low..=high).contains(&at.x_m))
            .collect();
        let band: Vec<(f64, [f64; 2])> = (inside.iter())
            .map(|(_, at)| {
                let half = scale * BAND * at.deviation_m;
                (at.x_m, [centre(at) - half, centre(at) + half])
            })
            .collect();
        panel.band(&band, SKY)?;
        panel.line(&[(low, 0.0), (high, 0.0)], SOFT, 1.0)?;
        let curve: Vec<(f64, f64)> = inside.iter().map(|(_, at)| (at.x_m, centre(at))).collect();
        panel.line(&curve, BLUE, 1.4)?;
        if let Some(truth) = truth {
            let curve: Vec<(f64, f64)> = (inside.iter())
                .map(|(i, at)| (at.x_m, scale * (truth[*i] - apart * at.height_m)))
                .collect();
            for piece in curve.split(|(_, height)| height.abs() > self.reach) {
                panel.dashed(piece, VERMILION, 1.4)?;
            }
        }
        for end in [0.0, self.length_m] {
            if (low..=high).contains(&end) {
                panel.support(end)?;
            }
        }
        panel.x_axis(&along, "distance from node 1, m; triangles: the ends of the bridge")
    }
}
