//! The bridge as the time solution wants it: natural modes, each an oscillator, and how the path of the wheels and the
//! sensors move with each.
//!
//! ```text
//! q_k'' + c_k q_k' + omega_k^2 q_k = sum of wheel forces times the path's shape,    c_k = p1 + p2 omega_k^2
//! ```
//!
//! Shapes are mass-normalised, so their unit is kg^-1/2. The Rayleigh coefficients are those of the undamaged bridge
//! (the paper's Eqs 34 to 36), whatever the damage.

use anyhow::Result;
use nalgebra::DVectorView;

use super::eigen::{Wanted, natural_modes};
use super::frame::constraint::Row;
use super::structure::Structure;

/// A mode that reaches less than this part of the largest of all modes, in each quantity at the path and the sensors, is
/// left out. What it would add to any response goes with the product of two such parts, 1e-6.
const UNMOVED: f64 = 1e-3;
/// Quantities that are compared with their like: vertical, lateral and roll, values and slopes, and the sensors.
const QUANTITIES: usize = 7;

/// The modes of a bridge, damaged or not.
#[derive(Debug, Clone, PartialEq)]
pub struct ModalModel {
    /// Name of the bridge.
    pub name: String,
    /// Squared circular frequencies, ascending, rad²/s².
    pub omega_squared: Vec<f64>,
    /// Damping `2 xi omega` of each mode, 1/s.
    pub damping: Vec<f64>,
    /// The path of the wheels.
    pub path: Vec<PathPoint>,
    /// The sensors.
    pub sensors: Vec<Sensor>,
}

/// A point of the path of the wheels: value and slope (per metre along the track) of each mode, mass-normalised.
#[derive(Debug, Clone, PartialEq)]
pub struct PathPoint {
    /// Distance from the path's first point, m.
    pub x_m: f64,
    /// Movement upwards.
    pub vertical: [Vec<f64>; 2],
    /// Movement to the left, at the height of the rails.
    pub lateral: [Vec<f64>; 2],
    /// Roll, left side up.
    pub roll: [Vec<f64>; 2],
}

/// A sensor's movement in each mode, mass-normalised.
#[derive(Debug, Clone, PartialEq)]
pub struct Sensor {
    /// Its number.
    pub number: u16,
    /// Its name.
    pub name: String,
    /// Movement in its direction.
    pub row: Vec<f64>,
}

impl ModalModel {
    /// The modes of a structure with the fraction of stiffness that each damage group has lost (groups beyond the slice are
    /// whole). Modes that move neither the path nor any sensor (members of a truss that turn about their own axes, say)
    /// are left out; `wanted` counts them.
    ///
    /// # Errors
    /// If the damaged bridge can move without resistance.
    pub fn new(structure: &Structure, damage: &[f64], wanted: Wanted) -> Result<Self> {
        let modes = natural_modes(&structure.stiffness(damage), structure.mass())?;
        let damaged = damage.iter().any(|&loss| loss != 0.0);
        let rayleigh = if damaged && structure.bridge.damping.at_hz.is_none() {
            let whole = natural_modes(&structure.stiffness(&[]), structure.mass())?;
            structure.bridge.damping.rayleigh(&whole.omega_squared)
        } else {
            structure.bridge.damping.rayleigh(&modes.omega_squared)
        };
        let count = wanted.among(&modes.omega_squared);
        let reach: Vec<[f64; QUANTITIES]> = (0..count).map(|k| reach(structure, modes.shapes.column(k))).collect();
        let largest = (reach.iter()).fold([0.0; QUANTITIES], |most, of| {
            std::array::from_fn(|i| of[i].max(most[i]))
        });
        let kept: Vec<usize> = (0..count)
            .filter(|&k| reach[k].iter().zip(largest).any(|(of, most)| *of > UNMOVED * most))
            .collect();
        let along = |row: &Row| -> Vec<f64> { kept.iter().map(|&k| value(row, modes.shapes.column(k))).collect() };
        let pair = |rows: &[Row; 2]| [along(&rows[0]), along(&rows[1])];
        let omega_squared: Vec<f64> = kept.iter().map(|&k| modes.omega_squared[k]).collect();
        Ok(Self {
            name: structure.bridge.name.clone(),
            damping: omega_squared.iter().map(|w2| rayleigh[0] + rayleigh[1] * w2).collect(),
            omega_squared,
            path: (structure.path.iter())
                .map(|at| PathPoint {
                    x_m: at.x_m,
                    vertical: pair(&at.vertical),
                    lateral: pair(&at.lateral),
                    roll: pair(&at.roll),
                })
                .collect(),
            sensors: (structure.sensors.iter())
                .map(|sensor| Sensor {
                    number: sensor.number,
                    name: sensor.name.clone(),
                    row: along(&sensor.row),
                })
                .collect(),
        })
    }
}

/// The largest value of each quantity in a mode.
fn reach(structure: &Structure, shape: DVectorView<'_, f64>) -> [f64; QUANTITIES] {
    let mut reach = [0.0_f64; QUANTITIES];
    for point in &structure.path {
        for (most, row) in reach
            .iter_mut()
            .zip(point.vertical.iter().chain(&point.lateral).chain(&point.roll))
        {
            *most = most.max(value(row, shape).abs());
        }
    }
    let sensors = structure.sensors.iter().map(|sensor| value(&sensor.row, shape).abs());
    reach[QUANTITIES - 1] = sensors.fold(0.0, f64::max);
    reach
}

/// A row's value for a shape.
pub fn value(row: &Row, shape: DVectorView<'_, f64>) -> f64 {
    row.iter().map(|&(freedom, factor)| factor * shape[freedom]).sum()
}
