//! A girder as a frame: the same beams, with nothing free but vertical bending.
//!
//! Damage of an element is the fraction of its `E I` that is lost, the only stiffness that it has here.

use nalgebra::Vector3;

use super::file::BridgeFile;
use super::frame::{Beam, Frame, Node, Section};
use super::path::PathLine;
use super::structure::{BridgeFrame, Damping, SensorPlace};

impl From<&BridgeFile> for BridgeFrame {
    fn from(file: &BridgeFile) -> Self {
        let length_m = file.length_m / file.elements as f64;
        let nodes: Vec<Node> = (0..=file.elements)
            .map(|node| Node {
                name: (node + 1).to_string(),
                place_m: Vector3::new(node as f64 * length_m, 0.0, 0.0),
                held: [true, true, file.supports.contains(&(node + 1)), true, false, true],
            })
            .collect();
        let section = Section {
            axial_n: 0.0,
            torsion_nm2: 0.0,
            bending_nm2: [file.bending_stiffness_nm2, 0.0],
            mass_kgpm: file.mass_per_length_kgpm,
            polar_inertia_kgm: 0.0,
        };
        let beams = (0..file.elements).map(|element| Beam {
            group: Some(element),
            ..Beam::plain([element, element + 1], section)
        });
        let sensors = (0..nodes.len()).map(|node| SensorPlace {
            number: node as u16 + 1,
            name: format!("node {}", node + 1),
            node,
            direction: Vector3::z(),
        });
        Self {
            name: file.name.clone(),
            path: PathLine {
                lines: vec![(0..nodes.len()).collect()],
                rail_height_m: 0.0,
            },
            sensors: sensors.collect(),
            damping: Damping {
                ratio: file.damping_ratio,
                at_hz: None,
            },
            basis_modes: file.basis_modes,
            masters: Vec::new(),
            frame: Frame {
                beams: beams.collect(),
                groups: (1..=file.elements)
                    .map(|element| format!("element {element}"))
                    .collect(),
                nodes,
                ..Frame::default()
            },
        }
    }
}
