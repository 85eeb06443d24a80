//! From a damage pattern to the modes that the solver steps.
//!
//! `L^1/2 (I - sum_e d_e S_e) L^1/2` is diagonalised by cyclic Jacobi rotations. Its entries span six decades, from the
//! first mode to the stiffest static vector; a method whose error is relative to the largest of them would lose the
//! first mode in `f32`. Jacobi's error is relative to each eigenvalue, with the condition number of the matrix after
//! scaling to a unit diagonal (Demmel and Veselić 1992), which here is that of `I - sum_e d_e S_e`: at most
//! `1 / (1 - 0.7) = 3.3`, for any bridge.
//!
//! Cost: about 6 sweeps of `n (n - 1) / 2` rotations, `12 n` operations each: 270,000 operations for `n = 20`.

use nalgebra::{SMatrix, SVector};

use super::{Damage, ReducedBridge};
use crate::capacity::{BASIS, CHANNELS, ELEMENTS, FACTORS, PATH_NODES};
use crate::math::{Real, columns, entries};

/// Sweeps after which the rotation stops in any case; convergence is quadratic and takes about 6.
const MAX_SWEEPS: usize = 15;

/// The lowest `M` modes of the bridge with one damage pattern: what is needed to step it in time.
///
/// A mode that is not there (`M` larger than the basis, or cut off by [`Self::keep`]) has no shape: it stays at rest.
#[derive(Debug, Clone, PartialEq)]
pub struct ModalBridge<T: Real, const M: usize> {
    /// Squared circular frequency of each mode, rad²/s².
    pub omega_squared: SVector<T, M>,
    /// Damping `2 xi omega = p1 + p2 omega^2` of each mode, 1/s.
    pub damping: SVector<T, M>,
    /// Distance of each path node from node 1, m.
    pub position_m: [T; PATH_NODES],
    /// Path nodes in use.
    pub nodes: usize,
    /// Displacement and slope of each path node, a column each.
    pub path: [[SVector<T, M>; 2]; PATH_NODES],
    /// Displacement of the modes at each observed sensor.
    pub sensors: [SVector<T, M>; CHANNELS],
}

/// All modes of the bridge with one damage pattern, in the model's basis.
#[derive(Debug, Clone)]
pub struct Eigenmodes<T: Real> {
    eigenvalues: [T; BASIS],
    /// The mode of each eigenvalue.
    vectors: [[T; BASIS]; BASIS],
    /// Numbers of the modes by ascending eigenvalue.
    order: [usize; BASIS],
    count: usize,
}

/// A shape `g_f` of [`Eigenmodes::remainders`], s kg^-1/2.
#[derive(Debug, Clone, Copy)]
pub struct Remainder<T: Real> {
    /// Displacement and slope of each path node.
    pub path: [[T; 2]; PATH_NODES],
    /// Displacement at each observed sensor.
    pub sensors: [T; CHANNELS],
}

impl<T: Real> Remainder<T> {
    /// No shape.
    pub const NONE: Self = Self {
        path: [[T::ZERO; 2]; PATH_NODES],
        sensors: [T::ZERO; CHANNELS],
    };
}

impl<T: Real> Eigenmodes<T> {
    /// The modes of `bridge` with `damage`.
    pub fn new(bridge: &ReducedBridge<T>, damage: &Damage<T>) -> Self {
        let count = bridge.basis.min(BASIS);
        let mut modes = Self {
            eigenvalues: [T::zero(); BASIS],
            vectors: *columns(&SMatrix::identity()),
            order: core::array::from_fn(|i| i),
            count,
        };
        let mut matrix = SMatrix::identity();
        stiffness(bridge, damage, &mut matrix);
        eigen(&mut matrix, &mut modes.vectors, count);
        modes.eigenvalues = *entries(&matrix.diagonal());
        let eigenvalues = &modes.eigenvalues;
        modes.order[..count].sort_unstable_by(|&a, &b| {
            (eigenvalues.get(a).partial_cmp(&eigenvalues.get(b))).unwrap_or(core::cmp::Ordering::Equal)
        });
        modes
    }

