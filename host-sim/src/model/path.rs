//! The path of the wheels: how it moves with the bridge.
//!
//! Vertical movement `w` and its slope, lateral movement `v` at the height of the rails and its slope, and roll `phi`
//! (positive with the left rail up), at each point of the path:
//!
//! ```text
//! w = u_z,            dw/dx = -r_y
//! v = u_y - h phi,    dv/dx = r_z - h dphi/dx
//! phi = r_x                         on one line of nodes
//! phi = (w_left - w_right) / b      on two lines, left and right, b apart; u_y, r_z and w are then the mean of both
//! ```
//!
//! `h` is the height of the rails above the nodes. On one line `r_x` is linear between nodes; its slope at a node is that
//! of the line through its neighbours. The path begins and ends at points that cannot sink, so that no load appears at
//! once: at the ground, a support, or a rail's beginning on the abutment.

use anyhow::{Result, bail};

use super::frame::Frame;
use super::frame::NODE_FREEDOMS;
use super::frame::constraint::{Row, combine};

/// Nodes along which wheels roll, in the order of travel.
#[derive(Debug, Clone, PartialEq)]
pub struct PathLine {
    /// One line of nodes, or two of equal length: left, then right.
    pub lines: Vec<Vec<usize>>,
    /// Height of the rails above the nodes, m.
    pub rail_height_m: f64,
}

/// How a point of the path moves: value and slope along the track, over the free degrees of freedom.
#[derive(Debug, Clone, PartialEq)]
pub struct PathRows {
    /// Distance from the first point, m.
    pub x_m: f64,
    /// Upwards, m.
    pub vertical: [Row; 2],
    /// To the left, at the height of the rails, m.
    pub lateral: [Row; 2],
    /// Left side up, rad.
    pub roll: [Row; 2],
}

/// The rows of all points of the path.
///
/// # Errors
/// If the points do not ascend along the track, or its first or last point can sink.
pub fn rows(frame: &Frame, path: &PathLine, motion: &[[Row; NODE_FREEDOMS]]) -> Result<Vec<PathRows>> {
    let lines: Vec<Vec<PathRows>> = path
        .lines
        .iter()
        .map(|line| along(frame, line, motion))
        .collect::<Result<_>>()?;
    let mut rows = match lines.as_slice() {
        [line] => line.clone(),
        [left, right] => between(frame, path, left, right)?,
        _ => bail!("[path] needs either one line of nodes, or left and right"),
    };
    for point in &mut rows {
        for (lateral, roll) in point.lateral.iter_mut().zip(&point.roll) {
            *lateral = combine([(1.0, &*lateral), (-path.rail_height_m, roll)]);
        }
    }
    for (point, which) in [(rows.first(), "begins"), (rows.last(), "ends")] {
        if point.is_some_and(|point| !point.vertical[0].is_empty()) {
            let end = if which == "begins" {
                path.lines[0].first()
            } else {
                path.lines[0].last()
            };
            bail!(
                "the path {which} at node \"{}\", which can sink, so a wheel's load would appear at once: begin and end it at nodes held in z",
                end.map_or("", |&node| frame.nodes[node].name.as_str())
            );
        }
    }
    Ok(rows)
}

/// The rows of one line of nodes, lateral movement at their own height.
fn along(frame: &Frame, line: &[usize], motion: &[[Row; NODE_FREEDOMS]]) -> Result<Vec<PathRows>> {
    let place = |i: usize| frame.nodes[line[i]].place_m.x;
    for i in 1..line.len() {
        if place(i) <= place(i - 1) {
            bail!(
                "the path goes from node \"{}\" at x = {} m to node \"{}\" at {} m: its nodes must ascend along the track",
                frame.nodes[line[i - 1]].name,
                place(i - 1),
                frame.nodes[line[i]].name,
                place(i)
            );
        }
    }
    let point = |(i, &node): (usize, &usize)| {
        let [_, lateral, vertical, roll, pitch, yaw] = &motion[node];
        let (before, after) = (i.saturating_sub(1), (i + 1).min(line.len() - 1));
        let over = (place(after) - place(before)).recip();
        let twist = combine([(over, &motion[line[after]][3]), (-over, &motion[line[before]][3])]);
        PathRows {
            x_m: place(i) - place(0),
            vertical: [vertical.clone(), combine([(-1.0, pitch)])],
            lateral: [lateral.clone(), yaw.clone()],
            roll: [roll.clone(), twist],
        }
    };
    Ok(line.iter().enumerate().map(point).collect())
}

/// The middle between two lines.
fn between(frame: &Frame, path: &PathLine, left: &[PathRows], right: &[PathRows]) -> Result<Vec<PathRows>> {
    let nodes = path.lines[0].iter().zip(&path.lines[1]);
    let mut rows = Vec::new();
    for ((l, r), (&left_node, &right_node)) in left.iter().zip(right).zip(nodes) {
        let (at_left, at_right) = (&frame.nodes[left_node], &frame.nodes[right_node]);
        let apart = at_left.place_m.y - at_right.place_m.y;
        if (at_left.place_m.x - at_right.place_m.x).abs() > 1e-6 || apart <= 0.0 {
            bail!(
                "the path's nodes \"{}\" and \"{}\" must stand side by side, at equal x, the left one at greater y",
                at_left.name,
                at_right.name
            );
        }
        let mean =
            |a: &[Row; 2], b: &[Row; 2]| -> [Row; 2] { std::array::from_fn(|i| combine([(0.5, &a[i]), (0.5, &b[i])])) };
        rows.push(PathRows {
            x_m: l.x_m,
            vertical: mean(&l.vertical, &r.vertical),
            lateral: mean(&l.lateral, &r.lateral),
            roll: std::array::from_fn(|i| combine([(1.0 / apart, &l.vertical[i]), (-1.0 / apart, &r.vertical[i])])),
        });
    }
    Ok(rows)
}
