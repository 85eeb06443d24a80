//! Bad files: each is refused with one sentence that says where, what is wrong and what to mend.

use host_sim::model::{Structure, file};

/// A portal frame that stands, one thing a line.
const GOOD: &str = r#"kind = "frame"
name = "portal"
damping_ratio = 0.02
[materials]
steel = { E_npm2 = 2.0e11, nu = 0.3, density_kgpm3 = 7850.0 }
[sections]
column = { material = "steel", A_m2 = 0.02, J_m4 = 1.0e-5, Iy_m4 = 3.0e-4, Iz_m4 = 3.0e-4 }
[nodes]
A = [0.0, 0.0, 0.0]
B = [0.0, 0.0, 5.0]
C = [6.0, 0.0, 5.0]
D = [6.0, 0.0, 0.0]
G = [-1.0, 0.0, 5.0]
H = [7.0, 0.0, 5.0]
[supports]
A = ["all"]
D = ["all"]
G = ["all"]
H = ["all"]
[[beam]]
nodes = ["A", "B", "C", "D"]
section = "column"
groups = ["left", "beam", "right"]
[path]
line = ["G", "B", "C", "H"]
[[sensor]]
number = 1
node = "B"
direction = "x"
"#;

fn refusal(text: &str) -> String {
    match file::read(text).and_then(Structure::new) {
        Ok(_) => panic!("believed:\n{text}"),
        Err(error) => format!("{error:#}"),
    }
}

#[test]
fn the_good_file_is_good() {
    file::read(GOOD).and_then(Structure::new).expect("stands");
}

