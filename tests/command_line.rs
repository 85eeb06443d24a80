//! The command line keeps its contract: flags, files, units and exit codes of the design's section 4.

mod program;

use std::fs;
use std::path::Path;

use tempfile::TempDir;

use program::host_sim;

/// Agreement with the independent histories that is asked for, relative RMS. Both programs take the same step and modes,
/// so what is left is rounding; the margin is for another scheme with another step error.
const DISPLACEMENT_TOLERANCE: f64 = 2e-3;
const ACCELERATION_TOLERANCE: f64 = 1e-2;
/// Exit code of bad input.
const BAD_INPUT: i32 = 2;

const PASSAGE: [&str; 9] = [
    "simulate",
    "--bridge",
    "girder50",
    "--train",
    "inspection-2dof",
    "--cars",
    "1",
    "--speed-kmh",
    "60",
];

fn folder() -> TempDir {
    TempDir::new().expect("a folder")
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8(bytes.to_vec()).expect("UTF-8")
}

fn succeeds(folder: &Path, arguments: &[&str]) -> String {
    let output = host_sim(folder, arguments);
    assert!(output.status.success(), "{arguments:?}: {}", text(&output.stderr));
    assert!(output.stderr.is_empty(), "not a terminal: {}", text(&output.stderr));
    text(&output.stdout)
}

/// The one sentence with which a command is refused, nothing having been written.
fn refusal(folder: &Path, arguments: &[&str]) -> String {
    let names = |folder: &Path| {
        let mut names: Vec<_> = (fs::read_dir(folder).expect("a folder"))
            .map(|entry| entry.expect("an entry").file_name())
            .collect();
        names.sort();
        names
    };
    let before = names(folder);
    let output = host_sim(folder, arguments);
    let sentence = text(&output.stderr);
    assert_eq!(output.status.code(), Some(BAD_INPUT), "{arguments:?}: {sentence}");
    assert!(
        output.stdout.is_empty(),
        "{arguments:?} printed {}",
        text(&output.stdout)
    );
    assert_eq!(names(folder), before, "{arguments:?} wrote something");
    assert!(sentence.starts_with("error: "), "{sentence}");
    sentence
}

fn columns(path: &Path) -> (Vec<String>, Vec<Vec<f64>>) {
    let text = fs::read_to_string(path).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
    let mut lines = text.lines();
    let header: Vec<String> = lines.next().expect("a header").split(',').map(str::to_owned).collect();
    let mut columns = vec![Vec::new(); header.len()];
    for line in lines {
        for (column, field) in columns.iter_mut().zip(line.split(',')) {
            column.push(field.parse().expect("a number"));
        }
    }
    (header, columns)
}

fn relative_rms(found: &[f64], expected: &[f64]) -> f64 {
    let square = |values: &mut dyn Iterator<Item = f64>| values.map(|v| v * v).sum::<f64>();
    let difference = square(&mut found.iter().zip(expected).map(|(f, e)| f - e));
    (difference / square(&mut expected.iter().copied())).sqrt()
}

