//! Time integration: from one step to the next with the acceleration at its end as the unknown.
//!
//! ```text
//! x(n+1)  = x + h x' + (1/2 - beta) h^2 x'' + beta h^2 x''(n+1)
//! x'(n+1) = x' + h/2 x'' + h/2 x''(n+1)                             (Newmark 1959, gamma = 1/2)
//! ```
//!
//! With `beta = 1/4`, the average acceleration of the paper, an oscillation of circular frequency `w` takes a part
//! `(w h)^2 / 12` too long; with `beta = 1/12` (Fox and Goodwin 1949) a part `(w h)^4 / 480` too short, but it explodes from
//! `w h = 2.45` on. [`Scheme::Exact`] gives each mode its own `beta` and a damping `c^` in place of `c = 2 xi w`, so that its
//! free vibration is exact at any step. From the poles `exp(-c h / 2 +- i w_d h)`, `w_d^2 = w^2 - c^2 / 4`:
//!
//! ```text
//! p = 1 + beta (w h)^2 = (w h)^2 cosh(c h / 2) / (2 (cosh(c h / 2) - cos(w_d h)))
//! c^ h / 2             = p tanh(c h / 2)
//! ```
//!
//! For small `w h` this `beta` is 1/12 too, so that forces that vary smoothly are followed to the fourth order. Forces
//! that do not, those of a wheel that rolls onto the bridge within a step, are what [`corner`] is for.

use nalgebra::SVector;

use crate::math::Real;

/// How bridge and cars are stepped in time.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum Scheme {
    /// Newmark's average acceleration for bridge and cars, as in the paper.
    AverageAcceleration,
    /// Fox and Goodwin's `beta = 1/12` for bridge and cars; conditionally stable.
    FoxGoodwin,
    /// Exact free vibration of each mode, `beta = 1/12` for the cars, and rounded corners.
    #[default]
    Exact,
}

impl Scheme {
    /// `beta` of the cars, and of the rail as their springs feel it: the same for both, so that the coupled matrix
    /// is symmetric.
    pub fn contact_beta<T: Real>(self) -> T {
        match self {
            Self::AverageAcceleration => T::of(0.25),
            Self::FoxGoodwin | Self::Exact => T::of(1.0 / 12.0),
        }
    }

    /// Largest `w h` of a car's own frequencies for which the step is safe; none: any.
    pub fn stability_limit<T: Real>(self) -> Option<T> {
        match self {
            Self::AverageAcceleration => None,
            // sqrt(6) = 2.449, with a margin for what the bridge adds.
            Self::FoxGoodwin | Self::Exact => Some(T::of(2.2)),
        }
    }

    /// Whether shapes are rounded where wheels enter and leave.
    pub fn rounds_corners(self) -> bool {
        self == Self::Exact
    }
}

/// The modes' coefficients for one step.
#[derive(Debug, Clone, PartialEq)]
pub struct ModeSteps<T: Real, const M: usize> {
    /// `beta h^2` of each mode, s².
    pub beta_h2: SVector<T, M>,
    /// Damping that is stepped, 1/s.
    pub damping: SVector<T, M>,
    /// `1 + c h / 2 + beta (w h)^2`.
    pub effective: SVector<T, M>,
}

impl<T: Real, const M: usize> ModeSteps<T, M> {
    /// The coefficients of modes with squared circular frequencies `omega_squared` and damping `2 xi omega`.
    pub fn new(scheme: Scheme, step_s: T, omega_squared: &SVector<T, M>, damping: &SVector<T, M>) -> Self {
        let h = step_s;
        let half = T::of(0.5);
        let mut steps = Self {
            beta_h2: SVector::zeros(),
            damping: *damping,
            effective: SVector::zeros(),
        };
        for k in 0..M {
            let (w2, c) = (omega_squared[k], damping[k]);
            let (beta_h2, stepped) = match scheme {
                Scheme::AverageAcceleration | Scheme::FoxGoodwin => (scheme.contact_beta::<T>() * h * h, c),
                Scheme::Exact => exact(h, w2, c),
            };
            steps.beta_h2[k] = beta_h2;
            steps.damping[k] = stepped;
            steps.effective[k] = T::one() + half * h * stepped + beta_h2 * w2;
        }
        steps
    }
}

/// Largest `c h` that is stepped: the quick part of such a mode's vibration is gone, to 17 digits, within a step. More would leave the range
/// of `f32`.
const QUICKEST: f64 = 80.0;

/// `beta h^2` and damping of a mode whose free vibration is exact.
fn exact<T: Real>(h: T, omega_squared: T, damping: T) -> (T, T) {
    let (half, quarter, two) = (T::of(0.5), T::of(0.25), T::of(2.0));
    let damping = damping.min(T::of(QUICKEST) / h);
    let decay = half * damping * h;
    // sinh and cosh of half the decay give those of the whole without losing digits.
    let (sinh, cosh) = sinh_cosh(half * decay);
    let cosh_decay = T::one() + two * sinh * sinh;
    let tanh_decay = two * sinh * cosh / cosh_decay;
    // cosh(c h / 2) - cos(w_d h) = 2 (sinh^2(c h / 4) + sin^2(w_d h / 2)), with sin^2(i x) = -sinh^2(x) beyond critical damping.
    let w2h2 = omega_squared * h * h;
    let wd2 = omega_squared - quarter * damping * damping;
    let gap = if wd2 >= T::zero() {
        let (sin, _) = (half * wd2.sqrt() * h).sin_cos_exact();
        sinh * sinh + sin * sin
    } else {
        // sinh^2(a) - sinh^2(b) = sinh(a + b) sinh(a - b), and (a + b)(a - b) = (w h / 2)^2: nothing cancels.
        let sum = half * (decay + (-wd2).sqrt() * h);
        sinh_cosh(sum).0 * sinh_cosh(quarter * w2h2 / sum).0
    };
    let p = w2h2 * cosh_decay / (T::of(4.0) * gap);
    ((p - T::one()) / omega_squared, two * p * tanh_decay / h)
}

