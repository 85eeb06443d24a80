//! The one door to transcendental functions.
//!
//! The logger's answer must equal, byte for byte, that of the same code on a PC. `+ - * /` and the square root are
//! exact everywhere (IEEE 754), so these are free; all else comes from [`libm`] on both sides, never from the platform's
//! own library. For the same reason nothing here or in the solver asks for a fused multiply-add, and products of two
//! matrices are written out: on a PC nalgebra would hand them to kernels that fuse.
//!
//! [`micromath`] is faster and coarser: its square root is off by up to 6 %, its logarithm by 0.12. It serves only
//! [`level_db`], a number for the eye.

use nalgebra::{RealField, SMatrix, SVector};

/// The two number types that the physics is written for.
pub trait Real: RealField + Copy + Into<f64> {
    /// Zero, for constants.
    const ZERO: Self;
    /// Nearest value of this type.
    fn of(value: f64) -> Self;
    /// Sine and cosine of an angle in radians, to 1 ulp.
    fn sin_cos_exact(self) -> (Self, Self);
    /// `exp(x) - 1`, to 1 ulp.
    fn exp_m1_exact(self) -> Self;
    /// The whole part of a number that is not negative; 0 for one that is.
    fn whole(self) -> usize;
    /// A count, to the nearest value of this type. (By way of `f64` it would cost a hundred instructions on the logger.)
    fn counted(count: i32) -> Self;
}

impl Real for f32 {
    const ZERO: Self = 0.0;
    fn of(value: f64) -> Self {
        value as f32
    }
    fn sin_cos_exact(self) -> (Self, Self) {
        libm::sincosf(self)
    }
    fn exp_m1_exact(self) -> Self {
        libm::expm1f(self)
    }
    fn whole(self) -> usize {
        self as usize
    }
    fn counted(count: i32) -> Self {
        count as f32
    }
}

impl Real for f64 {
    const ZERO: Self = 0.0;
    fn of(value: f64) -> Self {
        value
    }
    fn sin_cos_exact(self) -> (Self, Self) {
        libm::sincos(self)
    }
    fn exp_m1_exact(self) -> Self {
        libm::expm1(self)
    }
    fn whole(self) -> usize {
        self as usize
    }
    fn counted(count: i32) -> Self {
        count.into()
    }
}

/// A vector's entries.
pub fn entries<T: Real, const N: usize>(vector: &SVector<T, N>) -> &[T; N] {
    let [entries] = &vector.data.0;
    entries
}

/// A matrix's columns.
pub fn columns<T: Real, const R: usize, const C: usize>(matrix: &SMatrix<T, R, C>) -> &[[T; R]; C] {
    &matrix.data.0
}

/// `sum_i a_i b_i`, written out: short rows become straight code without calls.
pub fn dot<T: Real, const N: usize>(a: &[T; N], b: &[T; N]) -> T {
    let mut sum = T::zero();
    for i in 0..N {
        sum += a[i] * b[i];
    }
    sum
}

/// `sum += factor row`, likewise.
pub fn add_scaled<T: Real, const N: usize>(sum: &mut [T; N], factor: T, row: &[T; N]) {
    for i in 0..N {
        sum[i] += factor * row[i];
    }
}

/// Square root of an `f32`, exact (to half an ulp). `libm`'s compiles to one instruction where there is one.
pub fn sqrt(value: f32) -> f32 {
    libm::sqrtf(value)
}

/// The error function of an `f32`, to 1 ulp.
pub fn erf(value: f32) -> f32 {
    libm::erff(value)
}

/// Natural logarithm, to 1 ulp.
pub fn ln(value: f32) -> f32 {
    libm::logf(value)
}

/// Mean square acceleration, (m/s²)², as a level in dB re 1 µm/s² (ISO 1683), for the eye: off by at most 1 dB.
///
/// From [`micromath`]; no decision is taken on it.
pub fn level_db(mean_square_mps2: f32) -> f32 {
    const REFERENCE_SQUARED: f32 = 1e-12;
    if mean_square_mps2 <= REFERENCE_SQUARED {
        return 0.0;
    }
    10.0 * micromath::F32Ext::log10(mean_square_mps2 / REFERENCE_SQUARED)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn level_is_within_one_decibel_of_the_exact_one() {
        let mut worst = 0.0_f32;
        for i in 0..4000 {
            let mean_square = 1e-12 * libm::powf(10.0, i as f32 / 250.0);
            let exact = 10.0 * libm::log10f(mean_square / 1e-12);
            worst = worst.max((level_db(mean_square) - exact).abs());
        }
        assert!(worst < 1.0, "off by {worst} dB");
    }
}
