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
/// Parts by which a diagonal is raised, the first that helps: a matrix that is the difference of larger ones, as when unknowns were
/// marginalised, is rounded by more than its own entries tell.
pub const RIDGES: [f32; 3] = [SINGULAR, 10.0 * SINGULAR, 100.0 * SINGULAR];
/// Steps for each variable before the search is given up. A hundred thousand random cases took less than a third of it.
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
    /// Part by which the diagonal was raised to find it: 0, or one of [`RIDGES`].
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
        let columns = self.matrix.column_iter_mut().zip(self.vector.iter_mut());
        for ((mut column, value), &known_here) in columns.zip(&known) {
            for (entry, &known_there) in column.iter_mut().zip(&known) {
                if !(known_here && known_there) {
                    *entry = 0.0;
                }
            }
            if !known_here {
                *value = 0.0;
            }
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

    /// Like [`Self::minimum`] for a matrix that may be singular: its diagonal is raised by the part [`SINGULAR`], or
    /// more if need be ([`RIDGES`]), and of points that are equally low the one is found that is small.
    pub fn small_minimum(&self, lower: &[f32; N], upper: &[f32; N]) -> Option<Minimum<N>> {
        RIDGES.into_iter().find_map(|ridge| self.descend(lower, upper, ridge))
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
        let (factor, _) = self.raised(&self.known())?;
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
            None => self.raised(&known)?,
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

    /// `v^T (A + ridge diag A)^-1 v`, the ridge not less than [`SINGULAR`]: never more than `v^T A^-1 v`.
    pub fn length_squared(&self, vector: &SVector<f32, N>, ridge: f32) -> Option<f32> {
        let known = self.known();
        let factor = match self.factor(&known, ridge.max(SINGULAR)) {
            Some(factor) => factor,
            None => self.raised(&known)?.0,
        };
        Some(vector.dot(&factor.solve(vector)))
    }

    /// `sum_i A_ii x_i^2`: the size of the terms that a value is made of, and so a measure of its rounding.
    pub fn size(&self, at: &SVector<f32, N>) -> f32 {
        self.matrix.diagonal().dot(&at.component_mul(at))
    }

    /// Whether all is finite, nothing is said of a variable of which nothing is known, and the matrix
    /// is, but for rounding, positive semidefinite.
    pub fn is_information(&self) -> bool {
        let known = self.known();
        let finite = self.matrix.iter().chain(self.vector.iter()).all(|v| v.is_finite());
        let silent = (0..N).filter(|&i| !known[i]).all(|i| {
            self.vector[i] == 0.0 && self.matrix.row(i).iter().all(|&v| v == 0.0) && self.matrix[(i, i)] == 0.0
        });
        finite && silent && self.raised(&known).is_some()
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

    /// The factor with the diagonal raised as little as need be, and by how much.
    fn raised(&self, free: &[bool; N]) -> Option<(Factor<N>, f32)> {
        RIDGES
            .into_iter()
            .find_map(|ridge| Some((self.factor(free, ridge)?, ridge)))
    }

    // Not inlined: its matrix must leave the stack before the next is made.
    #[inline(never)]
    fn factor(&self, free: &[bool; N], ridge: f32) -> Option<Factor<N>> {
        let mut scale = self.matrix.diagonal();
        for (scale, &free) in scale.iter_mut().zip(free) {
            if !free {
                *scale = 0.0;
            } else if (f32::MIN_POSITIVE..=f32::MAX).contains(scale) {
                *scale = 1.0 / math::sqrt(*scale);
            } else {
                return None;
            }
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
        // A diagonal that was raised need only be definite.
        let least = if ridge > 0.0 { 0.0 } else { SINGULAR };
        let definite = (0..N).all(|i| lower[(i, i)] * lower[(i, i)] > least);
        definite.then_some(Factor { cholesky, scale })
    }

    fn descend(&self, lower: &[f32; N], upper: &[f32; N], ridge: f32) -> Option<Minimum<N>> {
        let mut at = SVector::<f32, N>::zeros();
        let mut free = [false; N];
        let diagonal = self.matrix.diagonal();
        let diagonal = math::entries(&diagonal);
        for i in 0..N {
            at[i] = within(lower[i], 0.0, upper[i]);
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
                    let bound = within(lower[i], goal, upper[i]);
                    if bound != goal {
                        let reached = (bound - at[i]) / step[i];
                        if first.is_none() || reached < part {
                            first = Some((i, bound));
                            part = reached;
                        }
                    }
                }
                for i in (0..N).filter(|&i| free[i]) {
                    at[i] = within(lower[i], at[i] + part * step[i], upper[i]);
                }
                if let Some((i, bound)) = first {
                    if let (Some(at), Some(free)) = (at.get_mut(i), free.get_mut(i)) {
                        *at = bound;
                        *free = false;
                    }
                    continue;
                }
            }
            let (mut pull, size) = self.pull(&at, ridge);
            let mut release: Option<(usize, f32)> = None;
            for i in (0..N).filter(|&i| !free[i] && lower[i] < upper[i]) {
                let inward = if at[i] <= lower[i] { -pull[i] } else { pull[i] };
                // What the release of this one alone would gain, twice.
                let gain = inward * inward / diagonal[i].max(f32::MIN_POSITIVE);
                if inward > ROUNDING * size[i] && release.is_none_or(|(_, most)| gain > most) {
                    release = Some((i, gain));
                }
            }
            match release.and_then(|(i, _)| free.get_mut(i)) {
                Some(free) => *free = true,
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

/// The nearest to `value` between `lower` and `upper`. Unlike `f32::max`, the same for zeros of either sign on every machine.
fn within(lower: f32, value: f32, upper: f32) -> f32 {
    if value < lower {
        lower
    } else if value > upper {
        upper
    } else {
        value
    }
}

#[cfg(test)]
mod tests {
    use rand_core::SeedableRng;
    use rand_xoshiro::Xoshiro128PlusPlus;

    use super::*;
    use crate::identify::random::{below, unit};

    /// Rise above the true minimum, as part of `sum_i A_ii x_i^2`: what rounding of the matrix itself may make of it.
    const RISE: f64 = 1e-6;
    /// Pull of a free variable, and inward pull of a held one, as part of the terms that it is a sum of: a solution of a
    /// system of fourteen rows, 1e-7 a row, and [`ROUNDING`].
    const PULL: f64 = 5e-6;

    fn real(quadratic: &Quadratic<14>, i: usize, j: usize) -> f64 {
        f64::from(quadratic.matrix[(i, j)])
    }

    /// A random one of `n` variables in units that differ by up to 1e6, its rows as dependent on each other as `common`
    /// says, and its minimum without bounds well outside of the box for about half of them. Others are zero.
    fn random(rng: &mut Xoshiro128PlusPlus, n: usize, common: f32) -> (Quadratic<14>, [f32; 14], [f32; 14]) {
        let mut even = |span: f32| span * (2.0 * unit(rng) - 1.0);
        let scale: [f32; 14] = core::array::from_fn(|_| libm::powf(10.0, even(3.0)));
        let goal: [f32; 14] = core::array::from_fn(|_| even(3.0));
        let mut quadratic = Quadratic::<14>::ZERO;
        for _ in 0..n + 4 {
            let shared = even(common);
            let row = SVector::<f32, 14>::from_fn(|i, _| if i < n { (shared + even(1.0)) / scale[i] } else { 0.0 });
            let right: f32 = (0..n).map(|i| row[i] * goal[i] * scale[i]).sum();
            quadratic.matrix.ger(1.0, &row, &row, 1.0);
            quadratic.vector.axpy(right + even(1.0), &row, 1.0);
        }
        let mut lower = [0.0; 14];
        let mut upper = [0.0; 14];
        for i in 0..n {
            match below(rng, 8) {
                0 => {
                    lower[i] = -scale[i];
                    upper[i] = scale[i];
                }
                1 => {
                    lower[i] = 0.5 * scale[i];
                    upper[i] = lower[i];
                }
                _ => upper[i] = 2.0 * scale[i],
            }
        }
        (quadratic, lower, upper)
    }

    /// The lowest value of all sets of held variables, tried one by one in `f64`.
    fn enumerated(quadratic: &Quadratic<14>, lower: &[f32; 14], upper: &[f32; 14], n: usize) -> f64 {
        let mut least = f64::INFINITY;
        for mut choice in 0..3_usize.pow(n as u32) {
            let mut matrix = SMatrix::<f64, 14, 14>::identity();
            let mut right = SVector::<f64, 14>::zeros();
            for i in 0..n {
                match choice % 3 {
                    0 => {
                        for j in 0..n {
                            matrix[(i, j)] = real(quadratic, i, j);
                        }
                        right[i] = f64::from(quadratic.vector[i]);
                    }
                    1 => right[i] = f64::from(lower[i]),
                    _ => right[i] = f64::from(upper[i]),
                }
                choice /= 3;
            }
            let Some(at) = matrix.lu().solve(&right) else { continue };
            let inside = (0..n).all(|i| {
                let slack = 1e-9 * f64::from(upper[i] - lower[i].min(0.0));
                at[i] >= f64::from(lower[i]) - slack && at[i] <= f64::from(upper[i]) + slack
            });
            if inside {
                least = least.min(value(quadratic, &at));
            }
        }
        least
    }

    fn value(quadratic: &Quadratic<14>, at: &SVector<f64, 14>) -> f64 {
        let mut sum = 0.0;
        for i in 0..14 {
            sum -= f64::from(quadratic.vector[i]) * at[i];
            for j in 0..14 {
                sum += 0.5 * at[i] * real(quadratic, i, j) * at[j];
            }
        }
        sum
    }

    #[test]
    fn the_minimum_is_the_best_of_all_sets_of_held_variables() {
        let mut rng = Xoshiro128PlusPlus::seed_from_u64(1);
        for case in 0..1500 {
            let n = 4 + case % 3;
            let common = [0.0, 1.0, 10.0][below(&mut rng, 3)];
            let (quadratic, lower, upper) = random(&mut rng, n, common);
            let found = quadratic.minimum(&lower, &upper).expect("definite");
            assert!(
                (0..14).all(|i| lower[i] <= found.at[i] && found.at[i] <= upper[i]),
                "case {case}: in the box"
            );
            let size: f64 = (0..n)
                .map(|i| real(&quadratic, i, i) * f64::from(found.at[i] * found.at[i]))
                .sum();
            let rise = value(&quadratic, &found.at.cast()) - enumerated(&quadratic, &lower, &upper, n);
            assert!(
                rise.abs() <= RISE * size.max(1.0),
                "case {case}: {rise:.1e} above, of {size:.1e}"
            );
        }
    }

    fn is_lowest(quadratic: &Quadratic<14>, lower: &[f32; 14], upper: &[f32; 14], at: &SVector<f32, 14>) -> bool {
        (0..14).all(|i| {
            let terms = || (0..14).map(|j| real(quadratic, i, j) * f64::from(at[j]));
            let right = f64::from(quadratic.vector[i]);
            let pull = terms().sum::<f64>() - right;
            let rounding = PULL * (terms().map(f64::abs).sum::<f64>() + right.abs());
            lower[i] == upper[i]
                || ((pull <= rounding || at[i] == lower[i]) && (pull >= -rounding || at[i] == upper[i]))
        })
    }

    #[test]
    fn no_pull_is_left_in_ten_and_in_fourteen_variables_and_the_search_never_gives_up() {
        let mut rng = Xoshiro128PlusPlus::seed_from_u64(2);
        for case in 0..20_000 {
            let n = 10 + 4 * (case % 2);
            let common = [0.0, 1.0, 10.0, 50.0][below(&mut rng, 4)];
            let (quadratic, lower, upper) = random(&mut rng, n, common);
            let found = quadratic
                .minimum(&lower, &upper)
                .or_else(|| quadratic.small_minimum(&lower, &upper));
            let found = found.expect("found");
            if found.ridge == 0.0 {
                assert!(is_lowest(&quadratic, &lower, &upper, &found.at), "case {case}");
            }
        }
    }

    #[test]
    fn what_is_held_by_mistake_is_released() {
        // From zero the way first leads out of the box in the second variable, which is inside at the minimum.
        let mut quadratic = Quadratic::<2>::ZERO;
        quadratic.matrix = SMatrix::<f32, 2, 2>::new(1.0, 0.9, 0.9, 1.0);
        quadratic.vector = SVector::<f32, 2>::new(2.9, 3.0);
        let found = quadratic.minimum(&[-1.0, -1.0], &[1.0, 2.5]).expect("definite");
        assert_eq!(found.at[0], 1.0);
        assert!((found.at[1] - 2.1).abs() < 1e-6);
    }

    #[test]
    fn a_singular_matrix_has_no_minimum_but_a_small_one() {
        let mut quadratic = Quadratic::<2>::ZERO;
        quadratic.matrix = SMatrix::<f32, 2, 2>::repeat(4.0);
        quadratic.vector = SVector::<f32, 2>::repeat(4.0);
        let (lower, upper) = ([-1.0; 2], [1.0; 2]);
        assert_eq!(quadratic.minimum(&lower, &upper), None);
        let found = quadratic.small_minimum(&lower, &upper).expect("found");
        assert!((found.at[0] - 0.5).abs() < 1e-4 && (found.at[1] - 0.5).abs() < 1e-4);
        assert_eq!(quadratic.variances(), Some(SVector::repeat(f32::INFINITY)));
    }

    #[test]
    fn numbers_that_are_none_have_no_minimum() {
        for broken in [f32::NAN, f32::INFINITY, -1.0, 0.0] {
            let mut quadratic = Quadratic::<2>::ZERO;
            quadratic.matrix = SMatrix::<f32, 2, 2>::new(broken, 0.0, 0.0, 1.0);
            quadratic.vector = SVector::<f32, 2>::repeat(1.0);
            assert_eq!(quadratic.minimum(&[0.0; 2], &[1.0; 2]), None, "{broken}");
        }
        let mut quadratic = Quadratic::<2>::ZERO;
        quadratic.matrix = SMatrix::identity();
        quadratic.vector = SVector::<f32, 2>::repeat(f32::NAN);
        assert_eq!(quadratic.minimum(&[0.0; 2], &[1.0; 2]), None);
        assert!(!quadratic.is_information());
    }

    #[test]
    fn variances_are_the_inverse_s_diagonal_and_the_centre_solves_the_system() {
        let mut rng = Xoshiro128PlusPlus::seed_from_u64(3);
        for case in 0..1000 {
            let (quadratic, ..) = random(&mut rng, 14, 1.0);
            let matrix = quadratic.matrix.cast::<f64>();
            let inverse = matrix.try_inverse().expect("definite");
            let centre = inverse * quadratic.vector.cast::<f64>();
            let variances = quadratic.variances().expect("definite");
            let found = quadratic.centre().expect("definite");
            for i in 0..14 {
                let deviation = libm::sqrt(inverse[(i, i)]);
                // A thousandth of a deviation, or of itself: `f32` times the condition number, 1e4 at most here.
                let off = (f64::from(found[i]) - centre[i]).abs();
                assert!(
                    off < 1e-3 * (deviation + centre[i].abs()),
                    "case {case}: centre off by {off:.1e}"
                );
                let ratio = f64::from(variances[i]) / inverse[(i, i)];
                assert!((ratio - 1.0).abs() < 5e-3, "case {case}: variance off by {ratio}");
            }
        }
    }
}
