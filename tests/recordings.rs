//! Recordings: what is written can be read again, real recorders' habits are understood, and everything that cannot be
//! is refused with one sentence that says where.

use std::fs;
use std::path::{Path, PathBuf};

use host_sim::recording::{
    Channel, DEFAULT_FULL_SCALE_COUNTS, DEFAULT_LSB_M, DEFAULT_LSB_MPS2, Margins, Recording, Run, Unit,
};
use host_sim::replay;
use host_sim::train::TrainName;
use spanwatch::interaction::Direction;
use spanwatch::wire::message::{Ranges, TrainKind};
use tempfile::TempDir;

const TOML: &str = r#"bridge = "girder50"
train = "inspection-2dof"
cars = 1
speed_kmh = 60
entry_time_s = 1.0
load_factor = 1.0
antialias_hz = 40.0

[[channel]]
column = "acc_node6_mps2"
node = 6
unit = "m/s2"
"#;
const CSV: &str = "time_s,acc_node6_mps2\n0.000,0.1\n0.005,-0.2\n0.010,0.3\n";

/// 60 km/h.
const SPEED_MPS: f32 = (60.0_f64 / 3.6) as f32;
/// Values are written with nine digits.
const WRITTEN_DIGITS: f64 = 1e-8;

fn written(csv: &str, toml: Option<&str>) -> (TempDir, PathBuf) {
    let folder = TempDir::new().expect("a folder");
    let path = folder.path().join("rec.csv");
    fs::write(&path, csv).expect("written");
    if let Some(toml) = toml {
        fs::write(path.with_extension("toml"), toml).expect("written");
    }
    (folder, path)
}

fn read(csv: &str, toml: &str) -> Recording {
    let (_folder, path) = written(csv, Some(toml));
    Recording::read(&path).unwrap_or_else(|error| panic!("{error:#}"))
}

/// The sentence with which a recording is refused, without the folder.
fn refusal(csv: &str, toml: &str) -> String {
    let (folder, path) = written(csv, Some(toml));
    let error = Recording::read(&path).expect_err("this recording must be refused");
    let sentence = format!("{error:#}").replace(&format!("{}/", folder.path().display()), "");
    assert!(!sentence.contains('\n'), "more than one line: {sentence}");
    sentence
}

#[test]
fn a_recording_says_what_section_4_of_the_design_says() {
    let recording = read(CSV, TOML);
    assert_eq!(recording.bridge.as_deref(), Some("girder50"));
    assert_eq!(recording.train, Some(TrainName::Known(TrainKind::Inspection2Dof)));
    assert_eq!(recording.cars, Some(1));
    assert_eq!(recording.speed_kmh, Some(60.0));
    assert_eq!(recording.entry_time_s, Some(1.0));
    assert_eq!(recording.load_factor, Some(1.0));
    assert_eq!(recording.antialias_hz, Some(40.0));
    assert_eq!(recording.track, None);
    assert!((recording.rate_hz() - 200.0).abs() < 1e-9);
    let channel = &recording.channels[0];
    assert_eq!((channel.node, channel.unit), (Some(6), Unit::MetrePerSecondSquared));
    assert_eq!(channel.values, [0.1, -0.2, 0.3]);
}

#[test]
fn units_are_converted_and_further_columns_passed_over() {
    let toml = "[[channel]]\ncolumn = \"a\"\nunit = \"g\"\n[[channel]]\ncolumn = \"b\"\nunit = \"gal\"\n";
    let recording = read("time_s,b,force_kN,a\r\n0, 100, n/a, 0.5\r\n0.01, -50, 7, 1\r\n", toml);
    assert_eq!(recording.channels[0].values, [0.5 * 9.80665, 9.80665]);
    assert_eq!(recording.channels[1].values, [1.0, -0.5]);
    assert_eq!((recording.bridge, recording.train, recording.cars), (None, None, None));
}

#[test]
fn accelerations_and_displacements_stand_beside_each_other() {
    let toml = format!(
        "{TOML}\n[[channel]]\ncolumn = \"d\"\nnode = 6\nunit = \"mm\"\n[[channel]]\ncolumn = \"e\"\nnode = 3\nunit = \"mm\"\nlsb_mm = 0.5\n"
    );
    let recording = read(
        "time_s,acc_node6_mps2,d,e\n0,0.1,-2,0.74\n0.005,-0.2,1e-3,-1e9\n",
        &toml,
    );
    assert_eq!(recording.channels[1].values, [-2e-3, 1e-6]);
    assert_eq!(
        (recording.channels[1].lsb, recording.channels[2].lsb),
        (DEFAULT_LSB_M, 5e-4)
    );
    let counts = recording.to_counts();
    assert_eq!(counts[1], (-2e-3 / f64::from(DEFAULT_LSB_M)).round() as i32);
    assert_eq!((counts[2], counts[5]), (1, -DEFAULT_FULL_SCALE_COUNTS));
    // The converter that is assumed: 24 bits over ± 100 mm.
    assert!((f64::from(DEFAULT_LSB_M) * f64::from(1 << 24) / 0.2 - 1.0).abs() < 1e-7);
}

