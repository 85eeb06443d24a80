//! A third image for the same board: counts what a step of the solver costs there, by the number of cars on the bridge.
//! `tests/instructions.rs` holds the counts to their limits.
//!
//! The steps alone are counted: no search, no eigenproblem, no recorder's filter. The bridge is a simply supported beam in
//! closed form, for what a step costs does not depend on the bridge's numbers.
//!
//! A byte orders a passage of the longest train at 270 km/h: `i` of inspection cars, `s` of `shinkansen-3d`, over a smooth track; `I`
//! and `S` over a learnt one. The answer, behind one byte that gives its length, is in postcard: for 0, 1, .. [`CARS_ON_BRIDGE`] cars
//! on the bridge the number of such steps and the ticks that they took; and the same of the step in which the first car comes, with
//! its whole approach.
#![no_std]
#![no_main]

mod board;

use board::Board;
use core::f32::consts::{PI, TAU};
use nalgebra::SVector;
use spanwatch::bridge::ModalBridge;
use spanwatch::capacity::{CARS, CARS_ON_BRIDGE, CHANNELS, MODES, PATH_NODES, PROFILE_COEFFICIENTS};
use spanwatch::interaction::scheme::CORNER_STEPS;
use spanwatch::interaction::{PlanarInteraction, Run, Scheme, TrainSteps};
use spanwatch::link::Board as _;
use spanwatch::track::profile::{Knots, Profile, Stretch};
use spanwatch::track::{Smooth, Track};
use spanwatch::train::PlanarTrain;
use spanwatch::wire::message::TrainKind;

/// No stretch of steps takes nearly as long.
const LONGEST_TURN_S: u32 = 60;
/// 270 km/h.
const SPEED_MPS: f32 = 75.0;
/// The logger's step.
const STEP_S: f32 = 2.5e-3;
/// girder50: length, mass per length, first frequency, damping ratio.
const LENGTH_M: f32 = 50.0;
const MASS_KGPM: f32 = 5000.0;
const FIRST_HZ: f32 = 3.5;
const DAMPING_RATIO: f32 = 0.02;
/// Steps before the train enters: the first car's corner lies before it.
const LEAD_STEPS: u32 = 20;
/// Steps after the train has left.
const QUIET_STEPS: u32 = 400;

/// The knots that `host-sim calibrate` takes for it: from where, spacing, spans.
const APPROACH: (f32, f32, u16) = (-139.0, 4.0, 34);
const BRIDGE: (f32, f32, u16) = (-3.0, 0.5, 108);
const BEHIND: (f32, f32, u16) = (51.0, 3.0, 8);
/// Height of the rails, m.
const HEIGHT_M: f32 = 1e-3;

/// Steps with equally many cars on the bridge, and their ticks.
type Count = (u32, u64);

/// Counts by the number of cars on the bridge, and that of the approach.
type Counts = ([Count; CARS_ON_BRIDGE + 1], Count);

#[cortex_m_rt::entry]
fn main() -> ! {
    let mut board = Board::start(LONGEST_TURN_S);
    let mut chunk = [0; 16];
    loop {
        board.feed_watchdog();
        let bytes = board.take(&mut chunk);
        if bytes.is_empty() {
            board.sleep();
        }
        for byte in bytes {
            let kind = match byte.to_ascii_lowercase() {
                b'i' => TrainKind::Inspection2Dof,
                b's' => TrainKind::Shinkansen3d,
                _ => continue,
            };
            let counts = if byte.is_ascii_lowercase() {
                passage(kind, &Smooth, &mut board)
            } else {
                passage(kind, &rails(), &mut board)
            };
            let mut answer = [0; 128];
            if let Ok(answer) = postcard::to_slice(&counts, &mut answer) {
                board.send(&[answer.len() as u8]);
                board.send(answer);
            }
        }
    }
}

