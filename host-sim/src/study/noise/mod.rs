//! Monte Carlo of the paper's sixteen cases: how far identifications are off, beside how far they must be.
//!
//! [`truth`] makes passages, [`field`] adds to them what the model does not know, [`explain`] identifies, [`bound`] says what
//! is possible, [`campaign`] runs many seeds on all processors, [`table`] prints; [`fusion`] puts thirty passages of one bridge
//! together.

pub mod bound;
pub mod campaign;
pub mod explain;
pub mod field;
pub mod fusion;
pub mod table;
pub mod truth;

use spanwatch::bridge::Damage;
use spanwatch::interaction::Run;

/// Whether speed, entry time, load and stiffness of the whole bridge are known.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Nuisance {
    /// They are told, and true.
    Known,
    /// A first guess is told, and how far off it may be.
    Unknown,
}

impl Nuisance {
    /// As tables call it.
    pub fn name(self) -> &'static str {
        match self {
            Self::Known => "known",
            Self::Unknown => "unknown",
        }
    }
}

/// All that a passage can tell: what the bridge has lost, and how the train ran.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Point {
    /// Fraction of bending stiffness lost by each element.
    pub damage: Damage<f64>,
    /// How the train ran.
    pub run: Run<f64>,
    /// Stiffness of the whole bridge, as a part of the model's.
    pub stiffness: f64,
}
