//! The recorder's chain, applied to a simulation so that it can be compared with a recording: a causal low-pass
//! (4th-order Butterworth) before sampling.
//!
//! Two second-order sections, `Q = 1 / (2 cos(pi/8))` and `1 / (2 cos(3 pi/8))`, by the bilinear transform with the cut-off
//! prewarped; transposed direct form II:
//!
//! ```text
//! y = b0 x + s1,   s1 = b1 x - a1 y + s2,   s2 = b2 x - a2 y,   a0 = 1
//! ```
//!
//! Coefficients ([`AntiAlias`]) and state ([`AntiAliasState`]) are two types, so one filter serves all channels.

use crate::math::Real;

/// One second-order section `[b0, b1, b2, a1, a2]`.
type Section<T> = [T; 5];

/// Coefficients of the anti-alias filter at one step; none: the signal passes as it is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AntiAlias<T: Real> {
    sections: Option<[Section<T>; 2]>,
}

/// State of the filter on one channel.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AntiAliasState<T: Real> {
    s: [[T; 2]; 2],
}

impl<T: Real> Default for AntiAliasState<T> {
    fn default() -> Self {
        Self { s: [[T::zero(); 2]; 2] }
    }
}

impl<T: Real> AntiAlias<T> {
    /// The filter with cut-off `cutoff_hz` for a signal in steps of `step_s`; no cut-off, or one at or beyond half the
    /// rate of the steps: no filter.
    pub fn new(cutoff_hz: Option<T>, step_s: T) -> Self {
        let half = T::of(0.5);
        let Some(cutoff) = cutoff_hz.filter(|&f| f > T::zero() && f * step_s < half) else {
            return Self { sections: None };
        };
        let (sin, cos) = (T::pi() * cutoff * step_s).sin_cos_exact();
        let w = sin / cos;
        let section = |pole_angle: T| {
            let damping = T::of(2.0) * pole_angle.sin_cos_exact().1;
            let norm = (T::one() + w * damping + w * w).recip();
            let b0 = w * w * norm;
            let two = T::of(2.0);
            [
                b0,
                two * b0,
                b0,
                two * (w * w - T::one()) * norm,
                (T::one() - w * damping + w * w) * norm,
            ]
        };
        let eighth = T::pi() / T::of(8.0);
        Self {
            sections: Some([section(eighth), section(T::of(3.0) * eighth)]),
        }
    }

    /// The next value of a channel.
    pub fn apply(&self, state: &mut AntiAliasState<T>, input: T) -> T {
        let Some(sections) = &self.sections else { return input };
        let mut x = input;
        for ([b0, b1, b2, a1, a2], [s1, s2]) in sections.iter().zip(&mut state.s) {
            let y = *b0 * x + *s1;
            *s1 = *b1 * x - *a1 * y + *s2;
            *s2 = *b2 * x - *a2 * y;
            x = y;
        }
        x
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Gain at `f` Hz, measured with a long sine.
    fn gain(filter: &AntiAlias<f64>, f: f64, step: f64) -> f64 {
        let mut state = AntiAliasState::default();
        let (mut square, mut n) = (0.0, 0);
        for k in 0..40_000 {
            let y = filter.apply(
                &mut state,
                (core::f64::consts::TAU * f * k as f64 * step).sin_cos_exact().0,
            );
            if k > 20_000 {
                square += y * y;
                n += 1;
            }
        }
        libm::sqrt(2.0 * square / f64::from(n))
    }

    #[test]
    fn the_filter_is_a_fourth_order_butterworth() {
        let step = 1e-3;
        let filter = AntiAlias::new(Some(40.0), step);
        let warp =
            |f: f64| libm::tan(core::f64::consts::PI * f * step) / libm::tan(core::f64::consts::PI * 40.0 * step);
        for f in [5.0, 20.0, 40.0, 80.0, 160.0] {
            let exact = 1.0 / libm::sqrt(1.0 + libm::pow(warp(f), 8.0));
            assert!((gain(&filter, f, step) - exact).abs() < 1e-4, "{f} Hz");
        }
    }

    #[test]
    fn a_cut_off_beyond_half_the_rate_filters_nothing() {
        let filter = AntiAlias::new(Some(600.0), 1e-3);
        assert_eq!(filter.apply(&mut AntiAliasState::default(), 3.0), 3.0);
    }
}
