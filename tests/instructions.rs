//! What a step of the solver may cost on the Cortex-M4F: instructions, counted by QEMU, so that the count is the same on
//! every machine and a change that makes the solver dearer fails here.
//!
//! Needs QEMU and the images `logger` and `step-cost` (`sh tests/build-firmware.sh logger`, `.. step-cost`).

use std::path::Path;
use std::process::Command;
use std::time::{Duration, Instant};

use host_sim::channel::{Channel, Qemu, built_image};
use host_sim::replay;
use host_sim::station::Station;
use spanwatch::capacity::CARS_ON_BRIDGE;
use tempfile::TempDir;

/// With counted instructions an instruction lasts 1 ns, so a tick of the board's 25 MHz is 40 of them.
const INSTRUCTIONS_PER_TICK: u64 = 40;

/// Most instructions a step of the logger's whole identification, everything in it counted: the steps with all of a
/// train's passage (before, on and after the bridge), the recorder's filter, the misfit, the eigenproblem of each damage
/// pattern, the search. Measured: 2779, 4543 and 6143; the limits leave 3 % for another compiler.
const ONE_INSPECTION_CAR: u64 = 2862;
const SIXTEEN_INSPECTION_CARS: u64 = 4679;
const SIXTEEN_SHINKANSEN_CARS: u64 = 6327;

/// Most instructions of a step alone with 0, 1, 2 and 3 cars on the bridge, 8 modes. More than three cars of 17.5 m and
/// more at a pitch of 25 m do not fit on 50 m. Measured: 724, 3528, 5600, 6664 and 724, 4472, 8010, 9814.
const STEP_INSPECTION: [u64; 4] = [790, 3723, 5869, 6982];
const STEP_SHINKANSEN: [u64; 4] = [790, 4712, 8637, 10_377];

/// A passage takes less than a second; a loaded machine may take a while.
const PATIENCE: Duration = Duration::from_secs(60);

/// Instructions a step of the identification of a recording by the logger's image.
fn identification(recording: &Path) -> u64 {
    let qemu = Qemu::start(&built_image("logger"), true, false).expect("QEMU and the image are there");
    let mut station = Station::new(Box::new(qemu));
    let prepared = replay::prepare(recording, None, replay::DEFAULT_SEED).expect("a recording");
    let effort = prepared
        .replay(&mut station, None, None, |_| Ok(()))
        .expect("replays")
        .effort;
    assert!(effort.solver_steps > 100_000, "a whole search: {effort:?}");
    effort.identification_ticks * INSTRUCTIONS_PER_TICK / effort.solver_steps
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

/// Instructions a step alone with 0, 1, .. cars on the bridge; none where there was no such step.
fn steps(order: u8) -> [Option<u64>; CARS_ON_BRIDGE + 1] {
    let mut qemu = Qemu::start(&built_image("step-cost"), true, false).expect("QEMU and the image are there");
    qemu.send(&[order]).expect("sent");
    let deadline = Instant::now() + PATIENCE;
    let mut answer = Vec::new();
    while answer.first().is_none_or(|&length| answer.len() <= usize::from(length)) {
        assert!(Instant::now() < deadline, "no answer; log: {:#?}", qemu.log());
        let mut chunk = [0; 128];
        let count = qemu.receive(&mut chunk, Duration::from_millis(100)).expect("received");
        answer.extend_from_slice(&chunk[..count]);
    }
    let counts: [(u32, u64); CARS_ON_BRIDGE + 1] = postcard::from_bytes(&answer[1..]).expect("counts");
    counts.map(|(steps, ticks)| (ticks * INSTRUCTIONS_PER_TICK).checked_div(steps.into()))
}

fn assert_within(what: &str, counted: u64, limit: u64) {
    println!("{what}: {counted} instructions a step, limit {limit}");
    assert!(counted <= limit, "{what}: {counted} instructions a step, limit {limit}");
}

fn assert_steps(train: &str, order: u8, limits: [u64; 4]) {
    let counted = steps(order);
    assert_eq!(counted[limits.len()..], [None], "more cars than limits");
    for (cars, (counted, limit)) in counted.iter().zip(limits).enumerate() {
        let counted = counted.expect("steps with so many cars");
        assert_within(&format!("{cars} {train} cars on the bridge"), counted, limit);
    }
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
