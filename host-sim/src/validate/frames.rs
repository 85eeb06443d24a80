//! Finite elements: natural frequencies from books, statics that every stiffness matrix owes to mechanics, and the cars' own
//! frequencies.

use std::f64::consts::{PI, TAU};

use anyhow::Result;
use nalgebra::{DMatrix, DVector};
use spanwatch::train::stock;

use super::beam::SpatialCar;
use super::specimen::{
    FIXED, FREE, PINNED, SECTION, bending, displacement, line, modes, odd_beams, odd_frame, portal, portal_sway,
    rigid_motions,
};
use super::{Row, Topic};
use crate::model::eigen::{frequency_hz, natural_modes};
use crate::model::frame::{LumpedMass, Section};
use crate::model::{self, Structure};

/// The topic.
pub const TOPIC: Topic = Topic {
    title: "Elements, frames and cars",
    about: "Beams of 10 m in sixteen elements, rods in twenty, a portal of 5 m by 8 m, beams in odd directions with hinges, \
            offsets and stiff ends, the girder, the cars with their wheelsets held.",
    rows,
};

/// Length of beams and rods, m.
const L: f64 = 10.0;
const ROUNDING: f64 = 1e-8;
const ROUNDED: &str = "rounding";

fn rows() -> Result<Vec<Row>> {
    let mut rows = beams()?;
    rows.extend(rods_and_masses()?);
    rows.extend(girder()?);
    rows.extend(statics()?);
    rows.extend(cars()?);
    Ok(rows)
}

/// Frequency of a beam with the root `beta L` of its frequency equation, Hz.
fn exact_hz(beta_l: f64) -> f64 {
    (beta_l / L).powi(2) * (SECTION.bending_nm2[0] / SECTION.mass_kgpm).sqrt() / TAU
}

fn beams() -> Result<Vec<Row>> {
    const SOURCE: &str = "Blevins, table 8-1";
    let mut rows = Vec::new();
    for (name, ends, roots) in [
        ("cantilever", [FIXED, FREE], [1.875_104_07, 4.694_091_13, 7.854_757_44]),
        ("simply supported", [PINNED, PINNED], [PI, 2.0 * PI, 3.0 * PI]),
        ("clamped", [FIXED, FIXED], [4.730_040_74, 7.853_204_62, 10.995_607_9]),
        ("propped", [FIXED, PINNED], [3.926_602_31, 7.068_582_75, 10.210_176_1]),
    ] {
        let found = modes(&bending(L, 16, ends))?.omega_squared;
        for k in [0, 2] {
            rows.push(
                Row::new(format!("{name} beam, mode {}", k + 1), SOURCE)
                    .numbers(exact_hz(roots[k]), frequency_hz(found[k]))
                    .shown("Hz", 4)
                    .within(3e-4, "sixteen elements: fourth power of their length"),
            );
        }
    }
    let error = |elements| -> Result<f64> {
        let found = modes(&bending(L, elements, [PINNED, PINNED]))?.omega_squared[2];
        Ok(frequency_hz(found) / exact_hz(3.0 * PI) - 1.0)
    };
    rows.push(
        Row::new("order in the element's length, from 8 to 16", "theory of the element")
            .numbers(4.0, (error(8)? / error(16)?).log2())
            .shown("", 2)
            .within(0.05, "the next term of the error"),
    );
    Ok(rows)
}

