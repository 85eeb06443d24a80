//! The firmware image in QEMU and the logger in this process say the same, byte for byte. Without QEMU or without the
//! image (`sh tests/build-firmware.sh`) this fails.

mod by_hand;
mod nearest_track;
mod program;
mod rails;

use std::path::{Path, PathBuf};
use std::process::Command;

use host_sim::channel::{Channel, InProcess, Qemu, built_image};
use host_sim::replay::{self, Told};
use host_sim::station::Station;
use host_sim::track::{Profile, Rails};
use spanwatch::wire::message::{BLOCK_COUNTS, Event, Reason, Status, TrackState, TrainKind, Verdict};
use tempfile::TempDir;

/// By how much the rails are changed, m; where; and over what length to either side.
const CHANGED_BY_M: f64 = 1e-3;
const CHANGED_AT_M: f64 = 22.0;
const CHANGED_OVER_M: f64 = 8.0;

/// What a logger has said.
struct Said {
    /// Its events, as they lie in its outbox.
    frames: Vec<Vec<u8>>,
    alerts: usize,
    /// What it made of each passage.
    verdicts: Vec<Verdict>,
    /// How often it has said that the track has changed.
    changes: usize,
    /// At the end.
    status: Status,
    /// What it knows of the bridge at the end.
    evidence: Vec<u8>,
    /// Values of the last passage that the learnt track did not explain, as bits.
    kept: Vec<u32>,
}

/// What a logger says of recordings, one after the other, with the learnt `track`, if there is one.
fn events(channel: impl Channel + 'static, recordings: &[PathBuf], track: Option<&[u8]>) -> Said {
    let mut station = Station::new(Box::new(channel));
    let mut frames = vec![];
    let (mut alerts, mut changes, mut verdicts) = (0, 0, vec![]);
    let mut status = Status::default();
    for path in recordings {
        let prepared = replay::prepare(path, None, replay::DEFAULT_SEED).expect("a recording");
        status = prepared
            .replay(&mut station, track, None, |told| {
                let event = match told {
                    Told::Alert { alert, .. } => Event::Alert(alert.clone()),
                    Told::Track { report, .. } => Event::Track(*report),
                    Told::Passage { report, .. } => Event::Passage(report.clone()),
                };
                match &event {
                    Event::Alert(_) => alerts += 1,
                    Event::Track(_) => changes += 1,
                    Event::Passage(report) => verdicts.push(report.verdict),
                }
                let mut room = [0; 256];
                frames.push(postcard::to_slice(&event, &mut room)?.to_vec());
                Ok(())
            })
            .expect("replays");
        assert_eq!(
            (status.rejected, status.health.overruns),
            (0, 0),
            "nothing is lost at full speed"
        );
    }
    let evidence = station.evidence().expect("an answer").to_vec();
    let kept = station.strange_passage().expect("an answer");
    let kept = kept.map_or(vec![], |(_, values)| {
        values.iter().map(|value| value.to_bits()).collect()
    });
    assert_eq!(station.rejected(), 0);
    Said {
        frames,
        alerts,
        verdicts,
        changes,
        status,
        evidence,
        kept,
    }
}

fn image() -> PathBuf {
    std::env::var_os("SPANWATCH_IMAGE").map_or_else(|| built_image("logger"), PathBuf::from)
}

/// A logger in this process and one in QEMU say the same of these recordings, with the learnt `track`, if there is one; gives what.
fn same_on_both(recordings: &[PathBuf], track: Option<&[u8]>) -> Said {
    let here = events(InProcess::new(), recordings, track);
    let qemu = Qemu::start(&image(), false, true).expect("QEMU and the image are there");
    let there = events(qemu, recordings, track);
    for (here, there) in here.frames.iter().zip(&there.frames) {
        assert_eq!(here, there);
    }
    assert_eq!(here.frames.len(), there.frames.len());
    assert_eq!(here.evidence, there.evidence);
    assert_eq!(here.kept, there.kept);
    assert!(there.status.health.stack_peak_bytes > 0, "the stack is watched");
    println!("deepest stack: {} bytes", there.status.health.stack_peak_bytes);
    here
}

#[test]
fn the_image_in_qemu_sends_the_same_bytes_as_the_logger_in_this_process() {
    let recordings = [
        "healthy-60kmh.csv",
        "case1-60kmh.csv",
        "case4-60kmh-noise5-3nodes.csv",
        "case8-3d-270kmh-noise2-3nodes.csv",
    ];
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("recordings");
    let said = same_on_both(&recordings.map(|name| folder.join(name)), None);
    assert_eq!(said.alerts, 3);
    // A passage each and the alerts.
    assert_eq!(said.frames.len(), recordings.len() + said.alerts);
}

/// Simulates a recording of three noisy sensors.
fn simulate(path: &Path, flags: &str) {
    let simulated = Command::new(env!("CARGO_BIN_EXE_host-sim"))
        .args(["simulate", "--bridge", "girder50", "--nodes", "3,6,9"])
        .args(["--noise", "0.02", "--rate-hz", "200", "--antialias-hz", "40"])
        .args(flags.split(' '))
        .arg("-o")
        .arg(path)
        .output()
        .expect("host-sim runs");
    assert!(
        simulated.status.success(),
        "{}",
        String::from_utf8_lossy(&simulated.stderr)
    );
}