#[test]
fn simulated_passages_agree_with_the_independent_histories() {
    let folder = folder();
    let reference = Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/data/reference");
    let track = reference.join("track_a.csv");
    let track = track.to_str().expect("a path in text");
    for (file, train, cars, speed_kmh, more) in [
        ("r1_2dof_1car_60kmh_healthy.csv", "inspection-2dof", "1", "60", &[][..]),
        (
            "r2_2dof_1car_60kmh_e1_21_e5_41.csv",
            "inspection-2dof",
            "1",
            "60",
            &["--damage", "1=0.21", "--damage", "5=0.41"][..],
        ),
        (
            "r3_3d_1car_120kmh_e5_11.csv",
            "shinkansen-3d",
            "1",
            "120",
            &["--damage", "element 5=0.11"][..],
        ),
        (
            "r4_3d_4car_270kmh_e5_30_track_a.csv",
            "shinkansen-3d",
            "4",
            "270",
            &["--damage", "5=0.3", "--track", track][..],
        ),
    ] {
        let (names, expected) = columns(&reference.join(file));
        for (quantity, first, tolerance) in [
            ("acceleration", 1, ACCELERATION_TOLERANCE),
            ("displacement", 4, DISPLACEMENT_TOLERANCE),
        ] {
            let flags = [
                "--nodes",
                "3,6,9",
                "--lead-s",
                "0",
                "--tail-s",
                "0",
                "--quantity",
                quantity,
                "-o",
                "x.csv",
            ];
            let passage = [
                "simulate",
                "--bridge",
                "girder50",
                "--train",
                train,
                "--cars",
                cars,
                "--speed-kmh",
                speed_kmh,
            ];
            succeeds(folder.path(), &[&passage[..], more, &flags].concat());
            let (header, found) = columns(&folder.path().join("x.csv"));
            assert_eq!(header[0], "time_s");
            assert_eq!(header[1..], names[first..first + 3]);
            assert_eq!(found[0].len(), expected[0].len(), "rows of {file}");
            assert_eq!(found[0], expected[0], "times of {file}");
            for channel in 0..3 {
                // The load appears at once in the first sample, which is therefore left out.
                let error = relative_rms(&found[channel + 1][1..], &expected[channel + first][1..]);
                println!("{file}, {}: {error:.1e}", header[channel + 1]);
                assert!(error < tolerance, "{file}, {}: {error}", header[channel + 1]);
            }
        }
    }
}

#[test]
fn all_twenty_modes_of_girder50_can_be_taken() {
    let folder = folder();
    let mid_span = |modes: &str| {
        let flags = [
            "--quantity",
            "displacement",
            "--modes",
            modes,
            "--lead-s",
            "0",
            "-o",
            "x.csv",
        ];
        succeeds(folder.path(), &[&PASSAGE[..], &flags].concat());
        columns(&folder.path().join("x.csv")).1.remove(1)
    };
    let all = mid_span("20");
    // A mode's share of the mid-span deflection falls with the fourth power of its number: 2 / pi^4 / 9^3 for the 9th.
    let eight = relative_rms(&mid_span("8"), &all);
    assert!(eight < 1e-3, "{eight}");
    assert!(eight > 0.0);
    assert!(
        refusal(
            folder.path(),
            &[&PASSAGE[..], &["--modes", "21", "-o", "y.csv"]].concat()
        )
        .contains("1 to 20")
    );
}

#[test]
fn a_simulated_passage_describes_itself() {
    let folder = folder();
    let flags = [
        "--damage",
        "5=0.11",
        "--rate-hz",
        "200",
        "--antialias-hz",
        "40",
        "--noise",
        "0.05",
        "--seed",
        "9",
    ];
    let printed = succeeds(folder.path(), &[&PASSAGE[..], &flags, &["-o", "x.csv"]].concat());
    assert!(
        printed.contains("x.csv") && printed.contains("x.toml") && printed.contains("200 Hz"),
        "{printed}"
    );
    let toml = fs::read_to_string(folder.path().join("x.toml")).expect("the TOML");
    for line in [
        "# True damage: element 5 11 %.",
        "bridge = \"girder50\"",
        "train = \"inspection-2dof\"",
        "cars = 1",
        "speed_kmh = 60.0",
        "entry_time_s = 1.0",
        "load_factor = 1.0",
        "antialias_hz = 40.0",
        "[[channel]]",
        "column = \"acc_node6_mps2\"",
        "node = 6",
        "unit = \"m/s2\"",
    ] {
        assert!(toml.lines().any(|found| found == line), "no line {line} in\n{toml}");
    }
    let (_, first) = columns(&folder.path().join("x.csv"));
    // 1 s lead, (50 + 17.5) m at 60 km/h, 2 s tail.
    assert_eq!(first[0].len(), 1410);

    // The comment tells how to make it again.
    let made = toml
        .lines()
        .next()
        .and_then(|line| line.strip_prefix("# Made by: host-sim "))
        .expect("a command");
    let again: Vec<&str> = made.split(' ').chain(["-o", "again.csv"]).collect();
    succeeds(folder.path(), &again);
    let bytes = |name: &str| fs::read(folder.path().join(name)).expect("a file");
    assert_eq!(bytes("x.csv"), bytes("again.csv"));
    assert_eq!(bytes("x.toml"), bytes("again.toml"));

    let other = [&PASSAGE[..], &flags[..8], &["--seed", "10", "-o", "other.csv"]].concat();
    succeeds(folder.path(), &other);
    assert_ne!(bytes("x.csv"), bytes("other.csv"));
}

