//! A bridge in finite elements: a frame, the path of the wheels over it, the sensors on it and its damping.
//!
//! A girder file and a frame file both become a [`BridgeFrame`], and that a [`Structure`] with the matrices; all that
//! follows (modes, reduction, condensation) knows only this.

use anyhow::{Context, Result, bail};
use nalgebra::{DMatrix, Vector3};

use super::frame::Frame;
use super::frame::assembly::Assembly;
use super::frame::constraint::{Row, combine};
use super::path::{self, PathLine, PathRows};

/// A bridge, described as a frame.
#[derive(Debug, Clone, PartialEq)]
pub struct BridgeFrame {
    /// Name of the bridge.
    pub name: String,
    /// What moves.
    pub frame: Frame,
    /// Where the wheels go.
    pub path: PathLine,
    /// Where sensors can sit.
    pub sensors: Vec<SensorPlace>,
    /// Its damping.
    pub damping: Damping,
    /// Modes in the basis of the logger's model.
    pub basis_modes: usize,
    /// Degrees of freedom that remain in a condensed model, node and direction; empty if none is asked for.
    pub masters: Vec<(usize, usize)>,
}

impl BridgeFrame {
    /// Whether nothing moves but in vertical bending, as a girder does.
    pub fn is_girder(&self) -> bool {
        (self.frame.nodes.iter()).all(|node| [0, 1, 3, 5].iter().all(|&direction| node.held[direction]))
    }
}

impl From<&Self> for BridgeFrame {
    fn from(bridge: &Self) -> Self {
        bridge.clone()
    }
}

/// A place and direction in which movement is measured.
#[derive(Debug, Clone, PartialEq)]
pub struct SensorPlace {
    /// Its number on the command line and in recordings.
    pub number: u16,
    /// Its name.
    pub name: String,
    /// The node.
    pub node: usize,
    /// Unit vector of the direction.
    pub direction: Vector3<f64>,
}

/// Rayleigh damping `C = p1 M + p2 K` by one damping ratio at two frequencies (the paper's Eqs 34 to 36).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Damping {
    /// The ratio.
    pub ratio: f64,
    /// The two frequencies, Hz; none are the first two of the undamaged bridge.
    pub at_hz: Option<[f64; 2]>,
}

impl Damping {
    /// `p1` (1/s) and `p2` (s) for a bridge with these undamaged squared circular frequencies.
    pub fn rayleigh(&self, omega_squared: &[f64]) -> [f64; 2] {
        let [w1, w2] = match (self.at_hz, omega_squared) {
            (Some(at), _) => at.map(|hz| hz * std::f64::consts::TAU),
            (None, [first, second, ..]) => [first.sqrt(), second.sqrt()],
            // With a single mode any second frequency will do.
            (None, [only]) => [only.sqrt(), only.sqrt()],
            (None, []) => [1.0, 1.0],
        };
        [2.0 * self.ratio * w1 * w2 / (w1 + w2), 2.0 * self.ratio / (w1 + w2)]
    }
}

/// A sensor place with how it moves.
#[derive(Debug, Clone, PartialEq)]
pub struct SensorRow {
    /// Its number.
    pub number: u16,
    /// Its name.
    pub name: String,
    /// Its movement over the free degrees of freedom.
    pub row: Row,
}

/// A bridge in finite elements.
#[derive(Debug, Clone, PartialEq)]
pub struct Structure {
    /// What it is made of.
    pub bridge: BridgeFrame,
    /// Its matrices.
    pub matrices: Assembly,
    /// How the path moves.
    pub path: Vec<PathRows>,
    /// How the sensors move.
    pub sensors: Vec<SensorRow>,
}

impl Structure {
    /// Assembles a bridge.
    ///
    /// # Errors
    /// If the frame cannot stand, or the path does not begin and end at points that cannot sink.
    pub fn new(bridge: BridgeFrame) -> Result<Self> {
        let name = || format!("bridge \"{}\"", bridge.name);
        let matrices = Assembly::new(&bridge.frame).with_context(name)?;
        let path = path::rows(&bridge.frame, &bridge.path, &matrices.rows).with_context(name)?;
        let sensors = bridge
            .sensors
            .iter()
            .map(|place| SensorRow {
                number: place.number,
                name: place.name.clone(),
                row: combine((0..3).map(|axis| (place.direction[axis], &matrices.rows[place.node][axis]))),
            })
            .collect();
        Ok(Self {
            bridge,
            matrices,
            path,
            sensors,
        })
    }

    /// Length of the path of the wheels, m.
    pub fn length_m(&self) -> f64 {
        self.path.last().map_or(0.0, |end| end.x_m)
    }

    /// Consistent mass matrix over the free degrees of freedom.
    pub fn mass(&self) -> &DMatrix<f64> {
        &self.matrices.mass
    }

    /// Stiffness matrix with the fraction that each damage group has lost (groups beyond the slice are whole).
    pub fn stiffness(&self, damage: &[f64]) -> DMatrix<f64> {
        self.matrices.stiffness(damage)
    }

    /// The damage of every group from that of some, by name.
    ///
    /// # Errors
    /// If there is no such group, or a fraction is not between 0 and 1.
    pub fn damage(&self, of: &[(&str, f64)]) -> Result<Vec<f64>> {
        let groups = &self.bridge.frame.groups;
        let mut damage = vec![0.0; groups.len()];
        for &(name, loss) in of {
            let Some(group) = groups.iter().position(|group| group == name) else {
                bail!(
                    "bridge \"{}\" has no damage group \"{name}\"; its groups are: {}",
                    self.bridge.name,
                    groups.join(", ")
                );
            };
            if !(0.0..1.0).contains(&loss) {
                bail!("the damage of \"{name}\" must be a fraction from 0 to less than 1, not {loss}");
            }
            damage[group] = loss;
        }
        Ok(damage)
    }
}
