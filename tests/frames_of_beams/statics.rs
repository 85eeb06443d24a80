//! Statics: what every stiffness matrix owes to mechanics, and deflections from books.

use super::*;
use host_sim::model::frame::{Follows, Link, LumpedMass, Spring};

/// Of f64 in solutions of some tens of unknowns.
const ROUNDING: f64 = 1e-9;

fn close(found: f64, exact: f64) {
    assert!((found / exact - 1.0).abs() < ROUNDING, "{found:e}, not {exact:e}");
}

#[test]
fn a_rigid_motion_strains_no_beam_and_carries_its_whole_mass() {
    for (beam, places) in odd_beams() {
        let matrices = beam.matrices(places).expect("a beam");
        let motion = specimen::rigid_motions(places);
        let force = matrices.stiffness * &motion;
        let scale = matrices.stiffness.amax();
        assert!(force.amax() < ROUNDING * scale, "{:e}", force.amax() / scale);
        // Kinetic energy of a movement: that of the whole mass, whatever the end moments.
        for k in 0..3 {
            let energy = (motion.column(k).transpose() * matrices.mass * motion.column(k))[0];
            close(energy, matrices.total_kg);
        }
        // Exactly six motions (and the released rotations) are without strain.
        let released = beam.released.iter().flatten().filter(|&&released| released).count();
        let loose = (matrices.stiffness.symmetric_eigenvalues().iter())
            .filter(|value| **value < ROUNDING * scale)
            .count();
        assert_eq!(loose, 6 + released);
    }
}

#[test]
fn a_free_frame_has_six_rigid_body_modes() {
    // Ground springs so soft that a frame of beams in space floats on them: six modes far below the first that bends it.
    let mut frame = line([0.0; 3], [3.0, 4.0, 5.0], 4, [FREE; 2]);
    let spring = Spring {
        node: 2,
        to: None,
        stiffness: [1.0; 6],
        group: None,
    };
    frame.springs.push(spring);
    let modes = modes(&frame);
    assert!(modes.omega_squared[5] < 1e-3 * modes.omega_squared[6]);
    assert!(modes.omega_squared[6] > 1.0);
}

#[test]
fn displacements_are_reciprocal() {
    // Maxwell 1864: what a load at A does at B, a load at B does at A, in any directions, moments included.
    let frame = odd_frame();
    for (a, b) in [((1, 2), (4, 0)), ((4, 4), (2, 1)), ((3, 3), (4, 1))] {
        close(
            displacement(&frame, &[(a.0, a.1, 1.0)], b),
            displacement(&frame, &[(b.0, b.1, 1.0)], a),
        );
    }
}

#[test]
fn a_cantilever_bends_stretches_and_twists_as_in_every_book() {
    const L: f64 = 4.0;
    let frame = line([0.0; 3], [L, 0.0, 0.0], 1, [FIXED, FREE]);
    let tip = |direction: usize| displacement(&frame, &[(1, direction, 1.0)], (1, direction));
    let [vertical, lateral] = SECTION.bending_nm2;
    close(tip(0), L / SECTION.axial_n);
    close(tip(1), L.powi(3) / (3.0 * lateral));
    close(tip(2), L.powi(3) / (3.0 * vertical));
    close(tip(3), L / SECTION.torsion_nm2);
    close(tip(4), L / vertical);
    close(tip(5), L / lateral);
    // Signs: a load upwards turns the tip so that it rises along x, r_y = -dw/dx.
    close(displacement(&frame, &[(1, 2, 1.0)], (1, 4)), -L * L / (2.0 * vertical));
    close(displacement(&frame, &[(1, 1, 1.0)], (1, 5)), L * L / (2.0 * lateral));
}

#[test]
fn a_turned_cantilever_is_the_same_cantilever() {
    // Upright, with up along the global y axis: I_y then bends it in y, I_z in x.
    const L: f64 = 4.0;
    let mut frame = line([0.0; 3], [0.0, 0.0, L], 1, [FIXED, FREE]);
    frame.beams[0].up = Some(Vector3::y());
    let tip = |direction: usize| displacement(&frame, &[(1, direction, 1.0)], (1, direction));
    close(tip(1), L.powi(3) / (3.0 * SECTION.bending_nm2[0]));
    close(tip(0), L.powi(3) / (3.0 * SECTION.bending_nm2[1]));
    close(tip(2), L / SECTION.axial_n);
}

