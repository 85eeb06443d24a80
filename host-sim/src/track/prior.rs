//! What a spectrum says of a rail's profile before any train has passed: the covariance of its B-spline coefficients; and the B-splines
//! that come nearest to a track.
//!
//! ```text
//! c = argmin sum_i (sum_k c_k N_k(x_i) - g(x_i) + line(x_i))^2 = P g        line: through g at the first and the last knot
//! C = sum_w S(s_w) ds_w (P cos_w (P cos_w)^T + P sin_w (P sin_w)^T)        waves cos, sin (2 pi s_w x) of the spectrum
//! ```
//!
//! A [`Profile`] begins and ends at zero; a track does not. The line between is what no wheel feels on its way, neither a
//! height nor a constant slope, so it is taken off. What is left of the slope at both ends cannot be had by the B-splines and is wrong
//! over about one span.
//!
//! Waves shorter than two spans are no longer told from each other there. That is meant: a prior must not promise what its B-splines
//! cannot be.
//!
//! Cost: a projection of 2400 waves on the grid, half a second for 120 B-splines.

use std::f64::consts::TAU;

use anyhow::{Context, Result};
use nalgebra::{DMatrix, DVector};
use spanwatch::track::profile::{Knots, Profile};
use spanwatch::track::{Motion, Track};

use super::spectrum::{Quantity, Spectrum};

/// Points of the grid in the shortest span.
const POINTS_A_SPAN: f64 = 8.0;
/// Bands of the spectrum, of equal ratio.
const WAVES: usize = 1200;

/// Places at which a track and its B-splines are compared, and how to project on these.
struct Grid {
    x_m: Vec<f64>,
    /// A row a B-spline: the projection `P`, without the line.
    projection: DMatrix<f64>,
}

impl Grid {
    /// None without knots.
    fn new(knots: &Knots<f64>) -> Option<Self> {
        let [first, last] = knots.extent_m()?;
        let shortest = (knots.stretches().iter())
            .map(|stretch| stretch.spacing_m)
            .fold(f64::INFINITY, f64::min);
        let intervals = ((last - first) / shortest * POINTS_A_SPAN).ceil();
        let x_m: Vec<f64> = (0..=intervals as usize)
            .map(|i| first + (last - first) * i as f64 / intervals)
            .collect();
        let mut values = DMatrix::zeros(x_m.len(), knots.coefficients());
        for (k, mut column) in values.column_iter_mut().enumerate() {
            let bspline = Profile::bspline(knots.clone(), k);
            for (value, &x) in column.iter_mut().zip(&x_m) {
                *value = bspline.at(Motion::Vertical, x).value;
            }
        }
        let projection = values.tr_mul(&values).cholesky()?.solve(&values.transpose());
        Some(Self { x_m, projection })
    }

    /// Takes the line through both ends off.
    fn without_line(&self, values: &mut [f64]) {
        let (begin, end) = (values[0], values[values.len() - 1]);
        let last = (values.len() - 1) as f64;
        for (i, value) in values.iter_mut().enumerate() {
            *value -= begin + (end - begin) * i as f64 / last;
        }
    }
}

/// Covariance of the coefficients, m², of a profile of `spectrum`, all of its waves.
///
/// # Errors
/// Without knots.
pub fn covariance(spectrum: Spectrum, knots: &Knots<f64>) -> Result<DMatrix<f64>> {
    let grid = Grid::new(knots).context("a profile without knots has no covariance")?;
    let [shortest_m, longest_m] = spectrum.waves_m();
    let ratio = (longest_m / shortest_m).powf(1.0 / WAVES as f64);
    let mut waves = DMatrix::zeros(grid.x_m.len(), 2 * WAVES);
    for (i, mut column) in waves.column_iter_mut().enumerate() {
        let low = ratio.powi((i / 2) as i32) / longest_m;
        let s = low * ratio.sqrt();
        let amplitude = (spectrum.density(Quantity::Profile, s) * low * (ratio - 1.0)).sqrt();
        let quarter = (i % 2) as f64 * TAU / 4.0;
        for (value, x) in column.iter_mut().zip(&grid.x_m) {
            *value = amplitude * (TAU * s * x - quarter).cos();
        }
        grid.without_line(column.as_mut_slice());
    }
    let projected = &grid.projection * waves;
    Ok(&projected * projected.transpose())
}

/// The coefficients of the B-splines that come nearest to a track, m; of none without knots.
pub fn fit(track: &dyn Track<f64>, knots: &Knots<f64>) -> Vec<f64> {
    let Some(grid) = Grid::new(knots) else {
        return vec![];
    };
    let mut values = DVector::from_iterator(
        grid.x_m.len(),
        grid.x_m.iter().map(|&x| track.at(Motion::Vertical, x).value),
    );
    grid.without_line(values.as_mut_slice());
    (&grid.projection * values).as_slice().to_vec()
}

#[cfg(test)]
mod tests {
    use super::super::{Stretch, generate};
    use super::*;
    use spanwatch::track::profile;

    fn knots() -> Knots<f64> {
        let stretch = |from_m, spacing_m, spans| profile::Stretch {
            from_m,
            spacing_m,
            spans,
        };
        Knots::new(&[stretch(-145.0, 3.0, 45), stretch(-10.0, 0.8, 78)]).expect("knots")
    }

    #[test]
    fn a_profile_of_b_splines_is_fitted_by_its_own_coefficients() {
        let coefficients: Vec<f64> = (0..120).map(|k| 1e-3 * f64::from(k * k % 17)).collect();
        let fitted = fit(&Profile::new(knots(), &coefficients), &knots());
        let worst = (fitted.iter().zip(&coefficients)).fold(0.0_f64, |worst, (a, b)| worst.max((a - b).abs()));
        assert!(worst < 1e-12, "{worst}");
    }

    #[test]
    fn tracks_of_a_spectrum_are_as_likely_as_its_covariance_says() {
        /// The sum of squares of 120 standard normal numbers, over 120, averaged over 20 tracks: 0.03 standard deviation.
        const TRACKS: u64 = 20;
        const TOLERANCE: f64 = 0.1;
        let covariance = covariance(Spectrum::Fra6, &knots()).expect("knots");
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
                let fitted = DVector::from(fit(&track, &knots()));
                fitted.dot(&factor.solve(&fitted)) / 120.0
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
