//! Static (Guyan) condensation: a smaller model of chosen degrees of freedom, and what it costs in exactness.
//!
//! ```text
//! T = [I; -K_ss^-1 K_sm],   K' = T^T K T,   M' = T^T M T
//! ```
//!
//! `m` are the degrees of freedom that are kept, `s` the others, which follow as if nothing but the kept ones pushed them
//! (Guyan 1965; the paper's matrices are such, "after matrix condensation"). Statics stay exact, frequencies rise: the
//! motions that are lost are those of the slaves against held masters.

use anyhow::{Result, bail};
use nalgebra::DMatrix;

use super::eigen::{NaturalModes, natural_modes, solve};
use super::structure::Structure;

/// Modes with at least this modal assurance criterion are the same.
pub const SAME_MODE: f64 = 0.9;

/// A condensed model.
#[derive(Debug, Clone, PartialEq)]
pub struct Condensed {
    /// Numbers of the kept degrees of freedom in the full model.
    pub kept: Vec<usize>,
    /// Stiffness.
    pub stiffness: DMatrix<f64>,
    /// Mass.
    pub mass: DMatrix<f64>,
}

impl Condensed {
    /// Condenses a structure to the masters that its file names (held ones are passed over).
    ///
    /// # Errors
    /// If none is free or one is the slave of a link.
    pub fn new(structure: &Structure) -> Result<Self> {
        let frame = &structure.bridge.frame;
        let mut kept = Vec::new();
        for &(node, direction) in &structure.bridge.masters {
            match structure.matrices.rows[node][direction].as_slice() {
                [] => {}
                &[(freedom, 1.0)] => kept.push(freedom),
                _ => bail!(
                    "[condensation] names node \"{}\", which follows another by a link: name that one instead",
                    frame.nodes[node].name
                ),
            }
        }
        kept.sort_unstable();
        kept.dedup();
        if kept.is_empty() {
            bail!(
                "bridge \"{}\" names no free node in [condensation]",
                structure.bridge.name
            );
        }
        let n = structure.matrices.freedoms();
        let slaves: Vec<usize> = (0..n).filter(|freedom| kept.binary_search(freedom).is_err()).collect();
        let stiffness = structure.stiffness(&[]);
        let mut follow = DMatrix::zeros(n, kept.len());
        for (column, &freedom) in kept.iter().enumerate() {
            follow[(freedom, column)] = 1.0;
        }
        if !slaves.is_empty() {
            let part = |rows: &[usize], columns: &[usize]| stiffness.select_rows(rows).select_columns(columns);
            let dependence = solve(&part(&slaves, &slaves), &part(&slaves, &kept))?;
            for (row, &freedom) in slaves.iter().enumerate() {
                follow.row_mut(freedom).copy_from(&-dependence.row(row));
            }
        }
        Ok(Self {
            stiffness: follow.transpose() * stiffness * &follow,
            mass: follow.transpose() * structure.mass() * &follow,
            kept,
        })
    }

    /// Its natural modes.
    pub fn natural_modes(&self) -> Result<NaturalModes> {
        natural_modes(&self.stiffness, &self.mass)
    }

    /// For each mode of the full model, by how much the frequency of the same mode is higher here, as a fraction; none if
    /// this model has no such mode.
    ///
    /// Modes are the same if the square of their mass-weighted correlation over the kept degrees of freedom (the modal
    /// assurance criterion) is at least [`SAME_MODE`].
    pub fn errors(&self, full: &NaturalModes) -> Result<Vec<Option<f64>>> {
        let own = self.natural_modes()?;
        let seen = full.shapes.select_rows(&self.kept);
        let weighted = &self.mass * &seen;
        let alike = own.shapes.transpose() * &weighted;
        Ok((0..full.omega_squared.len())
            .map(|k| {
                let energy = seen.column(k).dot(&weighted.column(k));
                let best = alike.column(k).icamax();
                let same = alike[(best, k)].powi(2) >= SAME_MODE * energy;
                same.then(|| (own.omega_squared[best] / full.omega_squared[k]).sqrt() - 1.0)
            })
            .collect())
    }
}
