//! The cars that the program knows by name: the paper's 15-DOF car and its 2-DOF inspection car.
//!
//! The 15-DOF car is a body on two bogies on four wheelsets (paper's Fig. 1, Tables 1 to 3). Degrees of freedom, in this
//! order: `y z theta_x theta_y theta_z` of the body, then of the front and of the rear bogie; `x` forward, `y` to the left,
//! `z` up, right-handed. Left and right springs of a pair are equal, so each pair is two springs here: one for the
//! mean of their elongations and, where it is not the same, one for half the difference. With `+` for the front
//! and `-` for the rear of each `+-`, elongations are (Eqs 6 to 8 and 14 to 16)
//!
//! ```text
//! body - bogie       x   l_y4 (tz1 - tz2)                                          2 k1
//!                    y   y1 + l_z1 tx1 +- l_x1 tz1 - (y2 - l_z2 tx2)               2 k2, 2 c2
//!                    z   z1 -+ l_x1 ty1 - z2                                       2 k3, 2 c3
//!                        l_y3 (tx1 - tx2)                                          2 k3, 2 c3
//! bogie - wheelset   x   l_y2 tz2                                                  2 k21
//!                    y   y2 + l_z3 tx2 +- l_x2 tz2 - y3                            2 k22
//!                    z   z2 -+ l_x2 ty2 - z3                                       2 k23, 2 c23
//!                        l_y2 (tx2 - tx3)                                          2 k23, 2 c23
//! ```
//!
//! Wheelsets do not yaw. Their moment of inertia about the track is `m3 l_y1^2`, that of half the mass over each rail, as
//! Eqs 31 and 32 take it. Masses are the paper's weights divided by [`GRAVITY_MPS2`].

use heapless::Vec;

use super::{Car, Contact, GRAVITY_MPS2, Motion, Spring};
use crate::capacity::{CAR_DOFS, CONTACTS};
use crate::math::Real;

/// Degrees of freedom of a car in space.
pub const SPATIAL_DOFS: usize = 15;
/// Contacts of a car in space: three motions of four wheelsets.
pub const SPATIAL_CONTACTS: usize = 12;
/// Distance from a car's first wheelset to the next car's, both kinds (Table 3: twice `c`), m.
pub const PITCH_M: f64 = 25.0;
/// Degrees of freedom of the car in space that vertical, equal rails excite.
const VERTICAL: [usize; 6] = [1, 3, 6, 8, 11, 13];

/// The values of a bogie car, as in the paper's Tables 2 and 3.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BogieCar {
    /// Weight of the body, of a bogie and of a wheelset, N.
    pub weight_n: [f64; 3],
    /// Moments of inertia of the body about x, y and z, kg m².
    pub body_inertia_kgm2: [f64; 3],
    /// Moments of inertia of a bogie, kg m².
    pub bogie_inertia_kgm2: [f64; 3],
    /// Upper springs in x, y and z (k1, k2, k3), one side, N/m.
    pub upper_npm: [f64; 3],
    /// Upper dampers in x, y and z (none, c2, c3), one side, N s/m.
    pub upper_nspm: [f64; 3],
    /// Lower springs in x, y and z (k21, k22, k23), one side of a wheelset, N/m.
    pub lower_npm: [f64; 3],
    /// Lower dampers in x, y and z (none, none, c23), one side of a wheelset, N s/m.
    pub lower_nspm: [f64; 3],
    /// Half the distance of the bogies' centres (`l_x1`) and of a bogie's wheelsets (`l_x2`), m.
    pub half_base_m: [f64; 2],
    /// Half the distance of the rails, of the vertical lower and upper springs, of the longitudinal upper springs
    /// (`l_y1 .. l_y4`), m.
    pub half_width_m: [f64; 4],
    /// Height of the body's centroid over the lateral upper spring, of that over the bogie's, of the bogie's over the
    /// lateral lower spring (`l_z1 .. l_z3`), m.
    pub height_m: [f64; 3],
}

