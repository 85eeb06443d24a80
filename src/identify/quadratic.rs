//! The lowest point of a bowl within a box: least squares in unknowns that have bounds.
//!
//! ```text
//! f(x) = x^T A x / 2 - b^T x,     minimise over lower <= x <= upper         A symmetric, positive definite
//!
//! lowest if and only if (Karush, Kuhn, Tucker), with g = A x - b, for every i
//!     lower < x < upper:  g = 0        x = lower:  g >= 0        x = upper:  g <= 0
//! ```
//!
//! A primal active-set method (Nocedal and Wright, Numerical Optimization, 2006, section 16.5): at each moment some
//! variables are held at a bound and the others are free. The bottom for the free ones is one linear system. If the way
//! to it leaves the box, the first variable to do so is held where it would; at the bottom, the held variable whose
//! pull `g` points inward most is let go. `f` falls from bottom to bottom, so no set of held variables comes twice.
//!
//! Seen as an information matrix and vector, `f` is minus the logarithm of a Gaussian's density: `A^-1` is its
//! covariance, `A^-1 b` its centre, and a rise of `f` by `s^2 / 2` lies `s` standard deviations out.
//!
//! All systems are solved with the diagonal scaled to one. A pivot below [`SINGULAR`] of it counts as none: the matrix
//! is a sum of many rounded terms, and what is left there may be rounding.
//!
//! Cost: a factor of the free rows and a product for each step, of which there are about two for each variable that ends
//! up elsewhere than at the start; one copy of the matrix on the stack.

use nalgebra::{Cholesky, Const, SMatrix, SVector};

use crate::math;

/// Part of a row's diagonal below which its pivot counts as zero: thirty times the rounding of a sum.
pub const SINGULAR: f32 = 4e-6;
/// Steps for each variable before the search is given up. A hundred thousand random cases took a quarter of it at most.
const STEPS: usize = 10;
/// Pulls smaller than this part of the terms they are sums of are rounding: some ten times half an ulp.
const ROUNDING: f32 = 1e-6;
/// Repeated solutions that take away what a raised diagonal adds, see [`Quadratic::centre`].
const CORRECTIONS: usize = 2;
/// A variable with more than this share in directions that nothing determines is itself not determined.
const UNDETERMINED: f32 = 0.01;

/// `x^T A x / 2 - b^T x`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Quadratic<const N: usize> {
    /// `A`, symmetric; the lower triangle is what counts for solving.
    pub matrix: SMatrix<f32, N, N>,
    /// `b`.
    pub vector: SVector<f32, N>,
}

/// The lowest point of a [`Quadratic`] within a box.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Minimum<const N: usize> {
    /// The point.
    pub at: SVector<f32, N>,
    /// `g` there: zero for the free variables, not inward for those at a bound.
    pub pull: SVector<f32, N>,
    /// Part by which the diagonal was raised to find it: 0 or [`SINGULAR`].
    pub ridge: f32,
}

/// The factor of the rows that are free, scaled to a unit diagonal.
struct Factor<const N: usize> {
    cholesky: Cholesky<f32, Const<N>>,
    /// `A_ii^-1/2`; 0 where a variable is held.
    scale: SVector<f32, N>,
}

impl<const N: usize> Factor<N> {
    /// The free rows' solution, 0 for the held ones.
    fn solve(&self, right: &SVector<f32, N>) -> SVector<f32, N> {
        let mut solution = right.component_mul(&self.scale);
        self.cholesky.solve_mut(&mut solution);
        solution.component_mul(&self.scale)
    }
}

impl<const N: usize> Quadratic<N> {
    /// The flat one: no information.
    pub const ZERO: Self = Self {
        matrix: SMatrix::from_array_storage(nalgebra::ArrayStorage([[0.0; N]; N])),
        vector: SVector::from_array_storage(nalgebra::ArrayStorage([[0.0; N]; 1])),
    };

    /// The same with the lower triangle mirrored into the upper one.
    pub fn mirrored(&self) -> Self {
        let mut mirrored = *self;
        mirrored.matrix.fill_upper_triangle_with_lower_triangle();
        mirrored
    }

    /// Makes nothing of what is left of variables whose diagonal has faded to less than a number can hold.
    pub fn forget_faded(&mut self) {
        let known = self.known();
        for i in (0..N).filter(|&i| !known[i]) {
            self.matrix.row_mut(i).fill(0.0);
            self.matrix.column_mut(i).fill(0.0);
            self.vector[i] = 0.0;
        }
    }