#[test]
fn what_the_toml_gives_is_held_and_what_it_does_not_give_or_calls_unsure_is_not() {
    let told = |toml: &str| {
        let (_folder, path) = written(CSV, Some(toml));
        let prepared = replay::prepare(&path, None, 1).unwrap_or_else(|error| panic!("{error:#}"));
        prepared.configuration.traffic.expect("a train")
    };
    let traffic = told(TOML);
    assert_eq!(traffic.ranges, Ranges::HELD);
    assert_eq!((traffic.speed_mps, traffic.entry_time_s), (Some(SPEED_MPS), Some(1.0)));

    let without: String = (TOML.lines())
        .filter(|line| !["speed", "entry", "load"].iter().any(|key| line.starts_with(key)))
        .map(|line| format!("{line}\n"))
        .collect();
    let traffic = told(&without);
    assert_eq!((traffic.speed_mps, traffic.entry_time_s), (None, None));
    // An absent load factor is estimated, not 1; the bridge's stiffness is held even then.
    assert_eq!(traffic.load_factor, 1.0);
    let ranges = Ranges {
        load: 0.3,
        ..Ranges::HELD
    };
    assert_eq!(traffic.ranges, ranges);

    let unsure = "\n[range]\nspeed = 0.01\nentry_s = 0.2\nload = 0.1\nstiffness = 0.05\n";
    let traffic = told(&TOML.replace("\n[[", &format!("{unsure}[[")));
    let ranges = Ranges {
        speed: 0.01,
        entry_s: 0.2,
        load: 0.1,
        stiffness: 0.05,
    };
    assert_eq!((traffic.speed_mps, traffic.ranges), (Some(SPEED_MPS), ranges));
}

#[test]
fn missing_rows_stay_a_gap() {
    let recording = read(
        "time_s,acc_node6_mps2\n2.000,1\n2.005,2\n2.010,3\n2.025,4\n2.030,5\n",
        TOML,
    );
    let run = |first_sample, first_row, rows| Run {
        first_sample,
        first_row,
        rows,
    };
    assert_eq!(recording.runs, [run(0, 0, 3), run(5, 3, 2)]);
    assert_eq!((recording.rows(), recording.missing()), (5, 2));
    assert!((recording.duration_s() - 0.030).abs() < 1e-12);
    // The stream's clock starts with the first row, the file's need not.
    assert_eq!(recording.entry_in_stream_s(), Some(-1.0));
}

#[test]
fn the_rate_of_rounded_times_comes_from_first_to_last() {
    let times: String = (0..5000)
        .map(|k| format!("{:.6},0\n", f64::from(k) / 1828.57))
        .collect();
    let recording = read(&format!("time_s,acc_node6_mps2\n{times}"), TOML);
    // Half a microsecond's rounding over 2.7 s.
    assert!(
        (recording.rate_hz() / 1828.57 - 1.0).abs() < 2e-7,
        "{}",
        recording.rate_hz()
    );
    assert_eq!(recording.runs.len(), 1);
}

#[test]
fn the_measured_records_are_read() {
    let real = Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/data/real");
    for (file, columns, rate_hz, rows) in [
        (
            "usc_footbridge_roller.csv",
            &["a1_mps2", "a2_mps2", "a3_mps2"][..],
            1828.57,
            22_200,
        ),
        ("munich_bridge_load_test.csv", &["acc_mps2"][..], 100.0, 72_000),
    ] {
        let csv = fs::read_to_string(real.join(file)).expect("a measured record");
        let toml: String = (columns.iter())
            .map(|column| format!("[[channel]]\ncolumn = \"{column}\"\nunit = \"m/s2\"\n"))
            .collect();
        let recording = read(&csv, &toml);
        assert_eq!((recording.rows(), recording.missing()), (rows, 0), "{file}");
        // The printed rate has six digits.
        assert!(
            (recording.rate_hz() / rate_hz - 1.0).abs() < 3e-6,
            "{file}: {} Hz",
            recording.rate_hz()
        );
    }
}