const RECORDER: [&str; 4] = ["--rate-hz", "200", "--antialias-hz", "40"];

fn json(text: &str) -> serde_json::Value {
    serde_json::from_str(text).expect("one JSON object")
}

#[test]
fn what_is_withheld_is_left_out_of_the_toml_and_estimated() {
    let folder = folder();
    let flags = ["--noise", "0.02", "--withhold", "speed,entry,load", "-o", "x.csv"];
    succeeds(folder.path(), &[&PASSAGE[..], &RECORDER, &flags].concat());
    let toml = fs::read_to_string(folder.path().join("x.toml")).expect("the TOML");
    for key in ["speed_kmh", "entry_time_s", "load_factor"] {
        assert!(!toml.lines().any(|line| line.starts_with(key)), "{toml}");
    }
    assert!(toml.contains("--withhold speed,entry,load"), "{toml}");

    let found = json(&succeeds(folder.path(), &["identify", "x.csv", "--json"]));
    let number = |key: &str| found[key].as_f64().unwrap_or_else(|| panic!("no {key} in {found}"));
    // No worse than the ranges of the first guess.
    assert!((number("speed_kmh") / 60.0 - 1.0).abs() < 0.15, "{found}");
    assert!((number("entry_time_s") - 1.0).abs() < 0.4, "{found}");
    assert!((number("load_factor") - 1.0).abs() < 0.3, "{found}");
    assert_eq!(number("stiffness_factor"), 1.0);
    assert_eq!(
        found["estimated"],
        serde_json::json!(["speed_kmh", "entry_time_s", "load_factor"])
    );
    let words = succeeds(folder.path(), &["identify", "x.csv"]);
    assert_eq!(words.matches("(estimated)").count(), 3, "{words}");
}

#[test]
fn what_the_toml_gives_is_said_to_be_given_and_comes_back_as_it_is() {
    let folder = folder();
    succeeds(folder.path(), &[&PASSAGE[..], &RECORDER, &["-o", "x.csv"]].concat());
    let found = json(&succeeds(folder.path(), &["identify", "x.csv", "--json"]));
    assert_eq!(
        (
            &found["speed_kmh"],
            &found["entry_time_s"],
            &found["load_factor"],
            &found["estimated"]
        ),
        (&60.0.into(), &1.0.into(), &1.0.into(), &serde_json::json!([]))
    );
    let words = succeeds(folder.path(), &["identify", "x.csv"]);
    assert!(
        words
            .contains("\nTrain: speed 60.00 km/h (given), first axle enters at 1.000 s (given), load 1.000 (given).\n"),
        "{words}"
    );

    // With a range it is a first guess. (Without noise the samples say so much that a range beside them says nothing.)
    let noisy = ["--noise", "0.05", "-o", "x.csv"];
    succeeds(folder.path(), &[&PASSAGE[..], &RECORDER, &noisy].concat());
    let toml = fs::read_to_string(folder.path().join("x.toml")).expect("the TOML");
    let unsure = toml.replace(
        "\n[[channel]]",
        "\n[range]\nentry_s = 0.1\nstiffness = 0.05\n\n[[channel]]",
    );
    fs::write(folder.path().join("x.toml"), unsure).expect("written");
    let found = json(&succeeds(folder.path(), &["identify", "x.csv", "--json"]));
    assert_eq!(
        found["estimated"],
        serde_json::json!(["entry_time_s", "stiffness_factor"])
    );
    let words = succeeds(folder.path(), &["identify", "x.csv"]);
    assert!(
        words.contains("whole bridge") && words.contains("of its model's stiffness (estimated)"),
        "{words}"
    );
}

