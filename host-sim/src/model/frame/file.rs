//! The frame file, as an engineer writes it (TOML).
//!
//! ```toml
//! kind = "frame"
//! name = "portal"
//! damping_ratio = 0.02                # Rayleigh, at the first two frequencies, or at those of damping_at_hz = [f1, f2]
//!
//! [materials]                         # G = E / (2 (1 + nu))
//! steel = { E_npm2 = 2.0e11, nu = 0.3, density_kgpm3 = 7850.0 }
//!
//! [sections]                          # added_kgpm (optional): mass that is not the beam's own
//! column = { material = "steel", A_m2 = 0.02, J_m4 = 1.0e-5, Iy_m4 = 3.0e-4, Iz_m4 = 3.0e-4 }
//!
//! [nodes]                             # x along the track, y to the left, z up
//! A1 = [0.0, 0.0, 0.0]
//! B1 = [0.0, 0.0, 5.0]
//! B2 = [6.0, 0.0, 5.0]
//! A2 = [6.0, 0.0, 0.0]
//!
//! [supports]                          # held directions: x y z and rx ry rz about them, or "all"
//! A1 = ["all"]
//! A2 = ["x", "y", "z"]
//!
//! [[beam]]
//! nodes = ["A1", "B1", "B2", "A2"]    # a chain of beams; or chains = [["A1", "B1"], ["A2", "B2"]] for several
//! section = "column"
//! groups = ["left", "beam", "right"]  # damage groups, one for each beam of nodes or each of chains; or one group
//! divide = 4                          # elements of each beam; inner nodes are "A1-B1/1" ..
//!
//! [path]
//! line = ["A1", "B1"]
//! ```
//!
//! Wherever nodes are listed, `"L0..L8"` stands for `L0`, `L1`, .. `L8`. The other tables: `[[row]]` makes nodes at equal
//! steps; `[[spring]]` joins nodes with others or the ground; `[[mass]]` is a rigid body at a node; `[[link]]` makes nodes
//! follow another; `[part.NAME]` holds any of these to be built once for each `[[place]]`, where the names of its nodes and
//! groups get the name of the place and a dot in front; `[condensation]` names nodes that a condensed model keeps.
//! The bridges that ship with the program use all of it.

use std::collections::BTreeMap;

use serde::Deserialize;
use toml::Spanned;

/// A name and where in the file it stands.
pub type Name = Spanned<String>;

/// The whole file.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FrameFile {
    /// Says that this is a frame.
    #[allow(dead_code, reason = "looked at before the rest is read")]
    kind: String,
    /// Name of the bridge, at most 24 bytes.
    pub name: String,
    /// Damping ratio.
    pub damping_ratio: f64,
    /// The two frequencies at which it holds, Hz.
    pub damping_at_hz: Option<[f64; 2]>,
    /// Modes in the basis of a logger's model.
    pub basis_modes: Option<usize>,
    /// Materials by name.
    pub materials: BTreeMap<String, Spanned<Material>>,
    /// Sections by name.
    pub sections: BTreeMap<String, Spanned<SectionEntry>>,
    /// Nodes: x, y, z in metres.
    #[serde(default)]
    pub nodes: BTreeMap<Name, [f64; 3]>,
    /// Rows of nodes.
    #[serde(default)]
    pub row: Vec<RowEntry>,
    /// Held directions of nodes.
    #[serde(default)]
    pub supports: BTreeMap<Name, Vec<Name>>,
    /// Beams.
    #[serde(default)]
    pub beam: Vec<BeamEntry>,
    /// Springs.
    #[serde(default)]
    pub spring: Vec<SpringEntry>,
    /// Masses at nodes.
    #[serde(default)]
    pub mass: Vec<MassEntry>,
    /// Nodes that follow others.
    #[serde(default)]
    pub link: Vec<LinkEntry>,
    /// Parts that are built several times.
    #[serde(default)]
    pub part: BTreeMap<String, Part>,
    /// Where parts are built.
    #[serde(default)]
    pub place: Vec<Place>,
    /// The path of the wheels.
    pub path: PathEntry,
    /// Sensors.
    #[serde(default)]
    pub sensor: Vec<SensorEntry>,
    /// What a condensed model keeps.
    pub condensation: Option<Condensation>,
}

/// What can be built once or several times.
#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Part {
    /// Nodes.
    pub nodes: BTreeMap<Name, [f64; 3]>,
    /// Rows of nodes.
    pub row: Vec<RowEntry>,
    /// Held directions.
    pub supports: BTreeMap<Name, Vec<Name>>,
    /// Beams.
    pub beam: Vec<BeamEntry>,
    /// Springs.
    pub spring: Vec<SpringEntry>,
    /// Masses.
    pub mass: Vec<MassEntry>,
    /// Links.
    pub link: Vec<LinkEntry>,
}

/// A material.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
#[allow(non_snake_case, reason = "the field's symbols are the keys of the file")]
pub struct Material {
    /// Young's modulus, N/m².
    pub E_npm2: f64,
    /// Poisson's ratio.
    pub nu: f64,
    /// Density, kg/m³.
    pub density_kgpm3: f64,
}