#[test]
fn what_is_written_is_read_again() {
    let folder = TempDir::new().expect("a folder");
    let path = folder.path().join("round.csv");
    let mut channel = Channel::new(
        "odd, \"name\"".to_owned(),
        Some(3),
        Unit::StandardGravity,
        vec![1.234_567_891, -1e-7, 0.0],
    );
    channel.lsb = 1e-4;
    channel.full_scale_counts = 32_767;
    let mut displacement = Channel::new("d".to_owned(), Some(6), Unit::Millimetre, vec![-1.5e-3, 2e-9, 0.0]);
    displacement.lsb = 1.7e-7;
    let recording = Recording {
        acceleration_mps2: -0.25,
        direction: Direction::Backward,
        start_s: 12.5,
        interval_s: 1.0 / 1828.57,
        runs: vec![
            Run {
                first_sample: 0,
                first_row: 0,
                rows: 2,
            },
            Run {
                first_sample: 7,
                first_row: 2,
                rows: 1,
            },
        ],
        channels: vec![channel, displacement],
        bridge: Some("a \"b\"".to_owned()),
        train: Some(TrainName::Known(TrainKind::Inspection2Dof)),
        cars: Some(16),
        speed_kmh: Some(123.4),
        entry_time_s: Some(-0.25),
        load_factor: Some(0.9),
        margins: Margins {
            speed: Some(0.02),
            entry_s: Some(0.0),
            load: None,
            stiffness: Some(0.3),
        },
        antialias_hz: None,
        track: Some("track.csv".to_owned()),
    };
    recording
        .write(&path, &["a remark\nof two lines".to_owned()])
        .expect("written");
    let toml = fs::read_to_string(path.with_extension("toml")).expect("the TOML");
    assert!(toml.starts_with("# a remark\n# of two lines\n"), "{toml}");
    let mut again = Recording::read(&path).unwrap_or_else(|error| panic!("{error:#}"));
    for (found, expected) in again.channels.iter_mut().zip(&recording.channels) {
        for (found, expected) in found.values.iter().zip(&expected.values) {
            assert!((found - expected).abs() <= WRITTEN_DIGITS * expected.abs());
        }
        found.values.clone_from(&expected.values);
    }
    // Times are written to the nanosecond.
    assert!((again.interval_s - recording.interval_s).abs() < 1e-9);
    again.interval_s = recording.interval_s;
    assert_eq!(again, recording);
}

#[test]
fn counts_are_rounded_and_end_at_the_converters_range() {
    let toml = format!(
        "{TOML}\n[[channel]]\ncolumn = \"b\"\nnode = 3\nunit = \"m/s2\"\nlsb_mps2 = 0.5\nfull_scale_counts = 7\n"
    );
    let recording = read(
        "time_s,acc_node6_mps2,b\n0,0.1,0.74\n0.005,-0.2,-100\n0.010,1000,0.76\n",
        &toml,
    );
    let count = |value: f64| (value / f64::from(DEFAULT_LSB_MPS2)).round() as i32;
    assert_eq!(
        recording.to_counts(),
        [count(0.1), 1, count(-0.2), -7, DEFAULT_FULL_SCALE_COUNTS, 2]
    );
    // The converter that is assumed: 24 bits over ± 2 g.
    assert!((f64::from(DEFAULT_LSB_MPS2) * f64::from(1 << 24) / (4.0 * 9.80665) - 1.0).abs() < 1e-7);
}

#[test]
fn shipped_recordings_are_read_and_fit_the_shipped_bridge() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("recordings");
    let mut seen = 0;
    for entry in fs::read_dir(&folder).expect("recordings") {
        let path = entry.expect("an entry").path();
        let simulated = path
            .file_name()
            .is_some_and(|name| name.to_string_lossy().contains("60kmh"));
        if path.extension().is_some_and(|extension| extension == "csv") && simulated {
            let recording = Recording::read(&path).unwrap_or_else(|error| panic!("{error:#}"));
            assert_eq!(recording.bridge.as_deref(), Some("girder50"), "{}", path.display());
            assert!((recording.rate_hz() - 200.0).abs() < 1e-9, "{}", path.display());
            assert!(recording.duration_s() > 7.0);
            seen += 1;
        }
    }
    assert_eq!(seen, 6);
}

