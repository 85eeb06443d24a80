//! The reduced bridge model: all that the logger knows of the bridge.
//!
//! The PC (`host-sim`) reduces the finite elements to a basis of `n` mass-normalised vectors, the columns of `Phi`: the
//! lowest modes of the undamaged bridge and, because these alone cannot bend where an element has gone soft, static
//! vectors `K0^-1 K_e phi_k` of all elements, `k = 1, 2, ..` as far as there is room. The basis is rotated until the undamaged stiffness in it is diagonal, so
//!
//! ```text
//! Phi^T M Phi  = I
//! Phi^T K0 Phi = L = diag(lambda_1 .. lambda_n)                              [rad^2/s^2]
//! Phi^T K(d) Phi = L^1/2 (I - sum_e d_e S_e) L^1/2,   sum_e S_e = I
//! S_e = sum_f b_f b_f^T                                                      [-]
//! C(d) = p1 M + p2 K(d)                          (Rayleigh, paper's Eq. 34)
//! ```
//!
//! `d_e` is the damage of element `e`, the fraction of its bending stiffness that is lost, 0 to 0.7. `S_e` is the
//! element's share of the bridge's stiffness; it is kept as the few vectors `b_f` whose outer products make it up (two
//! for a beam element, bending being linear along it), which takes an eighth of the memory and keeps `K(d)` positive.
//! `sum_e S_e = I` holds for every true model, and a blob for which it does not is refused.
//!
//! Displacements are vertical and positive up, as in the recordings. [`modes`] turns a damage pattern into the modes
//! that the solver steps; [`blob`] is the form in which the model travels.

pub mod blob;
pub mod modes;

use heapless::String;
use nalgebra::{ArrayStorage, SMatrix, SVector};

use crate::capacity::{BASIS, ELEMENTS, FACTORS, PATH_NODES, SENSOR_PLACES};
use crate::math::{Real, columns};

pub use blob::BlobError;
pub use modes::{Eigenmodes, ModalBridge};

/// Largest loss of stiffness that a damage pattern may hold.
pub const MAX_DAMAGE: f64 = 0.7;

/// Fraction of bending stiffness lost by each element, 0 to [`MAX_DAMAGE`].
pub type Damage<T> = [T; ELEMENTS];

/// The bridge in its enriched modal basis. Unused columns and rows beyond the counts are zero.
#[derive(Debug, Clone, PartialEq)]
pub struct ReducedBridge<T: Real> {
    /// Name of the bridge.
    pub name: String<24>,
    /// Vectors in the basis.
    pub basis: usize,
    /// Elements that can be damaged.
    pub elements: usize,
    /// Squared circular frequencies `lambda` of the undamaged basis, ascending, rad²/s².
    pub lambda: SVector<T, BASIS>,
    /// The vectors `b_f`, dimensionless, a column each.
    pub factors: SMatrix<T, BASIS, FACTORS>,
    /// Element, from 0, that each column of [`Self::factors`] belongs to.
    pub factor_element: [u8; FACTORS],
    /// Columns of [`Self::factors`] in use.
    pub factor_count: usize,
    /// The line that the wheels follow.
    pub path: Path<T>,
    /// Bridge node of each sensor place.
    pub sensor_node: [u16; SENSOR_PLACES],
    /// Displacement of each sensor place (a column) in the basis, kg^-1/2.
    pub sensors: SMatrix<T, BASIS, SENSOR_PLACES>,
    /// Sensor places in use.
    pub sensor_count: usize,
    /// Rayleigh coefficients `p1` (1/s) and `p2` (s) of the undamaged bridge.
    pub rayleigh: [T; 2],
}