#[test]
fn a_portal_frame_sways_as_its_textbook_formula_says() {
    // Fixed feet, height h, span b, columns and beam alike, no stretching.
    let (h, b) = (5.0, 8.0);
    let stiff = Section {
        axial_n: 1e16,
        ..SECTION
    };
    let frame = portal(h, b, stiff);
    let exact = portal_sway(h, b, stiff);
    let found = displacement(&frame, &[(1, 0, 1.0)], (1, 0));
    // Beams that hardly stretch leave less than this.
    assert!((found / exact - 1.0).abs() < 1e-6, "{found:e} {exact:e}");
}

#[test]
fn a_hinge_makes_a_propped_cantilever_of_a_clamped_beam() {
    const L: f64 = 6.0;
    let mut frame = line([0.0; 3], [L, 0.0, 0.0], 2, [FIXED, FIXED]);
    let middle = |frame: &Frame| displacement(frame, &[(1, 2, 1.0)], (1, 2));
    let ei = SECTION.bending_nm2[0];
    close(middle(&frame), L.powi(3) / (192.0 * ei));
    frame.beams[1].released[1] = [false, true, false];
    close(middle(&frame), 7.0 * L.powi(3) / (768.0 * ei));
    frame.beams[0].released[0] = [false, true, false];
    close(middle(&frame), L.powi(3) / (48.0 * ei));
}

#[test]
fn rigid_zones_and_offsets_bend_only_what_lies_between() {
    const L: f64 = 6.0;
    let mut frame = line([0.0; 3], [L, 0.0, 0.0], 1, [FIXED, FREE]);
    frame.beams[0].rigid_m = [1.0, 2.0];
    // The load at the tip acts 2 m beyond the elastic 3 m: P a^3/3 + P 2 a^2 + P 4 a over E I.
    let a: f64 = 3.0;
    let exact = (a.powi(3) / 3.0 + 2.0 * a * a + 4.0 * a) / SECTION.bending_nm2[0];
    close(displacement(&frame, &[(1, 2, 1.0)], (1, 2)), exact);

    // An eccentric column: its axis is 0.5 m in y from the nodes, so a load down on the node bends it.
    let mut column = line([0.0; 3], [0.0, 0.0, 4.0], 1, [FIXED, FREE]);
    column.beams[0].offset_m = [Vector3::new(0.0, 0.5, 0.0); 2];
    let down = displacement(&column, &[(1, 2, -1.0)], (1, 2));
    close(down, -(4.0 / SECTION.axial_n + 0.25 * 4.0 / SECTION.bending_nm2[1]));
}

#[test]
fn springs_carry_what_they_should_and_links_are_rigid() {
    let spring = |node, to, stiffness| Spring {
        node,
        to,
        stiffness,
        group: None,
    };
    // A block on a ground spring, a second one on a spring upon it 2 m higher.
    let k = [1e6, 2e6, 3e6, 4e6, 5e6, 6e6];
    let mut frame = Frame {
        nodes: vec![node("low", [0.0; 3], FREE), node("high", [0.0, 0.0, 2.0], FREE)],
        springs: vec![spring(0, None, k), spring(1, Some(0), k)],
        masses: (0..2)
            .map(|node| LumpedMass {
                node,
                mass_kg: 10.0,
                inertia_kgm2: [1.0; 3],
            })
            .collect(),
        ..Frame::default()
    };
    close(displacement(&frame, &[(1, 2, 1.0)], (1, 2)), 2.0 / 3e6);
    // Sideways the lower spring turns as well, by 2 m over its 5e6 N m/rad.
    close(displacement(&frame, &[(1, 0, 1.0)], (1, 0)), 2.0 / 1e6 + 4.0 / 5e6);

    frame.springs.pop();
    frame.links.push(Link {
        master: 0,
        slave: 1,
        follows: Follows::Rigidly,
    });
    close(displacement(&frame, &[(1, 0, 1.0)], (1, 0)), 1.0 / 1e6 + 4.0 / 5e6);
    // Chains of equal freedoms end at the first master.
    frame.nodes.push(node("third", [5.0, 0.0, 0.0], FIXED));
    frame.nodes[2].held[2] = false;
    frame.links.push(Link {
        master: 1,
        slave: 2,
        follows: Follows::Equally([false, false, true, false, false, false]),
    });
    close(displacement(&frame, &[(2, 2, 1.0)], (0, 2)), 1.0 / 3e6);
}
