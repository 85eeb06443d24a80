//! The rail's profile as the logger keeps it: a cubic spline in fixed memory, with coefficients that can be learnt.
//!
//! ```text
//! r(x) = sum_k c_k N_k(x)       N_k the cubic B-spline on the knots t_k .. t_(k+4)        n knots, n - 4 coefficients
//! ```
//!
//! Every `N_k` lies between the first knot and the last with all of its support, so the profile begins and ends at zero with neither slope
//! nor curvature, and is level outside. The knots are evenly spaced within each of up to [`STRETCHES`] stretches: coarse where
//! a car only has to be brought into its swing (the approach), fine where wheels shake the bridge.
//!
//! Learnt are the `c_k`, each of which moves four spans and no more. Kept are value `f_j` and second derivative `M_j` at each knot, from
//! which all else follows at once; between `t_j` and `t_j + h`, with `b = (x - t_j) / h`,
//!
//! ```text
//! r   = f_j + b (p + b (q + b s))        q = h^2 / 2 M_j,  s = h^2 / 6 (M_(j+1) - M_j),  p = f_(j+1) - f_j - q - s
//! r'  = (p + b (2 q + 3 b s)) / h        r'' = M_j + b (M_(j+1) - M_j),  r''' = (M_(j+1) - M_j) / h
//! ```
//!
//! (de Boor, A Practical Guide to Splines, chapters IV and IX). Waves shorter than two spans are not in it.
//!
//! On a bridge that moves in bending only the mean height of the two rails matters, so that is what it holds: vertical motion only.
//!
//! Cost: 1.3 kB; a look-up is some 12 multiplications, no division and no search.
//!
//! ```
//! use spanwatch::track::profile::{Knots, Profile, Stretch};
//! use spanwatch::track::{Motion, Track};
//!
//! let knots = Knots::new(&[
//!     Stretch { from_m: -30.0_f64, spacing_m: 3.0, spans: 10 },
//!     Stretch { from_m: 0.0, spacing_m: 1.0, spans: 20 },
//! ]).expect("stretches that join");
//! assert_eq!(knots.coefficients(), 27);
//! // All coefficients 1: a plateau of 1, as far from the ends as a B-spline reaches.
//! let plateau = Profile::new(knots, &[1.0; 27]);
//! let on_top = plateau.at(Motion::Vertical, -1.3);
//! assert!((on_top.value - 1.0).abs() < 1e-12 && on_top.slope.abs() < 1e-12);
//! assert_eq!(plateau.at(Motion::Vertical, 20.0).value, 0.0);
//! // Stretches that do not join are no knots.
//! let gap = [Stretch { from_m: 0.0, spacing_m: 1.0, spans: 5 }, Stretch { from_m: 6.0, spacing_m: 1.0, spans: 5 }];
//! assert!(Knots::<f64>::new(&gap).is_none());
//! ```

use heapless::Vec;
use serde::{Deserialize, Serialize};

use super::{Irregularity, Motion, Track};
use crate::capacity::{PROFILE_COEFFICIENTS, PROFILE_KNOTS};
use crate::math::Real;

/// Stretches of evenly spaced knots: an approach, a bridge, a way off it.
pub const STRETCHES: usize = 3;
/// Spans that a B-spline stands on.
const SUPPORT: usize = 4;
/// Part of a span by which the end of one stretch may miss the beginning of the next.
const JOINT: f64 = 1e-3;

/// Evenly spaced knots.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Stretch<T> {
    /// The first of them, m.
    pub from_m: T,
    /// Distance from one to the next, m.
    pub spacing_m: T,
    /// Spans between them.
    pub spans: u16,
}

impl<T: Real> Stretch<T> {
    fn knot(&self, span: usize) -> T {
        self.from_m + T::counted(span as i32) * self.spacing_m
    }
}

/// The knots of a profile: stretches that join. None at all is a smooth track.
#[derive(Debug, Clone, PartialEq)]
pub struct Knots<T> {
    stretches: Vec<Stretch<T>, STRETCHES>,
    /// The same as a look-up needs it.
    ready: Vec<Ready<T>, STRETCHES>,
}