    /// The modes that there are by ascending eigenvalue: each with its squared circular frequency, rad²/s².
    fn ascending(&self) -> impl Iterator<Item = (T, SVector<T, BASIS>)> {
        let mode = |&number: &usize| {
            let (&value, &vector) = self.eigenvalues.get(number).zip(self.vectors.get(number))?;
            Some((value, vector.into()))
        };
        self.order.iter().take(self.count).filter_map(mode)
    }

    /// Squared circular frequencies of the lowest `M` modes, rad²/s². A mode that does not exist gets the first one's.
    fn omega_squared<const M: usize>(&self) -> SVector<T, M> {
        let lowest = self.ascending().next().map_or(T::zero(), |(value, _)| value);
        let mut omega_squared = SVector::<T, M>::repeat(lowest);
        for (to, (value, _)) in omega_squared.iter_mut().zip(self.ascending()) {
            *to = value;
        }
        omega_squared
    }

    /// What the lowest `M` modes have of a vector in the model's basis.
    fn components<const M: usize>(&self, column: &SVector<T, BASIS>) -> SVector<T, M> {
        let mut components = SVector::<T, M>::zeros();
        for (component, (_, mode)) in components.iter_mut().zip(self.ascending()) {
            *component = mode.dot(column);
        }
        components
    }

    /// How the modes beyond the lowest `m` bend where an element goes soft, per factor: with `u_f` of [`Self::shares`] a loss of
    /// `d d_e` turns the shape `phi_k` by `sum_f u_fk g_f d d_e`,
    ///
    /// ```text
    /// g_f = sum_(j > m) phi_j u_fj / lambda_j                      (lambda_j - lambda_k, lambda_k left out)
    /// ```
    ///
    /// Displacement and slope of `g_f` at each node of the path, and its displacement at the sensor places `places`.
    pub fn remainders(
        &self,
        bridge: &ReducedBridge<T>,
        m: usize,
        places: impl Iterator<Item = usize> + Clone,
        remainders: &mut [Remainder<T>; FACTORS],
    ) {
        remainders.fill(Remainder::NONE);
        for (remainder, factor) in remainders.iter_mut().zip(self.factors(bridge)) {
            let mut vector = SVector::<T, BASIS>::zeros();
            for (value, mode) in self.ascending().skip(m) {
                vector.axpy(mode.dot(&factor) / value, &mode, T::one());
            }
            let path = [&bridge.path.displacement, &bridge.path.slope].map(columns);
            for (i, node) in remainder.path.iter_mut().enumerate() {
                *node = path.map(|nodes| SVector::from(nodes[i]).dot(&vector));
            }
            for (value, place) in remainder.sensors.iter_mut().zip(places.clone()) {
                *value = bridge.sensor(place).dot(&vector);
            }
        }
    }

    /// Each element's share of the stiffness in the lowest `M` modes, as the model's factors have it:
    /// `d (modal stiffness) / d d_e = -sum_f u_f u_f^T` over the factors `f` of element `e`; kg^1/2-normalised, rad/s.
    pub fn shares<const M: usize>(&self, bridge: &ReducedBridge<T>, shares: &mut [[T; M]; FACTORS]) {
        *shares = [[T::zero(); M]; FACTORS];
        for (share, factor) in shares.iter_mut().zip(self.factors(bridge)) {
            *share = *entries(&self.components(&factor));
        }
    }

    /// `L^1/2 b_f`.
    fn factors(&self, bridge: &ReducedBridge<T>) -> impl Iterator<Item = SVector<T, BASIS>> {
        let root = bridge.lambda.map(|value| value.sqrt());
        (columns(&bridge.factors).iter().take(bridge.factor_count))
            .map(move |&factor| SVector::from(factor).component_mul(&root))
    }
}

impl<T: Real, const M: usize> ModalBridge<T, M> {
    /// The modes of `bridge` with `damage`, observed at the sensor places `places` (at most [`CHANNELS`]).
    pub fn new(bridge: &ReducedBridge<T>, damage: &Damage<T>, places: &[usize]) -> Self {
        Self::of(
            &Eigenmodes::new(bridge, damage),
            bridge,
            T::one(),
            places.iter().copied(),
        )
    }

