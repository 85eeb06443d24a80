//! What pictures are drawn with: a canvas in pixels, panels with axes, round numbers along them, signs of a legend.

use std::fmt::Write as _;

use anyhow::{Result, anyhow};
use plotters::coord::Shift;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

/// The canvas has this many units to a pixel, since plotters places on whole units only.
const UNITS: f64 = 8.0;
/// Width of all pictures, px.
pub(super) const WIDTH: f64 = 1100.0;
/// Space left and right of the panels, px.
pub(super) const LEFT: f64 = 82.0;
pub(super) const RIGHT: f64 = 28.0;

pub(super) const INK: RGBColor = RGBColor(0x22, 0x22, 0x22);
pub(super) const SOFT: RGBColor = RGBColor(0x66, 0x66, 0x66);
pub(super) const GRID: RGBColor = RGBColor(0xE4, 0xE4, 0xE4);
pub(super) const BLUE: RGBColor = RGBColor(0x00, 0x72, 0xB2);
pub(super) const SKY: RGBColor = RGBColor(0x8C, 0xC8, 0xEA);
pub(super) const PALE: RGBColor = RGBColor(0xC9, 0xC9, 0xC9);
pub(super) const VERMILION: RGBColor = RGBColor(0xD5, 0x5E, 0x00);
pub(super) const GREEN: RGBColor = RGBColor(0x00, 0x9E, 0x73);

/// Text sizes, px.
pub(super) const TITLE: f64 = 22.0;
pub(super) const BODY: f64 = 14.0;
pub(super) const SMALL: f64 = 13.0;

/// Round numbers along an axis.
pub(super) struct Ticks {
    pub(super) values: Vec<f64>,
    pub(super) decimals: usize,
    /// The axis shows the logarithm; numbers are written as what it is taken of.
    pub(super) logarithmic: bool,
}

impl Ticks {
    pub(super) fn none() -> Self {
        Self {
            values: Vec::new(),
            decimals: 0,
            logarithmic: false,
        }
    }

    pub(super) fn text(&self, value: f64) -> String {
        if self.logarithmic {
            let number = 10_f64.powf(value);
            return match number {
                1e6.. => format!("{:.0} million", number / 1e6),
                1.0.. => format!("{number:.0}"),
                _ => format!("{number:.*}", (-value).ceil() as usize),
            };
        }
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
pub(super) fn ticks(low: f64, high: f64, count: usize) -> Ticks {
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
        logarithmic: false,
    }
}

/// The powers of ten, and 2 and 5 times these on a short axis, whose logarithm is from `low` to `high`.
pub(super) fn decades(low: f64, high: f64) -> Ticks {
    let factors: &[f64] = if high - low > 2.5 { &[1.0] } else { &[1.0, 2.0, 5.0] };
    let powers = low.floor() as i32..=high.ceil() as i32;
    Ticks {
        values: powers
            .flat_map(|power| factors.iter().map(move |factor| f64::from(power) + factor.log10()))
            .filter(|value| (low - 1e-9..=high + 1e-9).contains(value))
            .collect(),
        decimals: 0,
        logarithmic: true,
    }
}

/// Zero and the largest round number to either side that stays clear of `half`.
pub(super) fn around_zero(half: f64) -> Ticks {
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
        logarithmic: false,
    }
}

/// A sign in a legend.
#[derive(Clone, Copy)]
pub(super) enum Mark {
    Line(RGBAColor, f64),
    Dashed(RGBAColor, f64),
    Box(RGBColor),
    Whisker,
    Diamond,
}

/// The whole drawing, with coordinates in pixels.
pub(super) struct Canvas<'a> {
    area: DrawingArea<SVGBackend<'a>, Shift>,
}

/// A frame with axes.
pub(super) struct Panel<'c, 'a> {
    canvas: &'c Canvas<'a>,
    top: f64,
    height: f64,
    x: (f64, f64),
    y: (f64, f64),
}

/// Makes the text of an SVG.
pub(super) struct Svg;

