//! What a step of the solver may cost on the Cortex-M4F: instructions, counted by QEMU, so that the count is the same on
//! every machine and a change that makes the solver dearer fails here.
//!
//! Needs QEMU and the images `logger` and `step-cost` (`sh tests/build-firmware.sh logger`, `.. step-cost`).

mod by_hand;
mod nearest_track;

use std::path::Path;
use std::process::Command;

use host_sim::channel::{Qemu, built_image};
use host_sim::cost::{self, INSTRUCTIONS_PER_TICK};
use host_sim::replay;
use host_sim::station::Station;
use spanwatch::capacity::CARS_ON_BRIDGE;
use spanwatch::wire::message::{Effort, TrainKind};
use tempfile::TempDir;

/// Most instructions a step of the logger's whole identification, everything in it counted: the steps with all of a
/// train's passage (before, on and after the bridge), the recorder's filter, the misfit, the eigenproblem of each damage
/// pattern, the search. Measured: 2779, 4543 and 6143; the limits leave 3 % for another compiler.
const ONE_INSPECTION_CAR: u64 = 2951;
const SIXTEEN_INSPECTION_CARS: u64 = 4679;
const SIXTEEN_SHINKANSEN_CARS: u64 = 6327;

/// Most instructions of a step alone with 0, 1, 2 and 3 cars on the bridge, 8 modes. More than three cars of 17.5 m and
/// more at a pitch of 25 m do not fit on 50 m. Measured: 708, 3541, 5613, 6733 and 708, 4431, 8148, 9815.
const STEP_INSPECTION: [u64; 4] = [790, 3723, 5869, 6982];
const STEP_SHINKANSEN: [u64; 4] = [790, 4712, 8637, 10_377];

/// The same over a learnt track, a look-up in which is some 90 instructions a contact. Measured: 739, 3706, 5939, 7192 and 738, 4787,
/// 8879, 10,860; the limits leave 2 %.
const STEP_INSPECTION_LEARNT: [u64; 4] = [754, 3780, 6058, 7336];
const STEP_SHINKANSEN_LEARNT: [u64; 4] = [754, 4883, 9057, 11_077];
/// Most instructions of the step in which the first car comes, its approach of 139 m at 270 km/h in it: 640 and
/// 1030 for each of its steps. Measured: 474,480 and 761,200.
const APPROACH_INSPECTION: u64 = 484_000;
const APPROACH_SHINKANSEN: u64 = 776_500;

/// Most instructions to write and to read an alert's frame as it leaves the outbox, sealed by a session and in the clear. Measured: 10,892 and
/// 13,116, 2858 and 5125.
const SEALED_FRAME: [u64; 2] = [11_200, 13_500];
const CLEAR_FRAME: [u64; 2] = [2950, 5280];

/// Most instructions a step of a whole identification with a learnt track, as above: sixteen shinkansen cars at 240 km/h whose speed,
/// entry and load are not quite known. And most of it all: what is done at 168 MHz, an instruction a clock, in the three minutes
/// between two trains; and of a slice of it, 50 ms, during which the receive queue must hold.
const SIXTEEN_SHINKANSEN_CARS_LEARNT: u64 = 5956;
const BETWEEN_TRAINS: u64 = 180 * 168_000_000;
const LONGEST_SLICE: u64 = 8_000_000;

/// What the identification of a recording costs the logger's image, with the learnt `track`, if there is one.
fn effort(recording: &Path, track: Option<&[u8]>) -> Effort {
    let qemu = Qemu::start(&built_image("logger"), true, false).expect("QEMU and the image are there");
    let mut station = Station::new(Box::new(qemu));
    let prepared = replay::prepare(recording, None, replay::DEFAULT_SEED).expect("a recording");
    let effort = prepared
        .replay(&mut station, track, None, |_| Ok(()))
        .expect("replays")
        .effort;
    assert!(effort.solver_steps > 100_000, "a whole search: {effort:?}");
    effort
}

fn a_step(effort: &Effort) -> u64 {
    effort.identification_ticks * INSTRUCTIONS_PER_TICK / effort.solver_steps
}

/// Instructions a step of the identification of a recording by the logger's image.
fn identification(recording: &Path) -> u64 {
    a_step(&effort(recording, None))
}

/// The identification of a simulated passage of sixteen cars at 270 km/h over a girder with a slight damage.
fn identification_of_sixteen(train: &str) -> u64 {
    let folder = TempDir::new().expect("a folder");
    let recording = folder.path().join("passage.csv");
    let simulated = Command::new(env!("CARGO_BIN_EXE_host-sim"))
        .args(["simulate", "--bridge", "girder50", "--train", train, "--cars", "16"])
        .args([
            "--speed-kmh",
            "270",
            "--damage",
            "5=0.11",
            "--rate-hz",
            "200",
            "--antialias-hz",
            "40",
            "-o",
        ])
        .arg(&recording)
        .output()
        .expect("host-sim runs");
    assert!(
        simulated.status.success(),
        "{}",
        String::from_utf8_lossy(&simulated.stderr)
    );
    identification(&recording)
}