    /// The lowest of these modes, the stiffness of the whole bridge scaled by `stiffness`: its damping follows, its shapes stay.
    pub fn of(
        modes: &Eigenmodes<T>,
        bridge: &ReducedBridge<T>,
        stiffness: T,
        places: impl Iterator<Item = usize>,
    ) -> Self {
        let [p1, p2] = bridge.rayleigh;
        let omega_squared = modes.omega_squared() * stiffness;
        let mut sensors = [SVector::zeros(); CHANNELS];
        for (row, place) in sensors.iter_mut().zip(places) {
            *row = modes.components(&bridge.sensor(place));
        }
        Self {
            omega_squared,
            damping: omega_squared.map(|w2| p1 + p2 * w2),
            position_m: bridge.path.position_m,
            nodes: bridge.path.nodes,
            path: core::array::from_fn(|i| {
                [&bridge.path.displacement, &bridge.path.slope].map(|nodes| modes.components(&columns(nodes)[i].into()))
            }),
            sensors,
        }
    }

    /// Leaves only the lowest `modes` modes moving.
    pub fn keep(mut self, modes: usize) -> Self {
        for k in modes..M {
            for node in &mut self.path {
                node[0][k] = T::zero();
                node[1][k] = T::zero();
            }
            for row in &mut self.sensors {
                row[k] = T::zero();
            }
        }
        self
    }

    /// The span between two path nodes, from 0, that `x_m` lies in, the part of it before `x_m` and its length; beyond an end, that
    /// end. None if there is no span.
    pub fn span(&self, x_m: T) -> Option<(usize, T, T)> {
        let nodes = self.position_m.get(..self.nodes).filter(|nodes| nodes.len() >= 2)?;
        // The last element whose beginning has been reached: found at once where they are equal, by a few steps elsewhere.
        let last = nodes.len() - 2;
        let mut span = (x_m / (nodes[1] - nodes[0])).whole().min(last);
        while span > 0 && nodes.get(span).is_some_and(|&begin| begin > x_m) {
            span -= 1;
        }
        while span < last && nodes.get(span + 1).is_some_and(|&end| end <= x_m) {
            span += 1;
        }
        let &[a, b] = nodes.get(span..span + 2)?.first_chunk::<2>()?;
        let length = b - a;
        let part = (x_m - a) / length;
        let part = if part < T::zero() {
            T::zero()
        } else if part > T::one() {
            T::one()
        } else {
            part
        };
        Some((span, part, length))
    }

    /// Length of the path, m.
    pub fn length_m(&self) -> T {
        self.position_m
            .get(..self.nodes)
            .and_then(|nodes| nodes.last())
            .copied()
            .unwrap_or(T::zero())
    }

    /// Natural frequency of mode `k` (from 0), Hz.
    pub fn frequency_hz(&self, k: usize) -> T {
        self.omega_squared[k].sqrt() / T::two_pi()
    }
}

// ---- what an element's damage does to the frequencies ---------------------------------------------------------------

/// Squared circular frequencies of the lowest modes, and what each element's damage does to them.
#[derive(Debug, Clone, PartialEq)]
pub struct FrequencySlopes<T: Real, const M: usize> {
    /// Modes that there are; the rows beyond them are zero.
    pub modes: usize,
    /// Squared circular frequency of each mode, ascending, rad²/s².
    pub omega_squared: [T; M],
    /// Its derivative by the damage of each element, rad²/s²; never positive.
    pub by_damage: [[T; ELEMENTS]; M],
}

