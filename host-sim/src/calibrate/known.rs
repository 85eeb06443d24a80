//! How well a profile is known, and where, by the waves that shake a bridge.
//!
//! Trains tell waves of some metres to a few micrometres, and a gradient along the whole stretch not at all; what they do not feel does no
//! harm either. So a profile is shown, and set beside another, less its own mean over some metres, twice:
//!
//! ```text
//! h(x) = (1 - G) (1 - G) r,    (G r)(x) = integral g(u) r(x + u) du        g Gaussian, of deviation s
//! ```
//!
//! Of a wave of length l, `h` holds the part `(1 - exp(-2 (pi s / l)^2))^2`: with `s` = 5 m half of one of 20 m, all of one of 6 m, 0.6 % of
//! one of 80 m.
//!
//! Waves shorter than two spans are not in the profile, and so not known at all: their power by the prior counts as variance. On the bridge
//! there are none in a standard spectrum; on the approach, whose knots are ten metres apart, they are most of `h`.

use std::f64::consts::{FRAC_1_SQRT_2, PI, SQRT_2};

use nalgebra::DMatrix;
use spanwatch::track::profile::{Knots, Profile};
use spanwatch::track::{Motion, Track};

use super::Calibration;
use crate::track::Spectrum;
use crate::track::spectrum::Quantity;

/// The wave of which half is left, m.
pub const HALF_WAVE_M: f64 = 20.0;
/// Distance of points, m: a sixteenth of the waves that matter least.
pub const POINT_M: f64 = 0.25;
/// Deviations of the wider Gaussian to either side that are summed.
const REACH: f64 = 4.0;

/// Short waves of a profile at a place.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ShortWaves {
    /// Where, m from node 1.
    pub x_m: f64,
    /// Their height, m.
    pub height_m: f64,
    /// Its standard deviation, m.
    pub deviation_m: f64,
}

impl Calibration {
    /// The short waves of the profile, every [`POINT_M`] from its first knot to its last.
    pub fn short_waves(&self) -> Vec<ShortWaves> {
        let places = places(&self.knots);
        let n = self.knots.coefficients();
        let mut rows = DMatrix::zeros(places.len(), n);
        for k in 0..n {
            let bspline = Profile::bspline(self.knots.clone(), k);
            for (i, height) in short_waves_of(&bspline, &places).into_iter().enumerate() {
                rows[(i, k)] = height;
            }
        }
        let spread = &rows * &self.covariance;
        let missing: Vec<(f64, f64)> = (self.knots.stretches().iter())
            .map(|stretch| (stretch.from_m, self.level * power_below(2.0 * stretch.spacing_m)))
            .collect();
        (places.iter().enumerate())
            .map(|(i, &x_m)| {
                let row = rows.row(i);
                let height_m = row.iter().zip(&self.coefficients).map(|(part, c)| part * c).sum();
                let missing = missing.iter().rfind(|(from_m, _)| *from_m <= x_m);
                let variance = spread.row(i).dot(&row) + missing.map_or(0.0, |(_, power)| *power);
                ShortWaves {
                    x_m,
                    height_m,
                    deviation_m: variance.max(0.0).sqrt(),
                }
            })
            .collect()
    }
}

/// Mean square of `h` of the prior's waves below a length, m².
fn power_below(length_m: f64) -> f64 {
    const WAVES: usize = 400;
    let [shortest, longest] = Spectrum::Fra6.waves_m();
    let (low, high) = (length_m.clamp(shortest, longest).recip().ln(), shortest.recip().ln());
    let width = (high - low) / WAVES as f64;
    let each = (0..WAVES).map(|i| (low + (i as f64 + 0.5) * width).exp());
    each.map(|s| {
        let part = (1.0 - (-2.0 * (PI * deviation_m() * s).powi(2)).exp()).powi(2);
        Spectrum::Fra6.density(Quantity::Profile, s) * part * part * s * width
    })
    .sum()
}

/// `s`: exp(-2 (pi s / l)^2) = 1 - sqrt(1 / 2) of the wave of which half is left.
fn deviation_m() -> f64 {
    HALF_WAVE_M * (-(1.0 - FRAC_1_SQRT_2).ln() / 2.0).sqrt() / PI
}

/// Places along a profile, m.
fn places(knots: &Knots<f64>) -> Vec<f64> {
    let [first, last] = knots.extent_m().unwrap_or([0.0; 2]);
    let count = ((last - first) / POINT_M).round() as usize;
    (0..=count).map(|i| first + POINT_M * i as f64).collect()
}

/// The short waves of a track at places [`POINT_M`] apart, m.
pub fn short_waves_of(track: &impl Track<f64>, places_m: &[f64]) -> Vec<f64> {
    let deviation_m = deviation_m();
    let reach = (REACH * SQRT_2 * deviation_m / POINT_M).round() as usize;
    let Some(&first) = places_m.first() else {
        return Vec::new();
    };
    // Smoothed twice is smoothed by a Gaussian that is wider by the root of two.
    let gaussian = |deviation_m: f64| -> Vec<f64> {
        let weights: Vec<f64> = (0..=2 * reach)
            .map(|i| POINT_M * (i as f64 - reach as f64) / deviation_m)
            .map(|u| (-0.5 * u * u).exp())
            .collect();
        let sum: f64 = weights.iter().sum();
        weights.into_iter().map(|weight| weight / sum).collect()
    };
    let weights: Vec<f64> = (gaussian(deviation_m).into_iter().zip(gaussian(SQRT_2 * deviation_m)))
        .map(|(once, twice)| 2.0 * once - twice)
        .collect();
    let heights: Vec<f64> = (0..places_m.len() + 2 * reach)
        .map(|i| first + POINT_M * (i as f64 - reach as f64))
        .map(|x| track.at(Motion::Vertical, x).value)
        .collect();
    (heights.windows(2 * reach + 1))
        .map(|window| {
            let mean: f64 = window
                .iter()
                .zip(&weights)
                .map(|(height, weight)| height * weight)
                .sum();
            window[reach] - mean
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use spanwatch::track::Irregularity;

    use super::*;

    /// A wave of this length, 1 m high.
    struct Wave(f64);

    impl Track<f64> for Wave {
        fn extent_m(&self) -> Option<[f64; 2]> {
            None
        }

        fn at(&self, _: Motion, x_m: f64) -> Irregularity<f64> {
            Irregularity {
                value: (std::f64::consts::TAU * x_m / self.0).cos(),
                ..Irregularity::none()
            }
        }
    }

    #[test]
    fn half_of_a_wave_of_twenty_metres_is_short_and_all_of_one_of_six() {
        for (length_m, part) in [(80.0, 0.0055), (20.0, 0.5), (6.0, 1.0)] {
            let heights = short_waves_of(&Wave(length_m), &[0.0, 0.25]);
            assert!((heights[0] - part).abs() < 1e-3, "{length_m} m: {heights:?}");
        }
    }
}
