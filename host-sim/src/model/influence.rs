//! Influence lines: how far a sensor moves for a unit force, upwards, at any place of the path of the wheels.
//!
//! By Maxwell and Betti that is the shape into which a unit force at the sensor bends the path:
//!
//! ```text
//! K u = s,   eta(x) = w(x) . u                      s row of the sensor, w(x) row of the path, vertical
//! eta(x) = sum_k s_k w_k(x) / omega_k^2             the same by modes; equal only with all of them
//! ```

use anyhow::Result;
use nalgebra::DMatrix;
use spanwatch::interaction::contact::hermite;

use super::eigen::solve;
use super::frame::constraint::Row;
use super::modal::{ModalModel, value};
use super::structure::Structure;
use crate::train::SpatialTrain;

/// An influence line, m/N, positive up for a force upwards.
#[derive(Debug, Clone, PartialEq)]
pub struct InfluenceLine {
    x_m: Vec<f64>,
    /// Value and slope at each.
    nodes: Vec<[f64; 2]>,
}

impl InfluenceLine {
    /// The line of a sensor's row, by the stiffness matrix.
    ///
    /// # Errors
    /// If the structure cannot stand.
    pub fn exact(structure: &Structure, row: &Row) -> Result<Self> {
        let mut load = DMatrix::zeros(structure.matrices.freedoms(), 1);
        for &(freedom, factor) in row {
            load[freedom] += factor;
        }
        let bent = solve(&structure.stiffness(&[]), &load)?;
        Ok(Self {
            x_m: structure.path.iter().map(|at| at.x_m).collect(),
            nodes: (structure.path.iter())
                .map(|at| [0, 1].map(|order| value(&at.vertical[order], bent.column(0))))
                .collect(),
        })
    }

    /// The line of a sensor's row, by the modes that a model has.
    pub fn modal(model: &ModalModel, row: &[f64]) -> Self {
        let soft = |shape: &[f64]| {
            (row.iter().zip(shape).zip(&model.omega_squared))
                .map(|((s, w), w2)| s * w / w2)
                .sum()
        };
        Self {
            x_m: model.path.iter().map(|at| at.x_m).collect(),
            nodes: (model.path.iter())
                .map(|at| [0, 1].map(|order| soft(&at.vertical[order])))
                .collect(),
        }
    }

    /// Its value at `x_m` from the beginning of the path; zero off the path.
    pub fn at(&self, x_m: f64) -> f64 {
        let last = self.x_m.len() - 1;
        if !(x_m >= 0.0 && x_m <= self.x_m[last]) {
            return 0.0;
        }
        let span = self.x_m[1..last].partition_point(|&begin| begin <= x_m);
        let length = self.x_m[span + 1] - self.x_m[span];
        let [w1, s1, w2, s2] = hermite(0, (x_m - self.x_m[span]) / length, length);
        let ([left, left_slope], [right, right_slope]) = (self.nodes[span], self.nodes[span + 1]);
        left * w1 + left_slope * s1 + right * w2 + right_slope * s2
    }

    /// What the static loads of a train move the sensor by, m, its first wheelset `front_m` from the beginning of the path.
    pub fn under(&self, train: &SpatialTrain, front_m: f64) -> f64 {
        wheels(train)
            .map(|(behind_m, load_n)| -load_n * self.at(front_m - behind_m))
            .sum()
    }
}

/// Each wheelset of a train: its distance behind the first, m, and its static load, N.
pub fn wheels(train: &SpatialTrain) -> impl Iterator<Item = (f64, f64)> {
    train.cars.iter().flat_map(|place| {
        (train.kinds[place.kind].contacts.iter())
            .map(move |contact| (place.behind_m + contact.behind_m, contact.load_n))
    })
}
