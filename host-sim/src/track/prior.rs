//! What a standard spectrum says beforehand of a profile's coefficients.
//!
//! ```text
//! R(x, y) = rho(x - y) - rho(x - x0) - rho(y - x0) + rho(0),   rho(d) = integral S(s) cos(2 pi s d) ds
//! c = F r,  F = (N^T N)^-1 N^T                                 the B-splines' least-squares fit to the rail at close points
//! Cov(c) = F R F^T
//! ```
//!
//! `x0` is the first knot, from whose height a profile is measured. Waves shorter than two spans are not in a profile, and the
//! fit leaves them out.

use nalgebra::{DMatrix, DVector};
use spanwatch::track::profile::{Knots, Profile};
use spanwatch::track::{Motion, Track};

use super::Spectrum;
use super::spectrum::Quantity;

/// Distance of the points that a fit is made to, m.
const POINT_M: f64 = 0.2;
/// Waves by which the spectrum is summed, evenly spaced in the logarithm of their length.
const WAVES: usize = 1500;
/// Part of the largest variance that is added to each, so that the covariance keeps its inverse.
const RIDGE: f64 = 1e-9;

fn points(knots: &Knots<f64>) -> Vec<f64> {
    let [first, last] = knots.extent_m().unwrap_or([0.0; 2]);
    let count = ((last - first) / POINT_M) as usize;
    (0..=count).map(|i| first + POINT_M * i as f64).collect()
}

/// `F`, a row a coefficient.
fn fitting(knots: &Knots<f64>, points: &[f64]) -> DMatrix<f64> {
    let n = knots.coefficients();
    let mut bsplines = DMatrix::zeros(points.len(), n);
    for k in 0..n {
        let bspline = Profile::bspline(knots.clone(), k);
        for (i, &x) in points.iter().enumerate() {
            bsplines[(i, k)] = bspline.at(Motion::Vertical, x).value;
        }
    }
    let transposed = bsplines.transpose();
    let gram = &transposed * bsplines;
    // B-splines are independent: the matrix has a factor wherever a point lies in each.
    gram.cholesky()
        .map_or_else(|| DMatrix::zeros(n, points.len()), |factor| factor.solve(&transposed))
}

/// Coefficients of the profile nearest to a track, m: least squares at close points.
pub fn fit(track: &impl Track<f64>, knots: &Knots<f64>) -> Vec<f64> {
    let points = points(knots);
    let heights = DVector::from_iterator(
        points.len(),
        points.iter().map(|&x| track.at(Motion::Vertical, x).value),
    );
    let first = heights.iter().copied().next().unwrap_or(0.0);
    (fitting(knots, &points) * heights.add_scalar(-first))
        .as_slice()
        .to_vec()
}

/// Covariance of a profile's coefficients on a track of this spectrum, m².
pub fn covariance(spectrum: Spectrum, knots: &Knots<f64>) -> DMatrix<f64> {
    covariance_of_waves(spectrum, spectrum.waves_m(), knots)
}

/// The same of the spectrum's waves of these lengths alone, m.
pub fn covariance_of_waves(spectrum: Spectrum, [shortest, longest]: [f64; 2], knots: &Knots<f64>) -> DMatrix<f64> {
    let points = points(knots);
    let (low, high) = (longest.recip().ln(), shortest.recip().ln());
    let width = (high - low) / WAVES as f64;
    let waves: Vec<[f64; 2]> = (0..WAVES)
        .map(|i| {
            let s = (low + (i as f64 + 0.5) * width).exp();
            [s, spectrum.density(Quantity::Profile, s) * s * width]
        })
        .collect();
    let rho: Vec<f64> = (0..points.len())
        .map(|lag| {
            let distance = POINT_M * lag as f64;
            waves
                .iter()
                .map(|[s, power]| power * (std::f64::consts::TAU * s * distance).cos())
                .sum()
        })
        .collect();
    let at_points = DMatrix::from_fn(points.len(), points.len(), |i, j| {
        rho[i.abs_diff(j)] - rho[i] - rho[j] + rho[0]
    });
    let fitting = fitting(knots, &points);
    let mut covariance = &fitting * at_points * fitting.transpose();
    let ridge = RIDGE * covariance.diagonal().max();
    for k in 0..knots.coefficients() {
        covariance[(k, k)] += ridge;
    }
    covariance
}