impl Svg {
    pub(super) fn draw(height: f64, draw: impl FnOnce(&Canvas<'_>) -> Result<()>) -> Result<String> {
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
    pub(super) fn panel(&self, top: f64, height: f64, x: (f64, f64), y: (f64, f64)) -> Panel<'_, 'a> {
        Panel {
            canvas: self,
            top,
            height,
            x,
            y,
        }
    }

    pub(super) fn path(&self, points: Vec<(i32, i32)>, style: ShapeStyle) -> Result<()> {
        self.area.draw(&PathElement::new(points, style)).map_err(failed)
    }

    /// A line through points in pixels.
    pub(super) fn stroke(&self, points: &[(f64, f64)], colour: impl Into<RGBAColor>, width: f64) -> Result<()> {
        let points = points.iter().map(|&(x, y)| at(x, y)).collect();
        self.path(points, stroke(colour, width))
    }

    /// A round spot.
    pub(super) fn spot(&self, x: f64, y: f64, radius: f64, colour: RGBColor) -> Result<()> {
        self.area
            .draw(&Circle::new(at(x, y), units(radius), colour.filled()))
            .map_err(failed)
    }

    /// A line of dashes through points in pixels.
    fn dashed(&self, points: &[(f64, f64)], style: ShapeStyle) -> Result<()> {
        const DASH: f64 = 7.0;
        const GAP: f64 = 4.0;
        let mut walked = 0.0;
        let mut dash = Vec::new();
        for pair in points.windows(2) {
            let ((x0, y0), (x1, y1)) = (pair[0], pair[1]);
            let length = (x1 - x0).hypot(y1 - y0);
            let mut done = 0.0;
            while done < length {
                let phase = walked % (DASH + GAP);
                let rest = if phase < DASH { DASH } else { DASH + GAP } - phase;
                // Never so little that rounding would make no way.
                let next = (done + rest.max(1e-3)).min(length);
                let at_part = |part: f64| at(x0 + (x1 - x0) * part / length, y0 + (y1 - y0) * part / length);
                if phase < DASH {
                    if dash.is_empty() {
                        dash.push(at_part(done));
                    }
                    dash.push(at_part(next));
                } else if !dash.is_empty() {
                    self.path(std::mem::take(&mut dash), style)?;
                }
                walked += next - done;
                done = next;
            }
        }
        self.path(dash, style)
    }

    pub(super) fn text(&self, text: &str, x: f64, y: f64, size: f64, colour: RGBColor, side: HPos) -> Result<()> {
        let style = TextStyle::from(("sans-serif", size * UNITS * 1.24).into_font())
            .color(&colour)
            .pos(Pos::new(side, VPos::Center));
        self.area
            .draw(&Text::new(text.to_owned(), at(x, y), style))
            .map_err(failed)
    }

    pub(super) fn rotated(&self, text: &str, x: f64, y: f64, size: f64) -> Result<()> {
        let font = ("sans-serif", size * UNITS * 1.24).into_font();
        let style = TextStyle::from(font.transform(FontTransform::Rotate270))
            .color(&INK)
            .pos(Pos::new(HPos::Center, VPos::Center));
        self.area
            .draw(&Text::new(text.to_owned(), at(x, y), style))
            .map_err(failed)
    }

    /// A legend in one line, ending at the right edge of the panels.
    pub(super) fn legend(&self, y: f64, marks: &[(Mark, &str)]) -> Result<()> {
        // Widths of letters are not known here: a generous mean.
        let width = |label: &str| 34.0 + 7.2 * label.chars().count() as f64 + 18.0;
        let mut x = WIDTH - RIGHT + 18.0 - marks.iter().map(|(_, label)| width(label)).sum::<f64>();
        for (mark, label) in marks {
            match *mark {
                Mark::Line(colour, thick) => self.path(vec![at(x, y), at(x + 26.0, y)], stroke(colour, thick))?,
                Mark::Dashed(colour, thick) => self.dashed(&[(x, y), (x + 26.0, y)], stroke(colour, thick))?,
                Mark::Box(colour) => self.fill(x + 6.0, y - 6.0, x + 26.0, y + 6.0, colour)?,
                Mark::Whisker => self.whisker(x + 16.0, y - 7.0, y + 7.0)?,
                Mark::Diamond => self.diamond(x + 16.0, y)?,
            }
            self.text(label, x + 34.0, y, SMALL, INK, HPos::Left)?;
            x += width(label);
        }
        Ok(())
    }

    pub(super) fn fill(&self, x0: f64, y0: f64, x1: f64, y1: f64, colour: RGBColor) -> Result<()> {
        self.area
            .draw(&Rectangle::new([at(x0, y0), at(x1, y1)], colour.filled()))
            .map_err(failed)
    }

    pub(super) fn whisker(&self, x: f64, y0: f64, y1: f64) -> Result<()> {
        const CAP: f64 = 5.0;
        self.path(vec![at(x, y0), at(x, y1)], stroke(INK, 1.4))?;
        self.path(vec![at(x - CAP, y0), at(x + CAP, y0)], stroke(INK, 1.4))?;
        self.path(vec![at(x - CAP, y1), at(x + CAP, y1)], stroke(INK, 1.4))
    }

    pub(super) fn diamond(&self, x: f64, y: f64) -> Result<()> {
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
    pub(super) fn px(&self, x: f64) -> f64 {
        LEFT + (x - self.x.0) / (self.x.1 - self.x.0) * (WIDTH - LEFT - RIGHT)
    }

    pub(super) fn py(&self, y: f64) -> f64 {
        let y = y.clamp(self.y.0, self.y.1);
        self.top + (self.y.1 - y) / (self.y.1 - self.y.0) * self.height
    }

    pub(super) fn bottom(&self) -> f64 {
        self.top + self.height
    }

    /// Frame, grid and the numbers of the vertical axis.
    pub(super) fn grid(&self, x: &Ticks, y: &Ticks) -> Result<()> {
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

    pub(super) fn x_axis(&self, ticks: &Ticks, label: &str) -> Result<()> {
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

    pub(super) fn y_label(&self, label: &str) -> Result<()> {
        self.canvas.rotated(label, 22.0, self.top + self.height / 2.0, BODY)
    }

    pub(super) fn line(&self, points: &[(f64, f64)], colour: impl Into<RGBAColor>, width: f64) -> Result<()> {
        let points = points.iter().map(|&(x, y)| at(self.px(x), self.py(y))).collect();
        self.canvas.path(points, stroke(colour, width))
    }

    pub(super) fn dashed(&self, points: &[(f64, f64)], colour: impl Into<RGBAColor>, width: f64) -> Result<()> {
        let points: Vec<_> = points.iter().map(|&(x, y)| (self.px(x), self.py(y))).collect();
        self.canvas.dashed(&points, stroke(colour, width))
    }

    pub(super) fn area(&self, points: &[(f64, f64)], colour: RGBColor) -> Result<()> {
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

    /// The area between two heights at each place.
    pub(super) fn band(&self, points: &[(f64, [f64; 2])], colour: RGBColor) -> Result<()> {
        let low = points.iter().map(|&(x, ends)| (x, ends[0]));
        let high = points.iter().rev().map(|&(x, ends)| (x, ends[1]));
        let outline: Vec<_> = low.chain(high).map(|(x, y)| at(self.px(x), self.py(y))).collect();
        self.canvas
            .area
            .draw(&Polygon::new(outline, colour.filled()))
            .map_err(failed)
    }

    pub(super) fn bar(&self, x: f64, width: f64, value: f64, colour: RGBColor) -> Result<()> {
        let half = width / 2.0;
        self.canvas.fill(
            self.px(x - half),
            self.py(value),
            self.px(x + half),
            self.py(0.0),
            colour,
        )
    }

    pub(super) fn whisker(&self, x: f64, low: f64, high: f64) -> Result<()> {
        self.canvas.whisker(self.px(x), self.py(low), self.py(high))
    }

    pub(super) fn diamond(&self, x: f64, value: f64) -> Result<()> {
        self.canvas.diamond(self.px(x), self.py(value))
    }

    pub(super) fn dot(&self, x: f64, y: f64, colour: RGBColor) -> Result<()> {
        self.canvas
            .area
            .draw(&Circle::new(at(self.px(x), self.py(y)), units(3.2), colour.filled()))
            .map_err(failed)
    }

    /// A support's triangle under the zero line.
    pub(super) fn support(&self, x: f64) -> Result<()> {
        let (x, y) = (self.px(x), self.py(0.0) + 4.0);
        let corners = vec![at(x, y), at(x - 8.0, y + 14.0), at(x + 8.0, y + 14.0)];
        self.canvas
            .area
            .draw(&Polygon::new(corners, INK.filled()))
            .map_err(failed)
    }
}