#[test]
fn each_bad_file_is_refused_with_what_to_mend() {
    // What is replaced, by what, and the sentence.
    let cases = [
        (
            "kind = \"frame\"",
            "kind = \"shell\"",
            "line 1, column 8: kind is \"shell\"; it must be \"frame\", and for a girder it is left out",
        ),
        (
            "name = \"portal\"",
            "name = \"portal\"\nnmae = 1",
            "line 3, column 1: unknown field `nmae`",
        ),
        (
            "damping_ratio = 0.02",
            "damping_ratio = 0.6",
            "damping_ratio must lie between 0 and 0.5, not 0.6",
        ),
        (
            "damping_ratio = 0.02",
            "damping_ratio = 0.02\ndamping_at_hz = [5.0, 5.0]",
            "damping_at_hz must be two rising frequencies",
        ),
        (
            "E_npm2 = 2.0e11",
            "E_npm2 = -1.0",
            "line 5, column 9: material \"steel\" has E_npm2 = -1, which must be positive",
        ),
        (
            "density_kgpm3 = 7850.0",
            "density_kgpm3 = -7850.0",
            "material \"steel\" has density_kgpm3 = -7850, which must be zero or positive",
        ),
        (
            "A_m2 = 0.02",
            "A_m2 = 0.0",
            "line 7, column 10: section \"column\" has A_m2 = 0, which must be positive",
        ),
        (
            "Iz_m4 = 3.0e-4 }",
            "Iz_m4 = 3.0e-4, added_kgpm = -1.0 }",
            "section \"column\" has added_kgpm = -1, which must be zero or positive",
        ),
        (
            "material = \"steel\"",
            "material = \"steal\"",
            "line 7, column 23: section \"column\" is of material \"steal\", which is not in [materials]",
        ),
        (
            "section = \"column\"",
            "section = \"colum\"",
            "line 22, column 11: there is no section \"colum\"; known are: column",
        ),
        (
            "[\"A\", \"B\", \"C\", \"D\"]",
            "[\"A\", \"B\", \"X\", \"D\"]",
            "line 21, column 20: there is no node \"X\"; check the name, or add it to [nodes]",
        ),
        (
            "[\"A\", \"B\", \"C\", \"D\"]",
            "[\"A..B\"]",
            "\"A..B\" is no range of nodes: write one such as \"L0..L8\"",
        ),
        (
            "[\"A\", \"B\", \"C\", \"D\"]",
            "[\"A\"]",
            "a beam needs at least two nodes",
        ),
        (
            "groups = [\"left\", \"beam\", \"right\"]",
            "groups = [\"left\"]",
            "line 23, column 10: groups has 1 names for 3 beams",
        ),
        (
            "groups = [\"left\", \"beam\", \"right\"]",
            "divide = 0",
            "divide must be 1 to 100, not 0",
        ),
        (
            "groups = [\"left\", \"beam\", \"right\"]",
            "rigid_m = [5.0, 0.0]",
            "the beam from \"A\" to \"B\" has no length left between its ends (0.000 m): move its nodes apart or shorten its rigid zones",
        ),
        (
            "groups = [\"left\", \"beam\", \"right\"]",
            "up = [0.0, 0.0, 1.0]",
            "the beam from \"A\" to \"B\" points along its own up",
        ),
        (
            "groups = [\"left\", \"beam\", \"right\"]",
            "release = [[\"x\"], []]",
            "only the moments rx, ry and rz of a beam's end can be released",
        ),
        (
            "A = [\"all\"]",
            "A = [\"w\"]",
            "line 16, column 6: \"w\" is no direction: write x, y, z, rx, ry, rz or all",
        ),
        (
            "C = [6.0, 0.0, 5.0]",
            "C = [6.0, 0.0, 5.0]\nC = [1.0, 0.0, 0.0]",
            "line 12, column 1: duplicate key",
        ),
        (
            "C = [6.0, 0.0, 5.0]",
            "C = [0.0, 0.0, 5.0]",
            "the beam from \"B\" to \"C\" has no length left between its ends",
        ),
        (
            "C = [6.0, 0.0, 5.0]",
            "C = [6.0, 0.0, inf]",
            "node \"C\" has a coordinate that is no number: write metres",
        ),
        (
            "H = [7.0, 0.0, 5.0]",
            "H = [7.0, 0.0, 5.0]\nE = [9.0, 9.0, 9.0]",
            "node \"E\" belongs to no beam, spring or link: connect it or delete it",
        ),
        (
            "node = \"B\"",
            "node = \"Q\"",
            "line 28, column 8: there is no node \"Q\"",
        ),
        (
            "direction = \"x\"",
            "direction = \"up\"",
            "the direction of sensor 1 must be \"x\", \"y\", \"z\" or a vector that is not zero",
        ),
        (
            "direction = \"x\"",
            "direction = \"x\"\n[[sensor]]\nnumber = 1\nnode = \"C\"\ndirection = \"x\"",
            "sensor 1 is there twice: give each its own number",
        ),
        (
            "[\"G\", \"B\", \"C\", \"H\"]",
            "[\"G\", \"C\", \"B\", \"H\"]",
            "the path goes from node \"C\" at x = 6 m to node \"B\" at 0 m: its nodes must ascend along the track",
        ),
        (
            "[\"G\", \"B\", \"C\", \"H\"]",
            "[\"B\", \"C\", \"H\"]",
            "the path begins at node \"B\", which can sink, so a wheel's load would appear at once",
        ),
        (
            "line = [\"G\", \"B\", \"C\", \"H\"]",
            "left = [\"G\", \"B\", \"C\", \"H\"]",
            "[path] needs either line, or left and right",
        ),
        (
            "[path]",
            "[[mass]]\nnodes = [\"B\"]\nkg = -5.0\n[path]",
            "the mass at node \"B\" must have zero or positive kg and inertia, not -5 kg",
        ),
        (
            "[path]",
            "[[spring]]\nnodes = [\"B\"]\nz_npm = -5.0\n[path]",
            "line 25, column 9: a spring's stiffness in z is -5: it must be zero or positive",
        ),
        (
            "[path]",
            "[[link]]\nmaster = \"B\"\nslaves = [\"D\"]\n[path]",
            "node \"D\" is held in x but also linked to node \"B\": hold the master instead",
        ),
        (
            "[path]",
            "[[link]]\nmaster = \"B\"\nslaves = [\"C\"]\n[[link]]\nmaster = \"C\"\nslaves = [\"B\"]\n[path]",
            "lead in a circle",
        ),
        (
            "[path]",
            "[[place]]\npart = \"tower\"\nname = \"1\"\nat_m = [0.0, 0.0, 0.0]\n[path]",
            "there is no part \"tower\"",
        ),
    ];
    for (from, to, sentence) in cases {
        assert!(GOOD.contains(from), "{from}");
        let bad = GOOD.replacen(from, to, 1);
        let found = refusal(&bad);
        assert!(found.contains(sentence), "{to}:\n{found}");
        assert!(!found.contains('\n'), "{found}");
    }
}

