//! A track by chance: a sum of waves with random phases and the amplitudes of a [`Spectrum`].
//!
//! ```text
//! g(x) = sum_k sqrt(2 S(s_k) ds_k) cos(2 pi s_k x + phi_k),   phi_k even in 0 .. 2 pi
//! ```
//!
//! `s_k` lie at equal ratios, so that an octave of long waves has as many as one of short ones, although it is far
//! narrower; at equal differences it would have a handful, and the whole would repeat after `1 / ds`. Phases are drawn for
//! profile, alignment and cross-level in turn: the seed's profile is the same with and without the others. The wheelset
//! feels only the mean lateral place, so both rails get it and the gauge stays as it is.
//!
//! So that it begins and ends level, over [`FADE_M`] at each end `g` is blended into its value there,
//! `g(x0) + w (g(x) - g(x0))`, with `w = 10 u^3 - 15 u^4 + 6 u^5`, `u` from 0 to 1: smooth in value, slope and curvature.
//!
//! Waves longer than [`LONGEST_M`] are left out unless asked for. They hold most of a spectrum's mean square (class 6:
//! 1.2 mm up to 80 m, 7.3 mm up to 304.8 m) and little of what shakes a bridge: over a stretch of 200 m they are gradients
//! rather than irregularity. At 270 km/h waves of 80 to 113 m meet the slowest of a car's natural frequencies (0.66 Hz);
//! ask for them where that matters.

use std::f64::consts::TAU;

use anyhow::{Result, bail};
use rand_core::{Rng, SeedableRng};
use rand_xoshiro::Xoshiro256PlusPlus;

use super::spectrum::{Quantity, Spectrum};
use super::spline::POINTS_A_WAVE;
use super::{Profile, Rails, table};
use crate::random::unit;

/// Waves of each quantity.
const WAVES: usize = 1200;
/// Length at each end over which the track becomes level, m. The usual stretch ends 10 m behind a 50 m bridge.
pub const FADE_M: f64 = 10.0;
/// Longest wave unless another is asked for, m.
pub const LONGEST_M: f64 = 80.0;
/// Most points of a track: 50 km at the usual spacing.
const MOST_POINTS: f64 = 1e6;
/// A stretch that is a whole number of spacings but for this part of one ends there.
const WHOLE: f64 = 1e-6;
/// A wave is turned on from point to point this many times before its angle is computed anew, which keeps rounding at
/// 1e-14 of its amplitude.
const TURNS: usize = 256;

/// Where a track is generated, and how finely.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Stretch {
    /// Its beginning, m from node 1.
    pub from_m: f64,
    /// Its end, m from node 1.
    pub to_m: f64,
    /// Distance of points, m.
    pub spacing_m: f64,
    /// Longest wave, m.
    pub longest_m: f64,
    /// Whether the rails are alike and straight.
    pub vertical_only: bool,
}

impl Default for Stretch {
    /// Around a bridge of 50 m, long enough before it for a fast car to swing in.
    fn default() -> Self {
        Self {
            from_m: -140.0,
            to_m: 60.0,
            spacing_m: 0.05,
            longest_m: LONGEST_M,
            vertical_only: false,
        }
    }
}

impl Stretch {
    /// Places of the points, m.
    fn places_m(&self, shortest_m: f64) -> Result<Vec<f64>> {
        for (flag, value) in [("--from-m", self.from_m), ("--to-m", self.to_m)] {
            if value.is_nan() || value.abs() > table::FARTHEST_M {
                bail!("{flag} must be within {} m of node 1, not {value}", table::FARTHEST_M);
            }
        }
        let length_m = self.to_m - self.from_m;
        if length_m < 3.0 * FADE_M {
            bail!(
                "--to-m {} must lie at least {} m after --from-m {}: the track takes {FADE_M} m at each end to become level",
                self.to_m,
                3.0 * FADE_M,
                self.from_m
            );
        }
        let coarsest_m = shortest_m / POINTS_A_WAVE;
        if !(self.spacing_m > 0.0 && self.spacing_m <= coarsest_m) {
            bail!(
                "--spacing-m must be positive and at most {coarsest_m:.3} m, an eighth of the spectrum's shortest wave, \
                 not {}",
                self.spacing_m
            );
        }
        let intervals = (length_m / self.spacing_m + WHOLE).floor();
        if intervals >= MOST_POINTS {
            bail!(
                "{length_m} m in steps of {} m are more than {MOST_POINTS:.0} points; take a larger --spacing-m",
                self.spacing_m
            );
        }
        Ok((0..=intervals as usize)
            .map(|i| self.from_m + i as f64 * self.spacing_m)
            .collect())
    }

