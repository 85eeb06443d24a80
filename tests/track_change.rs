//! Promises of a logger on rough rails that were learnt: a healthy passage is healthy and a damaged one damaged; rails that change are told,
//! once, and not taken for damage; what was known of the bridge outlives them; and the base station can fetch what it learns the
//! new ones from.

mod nearest_track;
mod program;
mod rails;

use std::path::Path;

use host_sim::channel::InProcess;
use host_sim::model;
use host_sim::model::reduce::reduce;
use host_sim::recording::Recording;
use host_sim::replay::{self, Told};
use host_sim::station::Station;
use rails::{lay, learn, record};
use spanwatch::identify::evidence::{EVIDENCE_BYTES, EvidenceError};
use spanwatch::logger::Logger;
use spanwatch::track::blob::TrackError;
use spanwatch::wire::fingerprint;
use spanwatch::wire::message::{Reason, TrackState, Verdict};
use tempfile::TempDir;

/// What a logger says of a recording.
#[derive(Debug, Default)]
struct Said {
    verdict: Option<Verdict>,
    /// Elements beyond doubt.
    certain: u16,
    changes: usize,
    state: TrackState,
    /// The passage, where it was kept for the base station.
    kept: Option<Recording>,
}

fn say(station: &mut Station, path: &Path, track: &[u8], evidence: &mut Option<Vec<u8>>) -> Said {
    let prepared = replay::prepare(path, None, replay::DEFAULT_SEED).expect("a recording");
    let mut said = Said::default();
    let mut kept = None;
    let mut keep = |recording: &Recording, _: u32| {
        kept = Some(recording.clone());
        Ok(())
    };
    let tell = |told: &Told| {
        match told {
            Told::Passage { report, .. } => said.verdict = Some(report.verdict),
            Told::Alert { alert, .. } => said.certain |= alert.certain,
            Told::Track { .. } => said.changes += 1,
        }
        Ok(())
    };
    let status = prepared
        .replay_keeping(station, Some(track), evidence.as_deref(), tell, Some(&mut keep))
        .expect("replays");
    *evidence = Some(station.evidence().expect("an answer"));
    said.state = status.track;
    said.kept = kept;
    println!(
        "{}: {:?}, {:?}, certain {:b}, {} changes",
        path.display(),
        said.state,
        said.verdict,
        said.certain,
        said.changes
    );
    said
}

#[test]
fn rails_that_change_are_told_and_not_taken_for_damage_and_the_bridge_is_not_forgotten() {
    let folder = TempDir::new().expect("a folder");
    let folder = folder.path();
    let (old, new) = (lay(folder, "old", 1), lay(folder, "new", 2));
    let (old_track, new_track) = (learn(&old, 60.0), learn(&new, 60.0));
    let mut station = Station::new(Box::new(InProcess::new()));
    let mut evidence = None;

    let path = record(folder, "healthy", &old, "--speed-kmh 60");
    let said = say(&mut station, &path, &old_track, &mut evidence);
    assert!(matches!(said.verdict, Some(Verdict::Healthy { .. })));
    assert_eq!((said.state, said.kept), (TrackState::Learnt, None));

    // At another speed the rails are not known well enough; that is no change, but the passage may be learnt from.
    let path = record(folder, "fast", &old, "--speed-kmh 100");
    let said = say(&mut station, &path, &old_track, &mut evidence);
    assert_eq!(said.verdict, Some(Verdict::NotIdentified(Reason::Uncalibrated)));
    assert!(said.changes == 0 && said.kept.is_some());

    // The rails are tamped.
    let mut told = vec![];
    for seed in 0..3 {
        let path = record(
            folder,
            &format!("tamped{seed}"),
            &new,
            &format!("--speed-kmh 60 --seed {seed}"),
        );
        let said = say(&mut station, &path, &old_track, &mut evidence);
        assert!(matches!(said.verdict, Some(Verdict::NotIdentified(_))));
        assert_eq!(said.certain, 0, "no alarm");
        told.push(said.changes);
    }
    assert_eq!(told, [0, 0, 1]);

    // Nothing is believed until the track is learnt anew; what it can be learnt from is the passage as it was.
    let path = record(folder, "tamped", &new, "--speed-kmh 60 --seed 9");
    let said = say(&mut station, &path, &old_track, &mut evidence);
    assert_eq!(said.verdict, Some(Verdict::NotIdentified(Reason::AnotherTrack)));
    assert_eq!((said.changes, said.state), (0, TrackState::Changed));
    // Nor by a logger that has started again and goes on from the evidence.
    let mut restarted = Station::new(Box::new(InProcess::new()));
    let again = say(&mut restarted, &path, &old_track, &mut evidence.clone());
    assert_eq!((again.changes, again.state), (0, TrackState::Changed));
    let (kept, whole) = (said.kept.expect("kept"), Recording::read(&path).expect("a recording"));
    assert!(kept.rows() > 500 && kept.interval_s == whole.interval_s && kept.start_s > 0.0);
    let first = (kept.start_s / kept.interval_s).round() as usize;
    for (kept, whole) in kept.channels.iter().zip(&whole.channels) {
        let largest = whole.values.iter().fold(0.0_f64, |most, value| most.max(value.abs()));
        for (kept, whole) in kept.values.iter().zip(&whole.values[first..]) {
            // The logger takes the offset off that it sees before a passage.
            assert!((kept - whole).abs() < 0.01 * largest, "{kept}, {whole}");
        }
    }

    // With the new track it goes on where it was, and a damage is found.
    let said = say(&mut station, &path, &new_track, &mut evidence);
    assert!(matches!(said.verdict, Some(Verdict::Healthy { .. })));
    assert_eq!(said.state, TrackState::Learnt);
    let path = record(folder, "damaged", &new, "--speed-kmh 60 --seed 10 --damage 5=0.3");
    let mut certain = 0;
    for _ in 0..2 {
        // The first contradicts all before it, and is kept apart until a second one agrees.
        certain |= say(&mut station, &path, &new_track, &mut evidence).certain;
    }
    assert_eq!(certain, 0b1_0000);
}