    /// The sum of two: what both say together.
    pub fn plus(&self, other: &Self) -> Self {
        Self {
            matrix: self.matrix + other.matrix,
            vector: self.vector + other.vector,
        }
    }

    /// `f(x)`. Two values that differ little are better compared by [`Self::rise`].
    pub fn value(&self, at: &SVector<f32, N>) -> f32 {
        let (mut half, rest) = (self.times(at), -self.vector);
        half *= 0.5;
        at.dot(&(half + rest))
    }

    /// The lowest point between `lower` and `upper`. Equal bounds hold a variable.
    ///
    /// None if the matrix is not positive definite for a set of free variables on the way, or something is not finite.
    pub fn minimum(&self, lower: &[f32; N], upper: &[f32; N]) -> Option<Minimum<N>> {
        self.descend(lower, upper, 0.0)
    }

    /// Like [`Self::minimum`] for a matrix that may be singular: its diagonal is raised by the part [`SINGULAR`], and
    /// of points that are equally low the one is found that is small.
    pub fn small_minimum(&self, lower: &[f32; N], upper: &[f32; N]) -> Option<Minimum<N>> {
        self.descend(lower, upper, SINGULAR)
    }

    /// `f(to) - f(from)`, without the difference of two large numbers. `to` must lie in the box of `from`.
    pub fn rise(&self, from: &Minimum<N>, to: &SVector<f32, N>) -> f32 {
        let way = to - from.at;
        let mut slope = 0.0;
        for i in 0..N {
            slope += (from.pull[i] - from.ridge * self.matrix[(i, i)] * from.at[i]) * way[i];
        }
        slope + 0.5 * way.dot(&self.times(&way))
    }

    /// The pull `g = A x - b` at a point: which way `f` rises.
    pub fn slope(&self, at: &SVector<f32, N>) -> SVector<f32, N> {
        self.times(at) - self.vector
    }

    /// The lowest point without bounds, of the variables of which the matrix knows something; the others are 0.
    ///
    /// The diagonal is raised by [`SINGULAR`] and the solution corrected twice for it: directions of which the matrix says
    /// `k` times as much come out right to `k^-3`, those of which it says nothing stay near 0.
    pub fn centre(&self) -> Option<SVector<f32, N>> {
        let factor = self.factor(&self.known(), SINGULAR)?;
        let mut at = factor.solve(&self.vector);
        for _ in 0..CORRECTIONS {
            at -= factor.solve(&self.slope(&at));
        }
        at.iter().all(|value| value.is_finite()).then_some(at)
    }

    /// The diagonal of `A^-1`, for the variables of which the matrix knows something; infinite for the others, and for
    /// those that it knows only together with others ([`SINGULAR`]).
    pub fn variances(&self) -> Option<SVector<f32, N>> {
        let known = self.known();
        let (factor, ridge) = match self.factor(&known, 0.0) {
            Some(factor) => (factor, 0.0),
            None => (self.factor(&known, SINGULAR)?, SINGULAR),
        };
        let mut variances = SVector::repeat(f32::INFINITY);
        for i in (0..N).filter(|&i| known[i]) {
            let mut unit = SVector::zeros();
            unit[i] = 1.0;
            let solved = factor.cholesky.l_dirty().solve_lower_triangular_mut(&mut unit);
            let scaled = unit.dot(&unit);
            // With the diagonal raised, 1 / ridge times the variable's share in directions that nothing determines.
            if solved && scaled * ridge < UNDETERMINED {
                variances[i] = scaled * factor.scale[i] * factor.scale[i];
            }
        }
        Some(variances)
    }

    /// `v^T A^-1 v`, never more, less where the matrix is singular.
    pub fn length_squared(&self, vector: &SVector<f32, N>) -> Option<f32> {
        let factor = self.factor(&self.known(), SINGULAR)?;
        Some(vector.dot(&factor.solve(vector)))
    }

    /// Whether all is finite, nothing is said of a variable of which nothing is known, and the matrix
    /// is, but for rounding, positive semidefinite.
    pub fn is_information(&self) -> bool {
        let known = self.known();
        let finite = self.matrix.iter().chain(self.vector.iter()).all(|v| v.is_finite());
        let silent = (0..N).filter(|&i| !known[i]).all(|i| {
            self.vector[i] == 0.0 && self.matrix.row(i).iter().all(|&v| v == 0.0) && self.matrix[(i, i)] == 0.0
        });
        finite && silent && self.factor(&known, SINGULAR).is_some()
    }

