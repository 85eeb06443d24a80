//! Natural modes: `K phi = omega^2 M phi`, `phi^T M phi = 1`.
//!
//! Solved as `L^-1 M L^-T y = omega^-2 y` with `K = L L^T`, `phi = omega L^-T y`: the slow modes, which matter, come out
//! best, and degrees of freedom without mass do no harm (they belong to infinite frequencies, which are left out). Dense,
//! by the crate `faer`; the cost is about `10 n^3` operations.

use anyhow::{Result, anyhow};
use faer::linalg::triangular_solve::{solve_lower_triangular_in_place, solve_upper_triangular_in_place};
use faer::{Mat, MatRef, Par, Side};
use nalgebra::{DMatrix, DVector};

/// A mode of `omega^2` beyond this many times that of the first has lost all digits; it moves what has no mass.
const NO_MASS: f64 = 1e14;

/// Which of the modes are wanted.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Wanted {
    /// So many of the lowest.
    Count(usize),
    /// All up to this frequency, Hz.
    UpToHz(f64),
}

impl Wanted {
    /// How many of the modes with these squared circular frequencies (ascending) are wanted.
    pub fn among(self, omega_squared: &[f64]) -> usize {
        match self {
            Self::Count(count) => count.min(omega_squared.len()),
            Self::UpToHz(limit) => omega_squared.partition_point(|&w2| frequency_hz(w2) <= limit),
        }
    }
}

/// Natural modes, lowest first.
#[derive(Debug, Clone, PartialEq)]
pub struct NaturalModes {
    /// Squared circular frequencies, rad²/s².
    pub omega_squared: Vec<f64>,
    /// Mass-normalised shapes, a column each.
    pub shapes: DMatrix<f64>,
}

/// The frequency of a squared circular frequency, Hz.
pub fn frequency_hz(omega_squared: f64) -> f64 {
    omega_squared.sqrt() / std::f64::consts::TAU
}

/// All natural modes of finite frequency.
///
/// # Errors
/// If the stiffness is not positive or nothing has mass.
pub fn natural_modes(stiffness: &DMatrix<f64>, mass: &DMatrix<f64>) -> Result<NaturalModes> {
    let n = stiffness.nrows();
    let factor = view(stiffness)
        .llt(Side::Lower)
        .map_err(|_| anyhow!("the stiffness matrix is not positive: the bridge can move without resistance"))?;
    let lower = factor.L();
    let mut standard = view(mass).to_owned();
    solve_lower_triangular_in_place(lower, standard.as_mut(), Par::Seq);
    let mut standard = standard.transpose().to_owned();
    solve_lower_triangular_in_place(lower, standard.as_mut(), Par::Seq);
    let eigen = standard
        .self_adjoint_eigen(Side::Lower)
        .map_err(|_| anyhow!("the eigenvalues of the bridge could not be found: check its stiffnesses and masses"))?;
    let softness = eigen.S().column_vector();
    let largest = softness[n - 1];
    if largest <= 0.0 || largest.is_nan() {
        return Err(anyhow!("nothing of the bridge has mass: give a density or a mass"));
    }
    let finite = (0..n).rev().take_while(|&k| softness[k] > largest / NO_MASS).count();
    let mut shapes = Mat::from_fn(n, finite, |i, k| eigen.U()[(i, n - 1 - k)] / softness[n - 1 - k].sqrt());
    solve_upper_triangular_in_place(lower.transpose(), shapes.as_mut(), Par::Seq);
    Ok(NaturalModes {
        omega_squared: (0..finite).map(|k| softness[n - 1 - k].recip()).collect(),
        shapes: DMatrix::from_fn(n, finite, |i, k| shapes[(i, k)]),
    })
}

/// Solves `K x = f` for the columns of `f`.
///
/// # Errors
/// If `K` is not positive.
pub fn solve(stiffness: &DMatrix<f64>, loads: &DMatrix<f64>) -> Result<DMatrix<f64>> {
    use faer::linalg::solvers::Solve;
    let factor = view(stiffness)
        .llt(Side::Lower)
        .map_err(|_| anyhow!("the stiffness matrix is not positive: the bridge can move without resistance"))?;
    let answer = factor.solve(view(loads));
    Ok(DMatrix::from_fn(loads.nrows(), loads.ncols(), |i, j| answer[(i, j)]))
}

/// The smallest squared pivot of a matrix with unit diagonal, zero if it is not positive.
pub fn smallest_pivot(scaled: &DMatrix<f64>) -> f64 {
    view(scaled).llt(Side::Lower).map_or(0.0, |factor| {
        (0..scaled.nrows()).fold(1.0, |least, i| factor.L()[(i, i)].powi(2).min(least))
    })
}

/// The eigenvector of the smallest eigenvalue of a symmetric matrix.
pub fn softest(symmetric: &DMatrix<f64>) -> Option<DVector<f64>> {
    let eigen = view(symmetric).self_adjoint_eigen(Side::Lower).ok()?;
    Some(DVector::from_fn(symmetric.nrows(), |i, _| eigen.U()[(i, 0)]))
}

fn view(matrix: &DMatrix<f64>) -> MatRef<'_, f64> {
    MatRef::from_column_major_slice(matrix.as_slice(), matrix.nrows(), matrix.ncols())
}
