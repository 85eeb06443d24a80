//! One beam: Euler-Bernoulli bending in two planes, tension and torsion, with consistent mass.
//!
//! Local axes: `x` from the first end to the second, `z` in the plane of `x` and the direction `up`, on the side of `up`,
//! `y = z x x`. `I_y` resists bending in the local x-z plane (for a level beam with `up = +z`, vertical bending), `I_z` in
//! the local x-y plane. Displacements between the ends: linear along and about `x`, cubic (Hermite) across,
//!
//! ```text
//! K: E A / L [1 -1; -1 1],  G J / L [1 -1; -1 1]
//!    E I / L^3 [12 6L -12 6L; . 4L^2 -6L 2L^2; . . 12 -6L; . . . 4L^2]       for (v, dv/dx) at both ends
//! M: m L / 6 [2 1; 1 2],    rho (I_y + I_z) L / 6 [2 1; 1 2]
//!    m L / 420 [156 22L 54 -13L; . 4L^2 13L -3L^2; . . 156 -22L; . . . 4L^2]
//! ```
//!
//! (Przemieniecki, Theory of Matrix Structural Analysis, chapters 5 and 11, without shear deformation and without the
//! rotary inertia of bending). In the x-y plane `dv/dx = r_z`, in the x-z plane `dw/dx = -r_y`.
//!
//! A **released** end moment `r` is no moment: the rotation of the beam's end follows from the others, and both matrices
//! are condensed with that same dependence,
//!
//! ```text
//! T = [I; -K_rr^-1 K_rk],   K' = T^T K T,   M' = T^T M T
//! ```
//!
//! so the mass stays consistent with the deflected shape of a hinged beam. **Rigid zones** and **offsets**: the beam's end
//! lies at `p` from its node and follows it as a rigid body, `u = u_n + r_n x p`, `r = r_n`. A rigid zone along the axis
//! keeps the beam's mass, moving as a rigid body.

use anyhow::{Result, bail};
use nalgebra::{DMatrix, Matrix3, Matrix4, SMatrix, Vector3};

/// A beam whose axis and `up` form a smaller angle than this (its sine) has no sense of up.
const PARALLEL: f64 = 1e-6;

/// A matrix over the twelve degrees of freedom of a beam's ends: `u_x u_y u_z r_x r_y r_z` of the first, then the second.
pub type Matrix12 = SMatrix<f64, 12, 12>;

/// What a beam is made of, everywhere along it the same.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Section {
    /// Stiffness in tension, `E A`, N.
    pub axial_n: f64,
    /// Stiffness in torsion, `G J`, N m².
    pub torsion_nm2: f64,
    /// Stiffness in bending in the local x-z and x-y planes, `E I_y` and `E I_z`, N m².
    pub bending_nm2: [f64; 2],
    /// Mass, kg/m.
    pub mass_kgpm: f64,
    /// Moment of inertia about the axis, `rho (I_y + I_z)`, kg m.
    pub polar_inertia_kgm: f64,
}

/// A beam between two nodes.
#[derive(Debug, Clone, PartialEq)]
pub struct Beam {
    /// Its first and second node.
    pub nodes: [usize; 2],
    /// Its section.
    pub section: Section,
    /// The direction towards which local `z` points; none is +z, or +x for a vertical beam.
    pub up: Option<Vector3<f64>>,
    /// From each node to that end of the beam's axis, m.
    pub offset_m: [Vector3<f64>; 2],
    /// Length of the rigid zone at each end, along the axis, m.
    pub rigid_m: [f64; 2],
    /// Which moments each end does not transmit: about local x, y, z.
    pub released: [[bool; 3]; 2],
    /// The group in which it can be damaged: the whole stiffness of the beam, in tension, torsion and bending, is lost in
    /// equal parts.
    pub group: Option<usize>,
}

/// A beam's matrices in the degrees of freedom of its two nodes, global axes.
#[derive(Debug, Clone, PartialEq)]
pub struct BeamMatrices {
    /// Stiffness.
    pub stiffness: Matrix12,
    /// Consistent mass, that of the rigid zones included.
    pub mass: Matrix12,
    /// The part of the mass that is rotary inertia about the axis.
    pub rotary: Matrix12,
    /// All of its mass, kg.
    pub total_kg: f64,
}

impl Beam {
    /// A beam without offsets, rigid zones, releases or group.
    pub fn plain(nodes: [usize; 2], section: Section) -> Self {
        Self {
            nodes,
            section,
            up: None,
            offset_m: [Vector3::zeros(); 2],
            rigid_m: [0.0; 2],
            released: [[false; 3]; 2],
            group: None,
        }
    }

