//! Frames of beams in space: the elements obey statics and closed forms, bad files are refused with what to mend, and
//! every bridge that ships has the modes that are written here.

mod bad_files;
mod closed_forms;
mod damage;
mod files;
mod shipped;
mod shown;
mod statics;

use host_sim::model::eigen::{NaturalModes, natural_modes};
use host_sim::model::frame::assembly::Assembly;
use host_sim::model::frame::{Beam, Frame, NODE_FREEDOMS, Node, Section};
use nalgebra::{DMatrix, Vector3};

/// All six degrees of freedom held.
const FIXED: [bool; NODE_FREEDOMS] = [true; NODE_FREEDOMS];
/// None held.
const FREE: [bool; NODE_FREEDOMS] = [false; NODE_FREEDOMS];

/// A steel-like section with different stiffness in every way of deforming.
const SECTION: Section = Section {
    axial_n: 4.0e9,
    torsion_nm2: 3.0e6,
    bending_nm2: [2.0e7, 5.0e6],
    mass_kgpm: 150.0,
    polar_inertia_kgm: 0.4,
};

fn node(name: &str, place_m: [f64; 3], held: [bool; NODE_FREEDOMS]) -> Node {
    Node {
        name: name.into(),
        place_m: Vector3::from(place_m),
        held,
    }
}

/// A straight line of `elements` equal beams from `from` to `to`, its ends held as given.
fn line(from: [f64; 3], to: [f64; 3], elements: usize, held: [[bool; NODE_FREEDOMS]; 2]) -> Frame {
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

fn modes(frame: &Frame) -> NaturalModes {
    let matrices = Assembly::new(frame).expect("stands");
    natural_modes(&matrices.stiffness(&[]), &matrices.mass).expect("positive")
}

/// Displacement of a node's degree of freedom under unit loads on others: `loads` are (node, direction, force).
fn displacement(frame: &Frame, loads: &[(usize, usize, f64)], at: (usize, usize)) -> f64 {
    let matrices = Assembly::new(frame).expect("stands");
    let mut force = DMatrix::zeros(matrices.freedoms(), 1);
    for &(node, direction, value) in loads {
        for &(freedom, factor) in &matrices.rows[node][direction] {
            force[(freedom, 0)] += value * factor;
        }
    }
    let moved = host_sim::model::eigen::solve(&matrices.stiffness(&[]), &force).expect("positive");
    matrices.rows[at.0][at.1]
        .iter()
        .map(|&(freedom, factor)| factor * moved[(freedom, 0)])
        .sum()
}
