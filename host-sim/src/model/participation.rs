//! What moves in a mode: its shares of kinetic energy along and across the track and vertically.
//!
//! ```text
//! share_i = sum_n m_n u_ni^2 / sum_n m_n |u_n|^2,    i = x, y, z
//! ```
//!
//! with `m_n` the mass nearest to node `n`. Rotary inertia is left out, so it is a description, not a balance.

use nalgebra::DVectorView;

use super::modal::value;
use super::structure::Structure;

/// Shares of a mode's kinetic energy in x, y and z, which add up to 1.
pub fn shares(structure: &Structure, shape: DVectorView<'_, f64>) -> [f64; 3] {
    let mut shares = [0.0; 3];
    for (rows, mass_kg) in structure.matrices.rows.iter().zip(&structure.matrices.node_kg) {
        for (share, row) in shares.iter_mut().zip(rows) {
            *share += mass_kg * value(row, shape).powi(2);
        }
    }
    let all: f64 = shares.iter().sum();
    if all > 0.0 {
        shares.map(|share| share / all)
    } else {
        [0.0; 3]
    }
}
