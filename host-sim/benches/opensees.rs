//! A step of the solver beside a step of OpenSeesPy's moving-load analysis of the same train: `sh host-sim/benches/opensees/run.sh`.
//!
//! OpenSees takes the train as constant forces; the solver solves for the cars too. That both analyse the same thing is
//! shown by the displacement of mid-span under the same constant forces.

mod passage;

use std::collections::BTreeMap;
use std::ffi::OsStr;
use std::fs;
use std::io::Write;
use std::process::{Command, Stdio};
use std::time::Instant;

use anyhow::{Context, Result, ensure};
use divan::black_box;
use host_sim::model::file;
use passage::{Endless, InSpace, SPEED_MPS, Traffic};
use serde::{Deserialize, Serialize};
use spanwatch::interaction::{Scheme, TrainSteps};
use spanwatch::train::PlanarTrain;
use spanwatch::wire::message::TrainKind::{Inspection2Dof, Shinkansen3d};

/// Both step by Newmark's average acceleration, as the paper does, s.
const STEP_S: f64 = 1e-3;
const CARS: usize = 16;
/// Passages timed; the fastest counts, for what else runs on the machine only slows them.
const REPETITIONS: usize = 15;
/// Largest difference of mid-span's displacement under constant forces, as a part of its largest: the solver has 8 modes,
/// OpenSees all that its ten elements have.
const AGREEMENT: f64 = 5e-3;

/// What `moving_load.py` reads.
#[derive(Serialize)]
struct Task {
    length_m: f64,
    elements: usize,
    bending_stiffness_nm2: f64,
    mass_kgpm: f64,
    damping_ratio: f64,
    speed_mps: f64,
    wheels: Vec<(f64, f64)>,
    step_s: f64,
    steps: u32,
}

/// What it writes.
#[derive(Deserialize)]
struct Outcome {
    version: String,
    python: String,
    first_hz: f64,
    seconds_a_step: BTreeMap<String, f64>,
    mid_span_m: Vec<f64>,
}

fn main() -> Result<()> {
    let Some(python) = std::env::var_os("OPENSEES_PYTHON") else {
        println!("OpenSeesPy is not set up; `sh host-sim/benches/opensees/run.sh` does that and compares.");
        return Ok(());
    };
    let mut rows = String::new();
    let mut notes = String::new();
    for kind in [Inspection2Dof, Shinkansen3d] {
        let traffic = Traffic { kind, cars: CARS };
        let cars = passage::cars::<f64>(traffic, Scheme::AverageAcceleration, STEP_S);
        let mut endless = Endless::new(traffic, &cars);
        let outcome = opensees(&python, &task(cars.train(), endless.steps)?)?;
        let planar = fastest(endless.steps, || {
            for _ in 0..endless.steps {
                black_box(endless.step());
            }
        });
        let space = InSpace::new(traffic, Scheme::AverageAcceleration, STEP_S);
        let spatial = fastest(endless.steps, || {
            space.solve(&mut |state| {
                black_box(state.position[0]);
            });
        });
        let difference = difference(traffic, cars.train().clone(), &outcome.mid_span_m)?;
        for (way, &theirs) in &outcome.seconds_a_step {
            rows += &format!(
                "| {traffic} | {way} | {:.1} | {:.3} | {:.0} | {:.3} | {:.0} |\n",
                1e6 * theirs,
                1e6 * planar,
                theirs / planar,
                1e6 * spatial,
                theirs / spatial
            );
        }
        notes += &format!(
            "{traffic}: {} steps; mid-span under constant forces differs by {:.2} % of its largest displacement, {:.2} mm; \
             OpenSees' first frequency {:.5} Hz.\n",
            endless.steps,
            100.0 * difference,
            1e3 * outcome.mid_span_m.iter().fold(0.0_f64, |most, u| most.max(u.abs())),
            outcome.first_hz
        );
        if kind == Inspection2Dof {
            notes = format!(
                "{}; OpenSeesPy {} with Python {}; {}\n\n{notes}",
                processor(),
                outcome.version,
                outcome.python,
                compiler()
            );
        }
        ensure!(
            difference < AGREEMENT,
            "OpenSees and the solver analyse different things: {notes}"
        );
    }
    println!(
        "{notes}\n| train | OpenSees' analysis, no interaction | us a step | solver with interaction, f64, us a step | ratio | \
         its cars in space, us a step | ratio |\n|---|---|---|---|---|---|---|\n{rows}"
    );
    Ok(())
}

