//! Trains: rows of cars, each a rigid body on springs and dampers above its contact points.
//!
//! A car's equations, about static equilibrium, with the spring of contact `i` stretched by `e_i = s_i . y - u_i`
//! (`y`: the car's degrees of freedom, `u_i`: the rail under the contact, all positive up):
//!
//! ```text
//! m_d y_d'' + sum_i s_id (k_i e_i + c_i e_i') = 0                               (paper's Eqs 1 to 8, 30)
//! F_i = -W_i - m_i u_i'' + k_i e_i + c_i e_i'      force on the bridge, up      (paper's Eq. 32)
//! ```
//!
//! `W_i` is the static load and `m_i` the mass that rides unsprung on the rail.

pub mod track;

use crate::capacity::{CAR_DOFS, CARS, CONTACTS};
use crate::math::Real;
use crate::wire::message::TrainKind;

/// Standard gravity, m/s² (ISO 80000-3).
pub const GRAVITY_MPS2: f64 = 9.80665;

/// One contact point of a car.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Contact<T: Real> {
    /// Distance behind the car's first contact, m.
    pub behind_m: T,
    /// Static load, N.
    pub load_n: T,
    /// Mass that rides on the rail, kg.
    pub unsprung_kg: T,
    /// Stiffness of the spring above, N/m.
    pub stiffness_npm: T,
    /// Damping of the damper above, N s/m.
    pub damping_nspm: T,
    /// How far the spring's upper end rises for a unit of each degree of freedom (1, m).
    pub lever: [T; CAR_DOFS],
}

/// A car: masses and contacts.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Car<T: Real> {
    /// Mass (kg) or moment of inertia (kg m²) of each degree of freedom.
    pub inertia: [T; CAR_DOFS],
    /// Contacts, front first.
    pub contacts: [Contact<T>; CONTACTS],
}

/// Cars of one kind at equal distances.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Train<T: Real> {
    /// The kind of car.
    pub car: Car<T>,
    /// How many, 1 to [`CARS`].
    pub cars: usize,
    /// Distance from the first contact of one car to that of the next, m.
    pub pitch_m: T,
}

impl<T: Real> Train<T> {
    /// The train of `cars` cars of a kind that the logger knows; none if the number is not 1 to [`CARS`].
    pub fn of_kind(kind: TrainKind, cars: usize) -> Option<Self> {
        if !(1..=CARS).contains(&cars) {
            return None;
        }
        Some(match kind {
            TrainKind::Inspection2Dof => Self {
                car: inspection_car(),
                cars,
                pitch_m: T::of(25.0),
            },
        })
    }

    /// Distance from the first contact of the train to its last, m.
    pub fn length_m(&self) -> T {
        self.pitch_m * T::of(self.cars as f64 - 1.0) + self.car.length_m()
    }
}

impl<T: Real> Car<T> {
    /// Distance from the first contact to the last, m.
    pub fn length_m(&self) -> T {
        self.contacts
            .iter()
            .fold(T::zero(), |longest, contact| longest.max(contact.behind_m))
    }
}

/// The two-degree-of-freedom inspection car of the paper's section 4.3: bounce and pitch of the body, on two contacts.
///
/// The paper gives no values for it. Declared: the body of its 3D car (Table 2) on the bogies' four upper springs;
/// each bogie with its two wheelsets rides unsprung.
fn inspection_car<T: Real>() -> Car<T> {
    const BODY_N: f64 = 321.6e3;
    const BOGIE_N: f64 = 25.9e3;
    const WHEELSET_N: f64 = 8.8e3;
    const BODY_PITCH_INERTIA_KGM2: f64 = 2512.6e3;
    const HALF_BOGIE_DISTANCE_M: f64 = 8.75;
    const UPPER_SPRING_NPM: f64 = 443e3;
    const UPPER_DAMPER_NSPM: f64 = 21.6e3;
    const RIDING_N: f64 = BOGIE_N + 2.0 * WHEELSET_N;

    let contact = |ahead_m: f64| Contact {
        behind_m: T::of(HALF_BOGIE_DISTANCE_M - ahead_m),
        load_n: T::of(BODY_N / 2.0 + RIDING_N),
        unsprung_kg: T::of(RIDING_N / GRAVITY_MPS2),
        stiffness_npm: T::of(2.0 * UPPER_SPRING_NPM),
        damping_nspm: T::of(2.0 * UPPER_DAMPER_NSPM),
        lever: [T::one(), T::of(ahead_m)],
    };
    Car {
        inertia: [T::of(BODY_N / GRAVITY_MPS2), T::of(BODY_PITCH_INERTIA_KGM2)],
        contacts: [contact(HALF_BOGIE_DISTANCE_M), contact(-HALF_BOGIE_DISTANCE_M)],
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_inspection_car_has_its_declared_frequencies_and_weight() {
        let train = Train::<f64>::of_kind(TrainKind::Inspection2Dof, 1).expect("one car");
        let expected_hz = [1.1699, 1.1695];
        for (dof, expected) in expected_hz.iter().enumerate() {
            let stiffness: f64 = train
                .car
                .contacts
                .iter()
                .map(|c| c.stiffness_npm * c.lever[dof] * c.lever[dof])
                .sum();
            let hz = libm::sqrt(stiffness / train.car.inertia[dof]) / core::f64::consts::TAU;
            assert!((hz - expected).abs() < 5e-5, "{hz}");
        }
        let load: f64 = train.car.contacts.iter().map(|c| c.load_n).sum();
        assert!((load - (321.6e3 + 2.0 * 25.9e3 + 4.0 * 8.8e3)).abs() < 1e-6);
    }

    #[test]
    fn a_train_has_one_to_sixteen_cars() {
        assert!(Train::<f32>::of_kind(TrainKind::Inspection2Dof, 0).is_none());
        assert!(Train::<f32>::of_kind(TrainKind::Inspection2Dof, 17).is_none());
        let train = Train::<f32>::of_kind(TrainKind::Inspection2Dof, 16).expect("sixteen");
        assert_eq!(train.length_m(), 15.0 * 25.0 + 17.5);
    }
}
