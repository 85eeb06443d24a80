//! What an engineer writes means what it says: ranges, chains, divided beams, rows, parts at their places.

use host_sim::model::file;
use host_sim::model::frame::Follows;
use nalgebra::Vector3;

const SHORT: &str = r#"
kind = "frame"
name = "trestle"
damping_ratio = 0.01
[materials]
steel = { E_npm2 = 2.0e11, nu = 0.25, density_kgpm3 = 8000.0 }
[sections]
S = { material = "steel", A_m2 = 0.01, J_m4 = 1.0e-5, Iy_m4 = 2.0e-5, Iz_m4 = 3.0e-5, added_kgpm = 20.0 }
[part.leg]
row = [{ name = "a", first = 1, last = 3, at_m = [0.0, 0.0, 0.0], step_m = [0.0, 0.0, 2.0] }]
supports = { a1 = ["all"] }
beam = [{ nodes = ["a1..a3"], section = "S", group = "leg", rigid_m = [0.0, 0.5] }]
[[place]]
part = "leg"
name = "N"
at_m = [0.0, 0.0, 0.0]
[[place]]
part = "leg"
name = "S"
at_m = [9.0, 0.0, 0.0]
[nodes]
G0 = [-1.0, 0.0, 4.0]
G1 = [10.0, 0.0, 4.0]
top = [9.0, 0.0, 4.5]
[supports]
G0 = ["x", "y", "z", "rx"]
G1 = ["all"]
[[beam]]
nodes = ["S.a3", "N.a3"]
section = "S"
divide = 3
[[beam]]
chains = [["N.a3", "G0"], ["S.a3", "G1"]]
section = "S"
[[link]]
master = "S.a3"
slaves = ["top"]
[[spring]]
nodes = ["N.a3", "S.a3"]
to = ["N.a1", "S.a1"]
x_npm = 1.0e6
[path]
line = ["G0", "N.a3", "S.a3", "G1"]
[[sensor]]
number = 7
node = "top"
direction = [0.0, 3.0, 4.0]
"#;

#[test]
fn a_short_file_makes_the_whole_frame() {
    let bridge = file::read(SHORT).expect("good");
    let frame = &bridge.frame;
    let name = |node: usize| frame.nodes[node].name.as_str();
    let number = |name: &str| frame.nodes.iter().position(|node| node.name == name).expect("there");

    assert_eq!(frame.groups, ["N.leg", "S.leg"]);
    assert_eq!(frame.nodes[number("S.a3")].place_m, Vector3::new(9.0, 0.0, 4.0));
    // A divided beam has its inner nodes on the path, in the order of travel, whichever way it was written.
    let along: Vec<&str> = bridge.path.lines[0].iter().map(|&node| name(node)).collect();
    assert_eq!(along, ["G0", "N.a3", "S.a3-N.a3/2", "S.a3-N.a3/1", "S.a3", "G1"]);
    // Rigid zones are at the ends of a chain only.
    let legs: Vec<[f64; 2]> = (frame.beams.iter())
        .filter(|beam| beam.group == Some(0))
        .map(|beam| beam.rigid_m)
        .collect();
    assert_eq!(legs, [[0.0, 0.0], [0.0, 0.5]]);
    assert_eq!(frame.nodes[number("G0")].held, [true, true, true, true, false, false]);
    assert_eq!(frame.springs[1].to.map(name), Some("S.a1"));
    assert_eq!(frame.links[0].follows, Follows::Rigidly);
    assert_eq!(bridge.sensors[0].direction, Vector3::new(0.0, 0.6, 0.8));

    let section = frame.beams[0].section;
    assert_eq!(section.axial_n, 2.0e9);
    assert!((section.torsion_nm2 / (2.0e11 / 2.5 * 1.0e-5) - 1.0).abs() < 1e-15);
    assert_eq!(section.mass_kgpm, 100.0);
    assert!((section.polar_inertia_kgm / (8000.0 * 5.0e-5) - 1.0).abs() < 1e-15);
}
