//! Pictures (SVG): what was identified from a passage, the mode shapes of a girder or a frame, the irregularity of a track,
//! curves of any kind.
//!
//! Colours are of the palette of Okabe and Ito, which colour-blind eyes tell apart; no meaning rests on colour alone.

mod canvas;
pub mod chart;
pub mod estimates;
mod frame;
mod passage;
mod passage_on_tracks;
pub mod track;

use std::path::Path;

use anyhow::Result;
use plotters::prelude::*;
use plotters::style::text_anchor::HPos;
use spanwatch::wire::message::Quantity;

use crate::output;
use canvas::{
    BLUE, BODY, Canvas, INK, LEFT, Mark, PALE, SKY, SMALL, SOFT, Svg, TITLE, Ticks, VERMILION, around_zero, ticks,
};

pub use frame::frame_modes;
pub use passage::passage;
pub use passage_on_tracks::passage_on_tracks;

/// Largest damage on the scale, %.
const DAMAGE_SCALE_PERCENT: f64 = 70.0;
/// Width of an element's bar and of its rival's beside it, elements.
const BAR: f64 = 0.52;
const RIVAL_BAR: f64 = 0.14;
/// A rival that is worse by so many standard deviations is drawn; beyond it there is none to speak of.
const RIVAL_DRAWN: f64 = 100.0;
/// Height of a residual and of the line of words above it, px.
const STRIP: f64 = 64.0;
const STRIP_CAPTION: f64 = 24.0;
/// The measured curve is thin and dark; the fitted one lies over it broad and half transparent, so that both are seen
/// where they agree. Widths in px.
const MEASURED: f64 = 1.0;
const FITTED: f64 = 2.8;
const FITTED_OPACITY: f64 = 0.6;
/// Factors by which a residual may be magnified; more would show rounding.
const MAGNIFICATIONS: [f64; 7] = [100.0, 50.0, 20.0, 10.0, 5.0, 2.0, 1.0];

/// One channel of a passage, measured and as the identified bridge would have moved.
#[derive(Debug, Clone, Copy)]
pub struct History<'a> {
    /// What it is, such as "node 6".
    pub label: &'a str,
    /// What is measured.
    pub quantity: Quantity,
    /// Time of the first sample, s.
    pub start_s: f64,
    /// Time between samples, s.
    pub interval_s: f64,
    /// Recorded acceleration, m/s², or displacement, mm; not-a-number where there is none.
    pub measured: &'a [f64],
    /// The same of the fitted model; as many samples.
    pub fitted: &'a [f64],
}

/// The damage of each element, as fractions of bending stiffness lost; all slices of the same length.
#[derive(Debug, Clone, Copy)]
pub struct DamageBars<'a> {
    /// As identified.
    pub damage: &'a [f64],
    /// Lower and upper ends of their 95 % intervals, where known.
    pub interval: Option<[&'a [f64]; 2]>,
    /// What else could explain the passage, where that was asked.
    pub rival: Option<RivalBars<'a>>,
    /// The true damage, where known.
    pub truth: Option<&'a [f64]>,
}

/// The best explanation in which an element is whole.
#[derive(Debug, Clone, Copy)]
pub struct RivalBars<'a> {
    /// Damage of each element.
    pub damage: &'a [f64],
    /// The element, from 1, that is whole.
    pub whole: usize,
    /// Standard deviations by which it explains the passage worse.
    pub loses_by: f64,
}

impl<'a> History<'a> {
    fn residual(&self) -> impl Iterator<Item = f64> + use<'a> {
        self.measured.iter().zip(self.fitted).map(|(m, f)| m - f)
    }
}

