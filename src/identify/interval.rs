//! Intervals for a measured quantity that cannot be negative.
//!
//! A Gaussian measurement `x` of `mu >= 0` may well be negative; `x - 1.96 sigma .. x + 1.96 sigma` is then an empty or absurdly
//! short interval, and to choose between an upper limit and two sides after a look at `x` spoils the coverage. Feldman
//! and Cousins (Phys. Rev. D 57, 3873, 1998, section IV.B) order the outcomes by how well `mu` explains them compared with the
//! best `mu` that is allowed:
//!
//! ```text
//! R(x | mu) = exp(-(x - mu)^2 / 2)  for x >= 0,   exp(x mu - mu^2 / 2)  for x < 0              (their Eq. 4.3, sigma = 1)
//! accepted for mu: x1 <= x <= x2,   R(x1) = R(x2),   Phi(x2 - mu) - Phi(x1 - mu) = 0.95
//! interval of x: all mu that accept it
//! ```
//!
//! The interval holds the true value 95 % of the time whatever it is, is never empty, and turns from an upper limit into two
//! sides by itself. Where `x1 >= 0` the acceptance is `mu -+ 1.96`, so the upper end is `x + 1.96` for `x >= 0` and the
//! lower `x - 1.96` for `x >= 3.92`; below, the conditions leave one equation that is monotonic in `mu`, solved by bisection.
//!
//! Cost: at most 120 error functions.
//!
//! ```
//! use spanwatch::identify::interval::confidence;
//! // Nothing seen: an upper limit. Clearly seen: two sides.
//! assert_eq!(confidence(0.0, 1.0, 10.0)[0], 0.0);
//! assert!(confidence(5.0, 1.0, 10.0)[0] > 3.0);
//! ```

use crate::math;

/// The share of cases in which the interval holds the true value.
pub const CONFIDENCE: f32 = 0.95;
/// The two-sided quantile, `Phi(q) - Phi(-q) = 0.95`.
const TWO_SIDED: f32 = 1.959_964;
/// The one-sided quantile, `Phi(q) = 0.95`; below it the lower end is zero.
const ONE_SIDED: f32 = 1.644_853_6;
/// Bisections of an interval of 2: beyond the resolution of `f32`.
const BISECTIONS: u32 = 30;

/// The 95 % interval `[low, high]` of a quantity between 0 and `most`, measured as `x` with the standard deviation `sigma`.
///
/// The upper bound only cuts the interval off. A measurement that is none (`x` or `sigma` not a number, `sigma` infinite) leaves
/// all of `0 .. most`.
pub fn confidence(x: f32, sigma: f32, most: f32) -> [f32; 2] {
    if !(x.is_finite() && sigma.is_finite() && sigma >= 0.0) {
        return [0.0, most];
    }
    // Deviations beyond which only the closed forms are used, and a negative measurement is as good as zero.
    let t = (x / sigma.max(f32::MIN_POSITIVE)).clamp(-1e6, 1e6);
    let low = if t >= 2.0 * TWO_SIDED {
        x - TWO_SIDED * sigma
    } else if t <= ONE_SIDED {
        0.0
    } else {
        // x2(mu) = t: the lower mu, the more is accepted with it.
        let excess = |mu: f32| between(-mu + t - t * t / (2.0 * mu), t - mu) - CONFIDENCE;
        sigma * bisect(0.0, 0.5 * t, |mu| excess(mu) > 0.0)
    };
    let high = if t >= 0.0 {
        x + TWO_SIDED * sigma
    } else {
        // x1(mu) = t.
        let excess = |mu: f32| between(t - mu, math::sqrt(mu * (mu - 2.0 * t))) - CONFIDENCE;
        sigma * bisect(0.0, TWO_SIDED, |mu| excess(mu) < 0.0)
    };
    [low.max(0.0).min(most), high.max(0.0).min(most)]
}

/// Probability that a standard Gaussian lies between `a` and `b`.
fn between(a: f32, b: f32) -> f32 {
    const HALF_ROOT: f32 = core::f32::consts::FRAC_1_SQRT_2;
    0.5 * (math::erf(b * HALF_ROOT) - math::erf(a * HALF_ROOT))
}

/// Where `below` turns false between `low` and `high`.
fn bisect(mut low: f32, mut high: f32, below: impl Fn(f32) -> bool) -> f32 {
    for _ in 0..BISECTIONS {
        let middle = 0.5 * (low + high);
        if below(middle) {
            low = middle;
        } else {
            high = middle;
        }
    }
    0.5 * (low + high)
}