/// The line that the wheels follow, by the nodes on it; between them, exact Hermite beam shapes.
#[derive(Debug, Clone, PartialEq)]
pub struct Path<T: Real> {
    /// Nodes in use.
    pub nodes: usize,
    /// Distance of each node from node 1, ascending from 0, m.
    pub position_m: [T; PATH_NODES],
    /// Displacement (kg^-1/2) of each node in the basis, a column each.
    pub displacement: SMatrix<T, BASIS, PATH_NODES>,
    /// Slope (kg^-1/2/m) of each node in the basis, a column each.
    pub slope: SMatrix<T, BASIS, PATH_NODES>,
}

impl<T: Real> Path<T> {
    /// Length of the path, m.
    pub fn length_m(&self) -> T {
        self.position_m[..self.nodes.min(PATH_NODES)]
            .last()
            .copied()
            .unwrap_or(T::zero())
    }
}

impl<T: Real> ReducedBridge<T> {
    /// No bridge.
    pub const EMPTY: Self = Self {
        name: String::new(),
        basis: 0,
        elements: 0,
        lambda: SVector::from_array_storage(ArrayStorage([[T::ZERO; BASIS]])),
        factors: SMatrix::from_array_storage(ArrayStorage([[T::ZERO; BASIS]; FACTORS])),
        factor_element: [0; FACTORS],
        factor_count: 0,
        path: Path {
            nodes: 0,
            position_m: [T::ZERO; PATH_NODES],
            displacement: SMatrix::from_array_storage(ArrayStorage([[T::ZERO; BASIS]; PATH_NODES])),
            slope: SMatrix::from_array_storage(ArrayStorage([[T::ZERO; BASIS]; PATH_NODES])),
        },
        sensor_node: [0; SENSOR_PLACES],
        sensors: SMatrix::from_array_storage(ArrayStorage([[T::ZERO; BASIS]; SENSOR_PLACES])),
        sensor_count: 0,
        rayleigh: [T::ZERO; 2],
    };

    /// Makes it [`Self::EMPTY`] in place.
    fn clear(&mut self) {
        self.name.clear();
        (
            self.basis,
            self.elements,
            self.factor_count,
            self.sensor_count,
            self.path.nodes,
        ) = (0, 0, 0, 0, 0);
        self.lambda.fill(T::ZERO);
        self.factors.fill(T::ZERO);
        self.factor_element.fill(0);
        self.path.position_m.fill(T::ZERO);
        self.path.displacement.fill(T::ZERO);
        self.path.slope.fill(T::ZERO);
        self.sensor_node.fill(0);
        self.sensors.fill(T::ZERO);
        self.rayleigh.fill(T::ZERO);
    }

    /// The sensor place at a bridge node, if there is one.
    pub fn sensor_at(&self, node: u16) -> Option<usize> {
        self.sensor_node.iter().take(self.sensor_count).position(|&n| n == node)
    }

    /// How far each vector of the basis moves a sensor place, kg^-1/2; a place that is not there does not move.
    pub fn sensor(&self, place: usize) -> SVector<T, BASIS> {
        columns(&self.sensors)
            .get(place)
            .copied()
            .unwrap_or([T::ZERO; BASIS])
            .into()
    }

    /// The same model in the other precision.
    pub fn cast<U: Real>(&self) -> ReducedBridge<U> {
        let to = |value: T| U::of(value.into());
        ReducedBridge {
            name: self.name.clone(),
            basis: self.basis,
            elements: self.elements,
            lambda: self.lambda.map(to),
            factors: self.factors.map(to),
            factor_element: self.factor_element,
            factor_count: self.factor_count,
            path: Path {
                nodes: self.path.nodes,
                position_m: self.path.position_m.map(to),
                displacement: self.path.displacement.map(to),
                slope: self.path.slope.map(to),
            },
            sensor_node: self.sensor_node,
            sensors: self.sensors.map(to),
            sensor_count: self.sensor_count,
            rayleigh: self.rayleigh.map(to),
        }
    }

    /// The same bridge with `factor` times its damping.
    pub fn damped(mut self, factor: T) -> Self {
        self.rayleigh = self.rayleigh.map(|coefficient| coefficient * factor);
        self
    }
}