fn sinh_cosh<T: Real>(x: T) -> (T, T) {
    let half = T::of(0.5);
    let grown = x.exp_m1_exact();
    let shrunk = grown / (grown + T::one());
    (half * (grown + shrunk), T::one() + half * (grown - shrunk))
}

/// What rounds the corner of a shape that begins (or ends) at a support.
///
/// A wheel that rolls onto the bridge loads each mode with a force that begins like a ramp, `phi' v t`, somewhere within a
/// step. Sampled at the steps, the ramp would begin too early or too late and shake the high modes at random. So the
/// ramp, in units of the way `v h` of a step, is replaced by its average over a step, `r(s)`, corrected so that its moments up to
/// the third are the ramp's:
///
/// ```text
/// r(s) = max(s, 0) + max(1 - |s|, 0)^3 / 6
/// R(s) = r(s) - (r(s + 1) - 2 r(s) + r(s - 1)) / 12
/// ```
///
/// This gives `R(s) - max(s, 0)`, which is 0 from two steps' way off the corner on.
pub fn corner<T: Real>(s: T) -> T {
    let hat = |s: T| (T::one() - s.abs()).max(T::zero());
    let cubed = |s: T| {
        let part = hat(s);
        part * part * part
    };
    let one = T::one();
    (T::of(14.0) * cubed(s) - cubed(s + one) - cubed(s - one)) / T::of(72.0) - hat(s) / T::of(12.0)
}

/// Slope of [`corner`], continued from above at 0, as the slope of `max(s, 0)` is there.
pub fn corner_slope<T: Real>(s: T) -> T {
    let one = T::one();
    let hat = |s: T| (one - s.abs()).max(T::zero());
    let side = |s: T| if s < T::zero() { one } else { -one };
    let cubed_slope = |s: T| T::of(3.0) * side(s) * hat(s) * hat(s);
    let hat_slope = if s.abs() < one { side(s) } else { T::zero() };
    (T::of(14.0) * cubed_slope(s) - cubed_slope(s + one) - cubed_slope(s - one)) / T::of(72.0) - hat_slope / T::of(12.0)
}

/// Steps' way from a corner within which it is rounded.
pub const CORNER_STEPS: f64 = 2.0;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn free_vibration_has_the_exact_poles_at_any_step() {
        // Any three positions of x'' + c x' + w^2 x = 0 in equal steps obey x2 - 2 E cos(w_d h) x1 + E^2 x0 = 0.
        for (w, xi, h) in [
            (22.0, 0.02, 2.5e-3),
            (22.0, 0.0, 5e-3),
            (198.0, 0.04, 5e-3),
            (1440.0, 0.26, 2.5e-3),
            (10.0, 1.5, 1e-2),
        ] {
            let (w2, c) = (w * w, 2.0 * xi * w);
            let steps = ModeSteps::<f64, 1>::new(Scheme::Exact, h, &SVector::from([w2]), &SVector::from([c]));
            let (b, c_) = (steps.beta_h2[0], steps.damping[0]);
            let (mut x, mut v, mut a) = (1.0, 3.0, -c_ * 3.0 - w2);
            let positions: [f64; 3] = core::array::from_fn(|_| {
                let before = x;
                (x, v) = (x + h * v + (0.5 * h * h - b) * a, v + 0.5 * h * a);
                a = -(c_ * v + w2 * x) / steps.effective[0];
                (x, v) = (x + b * a, v + 0.5 * h * a);
                before
            });
            let decay = libm::exp(-0.5 * c * h);
            let wd2 = w2 - 0.25 * c * c;
            let cos = if wd2 > 0.0 {
                libm::cos(libm::sqrt(wd2) * h)
            } else {
                libm::cosh(libm::sqrt(-wd2) * h)
            };
            let [x0, x1, x2] = positions;
            let rest = x2 - 2.0 * decay * cos * x1 + decay * decay * x0;
            assert!(rest.abs() < 1e-10, "{w} {xi} {h}: {rest}");
        }
    }

    #[test]
    fn a_rounded_corner_loads_alike_wherever_it_falls_between_two_steps() {
        // Impulse and first moment of the samples of a ramp that begins at -s, up to the middle after its sample 20, less
        // the ramp's own.
        let excess = |s: f64| {
            let samples = || (-4..=20).map(|k| f64::from(k) + s).map(|x| (x, x.max(0.0) + corner(x)));
            let end = 20.5 + s;
            let impulse: f64 = samples().map(|(_, load)| load).sum();
            let moment: f64 = samples().map(|(x, load)| x * load).sum();
            [impulse - end * end / 2.0, moment - end * end * end / 3.0 + end / 12.0]
        };
        for s in [0.1, 0.25, 0.5, 0.99] {
            for (at, at_zero) in excess(s).iter().zip(excess(0.0)) {
                assert!((at - at_zero).abs() < 1e-11, "{s}: {at} {at_zero}");
            }
        }
        assert_eq!(corner(2.0_f64), 0.0);
        assert_eq!(corner(-3.0_f64), 0.0);
    }
}