    /// The matrices of the beam between nodes at `places_m`.
    ///
    /// # Errors
    /// If it has no length left, `up` points along it, or it is released so far that it can spin.
    pub fn matrices(&self, places_m: [Vector3<f64>; 2]) -> Result<BeamMatrices> {
        let axis = places_m[1] + self.offset_m[1] - places_m[0] - self.offset_m[0];
        let whole = axis.norm();
        let length = whole - self.rigid_m[0] - self.rigid_m[1];
        if !(whole > 0.0 && length > 1e-9 * whole) {
            bail!(
                "has no length left between its ends ({length:.3} m): move its nodes apart or shorten its rigid zones"
            );
        }
        let along = axis / whole;
        let arms = [
            self.offset_m[0] + along * self.rigid_m[0],
            self.offset_m[1] - along * self.rigid_m[1],
        ];
        let local = local_axes(along, self.up)?;
        let shape = released_shape(&local_stiffness(&self.section, length), self.released)?;
        let turns_only = Section {
            mass_kgpm: 0.0,
            ..self.section
        };
        let to_local = shape * turned(&local) * arms_to_ends(arms);
        let global = |matrix: Matrix12| {
            let matrix = to_local.transpose() * matrix * to_local;
            (matrix + matrix.transpose()) * 0.5
        };
        let mut mass = global(local_mass(&self.section, length));
        for (end, (rigid, offset)) in self.rigid_m.iter().zip(&self.offset_m).enumerate() {
            let block = rod(*offset, arms[end], self.section.mass_kgpm * rigid);
            let mut part = mass.fixed_view_mut::<6, 6>(6 * end, 6 * end);
            part += block;
        }
        Ok(BeamMatrices {
            stiffness: global(local_stiffness(&self.section, length)),
            mass,
            rotary: global(local_mass(&turns_only, length)),
            total_kg: self.section.mass_kgpm * whole,
        })
    }
}

/// The local axes as rows.
fn local_axes(along: Vector3<f64>, up: Option<Vector3<f64>>) -> Result<Matrix3<f64>> {
    let vertical = along.x.hypot(along.y) < PARALLEL;
    let up = up.unwrap_or(if vertical { Vector3::x() } else { Vector3::z() });
    let across = up.cross(&along);
    let sine = across.norm() / up.norm();
    if sine.is_nan() || sine < PARALLEL {
        bail!(
            "points along its own up = {:?}: give it an up across its axis",
            up.as_slice()
        );
    }
    let y = across.normalize();
    let z = along.cross(&y);
    Ok(Matrix3::from_rows(&[along.transpose(), y.transpose(), z.transpose()]))
}

/// The degrees of freedom of bending: deflection and slope at both ends, the sign of each slope as a rotation.
struct Plane {
    freedoms: [usize; 4],
    slope: f64,
}

const BENDING_XZ: Plane = Plane {
    freedoms: [2, 4, 8, 10],
    slope: -1.0,
};
const BENDING_XY: Plane = Plane {
    freedoms: [1, 5, 7, 11],
    slope: 1.0,
};

impl Plane {
    fn add(&self, block: &Matrix4<f64>, to: &mut Matrix12) {
        let sign = |i: usize| if i % 2 == 1 { self.slope } else { 1.0 };
        for (i, &row) in self.freedoms.iter().enumerate() {
            for (j, &column) in self.freedoms.iter().enumerate() {
                to[(row, column)] += sign(i) * sign(j) * block[(i, j)];
            }
        }
    }
}

#[rustfmt::skip]
fn bending_stiffness(l: f64) -> Matrix4<f64> {
    Matrix4::new(
        12.0,     6.0 * l,     -12.0,    6.0 * l,
        6.0 * l,  4.0 * l * l, -6.0 * l, 2.0 * l * l,
        -12.0,    -6.0 * l,    12.0,     -6.0 * l,
        6.0 * l,  2.0 * l * l, -6.0 * l, 4.0 * l * l,
    ) / (l * l * l)
}

#[rustfmt::skip]
fn bending_mass(l: f64) -> Matrix4<f64> {
    Matrix4::new(
        156.0,     22.0 * l,     54.0,      -13.0 * l,
        22.0 * l,  4.0 * l * l,  13.0 * l,  -3.0 * l * l,
        54.0,      13.0 * l,     156.0,     -22.0 * l,
        -13.0 * l, -3.0 * l * l, -22.0 * l, 4.0 * l * l,
    ) * (l / 420.0)
}

