//! Whether a frame can stand: every piece is connected with the ground, nothing has negative mass or stiffness, and no
//! motion is without resistance.

use anyhow::{Result, bail};
use nalgebra::{DMatrix, DVector};

use super::constraint::Row;
use super::{DIRECTIONS, Frame, NODE_FREEDOMS};
use crate::model::eigen;

/// A pivot of the scaled stiffness matrix (diagonal 1) below this is rounding; a cantilever of a hundred elements has 1e-8.
const NO_RESISTANCE: f64 = 1e-12;
/// Nodes that a sentence names before it says "and .. more".
const NAMED: usize = 4;

/// Refuses numbers that no bridge has.
pub fn check_numbers(frame: &Frame) -> Result<()> {
    let name = |node: usize| &frame.nodes[node].name;
    for node in &frame.nodes {
        if !node.place_m.iter().all(|x| x.is_finite()) {
            bail!(
                "node \"{}\" has a coordinate that is no number: write metres",
                node.name
            );
        }
    }
    for mass in &frame.masses {
        let values = mass.inertia_kgm2.iter().chain([&mass.mass_kg]);
        if !values.into_iter().all(|value| *value >= 0.0 && value.is_finite()) {
            bail!(
                "the mass at node \"{}\" must have zero or positive kg and inertia, not {} kg and {:?} kg m2",
                name(mass.node),
                mass.mass_kg,
                mass.inertia_kgm2
            );
        }
    }
    for spring in &frame.springs {
        if let Some(direction) = spring.stiffness.iter().position(|k| !(*k >= 0.0 && k.is_finite())) {
            bail!(
                "the spring at node \"{}\" has stiffness {} in {}: it must be zero or positive",
                name(spring.node),
                spring.stiffness[direction],
                DIRECTIONS[direction]
            );
        }
    }
    Ok(())
}

/// Refuses nodes to which nothing is fastened and pieces that nothing holds.
pub fn check_connections(frame: &Frame) -> Result<()> {
    let ground = frame.nodes.len();
    let mut pieces = Pieces((0..=ground).collect());
    let mut touched = vec![false; ground];
    let beams = frame.beams.iter().map(|beam| (beam.nodes[0], beam.nodes[1]));
    let springs = (frame.springs.iter()).map(|spring| (spring.node, spring.to.unwrap_or(ground)));
    let links = frame.links.iter().map(|link| (link.slave, link.master));
    for (a, b) in beams.chain(springs).chain(links) {
        pieces.join(a, b);
        for node in [a, b].into_iter().filter(|&node| node != ground) {
            touched[node] = true;
        }
    }
    for (number, node) in frame.nodes.iter().enumerate() {
        if node.held.contains(&true) {
            pieces.join(number, ground);
        }
        // A node that is held altogether may stand alone: a point of the ground that the path names.
        if !touched[number] && !node.held.iter().all(|&held| held) {
            bail!(
                "node \"{}\" belongs to no beam, spring or link: connect it or delete it",
                node.name
            );
        }
    }
    let loose: Vec<&str> = (0..ground)
        .filter(|&node| pieces.root(node) != pieces.root(ground))
        .map(|node| frame.nodes[node].name.as_str())
        .collect();
    if !loose.is_empty() {
        let rest = if loose.len() > NAMED {
            format!(" and {} more", loose.len() - NAMED)
        } else {
            String::new()
        };
        bail!(
            "nothing connects node \"{}\"{rest} with the ground: join them to the rest by beams or springs, or hold them in [supports]",
            loose[..loose.len().min(NAMED)].join("\", \"")
        );
    }
    Ok(())
}

/// Union-find over nodes and the ground.
struct Pieces(Vec<usize>);

impl Pieces {
    fn root(&self, mut node: usize) -> usize {
        while self.0[node] != node {
            node = self.0[node];
        }
        node
    }

    fn join(&mut self, a: usize, b: usize) {
        let (a, b) = (self.root(a), self.root(b));
        // The ground has the highest number and stays the root of its piece.
        self.0[a.min(b)] = a.max(b);
    }
}

/// Refuses a mechanism: a frame with a motion that no stiffness resists.
pub fn check_stiffness(frame: &Frame, rows: &[[Row; NODE_FREEDOMS]], stiffness: &DMatrix<f64>) -> Result<()> {
    let Some(motion) = free_motion(stiffness) else {
        return Ok(());
    };
    let movement = |direction: usize, node: usize| -> f64 {
        rows[node][direction]
            .iter()
            .map(|&(freedom, value)| value * motion[freedom])
            .sum()
    };
    let largest = |directions: std::ops::Range<usize>| {
        (0..frame.nodes.len())
            .flat_map(|node| directions.clone().map(move |direction| (node, direction)))
            .map(|(node, direction)| (movement(direction, node).abs(), node, direction))
            .max_by(|a, b| a.0.total_cmp(&b.0))
            .unwrap_or((0.0, 0, 0))
    };
    // Metres before radians: a rotation alone is free only where nothing moves.
    let (moved, turned) = (largest(0..3), largest(3..6));
    let (_, node, direction) = if moved.0 > 1e-3 * turned.0 { moved } else { turned };
    let how = if direction < 3 { "move along" } else { "turn about" };
    bail!(
        "this is a mechanism: node \"{}\" can {how} {} and nothing resists; hold it in [supports], brace it, or take back a release",
        frame.nodes[node].name,
        ["x", "y", "z"][direction % 3]
    );
}

/// A motion that the stiffness does not resist, if there is one.
fn free_motion(stiffness: &DMatrix<f64>) -> Option<DVector<f64>> {
    let n = stiffness.nrows();
    if let Some(freedom) = (0..n).find(|&i| stiffness[(i, i)] <= 0.0) {
        let mut motion = DVector::zeros(n);
        motion[freedom] = 1.0;
        return Some(motion);
    }
    let scale = stiffness.diagonal().map(|k| k.sqrt().recip());
    let scaled = DMatrix::from_fn(n, n, |i, j| scale[i] * stiffness[(i, j)] * scale[j]);
    if eigen::smallest_pivot(&scaled) > NO_RESISTANCE {
        return None;
    }
    Some(eigen::softest(&scaled)?.component_mul(&scale))
}
