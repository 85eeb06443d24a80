//! Curves in panels, one below the other, on linear or logarithmic axes.

use anyhow::Result;
use plotters::prelude::RGBColor;
use plotters::style::Color;
use plotters::style::text_anchor::HPos;

use super::canvas::{
    BLUE, BODY, Canvas, GREEN, INK, LEFT, Mark, Panel, RIGHT, SMALL, SOFT, Svg, TITLE, VERMILION, WIDTH, decades, ticks,
};

/// Space above a panel for its caption and legend, and below for its axis, px.
const CAPTION: f64 = 40.0;
const AXIS: f64 = 58.0;
/// Space below a panel whose axis is that of the one under it, px.
const SHARED: f64 = 8.0;

/// Height for each number along a vertical axis, px.
const PIXELS_A_TICK: f64 = 24.0;

/// How an axis is divided.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Scale {
    /// Evenly.
    Linear,
    /// By powers of ten; what is not positive is not drawn.
    Logarithmic,
}

/// An axis.
#[derive(Debug, Clone)]
pub struct Axis {
    /// What it shows; an horizontal axis without a label is that of the panel below.
    pub label: String,
    /// How it is divided.
    pub scale: Scale,
    /// Its two ends.
    pub ends: (f64, f64),
}

impl Axis {
    /// An evenly divided axis.
    pub fn linear(label: &str, ends: (f64, f64)) -> Self {
        Self {
            label: label.to_owned(),
            scale: Scale::Linear,
            ends,
        }
    }

    /// An axis divided by powers of ten.
    pub fn logarithmic(label: &str, ends: (f64, f64)) -> Self {
        Self {
            label: label.to_owned(),
            scale: Scale::Logarithmic,
            ends,
        }
    }

    fn place(&self, value: f64) -> f64 {
        match self.scale {
            Scale::Linear => value,
            Scale::Logarithmic => value.log10(),
        }
    }

    fn range(&self) -> (f64, f64) {
        (self.place(self.ends.0), self.place(self.ends.1))
    }

    fn ticks(&self, count: usize) -> super::Ticks {
        let (low, high) = self.range();
        match self.scale {
            Scale::Linear => ticks(low, high, count),
            Scale::Logarithmic => decades(low, high),
        }
    }
}

/// How a curve looks; each differs from the others in more than colour.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Look {
    /// Blue, of middle width.
    Blue,
    /// Vermilion, dashed.
    Dashed,
    /// Green and broad.
    Broad,
    /// Dark and thin.
    Thin,
}

impl Look {
    fn colour(self) -> RGBColor {
        match self {
            Self::Blue => BLUE,
            Self::Dashed => VERMILION,
            Self::Broad => GREEN,
            Self::Thin => INK,
        }
    }

    fn width(self) -> f64 {
        match self {
            Self::Blue | Self::Dashed => 1.6,
            Self::Broad => 3.0,
            Self::Thin => 0.9,
        }
    }

    fn mark(self) -> Mark {
        let (colour, width) = (self.colour().to_rgba(), self.width());
        match self {
            Self::Dashed => Mark::Dashed(colour, width),
            _ => Mark::Line(colour, width),
        }
    }
}

/// A curve.
#[derive(Debug, Clone)]
pub struct Curve {
    /// Its name in the legend; the legend has none without.
    pub label: String,
    /// Its points; a point beyond the ends of an axis interrupts it.
    pub points: Vec<(f64, f64)>,
    /// How it looks.
    pub look: Look,
    /// Whether each point is shown as a dot.
    pub dots: bool,
}

/// A panel.
#[derive(Debug, Clone)]
pub struct Plot {
    /// What it shows.
    pub caption: String,
    /// Its height, px.
    pub height: f64,
    /// Horizontal axis.
    pub x: Axis,
    /// Vertical axis.
    pub y: Axis,
    /// The curves, each over those before it.
    pub curves: Vec<Curve>,
    /// A height that is marked by a line across, and the words at it.
    pub level: Option<(f64, String)>,
    /// A point that is marked by a diamond, and its name in the legend.
    pub mark: Option<(f64, f64, String)>,
}