/// A stretch, ready for look-ups.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Ready<T> {
    from_m: T,
    /// Where the next one begins, or the knots end, m.
    to_m: T,
    /// Inverse of the spacing `h`, per m.
    inverse: T,
    /// `h^2 / 6`, m².
    sixth: T,
    /// Its first knot, and how many spans there are before its last.
    first: usize,
    last: usize,
}

impl<T: Real> Knots<T> {
    /// No knots.
    pub const NONE: Self = Self {
        stretches: Vec::new(),
        ready: Vec::new(),
    };

    /// The knots of `stretches`; none if these do not ascend and join, have values that are not finite, carry no B-spline or have more
    /// than [`PROFILE_KNOTS`] knots.
    pub fn new(stretches: &[Stretch<T>]) -> Option<Self> {
        let sound =
            |s: &Stretch<T>| s.from_m.is_finite() && s.spacing_m > T::zero() && s.spacing_m.is_finite() && s.spans > 0;
        let joined = |pair: &[Stretch<T>]| {
            let [left, right] = pair else { return false };
            (left.knot(left.spans.into()) - right.from_m).abs() <= T::of(JOINT) * left.spacing_m.min(right.spacing_m)
        };
        let mut knots = Self {
            stretches: Vec::from_slice(stretches).ok()?,
            ready: Vec::new(),
        };
        let mut first = 0;
        for (i, stretch) in stretches.iter().enumerate() {
            let spans = usize::from(stretch.spans);
            let next = stretches.get(i + 1).map(|next| next.from_m);
            // There is room for as many as there are stretches.
            let _ = knots.ready.push(Ready {
                from_m: stretch.from_m,
                to_m: next.unwrap_or_else(|| stretch.knot(spans)),
                inverse: stretch.spacing_m.recip(),
                sixth: stretch.spacing_m * stretch.spacing_m / T::of(6.0),
                first,
                last: spans.saturating_sub(1),
            });
            first += spans;
        }
        let all = stretches.iter().all(sound) && stretches.windows(2).all(joined);
        (all && knots.coefficients() > 0 && knots.count() <= PROFILE_KNOTS).then_some(knots)
    }

    /// The same in the other number type; none if rounding has made them no knots.
    pub fn cast<U: Real>(&self) -> Option<Knots<U>> {
        let to = |value: T| U::of(value.into());
        let stretches: Vec<Stretch<U>, STRETCHES> = (self.stretches.iter())
            .map(|stretch| Stretch {
                from_m: to(stretch.from_m),
                spacing_m: to(stretch.spacing_m),
                spans: stretch.spans,
            })
            .collect();
        Knots::new(&stretches)
    }

    /// The stretches.
    pub fn stretches(&self) -> &[Stretch<T>] {
        &self.stretches
    }

    /// Number of knots.
    pub fn count(&self) -> usize {
        let spans: usize = self.stretches.iter().map(|stretch| usize::from(stretch.spans)).sum();
        if spans == 0 { 0 } else { spans + 1 }
    }

    /// Number of B-splines on them.
    pub fn coefficients(&self) -> usize {
        self.count().saturating_sub(SUPPORT)
    }

    /// First and last knot, m.
    pub fn extent_m(&self) -> Option<[T; 2]> {
        let (first, last) = (self.stretches.first()?, self.stretches.last()?);
        Some([first.from_m, last.knot(last.spans.into())])
    }

    /// Knot `j`, m.
    pub fn knot(&self, j: usize) -> Option<T> {
        let mut left = j;
        for stretch in &self.stretches {
            if left <= usize::from(stretch.spans) {
                return Some(stretch.knot(left));
            }
            left -= usize::from(stretch.spans);
        }
        None
    }

    /// The middle knot of B-spline `k`, where it is highest, m.
    pub fn centre(&self, k: usize) -> Option<T> {
        self.knot(k + SUPPORT / 2)
    }

    /// First and last knot of B-spline `k`, m: it is zero outside.
    pub fn support(&self, k: usize) -> Option<[T; 2]> {
        Some([self.knot(k)?, self.knot(k + SUPPORT)?])
    }