/// The paper's Tables 2 and 3.
pub const SHINKANSEN: BogieCar = BogieCar {
    weight_n: [321.6e3, 25.9e3, 8.8e3],
    body_inertia_kgm2: [49.2e3, 2512.6e3, 2512.6e3],
    bogie_inertia_kgm2: [2.9e3, 4.1e3, 4.1e3],
    upper_npm: [5000e3, 176.4e3, 443e3],
    upper_nspm: [0.0, 39.2e3, 21.6e3],
    lower_npm: [17_500e3, 4704e3, 1210e3],
    lower_nspm: [0.0, 0.0, 19.6e3],
    half_base_m: [8.75, 1.25],
    half_width_m: [0.70, 1.00, 1.23, 1.42],
    height_m: [0.50, 0.37, 0.10],
};

impl BogieCar {
    /// The car in space.
    pub fn spatial<T: Real>(&self) -> Car<T, SPATIAL_DOFS, SPATIAL_CONTACTS> {
        let [m1, m2, m3] = self.weight_n.map(|weight| weight / GRAVITY_MPS2);
        let [lx1, lx2] = self.half_base_m;
        let [ly1, ly2, ly3, ly4] = self.half_width_m;
        let [lz1, lz2, lz3] = self.height_m;
        let [w1, w2, w3] = self.weight_n;

        let body = self.body_inertia_kgm2;
        let bogie = self.bogie_inertia_kgm2;
        let inertia = [
            [m1, m1, body[0], body[1], body[2]],
            [m2, m2, bogie[0], bogie[1], bogie[2]],
        ];
        let pair = |stiffness: f64, damping: f64, lever: &[(usize, f64)]| Spring {
            stiffness: T::of(2.0 * stiffness),
            damping: T::of(2.0 * damping),
            lever: core::array::from_fn(|dof| {
                let arm = lever.iter().find(|&&(moved, _)| moved == dof);
                arm.map_or(T::zero(), |&(_, arm)| T::of(arm))
            }),
        };

        let mut springs = Vec::new();
        let mut contacts = Vec::new();
        for (first, front) in [(5, 1.0), (10, -1.0)] {
            let [y, z, tx, ty, tz] = [0, 1, 2, 3, 4].map(|d| first + d);
            let upper = [
                pair(self.upper_npm[0], self.upper_nspm[0], &[(4, ly4), (tz, -ly4)]),
                pair(
                    self.upper_npm[1],
                    self.upper_nspm[1],
                    &[(0, 1.0), (2, lz1), (4, front * lx1), (y, -1.0), (tx, lz2)],
                ),
                pair(
                    self.upper_npm[2],
                    self.upper_nspm[2],
                    &[(1, 1.0), (3, -front * lx1), (z, -1.0)],
                ),
                pair(self.upper_npm[2], self.upper_nspm[2], &[(2, ly3), (tx, -ly3)]),
                // Two wheelsets that do not yaw.
                pair(2.0 * self.lower_npm[0], 2.0 * self.lower_nspm[0], &[(tz, ly2)]),
            ];
            let _ = springs.extend_from_slice(&upper);
            for ahead in [1.0, -1.0] {
                let behind_m = T::of(lx1 + lx2 - front * lx1 - ahead * lx2);
                let [k, c] = [self.lower_npm, self.lower_nspm];
                let wheelset = [
                    (
                        Motion::Vertical,
                        w1 / 4.0 + w2 / 2.0 + w3,
                        m3,
                        pair(k[2], c[2], &[(z, 1.0), (ty, -ahead * lx2)]),
                    ),
                    (
                        Motion::Lateral,
                        0.0,
                        m3,
                        pair(k[1], c[1], &[(y, 1.0), (tx, lz3), (tz, ahead * lx2)]),
                    ),
                    (
                        Motion::Roll,
                        0.0,
                        m3 * ly1 * ly1,
                        pair(k[2] * ly2 * ly2, c[2] * ly2 * ly2, &[(tx, 1.0)]),
                    ),
                ];
                for (motion, load, unsprung, spring) in wheelset {
                    let _ = contacts.push(Contact {
                        behind_m,
                        motion,
                        load_n: T::of(load),
                        unsprung: T::of(unsprung),
                        spring,
                    });
                }
            }
        }
        Car {
            inertia: core::array::from_fn(|d| T::of(inertia[usize::from(d >= 5)][d % 5])),
            springs,
            contacts,
        }
    }