impl<T: Real, const M: usize> FrequencySlopes<T, M> {
    /// Those of `bridge` with `damage`.
    ///
    /// ```text
    /// d(w_k^2) / d(d_e) = phi_k^T dK/d(d_e) phi_k = - sum_f (phi_k^T L^1/2 b_f)^2,   f the factors of element e
    /// ```
    ///
    /// This is exact (Fox and Kapoor 1968), because `phi_k^T phi_k = 1` whatever the damage. It asks that mode `k` has a
    /// frequency of its own: where two coincide, only the sum of their slopes means something.
    pub fn new(bridge: &ReducedBridge<T>, damage: &Damage<T>) -> Self {
        let eigenmodes = Eigenmodes::new(bridge, damage);
        let mut shares = [[T::zero(); M]; FACTORS];
        eigenmodes.shares(bridge, &mut shares);
        let mut slopes = Self {
            modes: M.min(eigenmodes.count),
            omega_squared: [T::zero(); M],
            by_damage: [[T::zero(); ELEMENTS]; M],
        };
        let known = eigenmodes.omega_squared::<M>();
        let rows = slopes.omega_squared.iter_mut().zip(&mut slopes.by_damage);
        for (k, (omega_squared, by_damage)) in rows.enumerate().take(slopes.modes) {
            *omega_squared = known[k];
            for (share, &element) in shares.iter().zip(&bridge.factor_element) {
                if let Some(slope) = by_damage.get_mut(usize::from(element)) {
                    *slope -= share[k] * share[k];
                }
            }
        }
        slopes
    }
}

/// `Phi^T K(d) Phi`, from the identity.
fn stiffness<T: Real>(bridge: &ReducedBridge<T>, damage: &Damage<T>, matrix: &mut SMatrix<T, BASIS, BASIS>) {
    for (column, &element) in bridge
        .factors
        .column_iter()
        .zip(&bridge.factor_element)
        .take(bridge.factor_count)
    {
        let loss = damage.get(usize::from(element)).copied().unwrap_or(T::zero());
        if loss != T::zero() {
            for (j, &right) in column.iter().enumerate() {
                matrix.column_mut(j).axpy(-loss * right, &column, T::one());
            }
        }
    }
    let root = bridge.lambda.map(|value| value.sqrt());
    for j in 0..BASIS {
        for i in 0..BASIS {
            matrix[(i, j)] *= root[i] * root[j];
        }
    }
}

/// Turns two vectors towards each other by an angle of the cosine `c` and the sine `s`, in their first `n` entries.
fn turn<T: Real>([p, q]: [&mut [T; BASIS]; 2], [c, s]: [T; 2], n: usize) {
    for (p, q) in p.iter_mut().zip(q).take(n) {
        (*p, *q) = (c * *p - s * *q, s * *p + c * *q);
    }
}

/// Makes the leading `n x n` block of a symmetric positive matrix diagonal: what is left there are its eigenvalues, unsorted. Turns the
/// vectors `v` with it.
fn eigen<T: Real>(a: &mut SMatrix<T, BASIS, BASIS>, v: &mut [[T; BASIS]; BASIS], n: usize) {
    let n = n.min(BASIS);
    let tolerance = T::default_epsilon() * T::default_epsilon();
    for _ in 0..MAX_SWEEPS {
        let mut rotated = false;
        for p in 0..n {
            for q in p + 1..n {
                let (app, aqq, apq) = (a[(p, p)], a[(q, q)], a[(p, q)]);
                if apq * apq <= tolerance * app * aqq {
                    continue;
                }
                rotated = true;
                // The smaller of the two angles that zero a_pq (Golub and Van Loan, 8.5.2).
                let tau = (aqq - app) / (apq + apq);
                let root = (T::one() + tau * tau).sqrt();
                let t = if tau >= T::zero() {
                    (tau + root).recip()
                } else {
                    (tau - root).recip()
                };
                let c = (T::one() + t * t).sqrt().recip();
                let s = t * c;
                for columns in [&mut a.data.0, &mut *v] {
                    if let Ok(columns) = columns.get_disjoint_mut([p, q]) {
                        turn(columns, [c, s], n);
                    }
                }
                for k in 0..n {
                    let (apk, aqk) = (a[(p, k)], a[(q, k)]);
                    a[(p, k)] = c * apk - s * aqk;
                    a[(q, k)] = s * apk + c * aqk;
                }
                // What the two products leave in the diagonal has cancelled; these have not.
                a[(p, p)] = app - t * apq;
                a[(q, q)] = aqq + t * apq;
                a[(p, q)] = T::zero();
                a[(q, p)] = T::zero();
            }
        }
        if !rotated {
            break;
        }
    }
}