    /// Value and second derivative (per m²) of B-spline `k` at its three inner knots, `k + 1` to `k + 3`.
    fn bspline(&self, k: usize) -> Option<[[T; 2]; 3]> {
        let mut t = [T::zero(); SUPPORT + 1];
        for (i, t) in t.iter_mut().enumerate() {
            *t = self.knot(k + i)?;
        }
        let [t0, t1, t2, t3, t4] = t;
        let (left, right, six) = (t3 - t0, t4 - t1, T::of(6.0));
        let inner = t3 - t1;
        let middle = (t2 - t0) / left * ((t3 - t2) / inner) + (t4 - t2) / right * ((t2 - t1) / inner);
        Some([
            [(t1 - t0) * (t1 - t0) / (left * (t2 - t0)), six / (left * (t2 - t0))],
            [middle, -six / inner * (left.recip() + right.recip())],
            [(t4 - t3) * (t4 - t3) / (right * (t4 - t2)), six / (right * (t4 - t2))],
        ])
    }

    /// The stretch in which `x_m` lies, the span of it, by its first knot, and how far into that, as a part.
    fn span(&self, x_m: T) -> Option<(&Ready<T>, usize, T)> {
        let stretch = self.ready.iter().find(|stretch| x_m < stretch.to_m)?;
        let along = (x_m - stretch.from_m) * stretch.inverse;
        if along < T::zero() {
            return None;
        }
        let whole = along.whole().min(stretch.last);
        Some((stretch, stretch.first + whole, along - T::counted(whole as i32)))
    }
}

/// A rail's profile. Without knots it is smooth.
#[derive(Debug, Clone, PartialEq)]
pub struct Profile<T> {
    knots: Knots<T>,
    /// Value, m, and second derivative, per m, at each knot.
    at_knots: Vec<[T; 2], PROFILE_KNOTS>,
}

impl<T: Real> Profile<T> {
    /// A smooth track.
    pub const SMOOTH: Self = Self {
        knots: Knots::NONE,
        at_knots: Vec::new(),
    };

    /// The profile of these coefficients, m. Those that are missing are zero, those too many are passed over.
    pub fn new(knots: Knots<T>, coefficients: &[T]) -> Self {
        let mut profile = Self::SMOOTH;
        profile.set(knots, coefficients.iter().copied());
        profile
    }

    /// B-spline `k` alone, 1 m high; smooth if there is none.
    pub fn bspline(knots: Knots<T>, k: usize) -> Self {
        let mut profile = Self::SMOOTH;
        let ones = (0..knots.coefficients()).map(|i| if i == k { T::one() } else { T::zero() });
        profile.set(knots, ones);
        profile
    }

    /// Becomes the profile of these coefficients, in its place.
    pub fn set(&mut self, knots: Knots<T>, coefficients: impl IntoIterator<Item = T>) {
        self.at_knots.clear();
        // There is room for all knots.
        let _ = self.at_knots.resize(knots.count(), [T::zero(); 2]);
        for (k, coefficient) in coefficients.into_iter().take(PROFILE_COEFFICIENTS).enumerate() {
            let Some(bspline) = knots.bspline(k) else { break };
            for (at, part) in self.at_knots.iter_mut().skip(k + 1).zip(bspline) {
                at[0] += coefficient * part[0];
                at[1] += coefficient * part[1];
            }
        }
        self.knots = knots;
    }

    /// Its knots.
    pub fn knots(&self) -> &Knots<T> {
        &self.knots
    }
}

impl<T: Real> Track<T> for Profile<T> {
    fn extent_m(&self) -> Option<[T; 2]> {
        self.knots.extent_m()
    }

    fn at(&self, motion: Motion, x_m: T) -> Irregularity<T> {
        let level = Irregularity::none();
        if motion != Motion::Vertical {
            return level;
        }
        let Some((stretch, j, b)) = self.knots.span(x_m) else {
            return level;
        };
        let Some(&[[f0, m0], [f1, m1]]) = self.at_knots.get(j..).and_then(|from| from.first_chunk()) else {
            return level;
        };
        // About the left knot, in powers of b.
        let (bend, twist) = (m0, m1 - m0);
        let three = T::of(3.0);
        let (square, cube) = (three * stretch.sixth * bend, stretch.sixth * twist);
        let first = f1 - f0 - square - cube;
        Irregularity {
            value: f0 + b * (first + b * (square + b * cube)),
            slope: (first + b * (square + square + three * b * cube)) * stretch.inverse,
            curvature: bend + b * twist,
            curvature_rate: twist * stretch.inverse,
        }
    }
}