/// Counts the steps of a passage of the longest train; a count for each number of cars on the bridge.
#[inline(never)]
fn passage(kind: TrainKind, track: &impl Track<f32>, board: &mut Board) -> Counts {
    let mut counts = ([(0, 0); CARS_ON_BRIDGE + 1], (0, 0));
    let Some(Ok(cars)) = PlanarTrain::of_kind(kind, CARS).map(|train| TrainSteps::new(train, Scheme::Exact, STEP_S))
    else {
        return counts;
    };
    let train = cars.train();
    let run = Run {
        entry_time_s: LEAD_STEPS as f32 * STEP_S,
        ..Run::at(SPEED_MPS)
    };
    let Ok(mut solver) = PlanarInteraction::<f32, MODES>::new(beam(), track, &cars, run) else {
        return counts;
    };
    let corner_m = CORNER_STEPS as f32 * STEP_S * SPEED_MPS;
    let aboard = |step: u32| {
        let way_m = (step as f32 - LEAD_STEPS as f32) * STEP_S * SPEED_MPS;
        let coupled = |behind_m: f32, length_m: f32| {
            let front_m = way_m - behind_m;
            front_m >= -corner_m && front_m - length_m <= LENGTH_M + corner_m
        };
        let lengths = train
            .cars
            .iter()
            .map(|place| (place.behind_m, train.kinds.get(place.kind)));
        lengths
            .filter(|(behind_m, car)| car.is_some_and(|car| coupled(*behind_m, car.length_m())))
            .count()
    };
    let all = ((LENGTH_M + train.length_m()) / (SPEED_MPS * STEP_S)) as u32 + LEAD_STEPS + QUIET_STEPS;
    let mut step = 1;
    while step <= all {
        board.feed_watchdog();
        // The clock is read only where a car enters or leaves, so that its own instructions do not count.
        let now = aboard(step);
        let first = now > 0 && counts.1.0 == 0;
        let mut steps = 1;
        while !first && step + steps <= all && aboard(step + steps) == now {
            steps += 1;
        }
        let start = board.ticks();
        for _ in 0..steps {
            solver.step(&cars, track);
        }
        let ticks = board.ticks().saturating_sub(start);
        let count = if first {
            Some(&mut counts.1)
        } else {
            counts.0.get_mut(now)
        };
        if let Some(count) = count {
            count.0 += steps;
            count.1 += ticks;
        }
        step += steps;
    }
    // The result is wanted, so the steps cannot be left out.
    core::hint::black_box(solver.acceleration());
    counts
}

/// Rails whose numbers are like none another: what a look-up costs does not depend on them.
#[inline(never)]
fn rails() -> Profile<f32> {
    let [approach, bridge, behind] = [APPROACH, BRIDGE, BEHIND].map(|(from_m, spacing_m, spans)| Stretch {
        from_m,
        spacing_m,
        spans,
    });
    let heights: [f32; PROFILE_COEFFICIENTS] = core::array::from_fn(|k| HEIGHT_M * libm::sinf(k as f32 * k as f32));
    Knots::new(&[approach, bridge, behind]).map_or(Profile::SMOOTH, |knots| Profile::new(knots, &heights))
}

/// A simply supported beam: sine modes, mass-normalised.
fn beam() -> ModalBridge<f32, MODES> {
    let norm = libm::sqrtf(2.0 / (MASS_KGPM * LENGTH_M));
    let order = |k: usize| k as f32 + 1.0;
    let omega = |k: usize| TAU * FIRST_HZ * order(k) * order(k);
    let wave = |k: usize| order(k) * PI / LENGTH_M;
    let position_m: [f32; PATH_NODES] = core::array::from_fn(|node| LENGTH_M * node as f32 / (PATH_NODES - 1) as f32);
    ModalBridge {
        omega_squared: SVector::from_fn(|k, _| omega(k) * omega(k)),
        damping: SVector::from_fn(|k, _| 2.0 * DAMPING_RATIO * omega(k)),
        position_m,
        nodes: PATH_NODES,
        path: position_m.map(|x| {
            [
                SVector::from_fn(|k, _| norm * libm::sinf(wave(k) * x)),
                SVector::from_fn(|k, _| norm * wave(k) * libm::cosf(wave(k) * x)),
            ]
        }),
        sensors: [SVector::from_fn(|k, _| norm * libm::sinf(wave(k) * 0.5 * LENGTH_M)); CHANNELS],
    }
}
