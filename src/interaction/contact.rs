//! Mode shapes under a wheel: exact Hermite beam shapes between the nodes of the path.

use nalgebra::SVector;

use crate::bridge::ModalBridge;
use crate::math::Real;

/// Mode shapes and their first two derivatives along the path, at one point of it.
#[derive(Debug, Clone, Copy)]
pub struct Shape<T: Real, const M: usize> {
    /// `phi`, kg^-1/2.
    pub value: SVector<T, M>,
    /// `d phi / dx`, kg^-1/2/m.
    pub slope: SVector<T, M>,
    /// `d2 phi / dx2`, kg^-1/2/m2.
    pub curvature: SVector<T, M>,
}

impl<T: Real, const M: usize> ModalBridge<T, M> {
    /// The shapes at `x_m` from node 1; none off the bridge.
    pub fn shape_at(&self, x_m: T) -> Option<Shape<T, M>> {
        let nodes = self.position_m.get(..self.nodes)?;
        let span = nodes
            .windows(2)
            .position(|ends| matches!(ends, [a, b] if (*a..=*b).contains(&x_m)))?;
        let ([a, b], [left, right]) = (
            [*nodes.get(span)?, *nodes.get(span + 1)?],
            [self.path.get(span)?, self.path.get(span + 1)?],
        );
        let length = b - a;
        let s = (x_m - a) / length;
        let [n2, n3, n4, n6, n12] = [2.0, 3.0, 4.0, 6.0, 12.0].map(T::of);
        let (s2, r) = (s * s, length.recip());
        let one = T::one();
        let blend = |w: [T; 4]| left[0] * w[0] + left[1] * w[1] + right[0] * w[2] + right[1] * w[3];
        Some(Shape {
            value: blend([
                one - n3 * s2 + n2 * s2 * s,
                length * s * (one - s) * (one - s),
                s2 * (n3 - n2 * s),
                length * s2 * (s - one),
            ]),
            slope: blend([
                n6 * s * (s - one) * r,
                one - n4 * s + n3 * s2,
                n6 * s * (one - s) * r,
                s * (n3 * s - n2),
            ]),
            curvature: blend([
                (n12 * s - n6) * r * r,
                (n6 * s - n4) * r,
                (n6 - n12 * s) * r * r,
                (n6 * s - n2) * r,
            ]),
        })
    }
}
