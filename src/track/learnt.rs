//! What healthy passages have taught of the track, and of the bridge under it.
//!
//! The base station learns it (`host-sim calibrate`), the logger monitors with it. Damage is measured relative to it: what bridge and
//! rails were like in those passages is what healthy means.
//!
//! **The reference is not exact.** What is wrong with the profile is wrong in every passage, and no number of them averages it away. With
//! `B = L L^T` the covariance that it gives to the elements' flexibilities, the information `I`, `b` of any passages counts as
//!
//! ```text
//! (I^-1 + B)^-1 = L^-T (S (1 + S)^-1) L^-1,    (1 + I B)^-1 b = L^-T (1 + S)^-1 L^T b,      S = L^T I L
//! ```
//!
//! in which nothing cancels, however much or little the passages say (covariances add; Schmidt's "consider" parameters: what is not
//! estimated but known to be uncertain).

use heapless::Vec;
use nalgebra::{SMatrix, SVector};

use super::profile::Profile;
use crate::capacity::{CHANNELS, ELEMENTS};
use crate::identify::estimate::Information;
use crate::interaction::{Direction, Run};
use crate::math;
use crate::wire::message::TrainKind;

/// Slowest speed of the first band, m/s.
pub const FIRST_BAND_MPS: f32 = 5.0;
/// Bands in which the speed doubles: 6 % each. 64 of them reach 200 m/s.
pub const BANDS_AN_OCTAVE: f32 = 12.0;

/// A lower triangle with a positive diagonal, or zero.
pub type Spread = SMatrix<f32, ELEMENTS, ELEMENTS>;
/// Numbers of a triangle.
pub const TRIANGLE: usize = ELEMENTS * (ELEMENTS + 1) / 2;

/// Standard deviations of a flexibility by which a track can be uncertain: what is beyond is known exactly, or not at all.
const SPREADS: core::ops::RangeInclusive<f32> = 1e-6..=10.0;

/// A track as it was learnt.
#[derive(Debug, Clone, PartialEq)]
pub struct LearntTrack {
    /// The mean height of the rails.
    pub profile: Profile<f32>,
    /// Stiffness of the whole bridge, as a part of its model's.
    pub stiffness: f32,
    /// Damping of the bridge, as a part of its model's.
    pub damping: f32,
    /// `L`; zero where the track is known exactly.
    pub spread: Spread,
    /// What is left unexplained of each channel.
    pub unexplained: [Unexplained; CHANNELS],
    /// Standard deviation, from passage to passage, of the logarithm of what is left over what is expected to be.
    pub scatter: f32,
    /// How many passages it was learnt from; 0: none, it is not a learnt one.
    pub passages: u16,
    /// The speeds at which trains of each kind passed: bit `i` of the kind's number for the `i`-th [band](speed_band).
    pub speeds: [u64; 2],
}

/// What a channel leaves unexplained of a healthy passage: `floor + part * mean square`.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Unexplained {
    /// Noise of the sensor, (m/s²)² (m²).
    pub floor: f32,
    /// Part of the mean square of the passage.
    pub part: f32,
}

impl LearntTrack {
    const NONE: Self = Self {
        profile: Profile::SMOOTH,
        stiffness: 1.0,
        damping: 1.0,
        spread: SMatrix::from_array_storage(nalgebra::ArrayStorage([[0.0; ELEMENTS]; ELEMENTS])),
        unexplained: [Unexplained { floor: 0.0, part: 0.0 }; CHANNELS],
        scatter: 0.0,
        passages: 0,
        speeds: [0; 2],
    };

    /// Whether it was learnt.
    pub fn is_learnt(&self) -> bool {
        self.passages > 0
    }

    /// What passages of this information say of the elements, the reference being as uncertain as it is.
    pub fn relative(&self, passages: &Information) -> Information {
        relative(&self.spread, passages)
    }

    /// Mean over the channels of the logarithm of what is left of a passage over what is expected to be, in deviations of one
    /// passage; `mean_squares` are those of recording and residuals of each channel.
    pub fn misfit(&self, mean_squares: &[[f32; 2]; CHANNELS]) -> f32 {
        let (mut sum, mut count) = (0.0, 0.0);
        for ([power, left], expected) in mean_squares.iter().zip(&self.unexplained) {
            let expected = expected.floor + expected.part * power;
            // A channel of which nothing came says nothing.
            if expected > 0.0 && *power > 0.0 {
                sum += math::ln((left / expected).max(f32::MIN_POSITIVE));
                count += 1.0;
            }
        }
        sum / (count * self.scatter)
    }