    fn waves_m(&self, spectrum: Spectrum) -> Result<[f64; 2]> {
        let [shortest, longest] = spectrum.waves_m();
        // At least two octaves: fewer are no spectrum any more.
        if !(self.longest_m >= 4.0 * shortest && self.longest_m <= longest) {
            bail!(
                "--longest-m must be {:.1} to {longest} m for this spectrum, not {}",
                4.0 * shortest,
                self.longest_m
            );
        }
        Ok([shortest, self.longest_m])
    }
}

/// A track of `spectrum` by the chance of `seed`, from -140 to 60 m unless `stretch` says otherwise.
///
/// # Errors
/// One sentence that names the flag of `host-sim track generate` whose value cannot be.
pub fn generate(spectrum: Spectrum, seed: u64, stretch: &Stretch) -> Result<Profile> {
    let waves_m = stretch.waves_m(spectrum)?;
    let x_m = stretch.places_m(waves_m[0])?;
    let mut rng = Xoshiro256PlusPlus::seed_from_u64(seed);
    let mut irregularity = |quantity| {
        let mut values = sum_of_waves(|s| spectrum.density(quantity, s), waves_m, stretch, x_m.len(), &mut rng);
        level_ends(&mut values, stretch.spacing_m);
        values
    };
    let profile = irregularity(Quantity::Profile);
    if stretch.vertical_only {
        return Ok(Profile::new(Rails::equal(x_m, profile)));
    }
    let alignment = irregularity(Quantity::Alignment);
    let cross_level = irregularity(Quantity::CrossLevel);
    let rail = |side: f64| -> Vec<f64> {
        (profile.iter().zip(&cross_level))
            .map(|(mean, difference)| mean + side * difference / 2.0)
            .collect()
    };
    Ok(Profile::new(Rails {
        z_m: [rail(1.0), rail(-1.0)],
        y_m: [alignment.clone(), alignment],
        x_m,
    }))
}

fn sum_of_waves(
    density: impl Fn(f64) -> f64,
    [shortest_m, longest_m]: [f64; 2],
    stretch: &Stretch,
    points: usize,
    rng: &mut impl Rng,
) -> Vec<f64> {
    let mut sum = vec![0.0; points];
    let ratio = (longest_m / shortest_m).powf(1.0 / WAVES as f64);
    for k in 0..WAVES {
        // The band from `low` to `low * ratio`, by its geometric mean.
        let low = ratio.powi(k as i32) / longest_m;
        let s = low * ratio.sqrt();
        let amplitude = (2.0 * density(s) * low * (ratio - 1.0)).sqrt();
        let phase = TAU * unit(rng);
        let (turn_sin, turn_cos) = (TAU * s * stretch.spacing_m).sin_cos();
        for (block, values) in sum.chunks_mut(TURNS).enumerate() {
            let x = stretch.from_m + (block * TURNS) as f64 * stretch.spacing_m;
            let (mut sin, mut cos) = (TAU * s * x + phase).sin_cos();
            for value in values {
                *value += amplitude * cos;
                (sin, cos) = (sin * turn_cos + cos * turn_sin, cos * turn_cos - sin * turn_sin);
            }
        }
    }
    sum
}

/// Makes both ends level and the first value zero.
fn level_ends(values: &mut [f64], spacing_m: f64) {
    let (first, last) = (values[0], values[values.len() - 1]);
    let count = values.len();
    for (i, value) in values.iter_mut().enumerate() {
        let (nearest, steps) = if 2 * i < count {
            (first, i)
        } else {
            (last, count - 1 - i)
        };
        let u = (steps as f64 * spacing_m / FADE_M).min(1.0);
        let weight = u * u * u * (10.0 - u * (15.0 - 6.0 * u));
        *value = nearest + weight * (*value - nearest) - first;
    }
}