fn rods_and_masses() -> Result<Vec<Row>> {
    let only = |direction: usize| -> Result<f64> {
        let held = std::array::from_fn(|d| d != direction);
        let mut frame = line([0.0; 3], [L, 0.0, 0.0], 20, [FIXED, held]);
        for node in &mut frame.nodes[1..] {
            node.held = held;
        }
        Ok(frequency_hz(modes(&frame)?.omega_squared[0]))
    };
    const LINEAR: &str = "linear elements: (pi h / 2 L)² / 24 is 2.6e-4";
    let quarter = |stiffness: f64, mass: f64| (stiffness / mass).sqrt() / (4.0 * L);

    let mut loaded = bending(L, 6, [FIXED, FREE]);
    let tip_kg = 100.0 * SECTION.mass_kgpm * L;
    let lump = |node, mass_kg| LumpedMass {
        node,
        mass_kg,
        inertia_kgm2: [0.0; 3],
    };
    loaded.masses.push(lump(6, tip_kg));
    let tip_npm = 3.0 * SECTION.bending_nm2[0] / L.powi(3);
    let tip_hz = (tip_npm / (tip_kg + 33.0 / 140.0 * SECTION.mass_kgpm * L)).sqrt() / TAU;

    let light = Section {
        axial_n: 1e14,
        mass_kgpm: 0.0,
        polar_inertia_kgm: 0.0,
        ..SECTION
    };
    let (h, b) = (5.0, 8.0);
    let mut swaying = portal(h, b, light);
    for node in &mut swaying.nodes[1..3] {
        node.held = [false, true, false, true, false, true];
    }
    swaying.masses = vec![lump(1, 5000.0), lump(2, 5000.0)];
    let sway_hz = (portal_sway(h, b, light) * 10_000.0).sqrt().recip() / TAU;
    Ok(vec![
        Row::new("rod in tension", "c / 4 L")
            .numbers(quarter(SECTION.axial_n, SECTION.mass_kgpm), only(0)?)
            .shown("Hz", 4)
            .within(3e-4, LINEAR),
        Row::new("rod in torsion", "c / 4 L")
            .numbers(quarter(SECTION.torsion_nm2, SECTION.polar_inertia_kgm), only(3)?)
            .shown("Hz", 4)
            .within(3e-4, LINEAR),
        Row::new(
            "cantilever with a mass of 100 of its own at its tip",
            "Rayleigh: 33/140 of the rod",
        )
        .numbers(tip_hz, frequency_hz(modes(&loaded)?.omega_squared[0]))
        .shown("Hz", 6)
        .within(1e-5, "the static shape of the rod"),
        Row::new("sway of a portal with its mass on the beam", "Kleinlogel, frame 41")
            .numbers(sway_hz, frequency_hz(modes(&swaying)?.omega_squared[0]))
            .shown("Hz", 6)
            .within(1e-6, "beams that hardly stretch"),
    ])
}

fn girder() -> Result<Vec<Row>> {
    let structure = Structure::new(model::shipped("girder50")?)?;
    let hz = |damage: &[f64]| -> Result<Vec<f64>> {
        let found = natural_modes(&structure.stiffness(damage), structure.mass())?;
        Ok(found.omega_squared.into_iter().map(frequency_hz).collect())
    };
    let whole = hz(&[])?;
    let exact = |k: f64| (k * PI / 50.0).powi(2) * (1.55148e11_f64 / 5000.0).sqrt() / TAU;
    let mut rows: Vec<Row> = [1, 3, 5]
        .into_iter()
        .map(|k| {
            Row::new(format!("girder50, mode {k}"), "(k pi / L)² sqrt(E I / m)")
                .numbers(exact(k as f64), whole[k - 1])
                .shown("Hz", 5)
                .within(5e-3, "ten elements: 0.4 % in the fifth mode")
        })
        .collect();
    rows.push(
        Row::new("girder50, element 5 with 30 % less", "the paper's section 4.3")
            .numbers(3.37, hz(&[0.0, 0.0, 0.0, 0.0, 0.3])?[0])
            .shown("Hz", 3)
            .within(3e-3, "three printed digits, of a bridge whose values it does not print"),
    );
    Ok(rows)
}