/// The beam of the girder's file and the static loads of the train.
fn task(train: &PlanarTrain<f64>, steps: u32) -> Result<Task> {
    let girder = file::parse(include_str!("../bridges/girder50.toml"))?;
    let wheels = (train.cars.iter())
        .flat_map(|place| {
            let contacts = train.kinds[place.kind].contacts.iter();
            contacts.map(|at| (place.behind_m + at.behind_m, at.load_n))
        })
        .collect();
    Ok(Task {
        length_m: girder.length_m,
        elements: girder.elements,
        bending_stiffness_nm2: girder.bending_stiffness_nm2,
        mass_kgpm: girder.mass_per_length_kgpm,
        damping_ratio: girder.damping_ratio,
        speed_mps: SPEED_MPS,
        wheels,
        step_s: STEP_S,
        steps,
    })
}

/// Runs `moving_load.py`.
fn opensees(python: &OsStr, task: &Task) -> Result<Outcome> {
    let script = concat!(env!("CARGO_MANIFEST_DIR"), "/benches/opensees/moving_load.py");
    let mut command = Command::new(python);
    command.arg(script).stdin(Stdio::piped()).stdout(Stdio::piped());
    if let Some(libraries) = std::env::var_os("OPENSEES_LIBRARIES") {
        command.env("LD_LIBRARY_PATH", libraries);
    }
    let mut child = command.spawn().context("Python cannot be started")?;
    // Dropped, and so ended, before the output is waited for.
    let mut input = child.stdin.take().context("no input")?;
    input.write_all(&serde_json::to_vec(task)?)?;
    drop(input);
    let output = child.wait_with_output()?;
    ensure!(output.status.success(), "moving_load.py failed");
    Ok(serde_json::from_slice(&output.stdout)?)
}

/// Seconds a step of the fastest of several passages.
fn fastest(steps: u32, mut passage: impl FnMut()) -> f64 {
    let seconds = (0..REPETITIONS).map(|_| {
        let start = Instant::now();
        passage();
        start.elapsed().as_secs_f64()
    });
    seconds.fold(f64::INFINITY, f64::min) / f64::from(steps)
}

/// Largest difference of mid-span's displacement from `theirs`, as a part of the largest of `theirs`.
fn difference(traffic: Traffic, mut train: PlanarTrain<f64>, theirs: &[f64]) -> Result<f64> {
    // Cars without springs and unsprung mass are constant forces.
    for contact in train.kinds.iter_mut().flat_map(|car| &mut car.contacts) {
        contact.unsprung = 0.0;
        contact.spring.stiffness = 0.0;
        contact.spring.damping = 0.0;
    }
    let forces = TrainSteps::new(train, Scheme::AverageAcceleration, STEP_S)?;
    let mut passage = Endless::new(traffic, &forces);
    let [most, apart] = theirs.iter().fold([0.0_f64; 2], |[most, apart], &u| {
        [most.max(u.abs()), apart.max((passage.step() - u).abs())]
    });
    Ok(apart / most)
}

/// Name of the processor, where the system tells it.
fn processor() -> String {
    let text = fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let name = (text.lines())
        .find(|line| line.starts_with("model name"))
        .and_then(|line| line.split_once(": "));
    let count = std::thread::available_parallelism().map_or(1, usize::from);
    format!(
        "{} ({count} processors)",
        name.map_or("unknown processor", |(_, name)| name)
    )
}

/// Version of the compiler.
fn compiler() -> String {
    let output = Command::new("rustc").arg("--version").output();
    output.map_or_else(
        |_| "unknown compiler".to_owned(),
        |output| String::from_utf8_lossy(&output.stdout).trim().to_owned(),
    )
}