    /// Whether trains of this kind were among those that it was learnt from, at about this speed. They all enter by node 1: before the other
    /// end the profile has no approach.
    pub fn knows(&self, train: TrainKind, run: &Run<f32>) -> bool {
        let band = 1_u64 << speed_band(run.speed_mps);
        let about = band | band << 1 | band >> 1;
        let learnt = (self.speeds.get(train as usize)).is_some_and(|speeds| speeds & about != 0);
        learnt && run.direction == Direction::Forward
    }
}

/// See [`LearntTrack::relative`].
pub fn relative(l: &Spread, passages: &Information) -> Information {
    if (0..ELEMENTS).any(|e| l[(e, e)] <= 0.0) {
        return *passages;
    }
    // S = L^T I L, and 1 + S.
    let mut half = SMatrix::<f32, ELEMENTS, ELEMENTS>::zeros();
    let mut s = half;
    for i in 0..ELEMENTS {
        for j in 0..ELEMENTS {
            for k in j..ELEMENTS {
                half[(i, j)] += passages.matrix[(i.max(k), i.min(k))] * l[(k, j)];
            }
        }
    }
    for i in 0..ELEMENTS {
        for j in 0..ELEMENTS {
            for k in i..ELEMENTS {
                s[(i, j)] += l[(k, i)] * half[(k, j)];
            }
        }
    }
    let mut right = SVector::<f32, ELEMENTS>::zeros();
    for i in 0..ELEMENTS {
        for k in i..ELEMENTS {
            right[i] += l[(k, i)] * passages.vector[k];
        }
    }
    let mut one_and = s;
    for e in 0..ELEMENTS {
        one_and[(e, e)] += 1.0;
    }
    // Numbers that are none have no factor, and say nothing.
    let Some(factor) = one_and.cholesky() else {
        return Information::ZERO;
    };
    factor.solve_mut(&mut s);
    factor.solve_mut(&mut right);
    // L^-T from the left, L^-1 from the right.
    for column in 0..ELEMENTS {
        solve_transposed(l, |i| s[(i, column)], &mut half, column);
    }
    let mut matrix = SMatrix::zeros();
    for row in 0..ELEMENTS {
        solve_transposed(l, |i| half[(row, i)], &mut matrix, row);
    }
    let mut vector = SMatrix::<f32, ELEMENTS, ELEMENTS>::zeros();
    solve_transposed(l, |i| right[i], &mut vector, 0);
    Information {
        // What rounding has made of the symmetry is shared out.
        matrix: SMatrix::from_fn(|i, j| 0.5 * (matrix[(i, j)] + matrix[(j, i)])),
        vector: SVector::from_fn(|i, _| vector[(i, 0)]),
    }
}

/// A spread as it travels: its triangle, row by row.
pub fn pack(spread: &Spread) -> Vec<f32, TRIANGLE> {
    (0..ELEMENTS)
        .flat_map(|i| (0..=i).map(move |j| spread[(i, j)]))
        .take(TRIANGLE)
        .collect()
}

/// The spread of a triangle; none if it is not one.
pub fn unpack(triangle: &[f32]) -> Option<Spread> {
    let mut spread = Spread::zeros();
    let mut values = triangle.iter().copied();
    for i in 0..ELEMENTS {
        for j in 0..=i {
            spread[(i, j)] = values.next()?;
        }
    }
    let positive = (0..ELEMENTS).all(|e| SPREADS.contains(&spread[(e, e)]));
    let sound = triangle.len() == TRIANGLE && triangle.iter().all(|value| value.abs() <= *SPREADS.end());
    (sound && (positive || spread == Spread::zeros())).then_some(spread)
}

/// `L^-T` times the column that `right` gives, into column `to` of `solution`.
fn solve_transposed(
    l: &SMatrix<f32, ELEMENTS, ELEMENTS>,
    right: impl Fn(usize) -> f32,
    solution: &mut SMatrix<f32, ELEMENTS, ELEMENTS>,
    to: usize,
) {
    for i in (0..ELEMENTS).rev() {
        let mut value = right(i);
        for k in i + 1..ELEMENTS {
            value -= l[(k, i)] * solution[(k, to)];
        }
        solution[(i, to)] = value / l[(i, i)];
    }
}

/// A smooth track under a bridge as its model has it: nothing was learnt.
pub static UNLEARNT: LearntTrack = LearntTrack::NONE;

/// The band of a speed, from 0 to 63.
pub fn speed_band(speed_mps: f32) -> u32 {
    let octaves = math::ln(speed_mps.max(FIRST_BAND_MPS) / FIRST_BAND_MPS) / core::f32::consts::LN_2;
    ((BANDS_AN_OCTAVE * octaves) as u32).min(u64::BITS - 1)
}