    /// The same car on straight, equal rails: bounce and pitch of its three bodies.
    pub fn vertical<T: Real>(&self) -> Car<T, CAR_DOFS, CONTACTS> {
        self.spatial().reduced(VERTICAL, &[Motion::Vertical])
    }
}

/// The paper's car in space: 15 degrees of freedom.
pub fn shinkansen<T: Real>() -> Car<T, SPATIAL_DOFS, SPATIAL_CONTACTS> {
    SHINKANSEN.spatial()
}

/// The paper's car on straight, equal rails: 6 degrees of freedom.
pub fn shinkansen_vertical<T: Real>() -> Car<T, CAR_DOFS, CONTACTS> {
    SHINKANSEN.vertical()
}

/// The two-degree-of-freedom inspection car of the paper's section 4.3: bounce and pitch of the body, on two contacts.
///
/// The paper gives no values for it. Declared: the body of its 3D car (Table 2) on the bogies' four upper springs;
/// each bogie with its two wheelsets rides unsprung.
pub fn inspection<T: Real, const D: usize, const C: usize>() -> Car<T, D, C> {
    let [body_n, bogie_n, wheelset_n] = SHINKANSEN.weight_n;
    let riding_n = bogie_n + 2.0 * wheelset_n;
    let half_base_m = SHINKANSEN.half_base_m[0];

    let mut inertia = [T::one(); D];
    for (own, value) in inertia
        .iter_mut()
        .zip([body_n / GRAVITY_MPS2, SHINKANSEN.body_inertia_kgm2[1]])
    {
        *own = T::of(value);
    }
    let contact = |ahead_m: f64| {
        let mut lever = [T::zero(); D];
        for (own, value) in lever.iter_mut().zip([1.0, -ahead_m]) {
            *own = T::of(value);
        }
        Contact {
            behind_m: T::of(half_base_m - ahead_m),
            motion: Motion::Vertical,
            load_n: T::of(body_n / 2.0 + riding_n),
            unsprung: T::of(riding_n / GRAVITY_MPS2),
            spring: Spring {
                stiffness: T::of(2.0 * SHINKANSEN.upper_npm[2]),
                damping: T::of(2.0 * SHINKANSEN.upper_nspm[2]),
                lever,
            },
        }
    };
    Car {
        inertia,
        springs: Vec::new(),
        contacts: [contact(half_base_m), contact(-half_base_m)]
            .into_iter()
            .take(C)
            .collect(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::train::PlanarTrain;
    use crate::wire::message::TrainKind;

    #[test]
    fn wheel_loads_sum_to_the_weight_of_the_car() {
        let weight = 321.6e3 + 2.0 * 25.9e3 + 4.0 * 8.8e3;
        assert!((shinkansen::<f64>().weight_n() - weight).abs() < 1e-6);
        assert!((shinkansen::<f64>().contacts[0].load_n - 102.15e3).abs() < 1e-9);
        assert!((inspection::<f64, 2, 2>().weight_n() - weight).abs() < 1e-6);
    }

    #[test]
    fn a_train_has_one_to_sixteen_cars() {
        assert!(PlanarTrain::<f32>::of_kind(TrainKind::Inspection2Dof, 0).is_none());
        assert!(PlanarTrain::<f32>::of_kind(TrainKind::Inspection2Dof, 17).is_none());
        let train = PlanarTrain::<f32>::of_kind(TrainKind::Inspection2Dof, 16).expect("sixteen");
        assert_eq!(train.length_m(), 15.0 * 25.0 + 17.5);
        let train = PlanarTrain::<f32>::of_kind(TrainKind::Shinkansen3d, 16).expect("sixteen");
        assert_eq!(train.length_m(), 15.0 * 25.0 + 20.0);
    }
}
