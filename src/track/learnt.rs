//! What healthy passages have taught of the track, and of the bridge under it.
//!
//! The base station learns it (`host-sim calibrate`), the logger monitors with it. Damage is measured relative to it: what the bridge and
//! its rails were like in those passages is what healthy means.

use nalgebra::SMatrix;

use super::profile::Profile;
use crate::capacity::{CHANNELS, ELEMENTS};

/// A track as it was learnt.
#[derive(Debug, Clone, PartialEq)]
pub struct LearntTrack {
    /// The mean height of the rails.
    pub profile: Profile<f32>,
    /// Stiffness of the whole bridge, as a part of its model's.
    pub stiffness: f32,
    /// Damping of the bridge, as a part of its model's.
    pub damping: f32,
    /// What the reference itself is known to, as an information about the elements' flexibilities: the inverse of the covariance that
    /// what is left unknown of the profile gives to any number of later passages. However many these are, no element is known better
    /// than by this. Zero where there is no such limit.
    pub reference: SMatrix<f32, ELEMENTS, ELEMENTS>,
    /// What is left unexplained of a channel's mean square: `floor + part * mean square`, (m/s²)² (m²) and a part.
    pub unexplained: [Unexplained; CHANNELS],
    /// Standard deviation of the logarithm of the ratio of what is left unexplained to that, from passage to passage.
    pub scatter: f32,
    /// How many passages it was learnt from.
    pub passages: u16,
    /// The speeds at which trains of each kind passed: bit `i` of the kind's number for the `i`-th [band](speed_band).
    pub speeds: [u64; 2],
}

/// What a channel leaves unexplained of a healthy passage.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Unexplained {
    /// Noise of the sensor, (m/s²)² (m²).
    pub floor: f32,
    /// Part of the mean square of the passage.
    pub part: f32,
}

/// Slowest speed of the first band, m/s.
const FIRST_BAND_MPS: f32 = 5.0;
/// Bands by which the speed doubles: 6 % each. 64 of them reach 200 m/s and more.
const BANDS_AN_OCTAVE: f32 = 12.0;

/// The band of a speed, from 0 to 63.
pub fn speed_band(speed_mps: f32) -> u32 {
    let bands =
        BANDS_AN_OCTAVE * crate::math::ln(speed_mps.max(FIRST_BAND_MPS) / FIRST_BAND_MPS) / core::f32::consts::LN_2;
    (bands as u32).min(u64::BITS - 1)
}
