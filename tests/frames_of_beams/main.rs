//! Frames of beams in space: the elements obey statics and closed forms, bad files are refused with what to mend, and
//! every bridge that ships has the modes that are written here.

mod bad_files;
mod closed_forms;
mod damage;
mod files;
#[path = "../program.rs"]
mod program;
mod shipped;
mod shown;
mod statics;

use host_sim::model::eigen::NaturalModes;
use host_sim::model::frame::{Frame, NODE_FREEDOMS, Section};
use host_sim::validate::specimen::{
    self, FIXED, FREE, PINNED, SECTION, line, node, odd_beams, odd_frame, portal, portal_sway,
};
use nalgebra::Vector3;

fn modes(frame: &Frame) -> NaturalModes {
    specimen::modes(frame).expect("stands")
}

/// Displacement of a node's degree of freedom under unit loads on others: `loads` are (node, direction, force).
fn displacement(frame: &Frame, loads: &[(usize, usize, f64)], at: (usize, usize)) -> f64 {
    specimen::displacement(frame, loads, at).expect("stands")
}