/// Steps and ticks by the number of cars on the bridge, and of the step in which the first car comes.
type Counts = ([(u32, u64); CARS_ON_BRIDGE + 1], (u32, u64));

/// Instructions a step alone with 0, 1, .. cars on the bridge, and of that in which the first car comes; none where there was no such
/// step.
fn steps(order: u8) -> ([Option<u64>; CARS_ON_BRIDGE + 1], Option<u64>) {
    let (counts, first): Counts = cost::count(order).expect("QEMU and the image are there");
    let a_step = |(steps, ticks): (u32, u64)| (ticks * INSTRUCTIONS_PER_TICK).checked_div(steps.into());
    (counts.map(a_step), a_step(first))
}

fn assert_within(what: &str, counted: u64, limit: u64) {
    println!("{what}: {counted} instructions, limit {limit}");
    assert!(counted <= limit, "{what}: {counted} instructions, limit {limit}");
}

/// Gives the instructions of the step in which the first car comes.
fn assert_steps(train: &str, order: u8, limits: [u64; 4]) -> u64 {
    let (counted, first) = steps(order);
    assert_eq!(counted[limits.len()..], [None], "more cars than limits");
    for (cars, (counted, limit)) in counted.iter().zip(limits).enumerate() {
        let counted = counted.expect("steps with so many cars");
        assert_within(&format!("{cars} {train} cars on the bridge"), counted, limit);
    }
    first.expect("a car comes")
}

#[test]
fn a_step_with_inspection_cars_stays_within_its_instructions() {
    assert_steps("inspection-2dof", b'i', STEP_INSPECTION);
}

#[test]
fn a_step_with_shinkansen_cars_stays_within_its_instructions() {
    assert_steps("shinkansen-3d", b's', STEP_SHINKANSEN);
}

#[test]
fn a_step_over_a_learnt_track_stays_within_its_instructions() {
    let inspection = assert_steps("inspection-2dof", b'I', STEP_INSPECTION_LEARNT);
    let shinkansen = assert_steps("shinkansen-3d", b'S', STEP_SHINKANSEN_LEARNT);
    assert_within("the approach of an inspection car", inspection, APPROACH_INSPECTION);
    assert_within("the approach of a shinkansen-3d car", shinkansen, APPROACH_SHINKANSEN);
}

#[test]
fn an_alert_s_frame_stays_within_its_instructions() {
    let [sealed, clear] = cost::of_an_alert().expect("QEMU and the image are there");
    for (name, frame, limits) in [("sealed", sealed, SEALED_FRAME), ("clear", clear, CLEAR_FRAME)] {
        let counted = [("write", frame.write), ("read", frame.read)];
        for ((what, counted), limit) in counted.into_iter().zip(limits) {
            assert_within(
                &format!("to {what} a {name} frame of {} bytes", frame.bytes),
                counted,
                limit,
            );
        }
    }
}

#[test]
fn an_identification_with_one_inspection_car_stays_within_its_instructions() {
    let recording = Path::new(env!("CARGO_MANIFEST_DIR")).join("recordings/case1-60kmh.csv");
    assert_within("one inspection car", identification(&recording), ONE_INSPECTION_CAR);
}

#[test]
fn an_identification_with_sixteen_inspection_cars_stays_within_its_instructions() {
    let counted = identification_of_sixteen("inspection-2dof");
    assert_within("sixteen inspection cars", counted, SIXTEEN_INSPECTION_CARS);
}

#[test]
fn an_identification_with_sixteen_shinkansen_cars_stays_within_its_instructions() {
    let counted = identification_of_sixteen("shinkansen-3d");
    assert_within("sixteen shinkansen-3d cars", counted, SIXTEEN_SHINKANSEN_CARS);
}

#[test]
fn an_identification_with_a_learnt_track_is_over_before_the_next_train() {
    let folder = TempDir::new().expect("a folder");
    let recording = folder.path().join("passage.csv");
    let track = by_hand::class_6();
    by_hand::record(&recording, &track, TrainKind::Shinkansen3d, 16, 240.0, 1);
    let effort = effort(&recording, Some(&by_hand::learnt(&track)));
    let whole = effort.identification_ticks * INSTRUCTIONS_PER_TICK;
    let slice = effort.longest_slice_ticks * INSTRUCTIONS_PER_TICK;
    println!(
        "{} steps, {:.1} s at 168 MHz; longest slice {:.1} million instructions",
        effort.solver_steps,
        whole as f64 / 168e6,
        slice as f64 / 1e6
    );
    assert!(whole < BETWEEN_TRAINS, "{whole}");
    assert!(slice < LONGEST_SLICE, "{slice}");
    assert_within(
        "sixteen shinkansen-3d cars on a learnt track",
        a_step(&effort),
        SIXTEEN_SHINKANSEN_CARS_LEARNT,
    );
}
