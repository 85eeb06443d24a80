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

#[cfg(test)]
mod tests {
    extern crate std;

    use std::vec::Vec;

    use rand_core::SeedableRng;
    use rand_xoshiro::Xoshiro128PlusPlus;

    use super::*;
    use crate::identify::random::unit;

    /// Far above everything tested here.
    const FREE: f32 = 1e3;
    /// Steps of the construction by hand, in deviations.
    const GRID: f64 = 0.005;

    #[test]
    fn an_interval_holds_the_true_value_nineteen_times_of_twenty_wherever_it_is() {
        const DRAWS: u32 = 200_000;
        let mut rng = Xoshiro128PlusPlus::seed_from_u64(4);
        for mu in [0.0, 0.3, 1.0, 2.0, 3.0, 5.0] {
            let mut held = 0;
            for _ in 0..DRAWS {
                let radius = libm::sqrtf(-2.0 * libm::logf(1.0 - unit(&mut rng)));
                let x = mu + radius * libm::cosf(core::f32::consts::TAU * unit(&mut rng));
                let [low, high] = confidence(x, 1.0, FREE);
                held += u32::from(low <= mu && mu <= high);
            }
            let coverage = f64::from(held) / f64::from(DRAWS);
            // Chance leaves 0.05 %.
            assert!((0.9475..=0.9525).contains(&coverage), "mu {mu}: {coverage}");
        }
    }

    /// The outcomes that `mu` accepts, by adding them up in the order of their likelihood ratios.
    fn accepted(mu: f64) -> [f64; 2] {
        let density = |x: f64, mu: f64| libm::exp(-0.5 * (x - mu) * (x - mu));
        let mut outcomes: Vec<(f64, f64, f64)> = (0..5000)
            .map(|i| -10.0 + GRID * f64::from(i))
            .map(|x| (density(x, mu) / density(x, x.max(0.0)), x, density(x, mu)))
            .collect();
        outcomes.sort_by(|a, b| b.0.total_cmp(&a.0));
        let mut sum = 0.0;
        let mut ends = [f64::INFINITY, f64::NEG_INFINITY];
        for (_, x, density) in outcomes {
            sum += density * GRID / libm::sqrt(core::f64::consts::TAU);
            ends = [ends[0].min(x), ends[1].max(x)];
            if sum >= 0.95 {
                break;
            }
        }
        ends
    }

    #[test]
    fn ends_are_those_of_the_ordering_principle_carried_out_by_hand() {
        let belts: Vec<(f64, [f64; 2])> = (0..1800)
            .map(|i| GRID * f64::from(i))
            .map(|mu| (mu, accepted(mu)))
            .collect();
        for x in [-3.0, -2.0, -1.0, -0.2, 0.0, 0.5, 1.0, 1.7, 2.0, 2.5, 3.0, 3.9, 4.0, 5.0] {
            let holding = || {
                belts
                    .iter()
                    .filter(|(_, [x1, x2])| (*x1..=*x2).contains(&x))
                    .map(|(mu, _)| *mu)
            };
            let by_hand = [holding().fold(9.0, f64::min), holding().fold(0.0, f64::max)];
            let found = confidence(x as f32, 1.0, FREE).map(f64::from);
            for (found, by_hand) in found.into_iter().zip(by_hand) {
                assert!(
                    (found - by_hand).abs() < 4.0 * GRID,
                    "x {x}: {found:.3}, by hand {by_hand:.3}"
                );
            }
        }
    }

    #[test]
    fn ends_rise_with_the_measurement_without_a_jump_and_are_never_empty() {
        let mut before = confidence(-20.0, 1.0, FREE);
        for i in 1..4000 {
            let now = confidence(-20.0 + 0.01 * i as f32, 1.0, FREE);
            assert!(now[0] < now[1] && now[1] > 0.0, "{now:?}");
            for (before, now) in before.into_iter().zip(now) {
                // The lower end leaves zero steeply: an outcome of 1.65 accepts 0.05 no more.
                assert!(now >= before - 1e-5 && now < before + 0.1, "{before} to {now}");
            }
            before = now;
        }
    }

    #[test]
    fn a_scaled_measurement_has_a_scaled_interval_and_none_leaves_everything() {
        let [low, high] = confidence(2.0, 1.0, FREE);
        let [scaled_low, scaled_high] = confidence(2e-3, 1e-3, FREE);
        assert!((scaled_low - 1e-3 * low).abs() < 1e-8 && (scaled_high - 1e-3 * high).abs() < 1e-8);
        assert_eq!(confidence(2.0, 1.0, 0.1), [0.1, 0.1]);
        for (x, sigma) in [(f32::NAN, 1.0), (1.0, f32::INFINITY), (1.0, f32::NAN), (1.0, -1.0)] {
            assert_eq!(confidence(x, sigma, 2.0), [0.0, 2.0]);
        }
        assert_eq!(confidence(1.0, 0.0, 2.0), [1.0, 1.0]);
        assert_eq!(confidence(-1.0, 0.0, 2.0), [0.0, 0.0]);
    }
}
