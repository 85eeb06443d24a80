//! What a standard spectrum says beforehand of a profile's coefficients.
//!
//! ```text
//! R(x, y) = rho(x - y) - rho(x - x0) - rho(y - x0) + rho(0),   rho(d) = integral S(s) cos(2 pi s d) ds
//! c = F r,  F = (N^T W N)^-1 N^T W,  W = w^2 + D^T D           the B-splines' least-squares fit to the rail at close points
//! Cov(c) = F R F^T
//! ```
//!
//! `x0` is the first knot, from whose height a profile is measured. `D` takes second differences: wheels follow the rail's curvature, so that is
//! what is fitted, and its height with the weight `w` that makes both equal for a wave of [`EVEN_M`]. Waves shorter than two spans are
//! not in a profile, and the fit leaves them out.

use anyhow::{Context, Result};
use nalgebra::{DMatrix, DVector};
use spanwatch::track::profile::{Knots, Profile};
use spanwatch::track::{Motion, Track};

use super::Spectrum;
use super::spectrum::Quantity;

/// Distance of the points that a fit is made to, m.
const POINT_M: f64 = 0.2;
/// Wave whose height counts as much as its curvature in a fit, m.
const EVEN_M: f64 = 20.0;
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
    let weighted = weigh(&bsplines);
    let gram = weighted.tr_mul(&bsplines);
    // B-splines are independent: the matrix has a factor wherever a point lies in each.
    gram.cholesky().map_or_else(
        || DMatrix::zeros(n, points.len()),
        |factor| factor.solve(&weighted.transpose()),
    )
}

/// `W` times columns of heights.
fn weigh(heights: &DMatrix<f64>) -> DMatrix<f64> {
    let mut weighted = heights * (std::f64::consts::TAU / EVEN_M).powi(4);
    for (mut to, from) in weighted.column_iter_mut().zip(heights.column_iter()) {
        for i in 1..from.len().saturating_sub(1) {
            let curvature = (from[i - 1] - 2.0 * from[i] + from[i + 1]) / POINT_M.powi(4);
            to[i - 1] += curvature;
            to[i] -= 2.0 * curvature;
            to[i + 1] += curvature;
        }
    }
    weighted
}

/// Coefficients of the profile nearest to a track, m, as wheels feel it.
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

/// Its inverse.
///
/// # Errors
/// If it has none.
pub fn precision(spectrum: Spectrum, knots: &Knots<f64>) -> Result<DMatrix<f64>> {
    let factor = covariance(spectrum, knots).cholesky();
    Ok(factor.context("a spectrum that these knots can hold")?.inverse())
}

/// The covariance of the spectrum's waves of these lengths alone, m.
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

#[cfg(test)]
mod tests {
    use super::super::{Stretch, generate};
    use super::*;

    /// Those of the shipped girder.
    fn knots() -> Knots<f64> {
        crate::calibrate::knots(50.0).expect("knots")
    }

    #[test]
    fn a_profile_of_b_splines_is_fitted_by_its_own_coefficients() {
        let count = knots().coefficients();
        let coefficients: Vec<f64> = (0..count).map(|k| 1e-3 * (k * k % 17) as f64).collect();
        let fitted = fit(&Profile::new(knots(), &coefficients), &knots());
        let worst = (fitted.iter().zip(&coefficients)).fold(0.0_f64, |worst, (a, b)| worst.max((a - b).abs()));
        assert!(worst < 1e-12, "{worst}");
    }

    #[test]
    fn tracks_of_a_spectrum_are_as_likely_as_its_covariance_says() {
        // Spans of half the shortest wave: with shorter ones some combinations of B-splines are in no wave.
        let stretch = |from_m, spacing_m, spans| spanwatch::track::profile::Stretch {
            from_m,
            spacing_m,
            spans,
        };
        let knots = Knots::new(&[stretch(-145.0, 3.0, 45), stretch(-10.0, 0.8, 78)]).expect("knots");
        /// The sum of squares of 120 standard normal numbers, over 120, averaged over 20 tracks: 0.03 standard deviation.
        const TRACKS: u64 = 20;
        const TOLERANCE: f64 = 0.1;
        let covariance = covariance(Spectrum::Fra6, &knots);
        let factor = covariance.cholesky().expect("positive definite");
        let stretch = Stretch {
            from_m: -250.0,
            to_m: 90.0,
            longest_m: Spectrum::Fra6.waves_m()[1],
            vertical_only: true,
            ..Stretch::default()
        };
        let mean = (1..=TRACKS)
            .map(|seed| {
                let track = generate(Spectrum::Fra6, seed, &stretch).expect("a track");
                let fitted = DVector::from(fit(&track, &knots));
                fitted.dot(&factor.solve(&fitted)) / fitted.len() as f64
            })
            .sum::<f64>()
            / TRACKS as f64;
        assert!((mean - 1.0).abs() < TOLERANCE, "{mean}");
    }

    #[test]
    fn what_b_splines_leave_of_a_track_are_its_shortest_waves() {
        let stretch = Stretch {
            vertical_only: true,
            from_m: -250.0,
            to_m: 90.0,
            ..Stretch::default()
        };
        let track = generate(Spectrum::Fra6, 1, &stretch).expect("a track");
        let fitted = Profile::new(knots(), &fit(&track, &knots()));
        // The line that no wheel feels is the chord of a second difference.
        let second = |track: &dyn Track<f64>, x: f64| {
            let at = |x| track.at(Motion::Vertical, x).value;
            at(x - 3.0) - 2.0 * at(x) + at(x + 3.0)
        };
        let squares = (0..450).fold([0.0; 2], |[left, all], i| {
            let x = f64::from(i) * 0.1 + 3.0;
            let (is, fits) = (second(&track, x), second(&fitted, x));
            [left + (is - fits).powi(2), all + is * is]
        });
        let part = (squares[0] / squares[1]).sqrt();
        assert!(part < 0.02, "{part}");
    }
}