/// A section.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
#[allow(non_snake_case, reason = "the field's symbols are the keys of the file")]
pub struct SectionEntry {
    /// Name of its material.
    pub material: Name,
    /// Area, m².
    pub A_m2: f64,
    /// Torsion constant, m⁴.
    pub J_m4: f64,
    /// Second moment of area for bending in the local x-z plane (vertical, for a level beam), m⁴.
    pub Iy_m4: f64,
    /// Second moment of area for bending in the local x-y plane, m⁴.
    pub Iz_m4: f64,
    /// Mass that is not the section's own, kg/m.
    #[serde(default)]
    pub added_kgpm: f64,
}

/// Nodes `NAME<first>` to `NAME<last>` at equal steps.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RowEntry {
    /// Name before the number.
    pub name: Name,
    /// First number.
    pub first: u32,
    /// Last number.
    pub last: u32,
    /// Place of the first, m.
    pub at_m: [f64; 3],
    /// From each to the next, m.
    pub step_m: [f64; 3],
}

/// Beams, from node to node of a chain or of several.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BeamEntry {
    /// Nodes of one chain.
    pub nodes: Option<Spanned<Vec<Name>>>,
    /// Nodes of several chains.
    pub chains: Option<Spanned<Vec<Vec<Name>>>>,
    /// Section of all.
    pub section: Name,
    /// Damage group of all.
    pub group: Option<String>,
    /// Damage group of each beam of `nodes`, or of each chain of `chains`.
    pub groups: Option<Spanned<Vec<String>>>,
    /// Elements of each beam.
    pub divide: Option<usize>,
    /// Direction of local z.
    pub up: Option<[f64; 3]>,
    /// Rigid zones at both ends of each chain, along it, m.
    pub rigid_m: Option<[f64; 2]>,
    /// From the first and last node of each chain to the ends of its axis, m.
    pub offset_m: Option<[[f64; 3]; 2]>,
    /// Moments about local axes that the ends of each chain do not transmit: rx, ry, rz.
    pub release: Option<[Vec<Name>; 2]>,
}

/// Springs.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SpringEntry {
    /// Nodes at which one sits each.
    pub nodes: Spanned<Vec<Name>>,
    /// The nodes at their other ends, one for each; absent: the ground.
    pub to: Option<Spanned<Vec<Name>>>,
    /// Stiffness along x, N/m.
    #[serde(default)]
    pub x_npm: f64,
    /// Stiffness along y, N/m.
    #[serde(default)]
    pub y_npm: f64,
    /// Stiffness along z, N/m.
    #[serde(default)]
    pub z_npm: f64,
    /// Stiffness about x, N m/rad.
    #[serde(default)]
    pub rx_nmprad: f64,
    /// Stiffness about y, N m/rad.
    #[serde(default)]
    pub ry_nmprad: f64,
    /// Stiffness about z, N m/rad.
    #[serde(default)]
    pub rz_nmprad: f64,
    /// Damage group.
    pub group: Option<String>,
}

/// Rigid bodies at nodes.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MassEntry {
    /// Nodes at which one sits each.
    pub nodes: Vec<Name>,
    /// Mass of each, kg.
    pub kg: f64,
    /// Moments of inertia of each, kg m².
    #[serde(default)]
    pub inertia_kgm2: [f64; 3],
}

/// Nodes that follow another.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LinkEntry {
    /// The node that leads.
    pub master: Name,
    /// Those that follow.
    pub slaves: Vec<Name>,
    /// Directions in which they have equal values; absent: they follow as one rigid body.
    pub equal: Option<Vec<Name>>,
}

/// A place at which a part is built.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Place {
    /// Name of the part.
    pub part: Name,
    /// Name of the place.
    pub name: String,
    /// Added to the places of the part's nodes, m.
    pub at_m: [f64; 3],
}

/// The path of the wheels: one line of nodes, or two.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PathEntry {
    /// Nodes in the middle of the track.
    pub line: Option<Vec<Name>>,
    /// Nodes under the left rail.
    pub left: Option<Vec<Name>>,
    /// Nodes under the right rail.
    pub right: Option<Vec<Name>>,
    /// Height of the rails above the nodes, m.
    #[serde(default)]
    pub rail_height_m: f64,
}

/// A sensor.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SensorEntry {
    /// Its number on the command line.
    pub number: u16,
    /// Its name.
    pub name: Option<String>,
    /// The node at which it sits.
    pub node: Name,
    /// What it measures.
    pub direction: Direction,
}

/// A direction: an axis, or a vector of any length.
#[derive(Debug, Deserialize)]
#[serde(
    untagged,
    expecting = "direction must be \"x\", \"y\", \"z\" or a vector such as [0.0, 0.6, 0.8]"
)]
pub enum Direction {
    /// By the name of an axis.
    Axis(String),
    /// As a vector.
    Vector([f64; 3]),
}

/// What a condensed model keeps.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Condensation {
    /// Nodes.
    pub nodes: Vec<Name>,
    /// Their directions that are kept.
    pub directions: Vec<Name>,
}
