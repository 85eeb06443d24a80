//! Frequencies from closed forms, and how fast the elements come to them.

use super::*;
use host_sim::model::eigen::frequency_hz;
use host_sim::model::frame::LumpedMass;
use std::f64::consts::{PI, TAU};

/// Length of all beams here, m.
const L: f64 = 10.0;

fn bending(elements: usize, ends: [[bool; NODE_FREEDOMS]; 2]) -> Frame {
    specimen::bending(L, elements, ends)
}

/// `f_k` of a beam with the root `beta L` of its frequency equation.
fn exact_hz(beta_l: f64) -> f64 {
    (beta_l / L).powi(2) * (SECTION.bending_nm2[0] / SECTION.mass_kgpm).sqrt() / TAU
}

#[test]
fn beams_come_to_their_closed_forms_from_above_with_the_fourth_power_of_the_element() {
    // Roots of the frequency equations (Blevins, Formulas for Natural Frequency and Mode Shape, table 8-1).
    let cases = [
        ("cantilever", [FIXED, FREE], [1.875_104_07, 4.694_091_13, 7.854_757_44]),
        ("simply supported", [PINNED, PINNED], [PI, 2.0 * PI, 3.0 * PI]),
        ("clamped", [FIXED, FIXED], [4.730_040_74, 7.853_204_62, 10.995_607_9]),
        ("propped", [FIXED, PINNED], [3.926_602_31, 7.068_582_75, 10.210_176_1]),
    ];
    for (name, ends, roots) in cases {
        let errors = |elements| {
            let found = modes(&bending(elements, ends)).omega_squared;
            std::array::from_fn::<f64, 3, _>(|k| frequency_hz(found[k]) / exact_hz(roots[k]) - 1.0)
        };
        let (coarse, fine) = (errors(8), errors(16));
        for k in 0..3 {
            assert!(coarse[k] > 0.0 && coarse[k] < 3e-3, "{name} {k}: {coarse:?}");
            // Halving the element divides the error by 16; where it is above the roots' printed digits.
            if fine[k] > 1e-7 {
                let order = (coarse[k] / fine[k]).log2();
                assert!((3.7..4.3).contains(&order), "{name} {k}: order {order}");
            }
        }
    }
}

#[test]
fn rods_ring_in_tension_and_in_torsion() {
    // Fixed at one end, free at the other: f = c / 4L, c = sqrt(EA / m) or sqrt(GJ / polar inertia).
    let only = |direction: usize| {
        let held: [bool; NODE_FREEDOMS] = std::array::from_fn(|d| d != direction);
        let mut frame = line([0.0; 3], [L, 0.0, 0.0], 20, [FIXED, held]);
        for node in &mut frame.nodes[1..] {
            node.held = held;
        }
        frequency_hz(modes(&frame).omega_squared[0])
    };
    let tension = (SECTION.axial_n / SECTION.mass_kgpm).sqrt() / (4.0 * L);
    let torsion = (SECTION.torsion_nm2 / SECTION.polar_inertia_kgm).sqrt() / (4.0 * L);
    // Linear elements: error (pi h / 2L)^2 / 24 for twenty of them, 2.6e-4.
    for (found, exact) in [(only(0), tension), (only(3), torsion)] {
        assert!((0.0..3e-4).contains(&(found / exact - 1.0)), "{found} {exact}");
    }
}

#[test]
fn a_mass_on_a_light_cantilever_is_an_oscillator_with_a_third_of_the_weight_of_the_rod() {
    // Rayleigh: 33/140 of a cantilever's mass moves with its tip.
    let mut frame = bending(6, [FIXED, FREE]);
    let mass_kg = 100.0 * SECTION.mass_kgpm * L;
    frame.masses.push(LumpedMass {
        node: 6,
        mass_kg,
        inertia_kgm2: [0.0; 3],
    });
    let k = 3.0 * SECTION.bending_nm2[0] / L.powi(3);
    let exact = (k / (mass_kg + 33.0 / 140.0 * SECTION.mass_kgpm * L)).sqrt() / TAU;
    let found = frequency_hz(modes(&frame).omega_squared[0]);
    assert!((found / exact - 1.0).abs() < 1e-5, "{found} {exact}");
}

#[test]
fn a_hinged_beam_has_the_mass_of_its_hinged_shape() {
    // Between clamped supports, released at both ends: a simply supported beam, and from above, as the elements at the
    // ends move in fewer shapes.
    let mut hinged = bending(16, [FIXED, FIXED]);
    hinged.beams[0].released[0][1] = true;
    hinged.beams[15].released[1][1] = true;
    let found = modes(&hinged).omega_squared;
    for (k, &w2) in found.iter().take(3).enumerate() {
        let error = frequency_hz(w2) / exact_hz((k + 1) as f64 * PI) - 1.0;
        assert!((0.0..2e-4).contains(&error), "{k}: {error:e}");
    }
}

#[test]
fn the_sway_of_a_portal_on_heavy_beam_is_that_of_an_oscillator() {
    // Columns without mass, the beam's mass on their tops: omega^2 = k / m with the textbook sway stiffness.
    let (h, b) = (5.0, 8.0);
    let light = Section {
        axial_n: 1e14,
        mass_kgpm: 0.0,
        polar_inertia_kgm: 0.0,
        ..SECTION
    };
    let mut frame = portal(h, b, light);
    frame.masses = [1, 2]
        .map(|node| LumpedMass {
            node,
            mass_kg: 5000.0,
            inertia_kgm2: [0.0; 3],
        })
        .to_vec();
    for node in &mut frame.nodes[1..3] {
        node.held = [false, true, false, true, false, true];
    }
    let exact = (1.0 / (portal_sway(h, b, light) * 10_000.0)).sqrt() / TAU;
    // Rotations have no mass here: they are no modes, and do no harm.
    let found = modes(&frame);
    assert_eq!(found.omega_squared.len(), 4);
    let error = frequency_hz(found.omega_squared[0]) / exact - 1.0;
    assert!(error.abs() < 1e-6, "{error:e}");
}
