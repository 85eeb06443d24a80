//! A third image for the same board: counts what a step of the solver costs there, by the number of cars on the bridge, and what an
//! alert's frame does. `tests/instructions.rs` holds the counts to their limits.
//!
//! The steps alone are counted: no search, no eigenproblem, no recorder's filter. The bridge is a simply supported beam in
//! closed form, for what a step costs does not depend on the bridge's numbers.
//!
//! A byte orders a passage of the longest train at 270 km/h: `i` of inspection cars, `s` of `shinkansen-3d`, over a smooth track; `I`
//! and `S` over a learnt one. The answer, behind one byte that gives its length, is in postcard: for 0, 1, .. [`CARS_ON_BRIDGE`] cars
//! on the bridge the number of such steps and the ticks that they took; and the same of the step in which the first car comes, with
//! its whole approach.
//!
//! The byte `l` orders an alert's frame on the line: sealed by a session as it leaves the outbox, and the same in the clear. The answer
//! is in postcard, too: how often each was written and read; then for each its bytes, and the ticks of all writing and all reading.
#![no_std]
#![no_main]

mod board;

use board::Board;
use core::f32::consts::{PI, TAU};
use nalgebra::SVector;
use serde::Serialize;
use spanwatch::bridge::ModalBridge;
use spanwatch::capacity::{CARS, CARS_ON_BRIDGE, CHANNELS, MODES, PATH_NODES, PROFILE_COEFFICIENTS};
use spanwatch::interaction::scheme::CORNER_STEPS;
use spanwatch::interaction::{PlanarInteraction, Run, Scheme, TrainSteps};
use spanwatch::link::Board as _;
use spanwatch::session::Hello;
use spanwatch::session::packet::NONCE_BYTES;
use spanwatch::session::{Channel, End, Key};
use spanwatch::track::profile::{Knots, Profile, Stretch};
use spanwatch::track::{Smooth, Track};
use spanwatch::train::PlanarTrain;
use spanwatch::wire::message::TrainKind;
use spanwatch::wire::{Decoder, Frame, FrameBuffer, Kind};

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
/// Times that each frame is written and read.
const ROUNDS: u32 = 64;
/// A parcel's head, and an alert of ten elements.
const PARCEL_BYTES: usize = 8 + 96;

/// Height of the rails, m.
const HEIGHT_M: f32 = 1e-3;

/// Steps with equally many cars on the bridge, and their ticks.
type Count = (u32, u64);

/// Bytes of a frame on the line, and ticks of all writing and of all reading.
type FrameCost = (u32, u64, u64);

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
            let (inspection, shinkansen) = (TrainKind::Inspection2Dof, TrainKind::Shinkansen3d);
            match byte {
                b'i' => tell(&passage(inspection, &Smooth, &mut board), &mut board),
                b's' => tell(&passage(shinkansen, &Smooth, &mut board), &mut board),
                b'I' => tell(&passage(inspection, &rails(), &mut board), &mut board),
                b'S' => tell(&passage(shinkansen, &rails(), &mut board), &mut board),
                b'l' => tell(&frames(&mut board), &mut board),
                _ => {}
            }
        }
    }
}

fn tell(counts: &impl Serialize, board: &mut Board) {
    let mut answer = [0; 128];
    if let Ok(answer) = postcard::to_slice(counts, &mut answer) {
        board.send(&[answer.len() as u8]);
        board.send(answer);
    }
}

/// Writes and reads an alert's frame again and again, sealed and in the clear.
#[inline(never)]
fn frames(board: &mut Board) -> (u32, [FrameCost; 2]) {
    let hello = Hello {
        device: 1,
        key: 0,
        stream: 1,
        nonce: [1; NONCE_BYTES],
    };
    let mut sender = Channel::new(End::Logger, &Key::DEMO, &hello, &[2; NONCE_BYTES]);
    let mut receiver = Channel::new(End::Station, &Key::DEMO, &hello, &[2; NONCE_BYTES]);
    let (mut buffer, mut decoder) = (FrameBuffer::new(), Decoder::new());
    let parcel: [u8; PARCEL_BYTES] = core::array::from_fn(|i| i as u8);
    let fill = |room: &mut [u8]| {
        room.get_mut(..PARCEL_BYTES)?.copy_from_slice(&parcel);
        Some(PARCEL_BYTES)
    };
    let (mut sealed, mut clear) = ((0, 0, 0), (0, 0, 0));
    for number in 0..ROUNDS {
        board.feed_watchdog();
        let start = board.ticks();
        let written = sender.next_counter().map(|counter| {
            let seal = |bytes: &mut [u8]| sender.seal(Kind::Sealed as u8, counter, bytes);
            buffer.write_sealed(counter, Kind::Parcel, number, fill, seal)
        });
        let Some(Ok(line)) = written else { break };
        let between = board.ticks();
        let opened = decode(&mut decoder, line).and_then(|frame| {
            let (kind, counter) = (frame.kind as u8, frame.sequence);
            frame.open(|bytes, tag| receiver.open(kind, counter, bytes, tag).is_ok())
        });
        if opened.is_none_or(|frame| frame.payload() != parcel) {
            break;
        }
        add(&mut sealed, line, [start, between, board.ticks()]);

        let start = board.ticks();
        let Ok(line) = buffer.write_with(Kind::Event, number, fill) else {
            break;
        };
        let between = board.ticks();
        if decode(&mut decoder, line).is_none_or(|frame| frame.payload() != parcel) {
            break;
        }
        add(&mut clear, line, [start, between, board.ticks()]);
    }
    (ROUNDS, [sealed, clear])
}

/// The frame that the bytes of a line end with.
fn decode<'d>(decoder: &'d mut Decoder, line: &[u8]) -> Option<Frame<'d>> {
    let (last, others) = line.split_last()?;
    for &byte in others {
        decoder.push(byte);
    }
    decoder.push(*last)
}

fn add((bytes, write, read): &mut FrameCost, line: &[u8], [start, between, end]: [u64; 3]) {
    *bytes = line.len() as u32;
    *write += between.saturating_sub(start);
    *read += end.saturating_sub(between);
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
