//! Simply supported beams, cars on one wheel, and what they do to each other.

use std::f64::consts::PI;

use anyhow::{Context, Result};
use spanwatch::train::stock::{SPATIAL_CONTACTS, SPATIAL_DOFS};
use spanwatch::train::{Car, Contact, Motion, Spring, Train};

use crate::crossing::Crossing;
use crate::model::eigen::Wanted;
use crate::model::modal::ModalModel;
use crate::model::{BridgeFile, BridgeFrame, Structure};
use crate::train::SpatialTrain;

/// A car in space.
pub type SpatialCar = Car<f64, SPATIAL_DOFS, SPATIAL_CONTACTS>;

/// Degree of freedom of a car's body in which it bounces.
pub const BOUNCE: usize = 1;

/// A uniform, simply supported beam.
#[derive(Debug, Clone, Copy)]
pub struct Beam {
    /// Length, m.
    pub length_m: f64,
    /// E I, N m².
    pub bending_stiffness_nm2: f64,
    /// Mass, kg/m.
    pub mass_kgpm: f64,
    /// Damping ratio of the first two modes.
    pub damping_ratio: f64,
}

/// The girder of the paper's examples, as this project declares it (`bridges/girder50.toml`).
pub const GIRDER50: Beam = Beam {
    length_m: 50.0,
    bending_stiffness_nm2: 1.55148e11,
    mass_kgpm: 5000.0,
    damping_ratio: 0.02,
};

impl Beam {
    /// The bridge file of the beam in `elements` finite elements, `basis_modes` modes in the basis of a logger's model.
    pub fn file(&self, elements: usize, basis_modes: usize) -> BridgeFile {
        BridgeFile {
            name: "beam".into(),
            length_m: self.length_m,
            elements,
            mass_per_length_kgpm: self.mass_kgpm,
            bending_stiffness_nm2: self.bending_stiffness_nm2,
            supports: vec![1, elements + 1],
            damping_ratio: self.damping_ratio,
            basis_modes,
        }
    }

    /// The lowest `modes` modes of the beam in `elements` finite elements, some of which have lost a part of their stiffness.
    ///
    /// # Errors
    /// If the beam cannot stand: a length, stiffness or mass that is not positive.
    pub fn damaged(&self, elements: usize, modes: usize, damage: &[f64]) -> Result<ModalModel> {
        let frame = BridgeFrame::from(&self.file(elements, 1));
        ModalModel::new(&Structure::new(frame)?, damage, Wanted::Count(modes))
    }

    /// The same of the whole beam.
    ///
    /// # Errors
    /// If the beam cannot stand: a length, stiffness or mass that is not positive.
    pub fn modes(&self, elements: usize, modes: usize) -> Result<ModalModel> {
        self.damaged(elements, modes, &[])
    }

    /// Circular frequency of mode `k` (from 1) by the closed form, rad/s.
    pub fn omega(&self, k: usize) -> f64 {
        (k as f64 * PI / self.length_m).powi(2) * (self.bending_stiffness_nm2 / self.mass_kgpm).sqrt()
    }

    /// Damping `2 xi omega` of mode `k` (from 1) by the closed form, 1/s: Rayleigh's, by the ratio at the first two modes.
    pub fn damping(&self, k: usize) -> f64 {
        let [w1, w2] = [self.omega(1), self.omega(2)];
        2.0 * self.damping_ratio * (w1 * w2 + self.omega(k).powi(2)) / (w1 + w2)
    }

    /// Mass-normalised shape of mode `k` (from 1) by the closed form, kg^-1/2.
    pub fn shape(&self, k: usize, x_m: f64) -> f64 {
        (2.0 / (self.mass_kgpm * self.length_m)).sqrt() * (k as f64 * PI * x_m / self.length_m).sin()
    }
}

/// A body of `body_kg` on a spring and damper above one wheel without mass.
pub fn one_wheel(load_n: f64, body_kg: f64, stiffness_npm: f64, damping_nspm: f64) -> SpatialCar {
    let mut lever = [0.0; SPATIAL_DOFS];
    lever[BOUNCE] = 1.0;
    let mut inertia = [1.0; SPATIAL_DOFS];
    inertia[BOUNCE] = body_kg;
    let wheel = Contact {
        behind_m: 0.0,
        motion: Motion::Vertical,
        load_n,
        unsprung: 0.0,
        spring: Spring {
            stiffness: stiffness_npm,
            damping: damping_nspm,
            lever,
        },
    };
    Car {
        inertia,
        springs: heapless::Vec::new(),
        contacts: [wheel].into_iter().collect(),
    }
}

/// A force that moves.
pub fn force(load_n: f64) -> SpatialCar {
    one_wheel(load_n, 1.0, 0.0, 0.0)
}

/// A train of one car.
///
/// # Errors
/// If a train has no room for one.
pub fn alone(car: SpatialCar) -> Result<SpatialTrain> {
    Train::uniform(car, 1, 0.0).context("one car")
}

/// Displacement and acceleration of one sensor, and how the first car's body bounces: a value a step, the first after one step.
#[derive(Debug, Clone, Default)]
pub struct History {
    /// Displacement, m.
    pub displacement_m: Vec<f64>,
    /// Acceleration, m/s².
    pub acceleration_mps2: Vec<f64>,
    /// Bounce of the first car's body while it is on the bridge, m.
    pub bounce_m: Vec<f64>,
}

impl Crossing<'_> {
    /// What sensor `number` and the first car do in `duration_s`.
    ///
    /// # Errors
    /// If the crossing cannot be solved, or there is no such sensor.
    pub fn history(&self, number: u16, duration_s: f64) -> Result<History> {
        let sensor = self.model.sensors.iter().find(|sensor| sensor.number == number);
        let row = &sensor.with_context(|| format!("no sensor {number}"))?.row;
        let at_sensor = |modal: &[f64]| row.iter().zip(modal).map(|(row, q)| row * q).sum();
        let mut history = History::default();
        self.solve((duration_s / self.step_s).round() as usize, &mut |state| {
            history.displacement_m.push(at_sensor(state.position));
            history.acceleration_mps2.push(at_sensor(state.acceleration));
            history
                .bounce_m
                .extend((state.car)(0).map(|car| car.position()[BOUNCE]));
        })?;
        Ok(history)
    }
}