#[test]
fn of_several_passages_the_strongest_is_identified_and_that_is_said() {
    let folder = folder();
    let flags = [
        "--noise",
        "0.05",
        "--tail-s",
        "14",
        "--withhold",
        "entry",
        "-o",
        "x.csv",
    ];
    succeeds(folder.path(), &[&PASSAGE[..], &RECORDER, &flags].concat());
    let (_, columns) = columns(&folder.path().join("x.csv"));
    let (count, mut text) = (columns[0].len(), "time_s,acc_node6_mps2\n".to_owned());
    for (k, (loads, value)) in [1.0, 1.5, 1.0]
        .iter()
        .flat_map(|load| columns[1].iter().map(move |v| (load, v)))
        .enumerate()
    {
        text += &format!("{:.3},{}\n", 0.005 * k as f64, loads * value);
    }
    fs::write(folder.path().join("x.csv"), text).expect("written");
    let output = host_sim(folder.path(), &["identify", "x.csv", "--json"]);
    let note = self::text(&output.stderr);
    assert!(output.status.success(), "{note}");
    assert!(
        note.starts_with("note: x.csv: 3 passages; the strongest, at "),
        "{note}"
    );
    assert_eq!(note.lines().count(), 1, "{note}");
    let entry_s = json(&self::text(&output.stdout))["entry_time_s"]
        .as_f64()
        .expect("an entry time");
    assert!((entry_s - 0.005 * count as f64 - 1.0).abs() < 0.4, "{entry_s}");
}

#[test]
fn a_softer_bridge_is_one_that_has_lost_as_much_everywhere() {
    let folder = folder();
    let made = |name: &str, more: &[&str]| {
        succeeds(folder.path(), &[&PASSAGE[..], more, &["-o", name]].concat());
        columns(&folder.path().join(name)).1.remove(1)
    };
    let damage: Vec<String> = (1..=10)
        .map(|e| format!("--damage={e}={}", if e == 5 { 0.55 } else { 0.1 }))
        .collect();
    let damage: Vec<&str> = damage.iter().map(String::as_str).collect();
    let softer = made("soft.csv", &["--stiffness-factor", "0.9", "--damage", "5=0.5"]);
    // Written with nine digits.
    assert!(relative_rms(&softer, &made("damaged.csv", &damage)) < 1e-7);
    let toml = fs::read_to_string(folder.path().join("soft.toml")).expect("the TOML");
    assert!(
        toml.contains("--stiffness-factor 0.9") && toml.contains("# True damage: element 5 50 %."),
        "{toml}"
    );
    assert!(
        toml.contains("# True stiffness of the whole bridge: 0.9 of the model's."),
        "{toml}"
    );
}

#[test]
fn displacements_are_recorded_replayed_and_identified_beside_accelerations() {
    let folder = folder();
    let made = |name: &str, quantity: &str| {
        let flags = ["--damage", "5=0.3", "--quantity", quantity, "-o", name];
        succeeds(folder.path(), &[&PASSAGE[..], &RECORDER, &flags].concat());
        let read =
            |extension: &str| fs::read_to_string(folder.path().join(name).with_extension(extension)).expect("written");
        (read("csv"), read("toml"))
    };
    let ((acceleration, toml), (displacement, other)) = (made("a.csv", "acceleration"), made("d.csv", "displacement"));
    let mixed: String = (acceleration.lines().zip(displacement.lines()))
        .map(|(a, d)| format!("{a},{}\n", d.split(',').nth(1).expect("a value")))
        .collect();
    let channel = &other[other.find("[[channel]]").expect("a channel")..];
    fs::write(folder.path().join("m.csv"), mixed).expect("written");
    fs::write(folder.path().join("m.toml"), format!("{toml}\n{channel}")).expect("written");

    let found = json(&succeeds(folder.path(), &["identify", "m.csv", "--json"]));
    assert!(
        (found["damage"][4].as_f64().expect("element 5") - 0.3).abs() < 0.01,
        "{found}"
    );
    let said = succeeds(folder.path(), &["replay", "m.csv"]);
    assert!(said.contains("m/s² and ") && said.contains(" mm, level"), "{said}");
    let told = succeeds(folder.path(), &["replay", "m.csv", "--json"]);
    let passage = told
        .lines()
        .map(json)
        .find(|told| told["event"] == "passage")
        .expect("a passage");
    let peak_mm = passage["peak_mm"][1].as_f64().expect("a peak");
    assert!(
        (1.0..20.0).contains(&peak_mm) && passage["peak_mm"][0].is_null(),
        "{passage}"
    );
    assert!(
        passage["peak_mps2"][0].is_f64() && passage["peak_mps2"][1].is_null(),
        "{passage}"
    );
}