/// Draws an identification into the SVG file at `path`: measured and fitted history with the residual below, a row a
/// channel, then the damage by element with its 95 % intervals.
pub fn identification(
    path: &Path,
    title: &str,
    subtitle: &str,
    histories: &[History<'_>],
    damage: &DamageBars<'_>,
) -> Result<()> {
    const HEAD: f64 = 76.0;
    const CAPTION: f64 = 30.0;
    const BARS: f64 = 250.0;
    const AXIS: f64 = 58.0;
    let main = match histories.len() {
        1 => 230.0,
        2 => 170.0,
        _ => 140.0,
    };
    let row = CAPTION + main + STRIP_CAPTION + STRIP;
    // Only the last row carries the time axis.
    let height = HEAD + row * histories.len() as f64 + AXIS + CAPTION + BARS + AXIS;
    let svg = Svg::draw(height, |canvas| {
        canvas.text(title, LEFT, 30.0, TITLE, INK, HPos::Left)?;
        canvas.text(subtitle, LEFT, 56.0, BODY, SOFT, HPos::Left)?;
        for (i, history) in histories.iter().enumerate() {
            let top = HEAD + row * i as f64 + CAPTION;
            canvas.text(history.label, LEFT, top - 13.0, BODY, INK, HPos::Left)?;
            if i == 0 {
                canvas.legend(
                    top - 13.0,
                    &[
                        (Mark::Line(INK.to_rgba(), MEASURED), "measured"),
                        (Mark::Line(VERMILION.mix(FITTED_OPACITY), FITTED), "fitted"),
                    ],
                )?;
            }
            let scale = Scale::of(histories, history.quantity, main);
            draw_history(canvas, history, top, main, &scale, i + 1 == histories.len())?;
        }
        let top = HEAD + row * histories.len() as f64 + AXIS + CAPTION;
        draw_damage(canvas, damage, top, BARS)
    })?;
    output::write(&[(path, svg.as_bytes())])
}

/// The vertical scale that all channels of a quantity share, so that the eye can compare them.
struct Scale {
    /// Largest value on the axis.
    reach: f64,
    /// How many times larger the residual is drawn.
    magnification: f64,
}

impl Scale {
    fn of(histories: &[History<'_>], quantity: Quantity, main: f64) -> Self {
        let alike = || histories.iter().filter(|history| history.quantity == quantity);
        let peak = |values: &mut dyn Iterator<Item = f64>| values.fold(0.0_f64, |peak, v| peak.max(v.abs()));
        let all = alike().flat_map(|history| history.measured.iter().chain(history.fitted));
        let reach = match peak(&mut all.copied()) {
            largest if largest > 0.0 && largest.is_finite() => 1.08 * largest,
            _ => 1.0,
        };
        let largest = peak(&mut alike().flat_map(History::residual));
        let magnification = (MAGNIFICATIONS.into_iter())
            .find(|factor| largest * factor <= reach * STRIP / main)
            .unwrap_or(1.0);
        Self { reach, magnification }
    }
}

fn draw_history(
    canvas: &Canvas<'_>,
    history: &History<'_>,
    top: f64,
    main: f64,
    scale: &Scale,
    with_time: bool,
) -> Result<()> {
    let time = |i: usize| history.start_s + i as f64 * history.interval_s;
    let times = (time(0), time(history.measured.len().saturating_sub(1).max(1)));
    let along = ticks(times.0, times.1, 10);
    let points = |values: &mut dyn Iterator<Item = f64>| -> Vec<(f64, f64)> {
        values.enumerate().map(|(i, v)| (time(i), v)).collect()
    };

    let panel = canvas.panel(top, main, times, (-scale.reach, scale.reach));
    panel.grid(&along, &ticks(-scale.reach, scale.reach, 6))?;
    panel.y_label(match history.quantity {
        Quantity::Acceleration => "acceleration, m/s²",
        Quantity::Displacement => "displacement, mm",
    })?;
    panel.line(&points(&mut history.measured.iter().copied()), INK, MEASURED)?;
    panel.line(
        &points(&mut history.fitted.iter().copied()),
        VERMILION.mix(FITTED_OPACITY),
        FITTED,
    )?;

    let below = top + main + STRIP_CAPTION;
    let half = scale.reach * STRIP / main / scale.magnification;
    let strip = canvas.panel(below, STRIP, times, (-half, half));
    strip.grid(&along, &around_zero(half))?;
    strip.line(&points(&mut history.residual()), BLUE, 1.0)?;
    let caption = if scale.magnification > 1.0 {
        format!("measured minus fitted, drawn {} times as large", scale.magnification)
    } else {
        "measured minus fitted".to_owned()
    };
    canvas.text(&caption, LEFT, below - 11.0, SMALL, SOFT, HPos::Left)?;
    if with_time {
        strip.x_axis(&along, "time, s")?;
    }
    Ok(())
}

fn draw_damage(canvas: &Canvas<'_>, bars: &DamageBars<'_>, top: f64, height: f64) -> Result<()> {
    let elements = bars.damage.len();
    let panel = canvas.panel(top, height, (0.5, elements as f64 + 0.5), (0.0, DAMAGE_SCALE_PERCENT));
    canvas.text("Damage by element", LEFT, top - 13.0, BODY, INK, HPos::Left)?;
    let rival = bars.rival.filter(|rival| rival.loses_by < RIVAL_DRAWN);
    let mut marks = vec![(Mark::Box(SKY), "identified".to_owned())];
    if bars.interval.is_some() {
        marks.push((Mark::Whisker, "95 % interval".to_owned()));
    }
    if bars.truth.is_some() {
        marks.push((Mark::Diamond, "true".to_owned()));
    }
    if let Some(rival) = rival {
        let label = format!(
            "were element {} whole: {:.0} standard deviations worse",
            rival.whole, rival.loses_by
        );
        marks.push((Mark::Box(PALE), label));
    }
    let marks: Vec<(Mark, &str)> = marks.iter().map(|(mark, label)| (*mark, label.as_str())).collect();
    canvas.legend(top - 13.0, &marks)?;
    panel.grid(&Ticks::none(), &ticks(0.0, DAMAGE_SCALE_PERCENT, 7))?;
    panel.y_label("loss of bending stiffness, %")?;
    for (e, damage) in bars.damage.iter().enumerate() {
        let x = (e + 1) as f64;
        panel.bar(x, BAR, 100.0 * damage, SKY)?;
        if let Some(&loss) = rival.and_then(|rival| rival.damage.get(e)) {
            panel.bar(x + (BAR + RIVAL_BAR) / 2.0, RIVAL_BAR, 100.0 * loss, PALE)?;
        }
        if let Some([low, high]) = bars.interval
            && let (Some(low), Some(high)) = (low.get(e), high.get(e))
        {
            panel.whisker(x, 100.0 * low, 100.0 * high)?;
        }
        if let Some(truth) = bars.truth.and_then(|truth| truth.get(e)) {
            panel.diamond(x, 100.0 * truth)?;
        }
    }
    let labels = Ticks {
        values: (1..=elements).map(|e| e as f64).collect(),
        decimals: 0,
        logarithmic: false,
    };
    panel.x_axis(&labels, "element, from the end by which the train enters")
}

/// Draws mode shapes into the SVG file at `path`, a row a shape: its label and its values at equal distances along the
/// bridge. `node_m` are the places of the nodes, m; `held` the numbers (from 1) of those on supports.
pub fn mode_shapes(path: &Path, title: &str, node_m: &[f64], held: &[u16], shapes: &[(&str, &[f64])]) -> Result<()> {
    const HEAD: f64 = 56.0;
    const ROW: f64 = 150.0;
    const CAPTION: f64 = 34.0;
    const AXIS: f64 = 62.0;
    let length = node_m.last().copied().unwrap_or(1.0);
    let svg = Svg::draw(HEAD + shapes.len() as f64 * (CAPTION + ROW) + AXIS, |canvas| {
        canvas.text(title, LEFT, 30.0, TITLE, INK, HPos::Left)?;
        for (k, (label, shape)) in shapes.iter().enumerate() {
            let top = HEAD + k as f64 * (CAPTION + ROW) + CAPTION;
            canvas.text(label, LEFT, top - 12.0, BODY, INK, HPos::Left)?;
            let panel = canvas.panel(top, ROW, (0.0, length), (-1.25, 1.25));
            let along = ticks(0.0, length, 10);
            panel.grid(&along, &ticks(-1.0, 1.0, 2))?;
            let last = (shape.len() - 1).max(1) as f64;
            let points: Vec<(f64, f64)> = (shape.iter().enumerate())
                .map(|(i, &w)| (i as f64 / last * length, w))
                .collect();
            panel.area(&points, SKY)?;
            panel.line(&[(0.0, 0.0), (length, 0.0)], SOFT, 1.0)?;
            panel.line(&points, BLUE, 2.2)?;
            for (i, &x) in node_m.iter().enumerate() {
                let place = x / length * last;
                let (left, part) = (place.floor() as usize, place.fract());
                let right = shape[(left + 1).min(shape.len() - 1)];
                panel.dot(x, shape[left] * (1.0 - part) + right * part, BLUE)?;
                if held.contains(&(i as u16 + 1)) {
                    panel.support(x)?;
                }
            }
            if k + 1 == shapes.len() {
                panel.x_axis(&along, "distance from node 1, m; dots: nodes, triangles: supports")?;
            }
        }
        Ok(())
    })?;
    output::write(&[(path, svg.as_bytes())])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_are_round_numbers_with_no_more_decimals_than_they_need() {
        let axis = ticks(-0.13, 0.13, 6);
        let texts: Vec<String> = axis.values.iter().map(|&v| axis.text(v)).collect();
        assert_eq!(texts, ["−0.10", "−0.05", "0.00", "0.05", "0.10"]);
        let axis = ticks(0.0, 7.05, 10);
        assert_eq!(axis.text(axis.values[7]), "7");
        assert!(ticks(1.0, 1.0, 5).values.is_empty());
    }

    #[test]
    fn a_picture_of_silence_or_of_anything_else_has_finite_coordinates_only() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("x.svg");
        for value in [0.0, 1e-9, 1e6] {
            let measured = vec![value; 50];
            let history = History {
                label: "node 6 <&>",
                quantity: Quantity::Acceleration,
                start_s: 0.0,
                interval_s: 0.005,
                measured: &measured,
                fitted: &vec![0.0; 50],
            };
            let bars = DamageBars {
                damage: &[0.0, 0.3, 2.0],
                interval: Some([&[0.0; 3], &[0.0, 0.1, f64::INFINITY]]),
                rival: Some(RivalBars {
                    damage: &[0.0, 0.5],
                    whole: 1,
                    loses_by: value,
                }),
                truth: None,
            };
            identification(&path, "title", "subtitle", &[history; 3], &bars).expect("a picture");
            let text = std::fs::read_to_string(&path).expect("the picture");
            assert!(text.starts_with("<svg width=\"1100\""), "{}", &text[..80]);
            assert!(text.contains("node 6 &lt;&amp;&gt;"));
            assert!(!text.contains("NaN") && !text.contains("inf"));
        }
    }
}
