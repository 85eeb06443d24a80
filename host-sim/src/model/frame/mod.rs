//! A bridge as a frame of straight beams in space.
//!
//! Axes: `x` along the track, `y` to the left, `z` up; metres, newtons, kilograms, radians. Each node has six degrees of
//! freedom, the movements `u_x u_y u_z` and the rotations `r_x r_y r_z` about the axes, right-handed: so a girder that
//! rises along the track, `du_z/dx > 0`, turns by `r_y = -du_z/dx`, and one that leads to the left by
//! `r_z = du_y/dx`. Rotations are small.
//!
//! [`element`] is one beam, [`constraint`] says how held and linked degrees of freedom follow the free ones, [`assembly`]
//! puts all together, [`soundness`] refuses what could not stand; [`mod@file`] and [`reading`] make a [`Frame`] of what an
//! engineer wrote.

pub mod assembly;
pub mod constraint;
pub mod element;
pub mod file;
pub mod reading;
pub mod soundness;

use nalgebra::Vector3;

pub use element::{Beam, Section};

/// Degrees of freedom of a node.
pub const NODE_FREEDOMS: usize = 6;
/// Names of a node's degrees of freedom in bridge files: movements, then rotations.
pub const DIRECTIONS: [&str; NODE_FREEDOMS] = ["x", "y", "z", "rx", "ry", "rz"];

/// A frame: all of a bridge that moves, has mass or resists.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Frame {
    /// The points at which things meet.
    pub nodes: Vec<Node>,
    /// The beams between them.
    pub beams: Vec<Beam>,
    /// The springs.
    pub springs: Vec<Spring>,
    /// Masses at nodes.
    pub masses: Vec<LumpedMass>,
    /// Nodes that follow others.
    pub links: Vec<Link>,
    /// Names of the groups that can be damaged.
    pub groups: Vec<String>,
}

/// A point of the frame.
#[derive(Debug, Clone, PartialEq)]
pub struct Node {
    /// Its name.
    pub name: String,
    /// Its place, m.
    pub place_m: Vector3<f64>,
    /// Which of its degrees of freedom are held by the ground.
    pub held: [bool; NODE_FREEDOMS],
}

/// A spring of six uncoupled stiffnesses along and about the axes.
///
/// It sits at its first node. The other end is the ground or a second node, which reaches it by a rigid arm: so nothing
/// is strained when both move as one rigid body, wherever the second node lies.
#[derive(Debug, Clone, PartialEq)]
pub struct Spring {
    /// The node at which it sits.
    pub node: usize,
    /// The other node; none is the ground.
    pub to: Option<usize>,
    /// Stiffness along x, y, z (N/m) and about them (N m/rad).
    pub stiffness: [f64; NODE_FREEDOMS],
    /// The group in which it can be damaged.
    pub group: Option<usize>,
}

/// A rigid body fastened to a node, its centre of mass there.
#[derive(Debug, Clone, PartialEq)]
pub struct LumpedMass {
    /// The node.
    pub node: usize,
    /// Its mass, kg.
    pub mass_kg: f64,
    /// Its moments of inertia about axes parallel to x, y, z, kg m².
    pub inertia_kgm2: [f64; 3],
}

/// A node that follows another.
#[derive(Debug, Clone, PartialEq)]
pub struct Link {
    /// The node that leads.
    pub master: usize,
    /// The node that follows.
    pub slave: usize,
    /// What it follows in.
    pub follows: Follows,
}

/// How a linked node follows.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Follows {
    /// As part of one rigid body: `u_s = u_m + r_m x (p_s - p_m)`, `r_s = r_m`.
    Rigidly,
    /// With equal values in the degrees of freedom that are marked.
    Equally([bool; NODE_FREEDOMS]),
}
