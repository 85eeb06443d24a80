//! The irregularity of a real track: two rails, read from a table or generated from a standard spectrum, and the smooth
//! curve through them that wheels roll on.
//!
//! ```text
//! vertical (z_L + z_R) / 2     lateral (y_L + y_R) / 2     roll (z_L - z_R) / (2 y1)
//! ```
//!
//! `z` up and `y` to the left, m, of the left (`L`) and the right rail (`R`) over `x`, m from node 1; `2 y1` =
//! [`RAIL_DISTANCE_M`] between them (paper's Table 3). Each motion is a cubic spline ([`spline`]): value, slope and
//! curvature that enter the contact are those of one curve, continuous all three.
//!
//! Cars start in static balance on level track before it: what a rail has at the beginning is taken off all of it, and
//! the curve begins and ends with slope zero. Behind its end the track stays level at its last height. A table that begins
//! or ends on a slope therefore has a sharp bend there, which shakes as a real one would: let it begin and end level, or
//! begin far before the bridge and end behind it.
//!
//! Cost: a look-up takes one guess where points are evenly spaced and a binary search where they are not, no allocation.
//!
//! ```
//! use host_sim::track::{Profile, Rails};
//! use spanwatch::track::{Motion, Track};
//!
//! let x_m: Vec<f64> = (0..=40).map(|i| 0.5 * f64::from(i)).collect();
//! let bump_m = x_m.iter().map(|x| 1e-3 * (1.0 - (std::f64::consts::TAU * x / 20.0).cos())).collect();
//! let track = Profile::new(Rails::equal(x_m, bump_m));
//! let top = Track::<f64>::at(&track, Motion::Vertical, 10.0);
//! assert!((top.value - 2e-3).abs() < 1e-12 && top.slope.abs() < 1e-12);
//! assert_eq!(Track::<f64>::at(&track, Motion::Vertical, -1.0).value, 0.0);
//! ```

pub mod generate;
pub mod prior;
pub mod spectrum;
pub mod spline;
pub mod summary;
pub mod table;

use spanwatch::math::Real;
use spanwatch::track::{Irregularity, Motion, Track};

pub use generate::{Stretch, generate};
pub use spectrum::Spectrum;
pub use table::read;

use spline::{Knots, Spline};

/// Distance between the rails, `2 y1`, m: twice the half width of the paper's Table 3, 0.70 m.
pub const RAIL_DISTANCE_M: f64 = 1.4;

/// The two rails at the points of a table, all lists of the same length.
#[derive(Debug, Clone, PartialEq)]
pub struct Rails {
    /// Places along the track, m from node 1, ascending.
    pub x_m: Vec<f64>,
    /// Height of the left and the right rail, m, up.
    pub z_m: [Vec<f64>; 2],
    /// Lateral place of the left and the right rail, m, to the left.
    pub y_m: [Vec<f64>; 2],
}

impl Rails {
    /// Two rails of the same height, straight.
    pub fn equal(x_m: Vec<f64>, z_m: Vec<f64>) -> Self {
        let straight = vec![0.0; x_m.len()];
        Self {
            x_m,
            z_m: [z_m.clone(), z_m],
            y_m: [straight.clone(), straight],
        }
    }

    /// The points of a motion, beginning at zero.
    fn motion(&self, motion: Motion) -> Vec<f64> {
        let ([left, right], weights) = match motion {
            Motion::Vertical => (&self.z_m, [0.5, 0.5]),
            Motion::Lateral => (&self.y_m, [0.5, 0.5]),
            Motion::Roll => (&self.z_m, [1.0 / RAIL_DISTANCE_M, -1.0 / RAIL_DISTANCE_M]),
        };
        let mut points: Vec<f64> = (left.iter().zip(right))
            .map(|(l, r)| weights[0] * l + weights[1] * r)
            .collect();
        let first = points[0];
        points.iter_mut().for_each(|point| *point -= first);
        points
    }
}

/// A track on which wheels roll: the smooth curves through [`Rails`].
#[derive(Debug, Clone)]
pub struct Profile {
    rails: Rails,
    knots: Knots,
    vertical: Spline,
    lateral: Spline,
    roll: Spline,
}

impl Profile {
    /// The curves through `rails`.
    ///
    /// # Panics
    /// If there are fewer than two points, places do not ascend or lists differ in length; [`read`] and [`generate()`]
    /// have seen to that.
    pub fn new(rails: Rails) -> Self {
        assert!(
            rails
                .z_m
                .iter()
                .chain(&rails.y_m)
                .all(|rail| rail.len() == rails.x_m.len()),
            "a rail has a value at every place"
        );
        let knots = Knots::new(rails.x_m.clone());
        let spline = |motion| Spline::new(&knots, rails.motion(motion));
        let [vertical, lateral, roll] = [Motion::Vertical, Motion::Lateral, Motion::Roll].map(spline);
        Self {
            rails,
            knots,
            vertical,
            lateral,
            roll,
        }
    }

    /// The points that the curves go through.
    pub fn rails(&self) -> &Rails {
        &self.rails
    }

    fn spline(&self, motion: Motion) -> &Spline {
        match motion {
            Motion::Vertical => &self.vertical,
            Motion::Lateral => &self.lateral,
            Motion::Roll => &self.roll,
        }
    }

    fn at_f64(&self, motion: Motion, x_m: f64) -> Irregularity<f64> {
        let spline = self.spline(motion);
        let [first, last] = self.knots.extent_m();
        if x_m > last {
            return Irregularity {
                value: spline.last(),
                ..Irregularity::none()
            };
        }
        // Not a number is nowhere, and so before the beginning, too.
        if x_m >= first {
            spline.at(&self.knots, x_m)
        } else {
            Irregularity::none()
        }
    }
}

impl<T: Real> Track<T> for Profile {
    fn extent_m(&self) -> Option<[T; 2]> {
        Some(self.knots.extent_m().map(T::of))
    }

    fn at(&self, motion: Motion, x_m: T) -> Irregularity<T> {
        let wide = self.at_f64(motion, x_m.into());
        Irregularity {
            value: T::of(wide.value),
            slope: T::of(wide.slope),
            curvature: T::of(wide.curvature),
            curvature_rate: T::of(wide.curvature_rate),
        }
    }
}
