//! Bad input gets one clear sentence on standard error and exit code 2, and nothing is written. Through the binary, as a
//! user meets it; tests/recordings.rs holds the sentences for recordings one by one.

mod program;

use std::fs;
use std::io::{Read, Write};
use std::net::TcpListener;
use std::path::Path;
use std::thread;

use tempfile::TempDir;

use program::host_sim;

const TOML: &str = "bridge = \"girder50\"\ntrain = \"inspection-2dof\"\ncars = 1\nspeed_kmh = 60.0\nentry_time_s = 1.0\n\
                    load_factor = 1.0\nantialias_hz = 40.0\n[[channel]]\ncolumn = \"acc_node6_mps2\"\nnode = 6\nunit = \"m/s2\"\n";

fn shipped(name: &str) -> String {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("recordings");
    fs::read_to_string(folder.join(name)).expect("a shipped recording")
}

/// Runs a command that must fail; its sentence must hold all of `words`.
fn refused(folder: &TempDir, arguments: &[&str], words: &[&str]) {
    let before = names(folder);
    let output = host_sim(folder.path(), arguments);
    let error = String::from_utf8(output.stderr).expect("text");
    println!("{error}");
    assert_eq!(output.status.code(), Some(2), "{arguments:?}: {error}");
    assert!(
        error.starts_with("error: ") && error.trim_end().lines().count() == 1,
        "{error}"
    );
    for word in words {
        assert!(error.contains(word), "{error:?} does not say {word:?}");
    }
    assert_eq!(names(folder), before, "{arguments:?} has written something");
}

/// The header and as many rows of a recording.
fn first_rows(csv: &str, rows: usize) -> String {
    csv.lines().take(rows + 1).map(|line| format!("{line}\n")).collect()
}

fn names(folder: &TempDir) -> Vec<String> {
    let mut names: Vec<String> = fs::read_dir(folder)
        .expect("a folder")
        .map(|entry| entry.expect("an entry").file_name().to_string_lossy().into_owned())
        .collect();
    names.sort();
    names
}

#[test]
fn bad_recordings_are_refused_by_replay_and_by_identify() {
    let csv = shipped("case1-60kmh.csv");
    let cases: [(&str, String, String, &[&str]); 7] = [
        (
            "a missing column",
            csv.clone(),
            TOML.replace("acc_node6_mps2", "acc_node7_mps2"),
            &["acc_node7_mps2"],
        ),
        (
            "not a number",
            csv.lines()
                .enumerate()
                .map(|(i, line)| {
                    if i == 500 {
                        "2.495,NaN\n".to_owned()
                    } else {
                        format!("{line}\n")
                    }
                })
                .collect(),
            TOML.to_owned(),
            &["501", "NaN"],
        ),
        (
            "a wrong unit",
            csv.clone(),
            TOML.replace("m/s2", "ft/s2"),
            &["ft/s2", "gal"],
        ),
        ("no samples", first_rows(&csv, 0), TOML.to_owned(), &["rec.csv"]),
        (
            "an unknown bridge",
            csv.clone(),
            TOML.replace("girder50", "girder51"),
            &["girder51", "girder50"],
        ),
        (
            "a node that is not there",
            csv.clone(),
            TOML.replace("node = 6", "node = 12"),
            &["node 12", "1 to 11"],
        ),
        (
            "an unknown train",
            csv.clone(),
            TOML.replace("inspection-2dof", "tram"),
            &["tram", "inspection-2dof"],
        ),
    ];
    for (what, csv, toml, words) in cases {
        println!("{what}:");
        let folder = TempDir::new().expect("a folder");
        fs::write(folder.path().join("rec.csv"), csv).expect("written");
        fs::write(folder.path().join("rec.toml"), toml).expect("written");
        refused(&folder, &["replay", "rec.csv"], words);
        refused(&folder, &["identify", "rec.csv"], words);
    }
}

