//! Small frames with known answers, and the answers' questions: modes, and displacements under loads.

use anyhow::Result;
use nalgebra::{DMatrix, Vector3};

use crate::model::eigen::{self, NaturalModes, natural_modes};
use crate::model::frame::assembly::Assembly;
use crate::model::frame::{Beam, Frame, NODE_FREEDOMS, Node, Section, Spring};

/// All six degrees of freedom held.
pub const FIXED: [bool; NODE_FREEDOMS] = [true; NODE_FREEDOMS];
/// None held.
pub const FREE: [bool; NODE_FREEDOMS] = [false; NODE_FREEDOMS];
/// A hinge that bends in the vertical plane.
pub const PINNED: [bool; NODE_FREEDOMS] = [true, true, true, true, false, true];
/// Holds all but vertical bending.
pub const VERTICAL_ONLY: [bool; NODE_FREEDOMS] = [true, true, false, true, false, true];

/// A steel-like section with different stiffness in every way of deforming.
pub const SECTION: Section = Section {
    axial_n: 4.0e9,
    torsion_nm2: 3.0e6,
    bending_nm2: [2.0e7, 5.0e6],
    mass_kgpm: 150.0,
    polar_inertia_kgm: 0.4,
};

/// A node.
pub fn node(name: &str, place_m: [f64; 3], held: [bool; NODE_FREEDOMS]) -> Node {
    Node {
        name: name.into(),
        place_m: Vector3::from(place_m),
        held,
    }
}

/// A straight line of `elements` equal beams from `from` to `to`, its ends held as given.
pub fn line(from: [f64; 3], to: [f64; 3], elements: usize, held: [[bool; NODE_FREEDOMS]; 2]) -> Frame {
    let (a, b) = (Vector3::from(from), Vector3::from(to));
    Frame {
        nodes: (0..=elements)
            .map(|i| Node {
                name: i.to_string(),
                place_m: a + (b - a) * (i as f64 / elements as f64),
                held: match i {
                    0 => held[0],
                    i if i == elements => held[1],
                    _ => FREE,
                },
            })
            .collect(),
        beams: (0..elements).map(|i| Beam::plain([i, i + 1], SECTION)).collect(),
        ..Frame::default()
    }
}

/// A line along the track that can only bend vertically.
pub fn bending(length_m: f64, elements: usize, ends: [[bool; NODE_FREEDOMS]; 2]) -> Frame {
    let mut frame = line([0.0; 3], [length_m, 0.0, 0.0], elements, ends);
    for node in &mut frame.nodes {
        for (held, always) in node.held.iter_mut().zip(VERTICAL_ONLY) {
            *held |= always;
        }
    }
    frame
}

/// A portal with fixed feet: nodes A, B, C, D, columns A-B and D-C of `height_m`, a beam B-C of `span_m`.
pub fn portal(height_m: f64, span_m: f64, section: Section) -> Frame {
    Frame {
        nodes: vec![
            node("A", [0.0, 0.0, 0.0], FIXED),
            node("B", [0.0, 0.0, height_m], FREE),
            node("C", [span_m, 0.0, height_m], FREE),
            node("D", [span_m, 0.0, 0.0], FIXED),
        ],
        beams: [[0, 1], [1, 2], [3, 2]]
            .map(|nodes| Beam::plain(nodes, section))
            .to_vec(),
        ..Frame::default()
    }
}

/// How far the beam of a [`portal`] that does not stretch moves along under a unit force, m/N: with `k = I_b h / (I_c b)`,
/// here of equal sections, `h^3 / (12 E I) (2 + 3 k) / (1 + 6 k)` (Kleinlogel, frame 41).
pub fn portal_sway(height_m: f64, span_m: f64, section: Section) -> f64 {
    let k = height_m / span_m;
    height_m.powi(3) / (12.0 * section.bending_nm2[0]) * (2.0 + 3.0 * k) / (1.0 + 6.0 * k)
}

/// Beams in odd directions, with a hinge, a stiff end and a spring: everything that Maxwell's theorem must survive.
pub fn odd_frame() -> Frame {
    let mut frame = line([0.0; 3], [2.0, 3.0, 1.0], 3, [FIXED, FREE]);
    frame.beams[1].released[0] = [false, true, false];
    frame.nodes.push(node("arm", [2.5, 3.0, 4.0], FREE));
    frame.beams.push(Beam {
        rigid_m: [0.3, 0.1],
        ..Beam::plain([3, 4], SECTION)
    });
    // The hinge would let it fall.
    frame.springs.push(Spring {
        node: 4,
        to: None,
        stiffness: [1e5, 2e5, 3e5, 4e5, 5e5, 6e5],
        group: None,
    });
    frame
}

/// Beams in odd directions, with every attribute that a beam can have, and the places of their ends.
pub fn odd_beams() -> Vec<(Beam, [Vector3<f64>; 2])> {
    let plain = Beam::plain([0, 1], SECTION);
    let places = [Vector3::new(1.0, -2.0, 0.5), Vector3::new(4.0, 1.5, 3.0)];
    vec![
        (plain.clone(), places),
        (plain.clone(), [Vector3::zeros(), Vector3::new(0.0, 0.0, -5.0)]),
        (
            Beam {
                up: Some(Vector3::new(1.0, 0.3, -0.2)),
                offset_m: [Vector3::new(0.1, 0.2, -0.3), Vector3::new(-0.2, 0.4, 0.5)],
                rigid_m: [0.4, 0.7],
                ..plain.clone()
            },
            places,
        ),
        (
            Beam {
                released: [[true, true, false], [false, true, true]],
                rigid_m: [0.2, 0.0],
                ..plain
            },
            places,
        ),
    ]
}

/// The six rigid motions of a beam's two ends, a column each: three movements, three rotations about the origin.
pub fn rigid_motions(places: [Vector3<f64>; 2]) -> DMatrix<f64> {
    let of_node = |p: Vector3<f64>, k: usize| -> [f64; NODE_FREEDOMS] {
        let mut unit = Vector3::zeros();
        unit[k % 3] = 1.0;
        let (moved, turned) = if k < 3 {
            (unit, Vector3::zeros())
        } else {
            (unit.cross(&p), unit)
        };
        [moved.x, moved.y, moved.z, turned.x, turned.y, turned.z]
    };
    DMatrix::from_fn(12, 6, |row, k| of_node(places[row / 6], k)[row % 6])
}

/// The modes of a frame.
///
/// # Errors
/// If it cannot stand.
pub fn modes(frame: &Frame) -> Result<NaturalModes> {
    let matrices = Assembly::new(frame)?;
    natural_modes(&matrices.stiffness(&[]), &matrices.mass)
}

/// Displacement of a node's degree of freedom under loads on others: `loads` are (node, direction, force), `at` is (node,
/// direction).
///
/// # Errors
/// If the frame cannot stand.
pub fn displacement(frame: &Frame, loads: &[(usize, usize, f64)], at: (usize, usize)) -> Result<f64> {
    let matrices = Assembly::new(frame)?;
    let mut force = DMatrix::zeros(matrices.freedoms(), 1);
    for &(node, direction, value) in loads {
        for &(freedom, factor) in &matrices.rows[node][direction] {
            force[(freedom, 0)] += value * factor;
        }
    }
    let moved = eigen::solve(&matrices.stiffness(&[]), &force)?;
    Ok(matrices.rows[at.0][at.1]
        .iter()
        .map(|&(freedom, factor)| factor * moved[(freedom, 0)])
        .sum())
}
