//! Trains: rows of cars, each a few rigid bodies on springs and dampers above its wheelsets.
//!
//! A car's equations, about static equilibrium, are those of its springs. Spring `s` is stretched by
//! `e_s = s . y` (inside the car) or `e_i = s_i . y - u_i` (above contact `i`), `y` the car's degrees of freedom and `u_i`
//! one of the [motions](Motion) in which the rails lead the wheelset:
//!
//! ```text
//! m_d y_d'' + sum_s s_d (k_s e_s + c_s e_s') = 0                              (paper's Eqs 1 to 16, 30)
//! F_i = -W_i - m_i u_i'' + k_i e_i + c_i e_i'      force (moment) on the rails   (Eqs 17 to 19, 31, 32)
//! ```
//!
//! `W_i` is the static load and `m_i` the mass (moment of inertia) that rides unsprung on the rails. `F_i` works on `u_i`, so
//! the coupled matrices are symmetric and no energy is made. The paper's Eq. 32 puts each side's spring force on
//! that side's rail, which keeps the sum of the two but not the moment that the springs, farther apart than the rails,
//! exert on the wheelset (Eq. 19); here the moment is kept. On equal rails the two are the same.
//!
//! [`stock`] has the cars that the program knows by name; the 2-DOF car and the 15-DOF car differ in their springs only.

pub mod stock;

use heapless::Vec;

use crate::capacity::{CAR_DOFS, CAR_KINDS, CAR_SPRINGS, CARS, CONTACTS};
use crate::math::Real;
use crate::wire::message::TrainKind;

pub use crate::track::Motion;

/// Standard gravity, m/s² (ISO 80000-3).
pub const GRAVITY_MPS2: f64 = 9.80665;

/// A spring with a damper inside a car.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Spring<T: Real, const D: usize> {
    /// Stiffness, N/m (N m/rad).
    pub stiffness: T,
    /// Damping, N s/m (N m s/rad).
    pub damping: T,
    /// How far a unit of each degree of freedom stretches it.
    pub lever: [T; D],
}

/// One motion of one wheelset: what rides on the rails there, and the spring above.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Contact<T: Real, const D: usize> {
    /// Distance behind the car's first wheelset, m.
    pub behind_m: T,
    /// The motion.
    pub motion: Motion,
    /// Static load, N; zero but in [`Motion::Vertical`].
    pub load_n: T,
    /// Mass (kg; in [`Motion::Roll`] moment of inertia, kg m²) that rides on the rails.
    pub unsprung: T,
    /// The spring above; its lever is that of its upper end.
    pub spring: Spring<T, D>,
}

/// A car of `D` degrees of freedom and at most `C` contacts.
#[derive(Debug, Clone, PartialEq)]
pub struct Car<T: Real, const D: usize, const C: usize> {
    /// Mass (kg) or moment of inertia (kg m²) of each degree of freedom; 1 where there is none.
    pub inertia: [T; D],
    /// Springs inside the car.
    pub springs: Vec<Spring<T, D>, CAR_SPRINGS>,
    /// Contacts, front first.
    pub contacts: Vec<Contact<T, D>, C>,
}

/// Where a car is in its train.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Place<T: Real> {
    /// Index of the kind of car.
    pub kind: usize,
    /// Distance of its first wheelset behind the train's first, m.
    pub behind_m: T,
}

/// A train: the kinds of car in it, at most `K`, and the cars, front first.
#[derive(Debug, Clone, PartialEq)]
pub struct Train<T: Real, const D: usize, const C: usize, const K: usize> {
    /// Kinds of car.
    pub kinds: Vec<Car<T, D, C>, K>,
    /// The cars.
    pub cars: Vec<Place<T>, CARS>,
}

/// A train of the kind that a logger has memory for: vertical motion, a kind or two of car.
pub type PlanarTrain<T> = Train<T, CAR_DOFS, CONTACTS, CAR_KINDS>;

impl<T: Real, const D: usize, const C: usize, const K: usize> Train<T, D, C, K> {
    /// `cars` equal cars, their first wheelsets `pitch_m` apart; none if the number is not 1 to [`CARS`].
    pub fn uniform(car: Car<T, D, C>, cars: usize, pitch_m: T) -> Option<Self> {
        let mut train = Self {
            kinds: Vec::new(),
            cars: Vec::new(),
        };
        train.kinds.push(car).ok()?;
        for i in 0..cars {
            let behind_m = pitch_m * T::of(i as f64);
            train.cars.push(Place { kind: 0, behind_m }).ok()?;
        }
        (cars > 0).then_some(train)
    }

    /// Distance from the first wheelset of the train to its last, m.
    pub fn length_m(&self) -> T {
        self.cars.iter().fold(T::zero(), |longest, place| {
            let car = self.kinds.get(place.kind).map_or(T::zero(), Car::length_m);
            longest.max(place.behind_m + car)
        })
    }
}

impl<T: Real> PlanarTrain<T> {
    /// The train of `cars` cars of a kind that the logger knows; none if the number is not 1 to [`CARS`].
    pub fn of_kind(kind: TrainKind, cars: usize) -> Option<Self> {
        let car = match kind {
            TrainKind::Inspection2Dof => stock::inspection(),
            TrainKind::Shinkansen3d => stock::shinkansen_vertical(),
        };
        Self::uniform(car, cars, T::of(stock::PITCH_M))
    }
}

impl<T: Real, const D: usize, const C: usize> Car<T, D, C> {
    /// Distance from the first wheelset to the last, m.
    pub fn length_m(&self) -> T {
        self.contacts
            .iter()
            .fold(T::zero(), |longest, contact| longest.max(contact.behind_m))
    }

    /// Sum of the static loads, N.
    pub fn weight_n(&self) -> T {
        self.contacts
            .iter()
            .fold(T::zero(), |sum, contact| sum + contact.load_n)
    }

    /// Every spring of the car, those above the wheelsets with these held.
    pub fn all_springs(&self) -> impl Iterator<Item = &Spring<T, D>> {
        (self.springs.iter()).chain(self.contacts.iter().map(|contact| &contact.spring))
    }

    /// The same car in other degrees of freedom: `D2` of its own, chosen by their numbers, and the contacts of `motions`.
    /// What is left must not be sprung against what is left out.
    pub fn reduced<const D2: usize, const C2: usize>(&self, dofs: [usize; D2], motions: &[Motion]) -> Car<T, D2, C2> {
        let at = |values: &[T; D]| dofs.map(|d| values.get(d).copied().unwrap_or(T::zero()));
        let spring = |spring: &Spring<T, D>| Spring {
            stiffness: spring.stiffness,
            damping: spring.damping,
            lever: at(&spring.lever),
        };
        let contact = |contact: &Contact<T, D>| Contact {
            behind_m: contact.behind_m,
            motion: contact.motion,
            load_n: contact.load_n,
            unsprung: contact.unsprung,
            spring: spring(&contact.spring),
        };
        Car {
            inertia: at(&self.inertia),
            springs: (self.springs.iter().map(spring))
                .filter(|spring| spring.lever.iter().any(|&lever| lever != T::zero()))
                .take(CAR_SPRINGS)
                .collect(),
            contacts: (self.contacts.iter())
                .filter(|contact| motions.contains(&contact.motion))
                .map(contact)
                .take(C2)
                .collect(),
        }
    }
}