fn statics() -> Result<Vec<Row>> {
    let frame = odd_frame();
    let mut rows = Vec::new();
    for (what, a, b) in [
        ("z of node 1 and x of the arm", (1, 2), (4, 0)),
        ("ry of the arm and y of node 2", (4, 4), (2, 1)),
        ("rx of node 3 and y of the arm", (3, 3), (4, 1)),
    ] {
        let nano = |load: (usize, usize), at| {
            Ok::<f64, anyhow::Error>(1e9 * displacement(&frame, &[(load.0, load.1, 1.0)], at)?)
        };
        rows.push(
            Row::new(format!("reciprocity: {what}"), "Maxwell (1864)")
                .numbers(nano(a, b)?, nano(b, a)?)
                .shown("nm/N", 4)
                .within(ROUNDING, ROUNDED),
        );
    }
    let stiff = Section {
        axial_n: 1e14,
        ..SECTION
    };
    rows.push(
        Row::new("sway of a portal under a force on its beam", "Kleinlogel, frame 41")
            .numbers(
                1e9 * portal_sway(5.0, 8.0, stiff),
                1e9 * displacement(&portal(5.0, 8.0, stiff), &[(1, 0, 1.0)], (1, 0))?,
            )
            .shown("nm/N", 4)
            .within(1e-5, "beams that hardly stretch"),
    );
    let (mut force, mut loose, mut wanted) = (0.0_f64, 0, 0);
    let (mut energy_kg, mut mass_kg) = (0.0, 0.0);
    for (beam, places) in odd_beams() {
        let matrices = beam.matrices(places)?;
        let motions = rigid_motions(places);
        let scale = matrices.stiffness.amax();
        force = force.max((matrices.stiffness * &motions).amax() / scale);
        let eigenvalues = matrices.stiffness.symmetric_eigenvalues();
        loose += eigenvalues.iter().filter(|value| **value < 1e-9 * scale).count();
        wanted += 6 + beam.released.iter().flatten().filter(|&&released| released).count();
        for k in 0..3 {
            energy_kg += (motions.column(k).transpose() * matrices.mass * motions.column(k))[0];
            mass_kg += matrices.total_kg;
        }
    }
    rows.push(
        Row::new(
            "four odd beams: largest force in a rigid motion, by the stiffness",
            "mechanics",
        )
        .measured_by(0.0, force, 1.0)
        .shown("", 6)
        .within(ROUNDING, ROUNDED),
    );
    rows.push(
        Row::new(
            "their motions without strain: six each, and the released rotations",
            "mechanics",
        )
        .numbers(wanted as f64, loose as f64)
        .shown("", 0)
        .within(0.0, "a number of them"),
    );
    rows.push(
        Row::new("their mass in rigid movements along x, y and z", "mechanics")
            .numbers(mass_kg, energy_kg)
            .shown("kg", 4)
            .within(ROUNDING, ROUNDED),
    );
    Ok(rows)
}

/// Natural frequencies of a car's first `dofs` degrees of freedom, wheelsets held, Hz.
fn car_hz(car: &SpatialCar, dofs: &[usize]) -> Result<Vec<f64>> {
    let n = dofs.len();
    let mut stiffness = DMatrix::zeros(n, n);
    for spring in car.all_springs() {
        let lever = DVector::from_iterator(n, dofs.iter().map(|&d| spring.lever[d]));
        stiffness += &lever * lever.transpose() * spring.stiffness;
    }
    let mass = DMatrix::from_diagonal(&DVector::from_iterator(n, dofs.iter().map(|&d| car.inertia[d])));
    let found = natural_modes(&stiffness, &mass)?;
    Ok(found.omega_squared.into_iter().map(frequency_hz).collect())
}

fn cars() -> Result<Vec<Row>> {
    const SOURCE: &str = "strain energy, written apart";
    const DIGITS: &str = "printed to 0.1 mHz";
    const SPATIAL_HZ: [f64; 15] = [
        0.6634, 0.9305, 1.0731, 1.0735, 1.1363, 6.8354, 6.8354, 7.3537, 7.3715, 7.4252, 7.4252, 13.6321, 13.6323,
        27.1787, 27.1799,
    ];
    let all: Vec<usize> = (0..SPATIAL_HZ.len()).collect();
    let found = car_hz(&stock::shinkansen(), &all)?;
    let inspection = car_hz(&stock::inspection(), &[0, 1])?;
    let apart = |k: &usize| (found[*k] / SPATIAL_HZ[*k] - 1.0).abs();
    let worst = (0..SPATIAL_HZ.len())
        .max_by(|a, b| apart(a).total_cmp(&apart(b)))
        .unwrap_or(0);
    let row = |what: String, expected, found| {
        Row::new(what, SOURCE)
            .numbers(expected, found)
            .shown("Hz", 4)
            .within(1e-4, DIGITS)
    };
    Ok(vec![
        row("15-DOF car, lowest".into(), SPATIAL_HZ[0], found[0]),
        row("15-DOF car, highest".into(), SPATIAL_HZ[14], found[14]),
        row(
            format!("15-DOF car, the worst of all fifteen: {}", worst + 1),
            SPATIAL_HZ[worst],
            found[worst],
        ),
        row("inspection car, bounce".into(), 1.1695, inspection[0]),
        row("inspection car, pitch".into(), 1.1699, inspection[1]),
    ])
}