#[test]
fn identify_says_what_it_needs() {
    let csv = shipped("case1-60kmh.csv");
    let folder = TempDir::new().expect("a folder");
    fs::write(folder.path().join("rec.csv"), first_rows(&csv, 599)).expect("written");
    fs::write(folder.path().join("rec.toml"), TOML).expect("written");
    refused(&folder, &["identify", "rec.csv"], &["shorter than the passage"]);
    let without = TOML
        .replace("bridge = \"girder50\"\n", "")
        .replace("train = \"inspection-2dof\"\ncars = 1\n", "");
    fs::write(folder.path().join("rec.toml"), without).expect("written");
    refused(&folder, &["identify", "rec.csv"], &["must give bridge and train"]);
    fs::write(
        folder.path().join("rec.toml"),
        TOML.replace("entry_time_s = 1.0", "entry_time_s = 99.0"),
    )
    .expect("written");
    refused(&folder, &["identify", "rec.csv"], &["entry_time_s"]);
    refused(&folder, &["identify", "absent.csv"], &["absent.csv"]);
}

#[test]
fn a_recording_without_a_passage_does_not_tell_when_or_how_fast_the_train_was() {
    // Four tenths of a second before the train, 0.9 s of silence and what the converter adds.
    let quiet = first_rows(&shipped("healthy-60kmh.csv"), 180);
    let folder = TempDir::new().expect("a folder");
    fs::write(folder.path().join("rec.csv"), quiet).expect("written");
    let without = TOML.replace("entry_time_s = 1.0\n", "");
    fs::write(folder.path().join("rec.toml"), &without).expect("written");
    refused(
        &folder,
        &["identify", "rec.csv"],
        &["no passage is found", "entry_time_s"],
    );

    // The passage is there, but not when the train is said to have entered.
    fs::write(folder.path().join("rec.csv"), late_passage()).expect("written");
    let elsewhere = TOML
        .replace("entry_time_s = 1.0", "entry_time_s = 0.5")
        .replace("speed_kmh = 60.0\n", "");
    fs::write(folder.path().join("rec.toml"), elsewhere).expect("written");
    refused(
        &folder,
        &["identify", "rec.csv"],
        &["no passage is found at 0.5 s", "speed_kmh"],
    );

    // Sixteen cars cannot have been there for so short a time.
    fs::write(
        folder.path().join("rec.toml"),
        without
            .replace("cars = 1", "cars = 16")
            .replace("speed_kmh = 60.0\n", ""),
    )
    .expect("written");
    fs::write(
        folder.path().join("rec.csv"),
        first_rows(&shipped("healthy-60kmh.csv"), 700),
    )
    .expect("written");
    refused(
        &folder,
        &["identify", "rec.csv"],
        &["no speed between 20 and 400 km/h", "cars"],
    );
}

/// Five seconds of a quiet sensor, then a train.
fn late_passage() -> String {
    let csv = shipped("healthy-60kmh-noise5-3nodes.csv");
    let rows: Vec<&str> = csv.lines().skip(1).collect();
    let value = |row: &str| row.split(',').nth(2).expect("node 6").to_owned();
    let mut text = "time_s,acc_node6_mps2\n".to_owned();
    for (k, row) in rows.iter().take(190).cycle().take(1000).chain(&rows).enumerate() {
        text += &format!("{:.3},{}\n", 0.005 * k as f64, value(row));
    }
    text
}

#[test]
fn a_recording_of_displacements_alone_is_refused() {
    let folder = TempDir::new().expect("a folder");
    fs::write(folder.path().join("rec.csv"), shipped("case1-60kmh.csv")).expect("written");
    fs::write(folder.path().join("rec.toml"), TOML.replace("m/s2", "mm")).expect("written");
    for command in ["identify", "replay"] {
        refused(
            &folder,
            &[command, "rec.csv"],
            &["rec.csv", "at least one channel must measure an acceleration"],
        );
    }
}