#[test]
fn a_refusal_names_file_line_and_column() {
    let with = |from: &str, to: &str| {
        assert!(TOML.contains(from), "{from}");
        TOML.replace(from, to)
    };
    let cases = [
        // What is wrong with the table.
        (
            "time_s,x\n0,1\n1,2\n",
            TOML.to_owned(),
            "rec.csv: line 1: there is no column \"acc_node6_mps2\"",
        ),
        (
            "t,acc_node6_mps2\n0,1\n1,2\n",
            TOML.to_owned(),
            "rec.csv: line 1: the first column must be \"time_s\", not \"t\"",
        ),
        (
            "",
            TOML.to_owned(),
            "rec.csv: line 1: the first column must be \"time_s\"",
        ),
        (
            "time_s,acc_node6_mps2,acc_node6_mps2\n0,1,1\n",
            TOML.to_owned(),
            "rec.csv: line 1: column \"acc_node6_mps2\" is there twice",
        ),
        // A quotation mark that is not closed.
        (
            "time_s,\"acc_node6_mps2\n0,1\n0.1,2\n",
            TOML.to_owned(),
            "rec.csv: line 1: the name of a column goes on in the next line; close its quotation mark",
        ),
        (
            "time_s,acc_node6_mps2\n0,\"1\n0.1,2\n",
            TOML.to_owned(),
            "rec.csv: line 2, column acc_node6_mps2: \"1\\n0.1,2\" is not a number",
        ),
        (
            "time_s,acc_node6_mps2\n0,1\n0.1,NaN\n",
            TOML.to_owned(),
            "rec.csv: line 3, column acc_node6_mps2: NaN is not a finite number",
        ),
        (
            "time_s,acc_node6_mps2\n0,1\n0.1,-inf\n",
            TOML.to_owned(),
            "rec.csv: line 3, column acc_node6_mps2: -inf is not a finite number",
        ),
        // More samples between two rows than can be counted, and a time between them that is no number.
        (
            "time_s,acc_node6_mps2\n0,1\n0.1,1\n0.2,1\n1e300,1\n",
            TOML.to_owned(),
            "is not a whole number of intervals",
        ),
        (
            "time_s,acc_node6_mps2\n-1e308,1\n1e308,1\n",
            TOML.to_owned(),
            "is not a whole number of intervals",
        ),
        (
            "time_s,acc_node6_mps2\n0,1\n0.1,abc\n",
            TOML.to_owned(),
            "rec.csv: line 3, column acc_node6_mps2: \"abc\" is not a number",
        ),
        (
            "time_s,acc_node6_mps2\n0,1\n0.1,\n",
            TOML.to_owned(),
            "rec.csv: line 3, column acc_node6_mps2: \"\" is not a number",
        ),
        (
            "time_s,acc_node6_mps2\n0,1\nx,1\n",
            TOML.to_owned(),
            "rec.csv: line 3, column time_s: \"x\" is not a number",
        ),
        (
            "time_s,acc_node6_mps2\n0,1\n0.1,1,7\n",
            TOML.to_owned(),
            "rec.csv: line 3: 3 columns, but line 1 names 2",
        ),
        (
            "time_s,acc_node6_mps2\n",
            TOML.to_owned(),
            "rec.csv: it has a header but no samples",
        ),
        (
            "time_s,acc_node6_mps2\n0,1\n",
            TOML.to_owned(),
            "rec.csv: one sample only",
        ),
        (
            "time_s,acc_node6_mps2\n0,1\n0.1,1\n0.1,1\n",
            TOML.to_owned(),
            "rec.csv: line 4, column time_s: 0.1 s does not come after 0.1 s",
        ),
        (
            "time_s,acc_node6_mps2\n0,1\n0.1,1\n0.2,1\n0.34,1\n0.4,1\n0.5,1\n",
            TOML.to_owned(),
            "rec.csv: line 5, column time_s: 0.34 s is not a whole number of intervals",
        ),
        // What is wrong with the description.
        (
            CSV,
            format!("{TOML}lsb_mm = 1e-5\n"),
            "rec.toml: line 13, column 10: lsb_mm is of a displacement, but channel \"acc_node6_mps2\" is an acceleration",
        ),
        (
            CSV,
            with("= \"m/s2\"", "= \"mm\"\nlsb_mps2 = 1e-5"),
            "rec.toml: line 13, column 12: lsb_mps2 is of an acceleration, but channel \"acc_node6_mps2\" is a displacement",
        ),
        (
            CSV,
            with("= \"m/s2\"", "= \"mm\"\nlsb_mm = 0"),
            "rec.toml: line 13, column 10: lsb_mm must be positive, not 0",
        ),
        // What is wrong with what is said to be unsure.
        (
            CSV,
            with("\n[[", "\n[range]\nspeed = -0.1\n[["),
            "rec.toml: line 10, column 9: speed in [range] must be 0 (held) or positive, and at most 0.5, not -0.1",
        ),
        (
            CSV,
            with("\n[[", "\n[range]\nstiffness = 0.31\n[["),
            "stiffness in [range] must be 0 (held) or positive, and at most 0.3, not 0.31",
        ),
        (
            CSV,
            with("\n[[", "\n[range]\nload = nan\n[["),
            "load in [range] must be 0 (held) or positive",
        ),
        (
            CSV,
            with("entry_time_s = 1.0\n", "").replace("\n[[", "\n[range]\nentry_s = 1\n[["),
            "entry_s in [range] says how far off entry_time_s may be, but there is no entry_time_s",
        ),
        (
            CSV,
            with("\n[[", "\n[range]\nspeed_kmh = 0.1\n[["),
            "rec.toml: line 10, column 1: unknown field `speed_kmh`",
        ),
        (
            CSV,
            with("= \"m/s2\"", "= \"ft\""),
            "rec.toml: line 12, column 8: unit of channel \"acc_node6_mps2\" must be",
        ),
        (
            CSV,
            with("node = 6", "node = 0"),
            "rec.toml: line 11, column 8: node must be 1 or more",
        ),
        (
            CSV,
            with("node = 6", "node = -6"),
            "rec.toml: line 11, column 8: node must be 1 or more",
        ),
        (CSV, with("node = 6\n", ""), "channel \"acc_node6_mps2\" needs its node"),
        (
            CSV,
            with("cars = 1", "cars = 0"),
            "rec.toml: line 3, column 8: cars must be 1 to 16, not 0",
        ),
        (
            CSV,
            with("cars = 1", "cars = 17"),
            "rec.toml: line 3, column 8: cars must be 1 to 16, not 17",
        ),
        (
            CSV,
            with("cars = 1\n", ""),
            "rec.toml: line 2, column 9: a train needs its number of cars",
        ),
        (
            CSV,
            with("inspection-2dof", "tram"),
            "rec.toml: line 2, column 9: there is no train \"tram\"",
        ),
        (
            CSV,
            with("= 60", "= -60"),
            "rec.toml: line 4, column 13: speed_kmh must be positive",
        ),
        (
            CSV,
            with("= 60", "= nan"),
            "rec.toml: line 4, column 13: speed_kmh must be positive",
        ),
        (
            CSV,
            with("load_factor = 1.0", "load_factor = 0"),
            "load_factor must be a positive number",
        ),
        (CSV, with("= 40.0", "= -1"), "antialias_hz must be a positive frequency"),
        (
            CSV,
            with("= 60", "= \"fast\""),
            "rec.toml: line 4, column 13: invalid type",
        ),
        (
            CSV,
            with("load_factor", "loadfactor"),
            "rec.toml: line 6, column 1: unknown field `loadfactor`",
        ),
        (CSV, with("cars = 1", "cars = "), "rec.toml: line 3"),
        (CSV, "cars = 1\n".to_owned(), "rec.toml: it names no channel"),
        (
            CSV,
            format!(
                "{TOML}{}",
                "[[channel]]\ncolumn = \"b\"\nnode = 3\nunit = \"g\"\n".repeat(2)
            ),
            "column \"b\" is taken already",
        ),
        (
            CSV,
            (0..4)
                .map(|c| format!("[[channel]]\ncolumn = \"{c}\"\nunit = \"g\"\n"))
                .collect(),
            "4 channels, but a logger has at most 3",
        ),
    ];
    for (csv, toml, expected) in cases {
        let sentence = refusal(csv, &toml);
        println!("{sentence}");
        assert!(sentence.contains(expected), "\"{sentence}\" should say \"{expected}\"");
    }
}

#[test]
fn missing_files_are_named() {
    let (folder, path) = written(CSV, None);
    let sentence = format!("{:#}", Recording::read(&path).expect_err("no TOML"));
    assert!(sentence.contains("there is no rec.toml beside it"), "{sentence}");
    let absent = folder.path().join("absent.csv");
    let sentence = format!("{:#}", Recording::read(&absent).expect_err("no CSV"));
    assert!(
        sentence.contains("there is no recording") && sentence.contains("absent.csv"),
        "{sentence}"
    );
    let sentence = format!(
        "{:#}",
        Recording::read(&path.with_extension("toml")).expect_err("a TOML")
    );
    assert!(sentence.contains("a recording is named by its file .csv"), "{sentence}");
}
