//! The track: how the rails lead a wheelset, and their irregularity.
//!
//! Wheelsets follow the rails (paper's Eqs 21 to 25). With `w_y`, `w_z` the lateral and vertical place of the left (`L`) and
//! the right rail (`R`) under it, `2 y1` the distance between them,
//!
//! ```text
//! z = (w_zL + w_zR) / 2     y = (w_yL + w_yR) / 2     theta = (w_zL - w_zR) / (2 y1)
//! ```
//!
//! are its vertical, lateral and rolling [`Motion`]. `x` points along the track from node 1, `y` to the left, `z` up;
//! `theta` is positive about `x`: the left wheel rises.

pub mod blob;
pub mod learnt;
pub mod profile;
pub mod watch;

use crate::math::Real;

/// One of the three motions in which the rails lead a wheelset.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Motion {
    /// Up, m.
    Vertical,
    /// To the left, m.
    Lateral,
    /// About the track's direction, left up, rad.
    Roll,
}

/// Irregularity at one point of the track, in one motion (m or rad), and its first three derivatives along the track.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Irregularity<T: Real> {
    /// The irregularity itself.
    pub value: T,
    /// Its derivative, per m.
    pub slope: T,
    /// Its second derivative, per m².
    pub curvature: T,
    /// Its third derivative, per m³; it need not be continuous.
    pub curvature_rate: T,
}

impl<T: Real> Irregularity<T> {
    /// A straight, level track.
    pub fn none() -> Self {
        Self {
            value: T::zero(),
            slope: T::zero(),
            curvature: T::zero(),
            curvature_rate: T::zero(),
        }
    }
}

/// The irregularity of a track. `x` is the bridge's coordinate, 0 at node 1: negative on the approach.
///
/// It is measured from the level track before it, where cars start in static balance: value, slope and curvature are zero
/// there. Behind its end the track stays level at the last value.
pub trait Track<T: Real> {
    /// Where the irregularity begins and ends, m; outside the track is level. None: level everywhere.
    fn extent_m(&self) -> Option<[T; 2]>;
    /// The irregularity at `x_m`, with slope and curvature of the same interpolant; none before the extent, and behind it
    /// the last value with neither slope nor curvature.
    fn at(&self, motion: Motion, x_m: T) -> Irregularity<T>;
}

impl<T: Real, R: Track<T> + ?Sized> Track<T> for &R {
    fn extent_m(&self) -> Option<[T; 2]> {
        (**self).extent_m()
    }

    fn at(&self, motion: Motion, x_m: T) -> Irregularity<T> {
        (**self).at(motion, x_m)
    }
}

/// A perfectly straight and level track.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Smooth;

impl<T: Real> Track<T> for Smooth {
    fn extent_m(&self) -> Option<[T; 2]> {
        None
    }

    fn at(&self, _: Motion, _: T) -> Irregularity<T> {
        Irregularity::none()
    }
}
