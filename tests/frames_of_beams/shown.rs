//! `host-sim model show` of a frame, and what is said where a frame cannot go.

use std::fs;

use tempfile::TempDir;

use super::program::host_sim;

#[test]
fn a_frame_is_shown_with_what_moves_in_each_mode_and_the_cost_of_condensation() {
    let folder = TempDir::new().expect("a folder");
    let output = host_sim(folder.path(), &["model", "show", "rdso45m", "--svg", "modes.svg"]);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let text = String::from_utf8(output.stdout).expect("UTF-8");
    for part in [
        "bridge             rdso45m\n",
        "172 nodes, 308 beam elements, 0 springs, 1000 degrees of freedom",
        "sensor             4: R.L4 vertical",
        "a logger has memory for 10",
        "   2        5.4662         0.0150        7   0  93        0  SL4 z                    +0.21 %",
    ] {
        assert!(text.contains(part), "{part}\n{text}");
    }
    let picture = fs::read_to_string(folder.path().join("modes.svg")).expect("a picture");
    assert!(picture.contains("mode 2: 5.466 Hz, from the side"));
    assert!(!picture.contains("NaN") && !picture.contains("inf"));
}

#[test]
fn a_frame_that_no_logger_can_hold_is_not_built_for_one() {
    let folder = TempDir::new().expect("a folder");
    let output = host_sim(folder.path(), &["model", "build", "viaduct24", "-o", "v.model"]);
    assert_eq!(output.status.code(), Some(2));
    let sentence = String::from_utf8(output.stderr).expect("UTF-8");
    assert!(
        sentence.contains("bridge \"viaduct24\" has 30 damage groups, but a logger has memory for 10"),
        "{sentence}"
    );
    assert!(!folder.path().join("v.model").exists());
}
