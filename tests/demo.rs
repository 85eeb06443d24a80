//! The demo: a healthy passage is reported healthy, a damaged one is located, the alert is decoded and stored, and each
//! passage has its picture. The same recordings through a logger on a TCP line say the same.

use std::fs;
use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::{Command, Stdio};

use rusqlite::Connection;
use tempfile::TempDir;

#[test]
fn the_demo_shows_the_whole_way() {
    let folder = TempDir::new().expect("a folder");
    let output = Command::new(env!("CARGO_BIN_EXE_host-sim"))
        .current_dir(folder.path())
        .args(["demo", "--out", "shown"])
        .output()
        .expect("host-sim runs");
    let text = String::from_utf8(output.stdout).expect("text");
    assert!(output.status.success(), "{text}");
    assert!(text.contains("Healthy"), "{text}");
    let alerts: Vec<&str> = text.lines().filter(|line| line.contains("ALERT")).collect();
    let [inspection, express] = alerts.as_slice() else {
        panic!("{text}")
    };
    assert!(
        inspection.contains("element 1") && inspection.contains("element 5"),
        "{inspection}"
    );
    assert!(
        !inspection.contains("element 4") && !inspection.contains("element 6"),
        "{inspection}"
    );
    assert!(
        express.contains("element 5") && !express.contains("element 1 "),
        "{express}"
    );

    let shown = folder.path().join("shown");
    for picture in [
        "healthy-60kmh-noise5-3nodes.svg",
        "case4-60kmh-noise5-3nodes.svg",
        "case8-3d-270kmh-noise2-3nodes.svg",
    ] {
        assert!(
            fs::read_to_string(shown.join(picture))
                .expect("a picture")
                .starts_with("<svg"),
            "{picture}"
        );
    }
    let store = Connection::open(shown.join("alerts.sqlite")).expect("stored");
    let damaged: Vec<i64> = store
        .prepare("SELECT element FROM alert_element WHERE certain = 1 ORDER BY rowid")
        .expect("tables")
        .query_map([], |row| row.get(0))
        .expect("rows")
        .map(|element| element.expect("a number"))
        .collect();
    assert_eq!(damaged, [1, 5, 5]);
}

#[test]
fn a_logger_on_a_tcp_line_says_the_same_as_one_in_the_program() {
    let folder = TempDir::new().expect("a folder");
    let mut logger = Command::new(env!("CARGO_BIN_EXE_host-sim"))
        .args(["logger", "--listen", "127.0.0.1:0"])
        .stdout(Stdio::piped())
        .spawn()
        .expect("host-sim runs");
    let mut line = String::new();
    BufReader::new(logger.stdout.take().expect("piped"))
        .read_line(&mut line)
        .expect("an address");
    let address = line
        .split_whitespace()
        .find(|word| word.starts_with("127."))
        .expect("an address");
    let via = format!("tcp:{}", address.trim_end_matches(';'));
    let recordings = Path::new(env!("CARGO_MANIFEST_DIR")).join("recordings");
    let replay = |via: &str| {
        let output = Command::new(env!("CARGO_BIN_EXE_host-sim"))
            .current_dir(folder.path())
            .args(["replay", "--json", "--via", via])
            .args(["healthy-60kmh.csv", "case4-60kmh.csv"].map(|name| recordings.join(name)))
            .output()
            .expect("host-sim runs");
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        let text = String::from_utf8(output.stdout).expect("text");
        // How often the base station had to ask whether the logger is still busy differs.
        text.lines()
            .filter(|line| !line.contains("summary"))
            .map(str::to_owned)
            .collect::<Vec<_>>()
    };
    let over_tcp = replay(&via);
    let again = replay(&via);
    logger.kill().expect("it runs");
    logger.wait().expect("it ends");
    assert_eq!(over_tcp.len(), 3);
    assert_eq!(over_tcp, replay("inproc"));
    assert_eq!(again, over_tcp, "a logger that has been used before says the same");
}