/// The text of an SVG with the `plots` below each other under a title.
///
/// # Errors
/// If it cannot be drawn.
pub fn svg(title: &str, subtitle: &str, plots: &[Plot]) -> Result<String> {
    const HEAD: f64 = 76.0;
    let below = |plot: &Plot| if plot.x.label.is_empty() { SHARED } else { AXIS };
    let height: f64 = plots.iter().map(|plot| CAPTION + plot.height + below(plot)).sum();
    Svg::draw(HEAD + height, |canvas| {
        canvas.text(title, LEFT, 30.0, TITLE, INK, HPos::Left)?;
        canvas.text(subtitle, LEFT, 56.0, BODY, SOFT, HPos::Left)?;
        let mut top = HEAD;
        for plot in plots {
            draw(canvas, plot, top + CAPTION)?;
            top += CAPTION + plot.height + below(plot);
        }
        Ok(())
    })
}

fn draw(canvas: &Canvas<'_>, plot: &Plot, top: f64) -> Result<()> {
    canvas.text(&plot.caption, LEFT, top - 14.0, BODY, INK, HPos::Left)?;
    let mut marks: Vec<(Mark, &str)> = (plot.curves.iter())
        .filter(|curve| !curve.label.is_empty())
        .map(|curve| (curve.look.mark(), curve.label.as_str()))
        .collect();
    if let Some((_, _, name)) = &plot.mark {
        marks.push((Mark::Diamond, name));
    }
    canvas.legend(top - 14.0, &marks)?;
    let panel = canvas.panel(top, plot.height, plot.x.range(), plot.y.range());
    let along = plot.x.ticks(10);
    panel.grid(&along, &plot.y.ticks((plot.height / PIXELS_A_TICK) as usize))?;
    panel.y_label(&plot.y.label)?;
    if let Some((value, words)) = &plot.level {
        let (y, (low, high)) = (plot.y.place(*value), plot.x.range());
        panel.line(&[(low, y), (high, y)], SOFT, 1.4)?;
        canvas.text(words, WIDTH - RIGHT - 6.0, panel.py(y) - 9.0, SMALL, SOFT, HPos::Right)?;
    }
    for curve in &plot.curves {
        for piece in pieces(plot, curve) {
            draw_piece(&panel, curve, &piece)?;
        }
    }
    if let Some((x, y, _)) = &plot.mark {
        panel.diamond(plot.x.place(*x), plot.y.place(*y))?;
    }
    if !plot.x.label.is_empty() {
        panel.x_axis(&along, &plot.x.label)?;
    }
    Ok(())
}

/// The parts of a curve that lie inside the panel.
fn pieces(plot: &Plot, curve: &Curve) -> Vec<Vec<(f64, f64)>> {
    let inside = |axis: &Axis, value: f64| value >= axis.ends.0 && value <= axis.ends.1;
    (curve.points)
        .split(|&(x, y)| !(inside(&plot.x, x) && inside(&plot.y, y)))
        .filter(|piece| !piece.is_empty())
        .map(|piece| piece.iter().map(|&(x, y)| (plot.x.place(x), plot.y.place(y))).collect())
        .collect()
}

fn draw_piece(panel: &Panel<'_, '_>, curve: &Curve, piece: &[(f64, f64)]) -> Result<()> {
    let (colour, width) = (curve.look.colour(), curve.look.width());
    match curve.look {
        Look::Dashed => panel.dashed(piece, colour, width)?,
        _ => panel.line(piece, colour, width)?,
    }
    if curve.dots {
        for &(x, y) in piece {
            panel.dot(x, y, colour)?;
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_chart_draws_what_is_inside_its_axes_and_nothing_else() {
        let plot = |x: Axis, y: Axis| Plot {
            caption: "caption".to_owned(),
            height: 100.0,
            x,
            y,
            curves: [Look::Blue, Look::Dashed]
                .map(|look| Curve {
                    label: "curve".to_owned(),
                    points: vec![
                        (1.0, 1.0),
                        (2.0, 3.0),
                        (3.0, f64::NAN),
                        (4.0, 1e9),
                        (5.0, 2.0),
                        (6.0, -1.0),
                    ],
                    look,
                    dots: true,
                })
                .to_vec(),
            level: Some((2.0, "level".to_owned())),
            mark: Some((2.0, 3.0, "mark".to_owned())),
        };
        let plots = [
            plot(Axis::linear("x", (0.0, 10.0)), Axis::linear("y", (0.0, 10.0))),
            plot(Axis::logarithmic("x", (1.0, 10.0)), Axis::logarithmic("y", (0.01, 1e4))),
        ];
        let text = svg("title", "subtitle", &plots).expect("a picture");
        assert!(!text.contains("NaN") && !text.contains("inf"));
        // Three points in each of two panels and two curves, (1, 1), (2, 3) and (5, 2).
        assert_eq!(text.matches("<circle").count(), 12);
        assert!(text.contains("0.01") && text.contains("10000"));
    }
}