#[test]
fn bad_flags_of_simulate_are_refused_and_nothing_is_written() {
    let folder = folder();
    let cases: &[(&[&str], &str)] = &[
        (&["--bridge", "girder51"], "there is no bridge named \"girder51\""),
        (&["--bridge", "absent.toml"], "cannot read absent.toml"),
        (&["--train", "tram"], "there is no train \"tram\""),
        (&["--track", "absent.csv"], "absent.csv"),
        (&["--cars", "0"], "--cars must be 1 to 16, not 0"),
        (&["--cars", "17"], "--cars must be 1 to 16, not 17"),
        (&["--cars", "-3"], "--cars must be 1 to 16, not -3"),
        (&["--speed-kmh", "-60"], "--speed-kmh must be a positive number"),
        (&["--speed-kmh", "nan"], "--speed-kmh must be a positive number"),
        (&["--speed-kmh", "6000"], "--speed-kmh must be at most 1000"),
        (&["--speed-kmh", "0.0001"], "check --speed-kmh"),
        (&["--lead-s", "1e12"], "check --speed-kmh, --lead-s"),
        (&["--damage", "5"], "ELEMENT=FRACTION"),
        (&["--damage", "5=much"], "the fraction must be a number"),
        (&["--damage", "0=0.1"], "elements 1 to 10"),
        (&["--damage", "11=0.1"], "elements 1 to 10"),
        (&["--damage", "5=0.8"], "--damage of element 5 must be 0 to 0.7"),
        (&["--damage", "5=nan"], "--damage of element 5 must be 0 to 0.7"),
        (&["--damage", "5=0.1", "--damage", "5=0.2"], "names element 5 twice"),
        (&["--nodes", "12"], "no node 12; its nodes are 1 to 11"),
        (&["--nodes", "0"], "no node 0"),
        (&["--nodes", "6,6"], "names node 6 twice"),
        (&["--nodes", "2,4,6,8"], "1 to 3 nodes"),
        (&["--quantity", "velocity"], "velocity"),
        (&["--modes", "0"], "--modes must be 1 to 20"),
        (&["--step-s", "0"], "--step-s must be a positive number"),
        (&["--rate-hz", "300"], "does not divide the time between samples"),
        (&["--antialias-hz", "600"], "--antialias-hz 600 needs steps shorter"),
        (&["--noise", "-0.1"], "--noise must be zero or positive"),
        (&["--load-factor", "0"], "--load-factor must be a positive number"),
        (&["--stiffness-factor", "0.2"], "--stiffness-factor must be 0.3 to 2"),
        (
            &["--stiffness-factor", "nan"],
            "--stiffness-factor must be a positive number",
        ),
        (&["--withhold", "mass"], "mass"),
        (&["--tail-s", "-1"], "--tail-s must be zero or positive"),
        (&["-o", "x.txt"], "x.txt: a recording is named by its file .csv"),
        (&["-o", "absent/x.csv"], "its folder does not exist"),
        (&["--surprise"], "--surprise"),
    ];
    for (flags, expected) in cases {
        // A flag given again would be refused for that alone, so the good one is left out.
        let mut arguments: Vec<&str> = vec![PASSAGE[0]];
        for pair in PASSAGE[1..].chunks(2).chain([&["-o", "x.csv"][..]]) {
            if !flags.contains(&pair[0]) {
                arguments.extend(pair);
            }
        }
        arguments.extend(*flags);
        let sentence = refusal(folder.path(), &arguments);
        println!("{}", sentence.lines().next().unwrap_or(""));
        assert!(sentence.contains(expected), "\"{sentence}\" should say \"{expected}\"");
    }
}

#[test]
fn a_recording_never_overwrites_the_bridge_it_is_made_from() {
    let folder = folder();
    let bridge = include_str!("../host-sim/bridges/girder50.toml");
    fs::write(folder.path().join("mine.toml"), bridge).expect("written");
    let arguments = |out| {
        let mut all = PASSAGE.to_vec();
        all[2] = "mine.toml";
        all.extend(["-o", out]);
        all
    };
    assert!(refusal(folder.path(), &arguments("mine.csv")).contains("would overwrite the bridge file"));
    assert!(refusal(folder.path(), &["model", "build", "mine.toml", "-o", "mine.toml"]).contains("would overwrite"));
    succeeds(folder.path(), &arguments("passage.csv"));
    assert_eq!(
        fs::read_to_string(folder.path().join("mine.toml")).expect("still there"),
        bridge
    );
}

