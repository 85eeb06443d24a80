//! Pictures (SVG): what was identified from a passage, and the mode shapes of a bridge.
//!
//! Colours are of the palette of Okabe and Ito, which colour-blind eyes tell apart; no meaning rests on colour alone.

use std::fmt::Write as _;
use std::path::Path;

use anyhow::{Result, anyhow};
use plotters::coord::Shift;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

use crate::output;

/// The canvas has this many units to a pixel, since plotters places on whole units only.
const UNITS: f64 = 8.0;
/// Width of all pictures, px.
const WIDTH: f64 = 1100.0;
/// Space left and right of the panels, px.
const LEFT: f64 = 82.0;
const RIGHT: f64 = 28.0;

const INK: RGBColor = RGBColor(0x22, 0x22, 0x22);
const SOFT: RGBColor = RGBColor(0x66, 0x66, 0x66);
const GRID: RGBColor = RGBColor(0xE4, 0xE4, 0xE4);
const BLUE: RGBColor = RGBColor(0x00, 0x72, 0xB2);
const SKY: RGBColor = RGBColor(0x8C, 0xC8, 0xEA);
const VERMILION: RGBColor = RGBColor(0xD5, 0x5E, 0x00);

/// Text sizes, px.
const TITLE: f64 = 22.0;
const BODY: f64 = 14.0;
const SMALL: f64 = 13.0;

/// Largest damage on the scale, %.
const DAMAGE_SCALE_PERCENT: f64 = 70.0;
/// Standard deviations to either side of an interval that holds the truth 95 times in 100.
const DEVIATIONS_95: f64 = 1.96;
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
    /// Time of the first sample, s.
    pub start_s: f64,
    /// Time between samples, s.
    pub interval_s: f64,
    /// Recorded acceleration, m/s².
    pub measured: &'a [f64],
    /// Acceleration of the fitted model, m/s²; as many samples.
    pub fitted: &'a [f64],
}

/// The damage of each element, as fractions of bending stiffness lost; all slices of the same length.
#[derive(Debug, Clone, Copy)]
pub struct DamageBars<'a> {
    /// As identified.
    pub damage: &'a [f64],
    /// Standard deviation of each, where known.
    pub std: Option<&'a [f64]>,
    /// The true damage, where known.
    pub truth: Option<&'a [f64]>,
}

impl<'a> History<'a> {
    fn residual(&self) -> impl Iterator<Item = f64> + use<'a> {
        self.measured.iter().zip(self.fitted).map(|(m, f)| m - f)
    }
}

/// Draws an identification into the SVG file at `path`: measured and fitted history with the residual below, a row a
/// channel, then the damage by element with its ± 2 standard deviations.
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
    let scale = Scale::of(histories, main);
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
            draw_history(canvas, history, top, main, &scale, i + 1 == histories.len())?;
        }
        let top = HEAD + row * histories.len() as f64 + AXIS + CAPTION;
        draw_damage(canvas, damage, top, BARS)
    })?;
    output::write(&[(path, svg.as_bytes())])
}

/// The vertical scale that all channels share, so that the eye can compare them.
struct Scale {
    /// Largest acceleration on the axis, m/s².
    reach: f64,
    /// How many times larger the residual is drawn.
    magnification: f64,
}