    /// The variables of which the matrix says something.
    pub fn known(&self) -> [bool; N] {
        core::array::from_fn(|i| self.matrix[(i, i)] >= f32::MIN_POSITIVE)
    }

    /// `A x`, written out so that no kernel fuses it.
    fn times(&self, vector: &SVector<f32, N>) -> SVector<f32, N> {
        let mut sum = SVector::<f32, N>::zeros();
        for (column, &factor) in self.matrix.column_iter().zip(vector.iter()) {
            sum.axpy(factor, &column, 1.0);
        }
        sum
    }

    /// `g`, and the sum of its terms' magnitudes.
    fn pull(&self, at: &SVector<f32, N>, ridge: f32) -> (SVector<f32, N>, SVector<f32, N>) {
        let (mut pull, mut size) = (-self.vector, self.vector.abs());
        for (j, column) in self.matrix.column_iter().enumerate() {
            for i in 0..N {
                let mut term = column[i] * at[j];
                if i == j {
                    term += ridge * term;
                }
                pull[i] += term;
                size[i] += term.abs();
            }
        }
        (pull, size)
    }

    // Not inlined: its matrix must leave the stack before the next is made.
    #[inline(never)]
    fn factor(&self, free: &[bool; N], ridge: f32) -> Option<Factor<N>> {
        let mut scale = SVector::zeros();
        for i in (0..N).filter(|&i| free[i]) {
            let diagonal = self.matrix[(i, i)];
            if !(f32::MIN_POSITIVE..=f32::MAX).contains(&diagonal) {
                return None;
            }
            scale[i] = 1.0 / math::sqrt(diagonal);
        }
        let mut scaled = self.matrix;
        for j in 0..N {
            for i in 0..N {
                let one = if free[i] { 1.0 + ridge } else { 1.0 };
                let entry = scaled[(i, j)] * scale[i] * scale[j];
                scaled[(i, j)] = if i == j { one } else { entry };
            }
        }
        let cholesky = scaled.cholesky()?;
        let lower = cholesky.l_dirty();
        let least = SINGULAR - ridge;
        let definite = (0..N).all(|i| lower[(i, i)] * lower[(i, i)] > least);
        definite.then_some(Factor { cholesky, scale })
    }

    fn descend(&self, lower: &[f32; N], upper: &[f32; N], ridge: f32) -> Option<Minimum<N>> {
        let mut at = SVector::<f32, N>::zeros();
        let mut free = [false; N];
        for i in 0..N {
            at[i] = 0.0_f32.max(lower[i]).min(upper[i]);
            free[i] = lower[i] < at[i] && at[i] < upper[i];
        }
        for _ in 0..STEPS * N {
            if free.contains(&true) {
                let (pull, _) = self.pull(&at, ridge);
                let step = self.factor(&free, ridge)?.solve(&-pull);
                let mut first: Option<(usize, f32)> = None;
                let mut part = 1.0;
                for i in (0..N).filter(|&i| free[i]) {
                    let goal = at[i] + step[i];
                    let bound = goal.max(lower[i]).min(upper[i]);
                    if bound != goal {
                        let reached = (bound - at[i]) / step[i];
                        if first.is_none() || reached < part {
                            first = Some((i, bound));
                            part = reached;
                        }
                    }
                }
                for i in (0..N).filter(|&i| free[i]) {
                    at[i] = (at[i] + part * step[i]).max(lower[i]).min(upper[i]);
                }
                if let Some((i, bound)) = first {
                    at[i] = bound;
                    free[i] = false;
                    continue;
                }
            }
            let (mut pull, size) = self.pull(&at, ridge);
            let mut release: Option<(usize, f32)> = None;
            for i in (0..N).filter(|&i| !free[i] && lower[i] < upper[i]) {
                let inward = if at[i] <= lower[i] { -pull[i] } else { pull[i] };
                // What the release of this one alone would gain, twice.
                let gain = inward * inward / self.matrix[(i, i)].max(f32::MIN_POSITIVE);
                if inward > ROUNDING * size[i] && release.is_none_or(|(_, most)| gain > most) {
                    release = Some((i, gain));
                }
            }
            match release {
                Some((i, _)) => free[i] = true,
                None => {
                    for i in (0..N).filter(|&i| free[i]) {
                        pull[i] = 0.0;
                    }
                    let finite = at.iter().chain(pull.iter()).all(|value| value.is_finite());
                    return finite.then_some(Minimum { at, pull, ridge });
                }
            }
        }
        None
    }
}