#[test]
fn a_recording_never_overwrites_the_train_or_the_track_it_is_made_from() {
    let folder = folder();
    let train = include_str!("../host-sim/trains/rdso-test.toml");
    fs::write(folder.path().join("train.toml"), train).expect("written");
    succeeds(
        folder.path(),
        &[
            "track",
            "generate",
            "--spectrum",
            "fra6",
            "--seed",
            "1",
            "-o",
            "track.csv",
        ],
    );
    let track = fs::read(folder.path().join("track.csv")).expect("a track");
    let passage = ["simulate", "--bridge", "girder50", "--speed-kmh", "60"];
    let train_run = ["--train", "train.toml", "-o", "train.csv"];
    let track_run = [
        "--train",
        "inspection-2dof",
        "--cars",
        "1",
        "--track",
        "track.csv",
        "-o",
        "track.csv",
    ];
    for (more, what) in [(&train_run[..], "train"), (&track_run[..], "track")] {
        let sentence = refusal(folder.path(), &[&passage[..], more].concat());
        assert!(
            sentence.contains(&format!("would overwrite the {what} file")),
            "{sentence}"
        );
    }
    assert_eq!(
        fs::read_to_string(folder.path().join("train.toml")).expect("there"),
        train
    );
    assert_eq!(fs::read(folder.path().join("track.csv")).expect("there"), track);
}

#[test]
fn a_frame_is_simulated_with_the_modes_that_bend_under_wheels() {
    // The eight lowest modes of the viaduct sway; a girder's default would show next to nothing of a train.
    let folder = folder();
    let largest = |more: &[&str]| {
        let passage = [
            "simulate",
            "--bridge",
            "viaduct24",
            "--train",
            "inspection-2dof",
            "--cars",
            "1",
        ];
        let run = [
            "--speed-kmh",
            "200",
            "--nodes",
            "1",
            "--step-s",
            "0.005",
            "--rate-hz",
            "200",
            "--tail-s",
            "0",
        ];
        succeeds(folder.path(), &[&passage[..], &run, more, &["-o", "x.csv"]].concat());
        let (_, found) = columns(&folder.path().join("x.csv"));
        found[1].iter().fold(0.0_f64, |most, a| most.max(a.abs()))
    };
    assert!(largest(&[]) > 20.0 * largest(&["--modes", "8"]));
}

#[test]
fn a_model_is_built_and_shown() {
    let folder = folder();
    succeeds(folder.path(), &["model", "build", "girder50", "-o", "girder.model"]);
    let shown = succeeds(folder.path(), &["model", "show", "girder.model", "--svg", "modes.svg"]);
    for expected in [
        "girder50",
        "50 m",
        "3.5000",
        "14.0015",
        "87.845",
        "format version 1",
        "CRC-32C 0x",
        "▲",
    ] {
        assert!(shown.contains(expected), "no {expected} in\n{shown}");
    }
    assert_eq!(shown, succeeds(folder.path(), &["model", "show", "girder50"]));
    assert!(!shown.contains('\u{1b}'), "colours in a pipe");
    let svg = fs::read_to_string(folder.path().join("modes.svg")).expect("the picture");
    assert!(svg.starts_with("<svg") && svg.contains("mode 3: 31.517 Hz") && svg.contains("sans-serif"));

    // The same bytes from the same bridge, whether by name or by file.
    fs::write(
        folder.path().join("b.toml"),
        include_str!("../host-sim/bridges/girder50.toml"),
    )
    .expect("written");
    succeeds(folder.path(), &["model", "build", "b.toml", "-o", "again.model"]);
    let bytes = |name: &str| fs::read(folder.path().join(name)).expect("a model");
    assert_eq!(bytes("girder.model"), bytes("again.model"));
}