impl Scale {
    fn of(histories: &[History<'_>], main: f64) -> Self {
        let peak = |values: &mut dyn Iterator<Item = f64>| values.fold(0.0_f64, |peak, v| peak.max(v.abs()));
        let all = (histories.iter()).flat_map(|history| history.measured.iter().chain(history.fitted));
        let reach = match peak(&mut all.copied()) {
            largest if largest > 0.0 && largest.is_finite() => 1.08 * largest,
            _ => 1.0,
        };
        let largest = peak(&mut histories.iter().flat_map(History::residual));
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
    panel.y_label("acceleration, m/s²")?;
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
    let mut marks = vec![(Mark::Box(SKY), "identified")];
    if bars.std.is_some() {
        marks.push((Mark::Whisker, "± 2 standard deviations"));
    }
    if bars.truth.is_some() {
        marks.push((Mark::Diamond, "true"));
    }
    canvas.legend(top - 13.0, &marks)?;
    panel.grid(&Ticks::none(), &ticks(0.0, DAMAGE_SCALE_PERCENT, 7))?;
    panel.y_label("loss of bending stiffness, %")?;
    for (e, damage) in bars.damage.iter().enumerate() {
        let x = (e + 1) as f64;
        let percent = 100.0 * damage;
        panel.bar(x, 0.52, percent, SKY)?;
        if let Some(std) = bars.std.and_then(|std| std.get(e)) {
            let half = 100.0 * DEVIATIONS_95 * std;
            panel.whisker(x, percent - half, percent + half)?;
        }
        if let Some(truth) = bars.truth.and_then(|truth| truth.get(e)) {
            panel.diamond(x, 100.0 * truth)?;
        }
    }
    let labels = Ticks {
        values: (1..=elements).map(|e| e as f64).collect(),
        decimals: 0,
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
                panel.dot(x, shape[left] * (1.0 - part) + right * part)?;
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

/// Round numbers along an axis.
struct Ticks {
    values: Vec<f64>,
    decimals: usize,
}

impl Ticks {
    fn none() -> Self {
        Self {
            values: Vec::new(),
            decimals: 0,
        }
    }

    fn text(&self, value: f64) -> String {
        let text = format!("{:.*}", self.decimals, value);
        // A typographic minus; no minus before zero.
        match text.strip_prefix('-') {
            Some(digits) if digits.bytes().all(|b| b == b'0' || b == b'.') => digits.to_owned(),
            Some(digits) => format!("−{digits}"),
            None => text,
        }
    }
}

/// About `count` multiples of 1, 2 or 5 times a power of ten from `low` to `high`.
fn ticks(low: f64, high: f64, count: usize) -> Ticks {
    let span = high - low;
    if !(span > 0.0 && span.is_finite()) {
        return Ticks::none();
    }
    let rough = span / count as f64;
    let power = rough.log10().floor();
    let decade = 10_f64.powf(power);
    let factor = [1.0, 2.0, 5.0, 10.0]
        .into_iter()
        .find(|factor| factor * decade >= rough * 0.999)
        .unwrap_or(10.0);
    let step = factor * decade;
    let first = (low / step - 1e-9).ceil() as i64;
    let last = (high / step + 1e-9).floor() as i64;
    Ticks {
        values: (first..=last).map(|k| k as f64 * step).collect(),
        decimals: (-step.log10().floor()).max(0.0) as usize,
    }
}

/// Zero and the largest round number to either side that stays clear of `half`.
fn around_zero(half: f64) -> Ticks {
    let limit = 0.85 * half;
    let decade = 10_f64.powf(limit.log10().floor());
    let step = decade
        * [8.0, 6.0, 5.0, 4.0, 3.0, 2.0]
            .into_iter()
            .find(|k| k * decade <= limit)
            .unwrap_or(1.0);
    Ticks {
        values: vec![-step, 0.0, step],
        decimals: (-step.log10().floor()).max(0.0) as usize,
    }
}

/// A sign in a legend.
#[derive(Clone, Copy)]
enum Mark {
    Line(RGBAColor, f64),
    Box(RGBColor),
    Whisker,
    Diamond,
}

/// The whole drawing, with coordinates in pixels.
struct Canvas<'a> {
    area: DrawingArea<SVGBackend<'a>, Shift>,
}

/// A frame with axes.
struct Panel<'c, 'a> {
    canvas: &'c Canvas<'a>,
    top: f64,
    height: f64,
    x: (f64, f64),
    y: (f64, f64),
}

/// Makes the text of an SVG.
struct Svg;

impl Svg {
    fn draw(height: f64, draw: impl FnOnce(&Canvas<'_>) -> Result<()>) -> Result<String> {
        let mut text = String::new();
        let size = (units(WIDTH) as u32, units(height) as u32);
        {
            let area = SVGBackend::with_string(&mut text, size).into_drawing_area();
            area.fill(&WHITE).map_err(failed)?;
            let canvas = Canvas { area };
            draw(&canvas)?;
            canvas.area.present().map_err(failed)?;
        }
        // The canvas keeps its fine units; the picture gets its size in pixels.
        let fine = format!("width=\"{}\" height=\"{}\"", size.0, size.1);
        let mut pixels = String::new();
        let _ = write!(pixels, "width=\"{WIDTH}\" height=\"{height}\"");
        Ok(text.replacen(&fine, &pixels, 1).replace(
            "font-family=\"sans-serif\"",
            "font-family=\"Helvetica, Arial, 'Liberation Sans', 'DejaVu Sans', sans-serif\"",
        ))
    }
}

fn failed(error: impl std::fmt::Display) -> anyhow::Error {
    anyhow!("cannot draw the picture: {error}")
}

fn units(pixels: f64) -> i32 {
    (pixels * UNITS).round() as i32
}

fn at(x: f64, y: f64) -> (i32, i32) {
    (units(x), units(y))
}

fn stroke(colour: impl Into<RGBAColor>, width: f64) -> ShapeStyle {
    ShapeStyle {
        color: colour.into(),
        filled: false,
        stroke_width: units(width) as u32,
    }
}

impl<'a> Canvas<'a> {
    fn panel(&self, top: f64, height: f64, x: (f64, f64), y: (f64, f64)) -> Panel<'_, 'a> {
        Panel {
            canvas: self,
            top,
            height,
            x,
            y,
        }
    }

    fn path(&self, points: Vec<(i32, i32)>, style: ShapeStyle) -> Result<()> {
        self.area.draw(&PathElement::new(points, style)).map_err(failed)
    }

    fn text(&self, text: &str, x: f64, y: f64, size: f64, colour: RGBColor, side: HPos) -> Result<()> {
        let style = TextStyle::from(("sans-serif", size * UNITS * 1.24).into_font())
            .color(&colour)
            .pos(Pos::new(side, VPos::Center));
        self.area
            .draw(&Text::new(text.to_owned(), at(x, y), style))
            .map_err(failed)
    }

    fn rotated(&self, text: &str, x: f64, y: f64, size: f64) -> Result<()> {
        let font = ("sans-serif", size * UNITS * 1.24).into_font();
        let style = TextStyle::from(font.transform(FontTransform::Rotate270))
            .color(&INK)
            .pos(Pos::new(HPos::Center, VPos::Center));
        self.area
            .draw(&Text::new(text.to_owned(), at(x, y), style))
            .map_err(failed)
    }

    /// A legend in one line, ending at the right edge of the panels.
    fn legend(&self, y: f64, marks: &[(Mark, &str)]) -> Result<()> {
        // Widths of letters are not known here: a generous mean.
        let width = |label: &str| 34.0 + 7.2 * label.chars().count() as f64 + 18.0;
        let mut x = WIDTH - RIGHT + 18.0 - marks.iter().map(|(_, label)| width(label)).sum::<f64>();
        for (mark, label) in marks {
            match *mark {
                Mark::Line(colour, thick) => self.path(vec![at(x, y), at(x + 26.0, y)], stroke(colour, thick))?,
                Mark::Box(colour) => self.fill(x + 6.0, y - 6.0, x + 26.0, y + 6.0, colour)?,
                Mark::Whisker => self.whisker(x + 16.0, y - 7.0, y + 7.0)?,
                Mark::Diamond => self.diamond(x + 16.0, y)?,
            }
            self.text(label, x + 34.0, y, SMALL, INK, HPos::Left)?;
            x += width(label);
        }
        Ok(())
    }

    fn fill(&self, x0: f64, y0: f64, x1: f64, y1: f64, colour: RGBColor) -> Result<()> {
        self.area
            .draw(&Rectangle::new([at(x0, y0), at(x1, y1)], colour.filled()))
            .map_err(failed)
    }

    fn whisker(&self, x: f64, y0: f64, y1: f64) -> Result<()> {
        const CAP: f64 = 5.0;
        self.path(vec![at(x, y0), at(x, y1)], stroke(INK, 1.4))?;
        self.path(vec![at(x - CAP, y0), at(x + CAP, y0)], stroke(INK, 1.4))?;
        self.path(vec![at(x - CAP, y1), at(x + CAP, y1)], stroke(INK, 1.4))
    }

    fn diamond(&self, x: f64, y: f64) -> Result<()> {
        const HALF: f64 = 6.0;
        let corners = vec![at(x, y - HALF), at(x + HALF, y), at(x, y + HALF), at(x - HALF, y)];
        self.area
            .draw(&Polygon::new(corners.clone(), VERMILION.filled()))
            .map_err(failed)?;
        let outline = corners.iter().chain(corners.first()).copied().collect();
        self.path(outline, stroke(WHITE, 1.2))
    }
}

impl Panel<'_, '_> {
    fn px(&self, x: f64) -> f64 {
        LEFT + (x - self.x.0) / (self.x.1 - self.x.0) * (WIDTH - LEFT - RIGHT)
    }

    fn py(&self, y: f64) -> f64 {
        let y = y.clamp(self.y.0, self.y.1);
        self.top + (self.y.1 - y) / (self.y.1 - self.y.0) * self.height
    }

    fn bottom(&self) -> f64 {
        self.top + self.height
    }

    /// Frame, grid and the numbers of the vertical axis.
    fn grid(&self, x: &Ticks, y: &Ticks) -> Result<()> {
        let (left, right) = (LEFT, WIDTH - RIGHT);
        for &value in &x.values {
            let place = self.px(value);
            self.canvas
                .path(vec![at(place, self.top), at(place, self.bottom())], stroke(GRID, 1.0))?;
        }
        for &value in &y.values {
            let place = self.py(value);
            self.canvas
                .path(vec![at(left, place), at(right, place)], stroke(GRID, 1.0))?;
            self.canvas
                .text(&y.text(value), left - 8.0, place, SMALL, SOFT, HPos::Right)?;
        }
        let frame = [
            (left, self.top),
            (right, self.top),
            (right, self.bottom()),
            (left, self.bottom()),
        ];
        let closed = frame.iter().chain(&frame[..1]).map(|&(x, y)| at(x, y)).collect();
        self.canvas.path(closed, stroke(RGBColor(0xB0, 0xB0, 0xB0), 1.0))
    }

    fn x_axis(&self, ticks: &Ticks, label: &str) -> Result<()> {
        for &value in &ticks.values {
            self.canvas.text(
                &ticks.text(value),
                self.px(value),
                self.bottom() + 15.0,
                SMALL,
                SOFT,
                HPos::Center,
            )?;
        }
        let middle = (LEFT + WIDTH - RIGHT) / 2.0;
        self.canvas
            .text(label, middle, self.bottom() + 39.0, BODY, INK, HPos::Center)
    }

    fn y_label(&self, label: &str) -> Result<()> {
        self.canvas.rotated(label, 22.0, self.top + self.height / 2.0, BODY)
    }

    fn line(&self, points: &[(f64, f64)], colour: impl Into<RGBAColor>, width: f64) -> Result<()> {
        let points = points.iter().map(|&(x, y)| at(self.px(x), self.py(y))).collect();
        self.canvas.path(points, stroke(colour, width))
    }

    fn area(&self, points: &[(f64, f64)], colour: RGBColor) -> Result<()> {
        let (first, last) = (points.first().map_or(0.0, |p| p.0), points.last().map_or(0.0, |p| p.0));
        let outline: Vec<_> = std::iter::once((first, 0.0))
            .chain(points.iter().copied())
            .chain([(last, 0.0)])
            .map(|(x, y)| at(self.px(x), self.py(y)))
            .collect();
        self.canvas
            .area
            .draw(&Polygon::new(outline, colour.mix(0.35).filled()))
            .map_err(failed)
    }

    fn bar(&self, x: f64, width: f64, value: f64, colour: RGBColor) -> Result<()> {
        let half = width / 2.0;
        self.canvas.fill(
            self.px(x - half),
            self.py(value),
            self.px(x + half),
            self.py(0.0),
            colour,
        )
    }

    fn whisker(&self, x: f64, low: f64, high: f64) -> Result<()> {
        self.canvas.whisker(self.px(x), self.py(low), self.py(high))
    }

    fn diamond(&self, x: f64, value: f64) -> Result<()> {
        self.canvas.diamond(self.px(x), self.py(value))
    }

    fn dot(&self, x: f64, y: f64) -> Result<()> {
        self.canvas
            .area
            .draw(&Circle::new(at(self.px(x), self.py(y)), units(3.2), BLUE.filled()))
            .map_err(failed)
    }

    /// A support's triangle under the zero line.
    fn support(&self, x: f64) -> Result<()> {
        let (x, y) = (self.px(x), self.py(0.0) + 4.0);
        let corners = vec![at(x, y), at(x - 8.0, y + 14.0), at(x + 8.0, y + 14.0)];
        self.canvas
            .area
            .draw(&Polygon::new(corners, INK.filled()))
            .map_err(failed)
    }
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
                start_s: 0.0,
                interval_s: 0.005,
                measured: &measured,
                fitted: &vec![0.0; 50],
            };
            let bars = DamageBars {
                damage: &[0.0, 0.3, 2.0],
                std: Some(&[0.0, 0.1, f64::INFINITY]),
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
