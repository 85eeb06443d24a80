//! Finite elements of a girder: Euler-Bernoulli beams with exact Hermite shapes and consistent mass.
//!
//! Two degrees of freedom a node, vertical displacement `w` (up) and slope `dw/dx`; those that are held are left out of
//! the matrices.

use nalgebra::{DMatrix, Matrix4, SymmetricEigen};

use super::file::BridgeFile;

/// The assembled girder.
#[derive(Debug, Clone)]
pub struct Girder {
    /// Distance of each node from node 1, m.
    pub position_m: Vec<f64>,
    /// Number in the matrices of each node's displacement and slope; none where it is held.
    pub freedom: Vec<[Option<usize>; 2]>,
    /// Consistent mass matrix.
    pub mass: DMatrix<f64>,
    /// Stiffness matrix of each element, in the freedoms of the whole.
    pub element_stiffness: Vec<DMatrix<f64>>,
}

impl Girder {
    /// Assembles the girder of a bridge file.
    pub fn new(file: &BridgeFile) -> Self {
        let nodes = file.elements + 1;
        let length = file.length_m / file.elements as f64;
        let mut count = 0;
        let mut number = |held: bool| {
            (!held).then(|| {
                count += 1;
                count - 1
            })
        };
        let freedom: Vec<[Option<usize>; 2]> = (1..=nodes)
            .map(|node| [number(file.supports.contains(&node)), number(false)])
            .collect();

        let stiffness = element_stiffness(file.bending_stiffness_nm2, length);
        let own_mass = element_mass(file.mass_per_length_kgpm, length);
        let mut mass = DMatrix::zeros(count, count);
        let mut shares = Vec::new();
        for element in 0..file.elements {
            let ends = [
                freedom[element][0],
                freedom[element][1],
                freedom[element + 1][0],
                freedom[element + 1][1],
            ];
            let mut share = DMatrix::zeros(count, count);
            for (r, row) in ends.iter().enumerate() {
                for (c, column) in ends.iter().enumerate() {
                    if let (Some(row), Some(column)) = (row, column) {
                        mass[(*row, *column)] += own_mass[(r, c)];
                        share[(*row, *column)] += stiffness[(r, c)];
                    }
                }
            }
            shares.push(share);
        }
        Self {
            position_m: (0..nodes).map(|node| node as f64 * length).collect(),
            freedom,
            mass,
            element_stiffness: shares,
        }
    }

    /// Stiffness matrix with the damage of each element (fraction lost; elements beyond the slice are whole).
    pub fn stiffness(&self, damage: &[f64]) -> DMatrix<f64> {
        let n = self.mass.nrows();
        self.element_stiffness
            .iter()
            .enumerate()
            .fold(DMatrix::zeros(n, n), |sum, (element, share)| {
                sum + share * (1.0 - damage.get(element).copied().unwrap_or(0.0))
            })
    }
}

/// Natural modes: squared circular frequencies (rad²/s², ascending) and mass-normalised shapes (columns) of
/// `stiffness x = lambda mass x`, both symmetric, `mass` positive. None if it is not.
pub fn natural_modes(stiffness: &DMatrix<f64>, mass: &DMatrix<f64>) -> Option<(Vec<f64>, DMatrix<f64>)> {
    let factor = mass.clone().cholesky()?.l();
    let half = factor.solve_lower_triangular(stiffness)?;
    let standard = factor.solve_lower_triangular(&half.transpose())?;
    let eigen = SymmetricEigen::new((&standard + standard.transpose()) * 0.5);
    let mut order: Vec<usize> = (0..mass.nrows()).collect();
    order.sort_by(|&a, &b| eigen.eigenvalues[a].total_cmp(&eigen.eigenvalues[b]));
    let shapes = factor.transpose().solve_upper_triangular(&eigen.eigenvectors)?;
    Some((
        order.iter().map(|&k| eigen.eigenvalues[k]).collect(),
        shapes.select_columns(&order),
    ))
}

fn element_stiffness(ei: f64, l: f64) -> Matrix4<f64> {
    Matrix4::new(
        12.0,
        6.0 * l,
        -12.0,
        6.0 * l, //
        6.0 * l,
        4.0 * l * l,
        -6.0 * l,
        2.0 * l * l, //
        -12.0,
        -6.0 * l,
        12.0,
        -6.0 * l, //
        6.0 * l,
        2.0 * l * l,
        -6.0 * l,
        4.0 * l * l,
    ) * (ei / (l * l * l))
}

fn element_mass(m: f64, l: f64) -> Matrix4<f64> {
    Matrix4::new(
        156.0,
        22.0 * l,
        54.0,
        -13.0 * l, //
        22.0 * l,
        4.0 * l * l,
        13.0 * l,
        -3.0 * l * l, //
        54.0,
        13.0 * l,
        156.0,
        -22.0 * l, //
        -13.0 * l,
        -3.0 * l * l,
        -22.0 * l,
        4.0 * l * l,
    ) * (m * l / 420.0)
}