#[test]
fn models_that_cannot_be_trusted_are_refused() {
    let folder = folder();
    succeeds(folder.path(), &["model", "build", "girder50", "-o", "good.model"]);
    let good = fs::read(folder.path().join("good.model")).expect("a model");
    let shown = |change: &dyn Fn(&mut Vec<u8>)| {
        let mut bytes = good.clone();
        change(&mut bytes);
        fs::write(folder.path().join("bad.model"), bytes).expect("written");
        refusal(folder.path(), &["model", "show", "bad.model"])
    };
    assert!(shown(&|bytes| bytes[4] = 9).contains("format version 9, this program reads version 1"));
    assert!(shown(&|bytes| bytes[1000] ^= 1).contains("checksum is wrong"));
    assert!(shown(&|bytes| bytes.truncate(100)).contains("checksum is wrong"));
    assert!(shown(&|bytes| bytes.truncate(3)).contains("cut off"));
    assert!(shown(&|bytes| bytes.fill(0)).contains("not a bridge model"));
    assert!(shown(&|bytes| bytes.resize(2 << 20, 0)).contains("larger than any"));
    assert!(refusal(folder.path(), &["model", "show", "absent"]).contains("no model file absent"));
    let picture = ["model", "show", "good.model", "--svg", "absent/x.svg"];
    assert!(refusal(folder.path(), &picture).contains("its folder does not exist"));
}

#[test]
fn bridge_files_with_mistakes_are_refused_by_line() {
    let folder = folder();
    let good = include_str!("../host-sim/bridges/girder50.toml");
    for (from, to, expected) in [
        (
            "length_m = 50.0",
            "length_m = -50.0",
            "length_m must be a positive number",
        ),
        ("elements = 10", "elements = 11", "elements must be 2 to 10"),
        (
            "elements = 10",
            "element = 10",
            "line 12, column 1: unknown field `element`",
        ),
        ("elements = 10", "elements = ", "line 12, column"),
        ("supports = [1, 11]", "supports = [1]", "the girder can fall"),
        ("supports = [1, 11]", "supports = [1, 12]", "names node 12"),
        ("damping_ratio = 0.02", "", "missing field `damping_ratio`"),
    ] {
        assert!(good.contains(from), "{from}");
        fs::write(folder.path().join("b.toml"), good.replace(from, to)).expect("written");
        let sentence = refusal(folder.path(), &["model", "build", "b.toml", "-o", "b.model"]);
        println!("{}", sentence.trim_end());
        assert!(
            sentence.contains("b.toml") && sentence.contains(expected),
            "\"{sentence}\" should say \"{expected}\""
        );
        assert_eq!(sentence.trim_end().lines().count(), 1, "{sentence}");
    }
}

#[test]
fn a_sudden_loss_is_believed_when_a_second_passage_agrees_though_the_logger_restarts_in_between() {
    let folder = folder();
    let simulate = |name: &str, seed: &str, damage: &[&str]| {
        let noise = ["--noise", "0.05", "--nodes", "3,6,9", "--seed", seed, "-o", name];
        let recorder = ["--rate-hz", "200", "--antialias-hz", "40"];
        succeeds(folder.path(), &[&PASSAGE[..], &recorder, damage, &noise].concat());
    };
    simulate("whole1.csv", "1", &[]);
    simulate("whole2.csv", "2", &[]);
    simulate("lost1.csv", "3", &["--damage", "5=0.2"]);
    simulate("lost2.csv", "4", &["--damage", "5=0.2"]);
    // Each call is a logger of its own: what it knows comes from the file and goes into it.
    let said: Vec<(String, Option<f64>)> = ["whole1.csv", "whole2.csv", "lost1.csv", "lost2.csv"]
        .into_iter()
        .map(|recording| {
            let text = succeeds(folder.path(), &["replay", recording, "--evidence", "e", "--json"]);
            let of = |event: &str| text.lines().map(json).find(|line| line["event"] == event);
            let change = of("passage").expect("a passage")["change"]
                .as_str()
                .expect("a word")
                .to_owned();
            (
                change,
                of("alert").map(|alert| alert["passages"].as_f64().expect("a number")),
            )
        })
        .collect();
    let expected = [
        ("none", None),
        ("none", None),
        ("outlier", Some(1.0)),
        ("sudden", Some(2.0)),
    ];
    assert_eq!(said, expected.map(|(change, passages)| (change.to_owned(), passages)));
}