fn local_stiffness(section: &Section, l: f64) -> Matrix12 {
    let mut k = Matrix12::zeros();
    for (freedom, stiffness) in [(0, section.axial_n / l), (3, section.torsion_nm2 / l)] {
        k[(freedom, freedom)] = stiffness;
        k[(freedom + 6, freedom + 6)] = stiffness;
        k[(freedom, freedom + 6)] = -stiffness;
        k[(freedom + 6, freedom)] = -stiffness;
    }
    let bending = bending_stiffness(l);
    BENDING_XZ.add(&(bending * section.bending_nm2[0]), &mut k);
    BENDING_XY.add(&(bending * section.bending_nm2[1]), &mut k);
    k
}

fn local_mass(section: &Section, l: f64) -> Matrix12 {
    let mut m = Matrix12::zeros();
    for (freedom, mass) in [(0, section.mass_kgpm * l), (3, section.polar_inertia_kgm * l)] {
        m[(freedom, freedom)] = mass / 3.0;
        m[(freedom + 6, freedom + 6)] = mass / 3.0;
        m[(freedom, freedom + 6)] = mass / 6.0;
        m[(freedom + 6, freedom)] = mass / 6.0;
    }
    let bending = bending_mass(l) * section.mass_kgpm;
    BENDING_XZ.add(&bending, &mut m);
    BENDING_XY.add(&bending, &mut m);
    m
}

/// The matrix `T` by which released rotations follow the rest.
fn released_shape(k: &Matrix12, released: [[bool; 3]; 2]) -> Result<Matrix12> {
    let (gone, kept): (Vec<usize>, Vec<usize>) =
        (0..12).partition(|&freedom| freedom % 6 >= 3 && released[freedom / 6][freedom % 6 - 3]);
    if gone.is_empty() {
        return Ok(Matrix12::identity());
    }
    if released[0][0] && released[1][0] {
        bail!("is released about its own axis at both ends, so it can spin: release one end only");
    }
    let pick = |columns: &[usize]| DMatrix::from_fn(gone.len(), columns.len(), |i, j| k[(gone[i], columns[j])]);
    let Some(dependence) = pick(&gone).lu().solve(&pick(&kept)) else {
        bail!("has no stiffness where it is released: give its section one, or take back the release");
    };
    let mut shape = Matrix12::zeros();
    for &freedom in &kept {
        shape[(freedom, freedom)] = 1.0;
    }
    for (i, &row) in gone.iter().enumerate() {
        for (j, &column) in kept.iter().enumerate() {
            shape[(row, column)] = -dependence[(i, j)];
        }
    }
    Ok(shape)
}

/// From global to local axes, for all four triples.
fn turned(local: &Matrix3<f64>) -> Matrix12 {
    let mut all = Matrix12::zeros();
    for triple in 0..4 {
        all.fixed_view_mut::<3, 3>(3 * triple, 3 * triple).copy_from(local);
    }
    all
}

/// From the nodes' degrees of freedom to those of the beam's ends at `arms` from them.
fn arms_to_ends(arms: [Vector3<f64>; 2]) -> Matrix12 {
    let mut all = Matrix12::identity();
    for (end, arm) in arms.iter().enumerate() {
        all.fixed_view_mut::<3, 3>(6 * end, 6 * end + 3)
            .copy_from(&carried(*arm));
    }
    all
}

/// The matrix `C` of `r x p = C r`: how a rotation `r` of a node moves a point at `p` from it.
pub fn carried(p: Vector3<f64>) -> Matrix3<f64> {
    -p.cross_matrix()
}

/// Mass matrix, in a node's degrees of freedom, of a thin rigid rod of `mass_kg` between two points given from the node.
fn rod(from: Vector3<f64>, to: Vector3<f64>, mass_kg: f64) -> SMatrix<f64, 6, 6> {
    let mut all = SMatrix::zeros();
    // The integrand is quadratic along the rod: two Gauss points are exact.
    for place in [0.5 - 0.5 / 3.0_f64.sqrt(), 0.5 + 0.5 / 3.0_f64.sqrt()] {
        let mut motion = SMatrix::<f64, 3, 6>::zeros();
        motion.fixed_view_mut::<3, 3>(0, 0).fill_with_identity();
        motion
            .fixed_view_mut::<3, 3>(0, 3)
            .copy_from(&carried(from + (to - from) * place));
        all += motion.transpose() * motion * (0.5 * mass_kg);
    }
    all
}
