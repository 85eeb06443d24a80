//! The modes of a frame in space: each from the side (x-z) and from above (x-y), over the frame at rest.

use std::path::Path;

use anyhow::Result;
use nalgebra::{DVector, Vector3};
use plotters::style::Color;
use plotters::style::text_anchor::HPos;

use super::canvas::{BLUE, BODY, Canvas, INK, LEFT, Panel, RIGHT, SMALL, SOFT, Svg, TITLE, WIDTH};
use crate::model::Structure;
use crate::model::modal::value;
use crate::output;

/// Largest displacement in a picture, as a part of the frame's length.
const LARGEST: f64 = 0.04;
/// Opacity of the frame at rest.
const AT_REST: f64 = 0.4;
/// Space between the panels, px.
const CAPTION: f64 = 34.0;
const HEAD: f64 = 56.0;

/// Draws modes, each a label and a shape over the free degrees of freedom, into the SVG file at `path`.
pub fn frame_modes(path: &Path, structure: &Structure, modes: &[(&str, DVector<f64>)]) -> Result<()> {
    let nodes = &structure.bridge.frame.nodes;
    let range = |axis: usize| {
        let places = nodes.iter().map(|node| node.place_m[axis]);
        places.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), x| {
            (low.min(x), high.max(x))
        })
    };
    let length = (range(0).1 - range(0).0).max(1e-3);
    let margin = 1.5 * LARGEST * length;
    let around = |(low, high): (f64, f64)| (low - margin, high + margin);
    let along = around(range(0));
    // The same scale in all directions.
    let pixels_per_m = (WIDTH - LEFT - RIGHT) / (along.1 - along.0);
    let views = [("from the side", 2), ("from above", 1)].map(|(name, axis)| {
        let across = around(range(axis));
        (name, axis, across, (across.1 - across.0) * pixels_per_m)
    });
    let row: f64 = views.iter().map(|(_, _, _, height)| CAPTION + height).sum();
    let svg = Svg::draw(HEAD + row * modes.len() as f64 + CAPTION, |canvas| {
        let title = format!("Modes of {}", structure.bridge.name);
        canvas.text(&title, LEFT, 30.0, TITLE, INK, HPos::Left)?;
        let mut top = HEAD;
        for (label, shape) in modes {
            let moved = displacements(structure, shape, LARGEST * length);
            for (name, axis, across, height) in views {
                let text = format!("{label}, {name}");
                canvas.text(&text, LEFT, top + CAPTION - 12.0, BODY, INK, HPos::Left)?;
                let panel = canvas.panel(top + CAPTION, height, along, across);
                draw(&panel, structure, &moved, axis)?;
                top += CAPTION + height;
            }
        }
        caption(canvas, top)
    })?;
    output::write(&[(path, svg.as_bytes())])
}

fn caption(canvas: &Canvas<'_>, top: f64) -> Result<()> {
    let text = "grey: at rest; blue: moved, the largest displacement drawn as 4 % of the length";
    canvas.text(text, LEFT, top + 16.0, SMALL, SOFT, HPos::Left)
}

/// The displacement of each node, the largest `largest` long.
fn displacements(structure: &Structure, shape: &DVector<f64>, largest: f64) -> Vec<Vector3<f64>> {
    let moved: Vec<Vector3<f64>> = (structure.matrices.rows.iter())
        .map(|rows| Vector3::from_fn(|axis, _| value(&rows[axis], shape.column(0))))
        .collect();
    let most = moved.iter().map(|u| u.norm()).fold(f64::MIN_POSITIVE, f64::max);
    moved.into_iter().map(|u| u * (largest / most)).collect()
}

fn draw(panel: &Panel<'_, '_>, structure: &Structure, moved: &[Vector3<f64>], axis: usize) -> Result<()> {
    let frame = &structure.bridge.frame;
    let point = |node: usize, scale: f64| {
        let at = frame.nodes[node].place_m + moved[node] * scale;
        (at.x, at[axis])
    };
    for (scale, colour, width) in [(0.0, SOFT.mix(AT_REST), 1.0), (1.0, BLUE.mix(1.0), 1.2)] {
        for beam in &frame.beams {
            panel.line(&beam.nodes.map(|node| point(node, scale)), colour, width)?;
        }
    }
    Ok(())
}
