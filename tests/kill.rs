//! Promises of the whole: a logger that is killed keeps what it has not been confirmed; with image and base station killed at any moment, and a
//! faulty line between, every alert arrives once. QEMU and the image must be there.

use std::path::{Path, PathBuf};

use host_sim::campaign::kill;
use host_sim::channel::{Qemu, built_image};
use host_sim::replay::{self, Prepared};
use host_sim::station::Station;
use spanwatch::wire::message::{BLOCK_COUNTS, Event};
use tempfile::TempDir;

/// Kills of the short campaign; `host-sim evaluate link --campaign kill` makes as many as one likes.
const KILLS: u32 = 10;
const SEED: u64 = 1;

fn recording() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("recordings/case1-60kmh.csv")
}

fn case1() -> Prepared {
    replay::prepare(&recording(), None, replay::DEFAULT_SEED).expect("a shipped recording")
}

fn logger(flash: &Path) -> Station {
    let qemu = Qemu::start_on(&built_image("logger"), flash, false, false).expect("QEMU and the image are there");
    Station::new(Box::new(qemu))
}

/// What the logger has said by the time that it is idle.
fn heard(station: &mut Station) -> Vec<Event> {
    station.finish().expect("an answer");
    std::iter::from_fn(|| station.next_event()).collect()
}

#[test]
fn an_alert_that_was_not_confirmed_comes_after_the_logger_was_killed_and_no_more_after_it_was() {
    let prepared = case1();
    let folder = TempDir::new().expect("a folder");
    let flash = folder.path().join("flash");
    let mut station = logger(&flash);
    station
        .load(prepared.bridge.as_ref().expect("a bridge"))
        .expect("loads");
    station.configure(&prepared.configuration).expect("configures");
    for (block, counts) in prepared.recording.to_counts().chunks(BLOCK_COUNTS).enumerate() {
        station.samples((block * BLOCK_COUNTS) as u64, counts).expect("taken");
    }
    let first = heard(&mut station);
    assert!(
        matches!(first.as_slice(), [Event::Alert(_), Event::Passage(_)]),
        "{first:?}"
    );
    // SIGKILL, before anything is confirmed; and once more.
    drop(station);
    for _ in 0..2 {
        let mut station = logger(&flash);
        assert_eq!(heard(&mut station), first);
    }
    let mut station = logger(&flash);
    assert_eq!(heard(&mut station), first);
    station.confirm().expect("sent");
    assert_eq!(station.finish().expect("an answer").waiting, 0);
    drop(station);
    assert_eq!(heard(&mut logger(&flash)), []);
}

#[test]
fn whatever_is_killed_and_when_every_alert_arrives_once() {
    let folder = TempDir::new().expect("a folder");
    let outcome = kill::run(
        Path::new(env!("CARGO_BIN_EXE_host-sim")),
        &built_image("logger"),
        &recording(),
        folder.path(),
        KILLS,
        SEED,
        |_| (),
    )
    .expect("all runs");
    assert!(outcome.is_clean(), "{outcome:?}");
    assert!(outcome.logger_kills > 0 && outcome.station_kills > 0, "{outcome:?}");
    assert!(outcome.stored > 5 && outcome.faults > 0, "{outcome:?}");
}
