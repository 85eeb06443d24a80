//! The stream on measured records (tests/data/real, with their sources): one passage on a footbridge, seven movements of a
//! load on a test bridge, nothing in the silences between them. No model of either bridge is known, so nothing is identified.

use std::path::Path;

use host_sim::channel::InProcess;
use host_sim::replay::{self, Told};
use host_sim::station::{Station, words};
use spanwatch::wire::message::Verdict;

/// The times of the load's movements were read off by eye, to the second; some are taken from the force, which begins to
/// change some seconds before the bridge moves.
const START_TOLERANCE_S: f64 = 3.0;
/// The vibration goes on after the load has come to rest, and is lost in the noise before it has in one event.
const END_TOLERANCE_S: f64 = 5.0;

fn passages(name: &str) -> Vec<(f64, f64)> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("../tests/data/real")
        .join(name);
    let prepared = replay::prepare(&path, None, 1).expect("a recording");
    let mut station = Station::new(Box::new(InProcess::new()));
    let mut found = Vec::new();
    let status = prepared
        .replay(&mut station, None, None, |told| {
            let Told::Passage { report, start_s, end_s } = told else {
                panic!("an alert without a model")
            };
            println!("{}", words::passage(report, &prepared.quantities(), *start_s, *end_s));
            assert!(matches!(report.verdict, Verdict::NotIdentified(_)));
            assert_eq!(report.quality.total(), 0);
            found.push((*start_s, *end_s));
            Ok(())
        })
        .expect("replays");
    assert_eq!(status.rejected, 0);
    found
}

#[test]
fn the_roller_on_the_footbridge_is_one_passage() {
    let found = passages("usc_footbridge_roller.csv");
    let [(start, end)] = found.as_slice() else {
        panic!("{found:?}")
    };
    assert!(*start < 3.3 && *start > 3.3 - START_TOLERANCE_S, "{start}");
    assert!((9.0..9.7 + START_TOLERANCE_S).contains(end), "{end}");
}

#[test]
fn the_seven_movements_of_the_load_are_found_and_nothing_else() {
    let moved = [
        (13.0, 30.0),
        (63.0, 80.0),
        (104.0, 116.0),
        (225.0, 240.0),
        (361.0, 373.0),
        (490.0, 500.0),
        (535.0, 553.0),
    ];
    let found = passages("munich_bridge_load_test.csv");
    assert_eq!(found.len(), moved.len(), "{found:?}");
    for ((start, end), (from, to)) in found.iter().zip(moved) {
        assert!((start - from).abs() < START_TOLERANCE_S, "{start} s for {from} s");
        assert!((end - to).abs() < END_TOLERANCE_S, "{end} s for {to} s");
    }
}