#[test]
fn a_train_that_nobody_announced_is_explained_by_the_same_bytes_too() {
    let folder = TempDir::new().expect("a folder");
    let recording = folder.path().join("unannounced.csv");
    simulate(
        &recording,
        "--train inspection-2dof --cars 2 --speed-kmh 150 --damage 5=0.3 --lead-s 4 --tail-s 12 --load-factor 1.1 --withhold \
         speed,entry,load",
    );
    let said = same_on_both(&[recording], None);
    assert_eq!(said.alerts, 1);
}

/// The same track, with a hump in the middle of the bridge.
fn changed(track: &Profile) -> Profile {
    let mut heights = track.rails().z_m[0].clone();
    for (x, height) in track.rails().x_m.iter().zip(&mut heights) {
        let u = (x - CHANGED_AT_M) / CHANGED_OVER_M;
        if u.abs() < 1.0 {
            *height += CHANGED_BY_M * (1.0 - u * u).powi(3);
        }
    }
    Profile::new(Rails::equal(track.rails().x_m.clone(), heights))
}

#[test]
fn a_learnt_track_and_its_change_are_told_by_the_same_bytes_too() {
    let folder = TempDir::new().expect("a folder");
    let track = by_hand::class_6();
    let changed = changed(&track);
    let passages = [
        (&track, 2, 240.0),
        (&track, 4, 220.0),
        (&changed, 2, 250.0),
        (&changed, 2, 230.0),
        (&changed, 2, 210.0),
    ];
    let recordings = passages.map(|(track, cars, speed_kmh)| {
        let path = folder.path().join(format!("passage-{speed_kmh}.csv"));
        by_hand::record(&path, track, TrainKind::Shinkansen3d, cars, speed_kmh, speed_kmh as u64);
        path
    });
    let said = same_on_both(&recordings, Some(&by_hand::learnt(&track)));
    let [first, second, after @ ..] = said.verdicts.as_slice() else {
        panic!("{:?}", said.verdicts)
    };
    assert!(
        matches!(first, Verdict::Healthy { .. }) && matches!(second, Verdict::Healthy { .. }),
        "{first:?} {second:?}"
    );
    let doubted = |verdict: &Verdict| {
        matches!(
            verdict,
            Verdict::NotIdentified(Reason::AnotherTrack | Reason::Unexplained | Reason::Implausible)
        )
    };
    assert!(after.len() == 3 && after.iter().all(doubted), "{after:?}");
    assert_eq!((said.alerts, said.changes), (0, 1));
    assert_eq!(said.status.track, TrackState::Changed);
}

#[test]
fn a_learnt_track_is_monitored_by_the_same_bytes_too() {
    let folder = TempDir::new().expect("a folder");
    let rails = rails::lay(folder.path(), "rails", 1);
    let recordings = [
        rails::record(folder.path(), "damaged", &rails, "--speed-kmh 60 --damage 5=0.3"),
        // A speed at which nothing was learnt.
        rails::record(folder.path(), "fast", &rails, "--speed-kmh 100"),
    ];
    let said = same_on_both(&recordings, Some(&rails::learn(&rails, 60.0)));
    assert_eq!((said.alerts, said.status.track), (1, TrackState::Learnt));
    assert!(!said.kept.is_empty());
}

#[test]
fn no_sample_is_lost_while_a_passage_is_being_identified() {
    // The sensor goes on for the rest of a headway: what comes after the train is offered at once, without waiting for the search.
    const RATE_HZ: u64 = 200;
    const HEADWAY_S: u64 = 180;
    // At 168 MHz and an instruction a clock, 100 ms, in which three sensors send 200 of the queue's 2048 bytes.
    const LONGEST_SLICE: u64 = 16_800_000;
    const INSTRUCTIONS_PER_TICK: u64 = 40;
    let folder = TempDir::new().expect("a folder");
    let path = folder.path().join("headway.csv");
    simulate(
        &path,
        "--train shinkansen-3d --cars 16 --speed-kmh 270 --damage 5=0.11 --tail-s 174",
    );
    let prepared = replay::prepare(&path, None, replay::DEFAULT_SEED).expect("a recording");
    let qemu = Qemu::start(&image(), true, true).expect("QEMU and the image are there");
    let mut station = Station::new(Box::new(qemu));
    station
        .load(prepared.bridge.as_ref().expect("a bridge"))
        .expect("loads");
    station.configure(&prepared.configuration).expect("configures");
    let channels = prepared.recording.channels.len();
    let rows = BLOCK_COUNTS / channels;
    let counts = prepared.recording.to_counts();
    let samples = (counts.len() / channels) as u64;
    assert!(samples > RATE_HZ * HEADWAY_S, "{samples}");
    let (mut busy_blocks, mut first) = (0, 0);
    for block in counts.chunks(rows * channels) {
        busy_blocks += usize::from(station.offer(first, block).expect("taken"));
        first += (block.len() / channels) as u64;
    }
    let status = station.finish().expect("finishes");
    println!(
        "{busy_blocks} blocks of {rows} samples came during the identification, of {} million instructions; longest slice {} million",
        status.effort.identification_ticks * INSTRUCTIONS_PER_TICK / 1_000_000,
        status.effort.longest_slice_ticks * INSTRUCTIONS_PER_TICK / 1_000_000
    );
    assert!(busy_blocks > 10, "the search was running meanwhile");
    assert_eq!(status.samples, samples);
    assert_eq!((status.quality.missing, status.health.overruns), (0, 0));
    assert_eq!((status.passages, status.alerts), (1, 1));
    assert!(status.effort.longest_slice_ticks * INSTRUCTIONS_PER_TICK < LONGEST_SLICE);
}
