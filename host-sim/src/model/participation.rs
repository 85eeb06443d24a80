//! What moves in a mode: its shares of kinetic energy along and across the track, vertically, and in turning.
//!
//! ```text
//! turning = phi^T M_rotary phi                                                 (phi^T M phi = 1)
//! share_i = (1 - turning) sum_n m_n u_ni^2 / sum_n m_n |u_n|^2,    i = x, y, z
//! ```
//!
//! with `m_n` the mass nearest to node `n`. Open sections resist torsion little, so the members of a truss have slow modes
//! in which they do little else than turn; these carry nothing that wheels or sensors would notice.

use nalgebra::DVectorView;

use super::modal::value;
use super::structure::Structure;

/// Shares of a mass-normalised mode's kinetic energy in x, y, z and in turning, which add up to 1.
pub fn shares(structure: &Structure, shape: DVectorView<'_, f64>) -> [f64; 4] {
    let mut moving = [0.0; 3];
    for (rows, mass_kg) in structure.matrices.rows.iter().zip(&structure.matrices.node_kg) {
        for (share, row) in moving.iter_mut().zip(rows) {
            *share += mass_kg * value(row, shape).powi(2);
        }
    }
    let all: f64 = moving.iter().sum();
    if all == 0.0 {
        return [0.0, 0.0, 0.0, 1.0];
    }
    let turning = structure.matrices.rotary.quadratic(shape).clamp(0.0, 1.0);
    let [x, y, z] = moving.map(|share| (1.0 - turning) * share / all);
    [x, y, z, turning]
}

/// The node that moves most in a mode, and its direction 0, 1, 2 for x, y, z.
pub fn largest(structure: &Structure, shape: DVectorView<'_, f64>) -> (usize, usize) {
    let rows = &structure.matrices.rows;
    (0..rows.len())
        .flat_map(|node| (0..3).map(move |direction| (node, direction)))
        .max_by(|&(a, i), &(b, j)| {
            value(&rows[a][i], shape)
                .abs()
                .total_cmp(&value(&rows[b][j], shape).abs())
        })
        .unwrap_or((0, 0))
}