#[test]
fn a_frame_larger_than_its_matrices_could_be_is_refused() {
    let row = |name: &str| {
        format!("[[row]]\nname = \"{name}\"\nfirst = 0\nlast = 999\nat_m = [0.0, 0.0, 0.0]\nstep_m = [1.0, 0.0, 0.0]\n")
    };
    let found = refusal(&format!("{GOOD}{}{}", row("P"), row("Q")));
    assert!(found.contains("more than 1500 nodes; divide the beams"), "{found}");
}

#[test]
fn a_mechanism_is_refused_by_node_and_direction() {
    // Feet that slide; a beam between two hinges that can spin about its axis; columns on hinges that can fall sideways.
    let sliding = GOOD.replace(
        "A = [\"all\"]\nD = [\"all\"]",
        "A = [\"y\", \"z\", \"rx\", \"ry\", \"rz\"]\nD = [\"y\", \"z\", \"rx\", \"ry\", \"rz\"]",
    );
    assert!(
        refusal(&sliding).contains("can move along x and nothing resists"),
        "{}",
        refusal(&sliding)
    );
    let falling = GOOD.replace(
        "A = [\"all\"]\nD = [\"all\"]",
        "A = [\"x\", \"y\", \"z\"]\nD = [\"x\", \"y\", \"z\"]",
    );
    assert!(
        refusal(&falling).contains("can move along y and nothing resists"),
        "{}",
        refusal(&falling)
    );
    // Three hinges in a row leave the middle node free.
    let hinged = GOOD.replace(
        "nodes = [\"A\", \"B\", \"C\", \"D\"]\nsection = \"column\"\ngroups = [\"left\", \"beam\", \"right\"]",
        "chains = [[\"A\", \"B\"], [\"B\", \"C\"], [\"C\", \"D\"]]\nsection = \"column\"\nrelease = [[\"ry\"], [\"ry\"]]",
    );
    let sentence = refusal(&hinged);
    assert!(
        sentence.starts_with("bridge \"portal\": this is a mechanism: node \""),
        "{sentence}"
    );
    assert!(
        sentence.ends_with("nothing resists; hold it in [supports], brace it, or take back a release"),
        "{sentence}"
    );
    let spinning = GOOD
        .replace(
            "groups = [\"left\", \"beam\", \"right\"]",
            "release = [[\"rx\"], [\"rx\"]]",
        )
        .replace(
            "nodes = [\"A\", \"B\", \"C\", \"D\"]",
            "chains = [[\"A\", \"B\"], [\"B\", \"C\"], [\"C\", \"D\"]]",
        );
    assert!(refusal(&spinning).contains("is released about its own axis at both ends, so it can spin"));
}

#[test]
fn pieces_that_nothing_holds_are_named() {
    let loose = GOOD.replace(
        "[path]",
        "[[beam]]\nnodes = [\"X1..X6\"]\nsection = \"column\"\n[[row]]\nname = \"X\"\nfirst = 1\nlast = 6\nat_m = [0.0, 3.0, 0.0]\nstep_m = [1.0, 0.0, 0.0]\n[path]",
    );
    assert_eq!(
        refusal(&loose),
        "bridge \"portal\": nothing connects node \"X1\", \"X2\", \"X3\", \"X4\" and 2 more with the ground: join them to the rest by beams or springs, or hold them in [supports]"
    );
}
