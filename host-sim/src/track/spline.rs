//! A cubic spline through points at any spacing, with slope zero at both ends.
//!
//! With the points `f_i` at `x_i`, `h_i = x_{i+1} - x_i`, `d_i = (f_{i+1} - f_i) / h_i` and the second derivatives `M_i`
//! at the points (de Boor, A Practical Guide to Splines, chapter IV), between `x_i` and `x_{i+1}`
//!
//! ```text
//! f(x) = a f_i + b f_{i+1} + h_i^2 / 6 ((a^3 - a) M_i + (b^3 - b) M_{i+1}),   b = (x - x_i) / h_i,  a = 1 - b
//!
//! h_{i-1} M_{i-1} + 2 (h_{i-1} + h_i) M_i + h_i M_{i+1} = 6 (d_i - d_{i-1})
//! 2 h_0 M_0 + h_0 M_1 = 6 d_0        h_{n-1} M_{n-1} + 2 h_{n-1} M_n = -6 d_{n-1}
//! ```
//!
//! The second lines make the slope continuous and zero at the ends. Their matrix is diagonally dominant, so elimination
//! without exchange of rows is safe at any spacing.
//!
//! Limit: of a wave of length `L` through points at spacing `h` the curvature is off by a part of about
//! `(2 pi h / L)^2 / 12`: 0.4 % of the shortest wave of a standard spectrum (1.5 m) at 0.05 m, 5 % at eight points a wave.
//! Shorter waves come out wrong, and those under `2 h` not at all: a table must be fine enough for the waves that matter.

use spanwatch::track::Irregularity;

/// Points a wave that [`Spline`] needs for its curvature to be within 5 %.
pub const POINTS_A_WAVE: f64 = 8.0;

/// The places of a spline's points.
#[derive(Debug, Clone, PartialEq)]
pub struct Knots {
    x_m: Vec<f64>,
    /// Intervals a metre, on the whole.
    density: f64,
}

impl Knots {
    /// Places in ascending order.
    ///
    /// # Panics
    /// If there are fewer than two, or they do not ascend.
    pub fn new(x_m: Vec<f64>) -> Self {
        assert!(
            x_m.len() >= 2 && x_m.windows(2).all(|pair| pair[0] < pair[1]),
            "at least two places, ascending"
        );
        let density = (x_m.len() - 1) as f64 / (x_m[x_m.len() - 1] - x_m[0]);
        Self { x_m, density }
    }

    /// First and last place, m.
    pub fn extent_m(&self) -> [f64; 2] {
        [self.x_m[0], self.x_m[self.x_m.len() - 1]]
    }

    /// The interval in which `x_m`, inside the extent, lies: at once where spacing is even.
    fn interval(&self, x_m: f64) -> usize {
        let last = self.x_m.len() - 2;
        let guess = (((x_m - self.x_m[0]) * self.density) as usize).min(last);
        if self.x_m[guess] <= x_m && x_m <= self.x_m[guess + 1] {
            guess
        } else {
            self.x_m.partition_point(|&x| x <= x_m).saturating_sub(1).min(last)
        }
    }
}

/// A curve through a value at each of some [`Knots`].
#[derive(Debug, Clone, PartialEq)]
pub struct Spline {
    value: Vec<f64>,
    curvature: Vec<f64>,
}

impl Spline {
    /// The curve through `value`, one at each knot.
    pub fn new(knots: &Knots, value: Vec<f64>) -> Self {
        let curvature = curvatures(&knots.x_m, &value);
        Self { value, curvature }
    }

    /// Value, slope and curvature at `x_m` inside the extent of `knots`.
    pub fn at(&self, knots: &Knots, x_m: f64) -> Irregularity<f64> {
        let i = knots.interval(x_m);
        let h = knots.x_m[i + 1] - knots.x_m[i];
        let b = (x_m - knots.x_m[i]) / h;
        let a = 1.0 - b;
        let ([f0, f1], [m0, m1]) = (
            [self.value[i], self.value[i + 1]],
            [self.curvature[i], self.curvature[i + 1]],
        );
        Irregularity {
            value: a * f0 + b * f1 + h * h / 6.0 * ((a * a * a - a) * m0 + (b * b * b - b) * m1),
            slope: (f1 - f0) / h + h / 6.0 * ((3.0 * b * b - 1.0) * m1 - (3.0 * a * a - 1.0) * m0),
            curvature: a * m0 + b * m1,
            curvature_rate: (m1 - m0) / h,
        }
    }

    /// The value at the last knot.
    pub fn last(&self) -> f64 {
        self.value[self.value.len() - 1]
    }

    /// Second derivatives at the knots. The curve's lie on straight lines between them.
    pub fn curvature(&self) -> &[f64] {
        &self.curvature
    }
}

fn curvatures(x: &[f64], f: &[f64]) -> Vec<f64> {
    let n = x.len();
    let h = |i: usize| x[i + 1] - x[i];
    let slope = |i: usize| (f[i + 1] - f[i]) / h(i);
    // Forward: row i becomes M_i + upper_i M_{i+1} = right_i.
    let (mut upper, mut right) = (vec![0.0; n], vec![0.0; n]);
    for i in 0..n {
        let (below, d_below) = if i > 0 { (h(i - 1), slope(i - 1)) } else { (0.0, 0.0) };
        let (above, d_above) = if i + 1 < n { (h(i), slope(i)) } else { (0.0, 0.0) };
        let (upper_before, right_before) = if i > 0 {
            (upper[i - 1], right[i - 1])
        } else {
            (0.0, 0.0)
        };
        let pivot = 2.0 * (below + above) - below * upper_before;
        upper[i] = above / pivot;
        right[i] = (6.0 * (d_above - d_below) - below * right_before) / pivot;
    }
    for i in (0..n - 1).rev() {
        right[i] -= upper[i] * right[i + 1];
    }
    right
}