#[test]
fn what_a_logger_keeps_is_a_recording_like_any_other() {
    let folder = TempDir::new().expect("a folder");
    let folder = folder.path();
    let rails = lay(folder, "rails", 1);
    std::fs::write(folder.join("rails.blob"), learn(&rails, 100.0)).expect("room");
    record(folder, "slow", &rails, "--speed-kmh 60");
    let run = |arguments: &str| {
        let output = program::host_sim(folder, &arguments.split(' ').collect::<Vec<_>>());
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        String::from_utf8(output.stdout).expect("text")
    };
    let said = run("replay slow.csv --track rails.blob --keep kept");
    assert!(said.contains("learn it from such trains, too"), "{said}");
    // The search alone says so, too.
    let said = run("identify slow.csv --track rails.blob");
    assert!(
        said.starts_with("Nothing is identified: no train of this kind"),
        "{said}"
    );
    let shown = run("track show rails.blob");
    for words in [
        "girder50",
        "60 passages",
        "inspection-2dof, between 96 and 102 km/h",
        "0.50 0.50",
    ] {
        assert!(shown.contains(words), "no {words} in {shown}");
    }
    // The same passage once more, found by the logger that is told nothing of rails.
    let again = run("replay kept/slow-passage1.csv --json");
    assert!(again.contains("\"event\":\"passage\""), "{again}");
}

#[test]
fn a_track_of_one_bridge_is_refused_before_a_recording_of_another_is_replayed() {
    let folder = TempDir::new().expect("a folder");
    let folder = folder.path();
    let rails = lay(folder, "rails", 1);
    std::fs::write(folder.join("rails.blob"), learn(&rails, 60.0)).expect("room");
    record(folder, "here", &rails, "--speed-kmh 60");
    let there = "simulate --bridge twospan --train inspection-2dof --cars 1 --speed-kmh 60 --rate-hz 200 --nodes 3 -o there.csv";
    let run = |arguments: &str| program::host_sim(folder, &arguments.split(' ').collect::<Vec<_>>());
    assert!(run(there).status.success());
    let refused = run("replay here.csv there.csv --track rails.blob");
    let text = String::from_utf8_lossy(&refused.stderr).into_owned();
    assert!(!refused.status.success() && refused.stdout.is_empty());
    assert!(
        text.contains("rails.blob: the track was learnt with another bridge"),
        "{text}"
    );
}

#[test]
fn what_belongs_to_one_bridge_is_refused_by_another() {
    let model = |name: &str| {
        let bridge = reduce(&model::shipped(name).expect("shipped")).expect("reduces");
        model::to_blob(&bridge).expect("room")
    };
    let (girder, other) = (model("girder50"), model("twospan"));
    assert_ne!(fingerprint(&girder), fingerprint(&other));
    let folder = TempDir::new().expect("a folder");
    let track = learn(&lay(folder.path(), "rails", 1), 60.0);
    let mut logger = Box::new(Logger::new());
    assert_eq!(
        logger.load_track(&track),
        Err(TrackError::Bridge),
        "it has no bridge at all"
    );
    logger.load(&girder).expect("sound");
    let mut evidence = [0; EVIDENCE_BYTES];
    let evidence = logger.evidence(&mut evidence).to_vec();
    logger.load_track(&track).expect("sound");
    assert_eq!(logger.track_state(), TrackState::Learnt);
    // The same model once more changes nothing; another one takes the track with it.
    logger.load(&girder).expect("sound");
    assert_eq!(logger.track_state(), TrackState::Learnt);
    logger.load(&other).expect("sound");
    assert_eq!(logger.track_state(), TrackState::Unknown);
    assert_eq!(logger.load_track(&track), Err(TrackError::Bridge));
    assert_eq!(logger.restore(&evidence), Err(EvidenceError::Bridge));
}