#[test]
fn a_recording_that_ends_within_the_passage_is_replayed_and_not_taken_for_damage() {
    let csv = shipped("healthy-60kmh.csv");
    let folder = TempDir::new().expect("a folder");
    fs::write(folder.path().join("rec.csv"), first_rows(&csv, 599)).expect("written");
    fs::write(folder.path().join("rec.toml"), TOML).expect("written");
    let output = host_sim(folder.path(), &["replay", "rec.csv", "--json"]);
    let text = String::from_utf8(output.stdout).expect("text");
    assert!(output.status.success(), "{text}");
    assert_eq!(text.lines().count(), 2, "{text}");
    assert!(
        text.lines().next().is_some_and(|line| line.contains("\"undecided\"")),
        "{text}"
    );
}

#[test]
fn a_model_of_another_version_or_with_a_changed_byte_is_refused() {
    let folder = TempDir::new().expect("a folder");
    assert!(
        host_sim(folder.path(), &["model", "build", "girder50", "-o", "good.blob"])
            .status
            .success()
    );
    let good = fs::read(folder.path().join("good.blob")).expect("built");
    let mut other = good.clone();
    other[4] += 1;
    let mut changed = good.clone();
    changed[100] ^= 1;
    for (name, bytes, words) in [
        ("version.blob", &other[..], ["version"]),
        ("changed.blob", &changed[..], ["checksum"]),
        ("cut.blob", &good[..2], ["cut off"]),
        ("text.blob", b"hello, world", ["not a bridge model"]),
    ] {
        fs::write(folder.path().join(name), bytes).expect("written");
        refused(&folder, &["model", "show", name], &words);
    }
}

#[test]
fn a_line_that_is_not_a_logger_is_said_to_be_none() {
    let folder = TempDir::new().expect("a folder");
    for name in ["case1-60kmh.csv", "case1-60kmh.toml"] {
        fs::write(folder.path().join(name), shipped(name)).expect("written");
    }
    refused(
        &folder,
        &["replay", "case1-60kmh.csv", "--via", "serial:/dev/absent"],
        &["/dev/absent"],
    );
    refused(
        &folder,
        &["replay", "case1-60kmh.csv", "--via", "qemu", "--image", "absent"],
        &["absent", "build-firmware.sh"],
    );

    // Someone answers with garbage and hangs up.
    let listener = TcpListener::bind("127.0.0.1:0").expect("a port");
    let via = format!("tcp:{}", listener.local_addr().expect("an address"));
    let other = thread::spawn(move || {
        let (mut line, _) = listener.accept().expect("a caller");
        let _ = line.write_all(&[0x00, 0x11, 0x22, 0x00, 0xff, 0xff, 0x00]);
        let _ = line.read(&mut [0; 4096]);
    });
    refused(&folder, &["replay", "case1-60kmh.csv", "--via", &via], &["logger"]);
    other.join().expect("no panic");
}

#[test]
fn garbage_on_the_line_is_counted_and_does_no_harm() {
    let folder = TempDir::new().expect("a folder");
    for name in ["case1-60kmh.csv", "case1-60kmh.toml"] {
        fs::write(folder.path().join(name), shipped(name)).expect("written");
    }
    // A logger behind a line that adds noise between the frames, in both directions.
    let listener = TcpListener::bind("127.0.0.1:0").expect("a port");
    let via = format!("tcp:{}", listener.local_addr().expect("an address"));
    thread::spawn(move || {
        let (line, _) = listener.accept().expect("a caller");
        noisy_logger(line);
    });
    let output = host_sim(folder.path(), &["replay", "case1-60kmh.csv", "--json", "--via", &via]);
    let text = String::from_utf8(output.stdout).expect("text");
    assert!(
        output.status.success(),
        "{text} {}",
        String::from_utf8_lossy(&output.stderr)
    );
    let summary: serde_json::Value = serde_json::from_str(text.lines().last().expect("a summary")).expect("JSON");
    assert_eq!(summary["event"], "summary");
    assert_eq!(summary["alerts"], 1);
    assert!(
        summary["rejected"].as_u64().is_some_and(|rejected| rejected > 10),
        "{summary}"
    );
}

/// A logger whose line carries garbage between the frames.
fn noisy_logger(mut line: std::net::TcpStream) {
    use host_sim::channel::{Channel, InProcess};
    const GARBAGE: [u8; 9] = [0x00, 0x05, 0xde, 0xad, 0xbe, 0xef, 0x00, 0x03, 0x00];
    let mut logger = InProcess::new();
    let mut buffer = [0; 4096];
    while let Ok(count @ 1..) = line.read(&mut buffer) {
        // Whole frames come: the base station waits for each answer.
        let _ = logger.send(&GARBAGE);
        let _ = logger.send(&buffer[..count]);
        while let Ok(count @ 1..) = logger.receive(&mut buffer, std::time::Duration::ZERO) {
            if line
                .write_all(&GARBAGE)
                .and_then(|()| line.write_all(&buffer[..count]))
                .is_err()
            {
                return;
            }
        }
    }
}

#[test]
fn a_place_where_no_alert_can_be_stored_is_refused_before_anything_is_replayed() {
    let folder = TempDir::new().expect("a folder");
    for name in ["case1-60kmh.csv", "case1-60kmh.toml"] {
        fs::write(folder.path().join(name), shipped(name)).expect("written");
    }
    fs::write(
        folder.path().join("notes.txt"),
        "no database, but longer than the header of one would have to be, so that it is read: ",
    )
    .expect("written");
    refused(
        &folder,
        &["replay", "case1-60kmh.csv", "--database", "notes.txt"],
        &["notes.txt"],
    );
    refused(
        &folder,
        &["replay", "case1-60kmh.csv", "--database", "absent/x.sqlite"],
        &["absent/x.sqlite"],
    );
}

#[test]
fn calibrate_says_what_keeps_it_from_learning() {
    let folder = TempDir::new().expect("a folder");
    let csv = shipped("healthy-60kmh.csv");
    let write = |stem: &str, toml: &str| {
        fs::write(folder.path().join(format!("{stem}.csv")), &csv).expect("written");
        fs::write(folder.path().join(format!("{stem}.toml")), toml).expect("written");
    };
    for stem in ["a", "b", "c"] {
        write(stem, TOML);
    }
    let learn = |recordings: &[&str], words: &[&str]| {
        let arguments = [&["calibrate"], recordings, &["-o", "track.blob", "--svg", "track.svg"]].concat();
        refused(&folder, &arguments, words);
    };
    learn(&["a.csv", "absent.csv"], &["absent.csv"]);
    let copies = ["only 1 of 3", "5 at least", "b.csv: it is the same passage as a.csv"];
    learn(&["a.csv", "b.csv", "c.csv"], &copies);

    write(
        "other",
        &TOML.replace("girder50", "twospan").replace("node = 6", "node = 5"),
    );
    learn(
        &["a.csv", "other.csv"],
        &["a.csv", "girder50", "other.csv", "twospan", "one bridge"],
    );
    write("other", &TOML.replace("train = \"inspection-2dof\"\ncars = 1\n", ""));
    learn(&["a.csv", "other.csv"], &["other.csv", "train"]);
    write("other", &TOML.replace("node = 6", "node = 5"));
    learn(&["a.csv", "other.csv"], &["a.csv", "other.csv", "different sensors"]);
    write("other", &TOML.replace("entry_time_s = 1.0", "entry_time_s = 99.0"));
    learn(&["other.csv"], &["other.csv", "entry_time_s", "nothing is left"]);

    refused(&folder, &["calibrate", "a.csv", "-o", "a.csv"], &["a.csv", "overwrite"]);
    refused(
        &folder,
        &["calibrate", "a.csv", "-o", "track.blob", "--svg", "track.blob"],
        &["-o", "--svg", "same file"],
    );
    refused(&folder, &["calibrate", "a.csv", "-o", "absent/track.blob"], &["absent"]);
}
