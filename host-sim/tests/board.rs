//! What the board promises, shown on QEMU with an image that breaks it on purpose (`src/bin/board_check.rs`).
//!
//! `sh tests/build-firmware.sh board-check` builds the image; without it these tests fail.

use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use host_sim::channel::Channel;
use host_sim::channel::qemu::Qemu;
use host_sim::image::Sizes;
use spanwatch::link::{Health, Restart};

/// Orders of `src/bin/board_check.rs`.
const HEALTH: u8 = 0x80;
const PANIC: u8 = 0x81;
const UNDEFINED_INSTRUCTION: u8 = 0x82;
const OVERFLOW_STACK: u8 = 0x83;
const HANG: u8 = 0x84;

/// QEMU answers within milliseconds; a loaded machine may take seconds.
const PATIENCE: Duration = Duration::from_secs(60);

fn image(name: &str) -> PathBuf {
    let target = std::env::var_os("CARGO_TARGET_DIR")
        .map_or_else(|| Path::new(env!("CARGO_MANIFEST_DIR")).join("../target"), PathBuf::from);
    target.join("thumbv7em-none-eabihf/firmware").join(name)
}

fn start(icount: bool) -> Qemu {
    Qemu::start(&image("board-check"), icount, false).unwrap()
}

/// The next `count` bytes.
fn receive(qemu: &mut Qemu, count: usize) -> Vec<u8> {
    let deadline = Instant::now() + PATIENCE;
    let mut received = Vec::with_capacity(count);
    while received.len() < count {
        assert!(Instant::now() < deadline, "{} of {count} bytes, log: {:#?}", received.len(), qemu.log());
        let mut chunk = vec![0; count - received.len()];
        let count = qemu.receive(&mut chunk, Duration::from_millis(100)).unwrap();
        received.extend_from_slice(&chunk[..count]);
    }
    received
}

fn health(qemu: &mut Qemu) -> Health {
    qemu.send(&[HEALTH]).unwrap();
    let length = receive(qemu, 1)[0];
    postcard::from_bytes(&receive(qemu, length.into())).unwrap()
}

/// Gives an order that ends the run, and waits until the next run has begun.
fn break_by(order: u8, qemu: &mut Qemu) -> Health {
    let lines = qemu.log().len();
    qemu.send(&[order]).unwrap();
    wait_for_log(qemu, lines + 1);
    health(qemu)
}

fn wait_for_log(qemu: &mut Qemu, lines: usize) {
    let deadline = Instant::now() + PATIENCE;
    while qemu.log().len() < lines {
        assert!(Instant::now() < deadline, "log: {:#?}", qemu.log());
        std::thread::sleep(Duration::from_millis(5));
    }
}

fn logged(qemu: &Qemu, words: &str) -> bool {
    qemu.log().iter().any(|line| line.contains(words))
}

/// Sends `total` bytes below 0x80 as fast as the line takes them, and compares what comes back.
fn echo(qemu: &mut Qemu, total: usize) {
    let byte = |place: usize| (place.wrapping_mul(2_654_435_761) >> 11) as u8 & 0x7F;
    let deadline = Instant::now() + PATIENCE;
    // So much may be under way: less than the receive queue and QEMU's socket hold together.
    const WINDOW: usize = 65_536;
    let (mut sent, mut received) = (0, 0);
    let mut chunk = [0; 4096];
    while received < total {
        assert!(Instant::now() < deadline, "{received} of {total} bytes came back");
        if sent < total && sent - received < WINDOW {
            let end = total.min(sent + 4096);
            qemu.send(&(sent..end).map(byte).collect::<Vec<_>>()).unwrap();
            sent = end;
        }
        let count = qemu.receive(&mut chunk, Duration::from_millis(1)).unwrap();
        for &came in &chunk[..count] {
            assert_eq!(came, byte(received), "byte {received}");
            received += 1;
        }
    }
    assert_eq!(health(qemu).overruns, 0);
}

#[test]
fn a_megabyte_at_full_speed_loses_nothing() {
    echo(&mut start(false), 1_000_000);
}

#[test]
fn nothing_is_lost_when_instructions_are_counted_either() {
    echo(&mut start(true), 200_000);
}

#[test]
fn a_fresh_board_starts_from_power_on_with_a_measured_stack() {
    let mut qemu = start(false);
    let health = health(&mut qemu);
    assert_eq!(health.restart, Restart::PowerOn);
    let stack = Sizes::of(&image("board-check")).unwrap().stack;
    assert!((1..stack).contains(&health.stack_peak_bytes.into()), "{health:?} of {stack}");
    assert!(logged(&qemu, "power on"));
}

#[test]
fn a_panic_is_logged_reported_and_restarted() {
    let mut qemu = start(false);
    assert_eq!(break_by(PANIC, &mut qemu).restart, Restart::Panic);
    assert!(logged(&qemu, "panic at src/bin/board_check.rs:"), "{:#?}", qemu.log());
}

#[test]
fn a_fault_is_logged_reported_and_restarted() {
    let mut qemu = start(false);
    assert_eq!(break_by(UNDEFINED_INSTRUCTION, &mut qemu).restart, Restart::Fault);
    // UNDEFINSTR
    assert!(logged(&qemu, "CFSR 0x00010000"), "{:#?}", qemu.log());
}

#[test]
fn a_stack_that_overflows_is_a_fault_and_not_a_ruined_variable() {
    let mut qemu = start(false);
    assert_eq!(break_by(OVERFLOW_STACK, &mut qemu).restart, Restart::Fault);
    assert!(logged(&qemu, "the stack ran over its end"), "{:#?}", qemu.log());
}

#[test]
fn a_hang_is_found_by_the_watchdog() {
    let mut qemu = start(false);
    assert_eq!(break_by(HANG, &mut qemu).restart, Restart::Watchdog);
    assert!(logged(&qemu, "hung at pc 0x0000"), "{:#?}", qemu.log());
}

#[test]
fn an_idle_board_feeds_its_watchdog() {
    let mut qemu = start(false);
    // Three times the watchdog's second.
    std::thread::sleep(Duration::from_secs(3));
    assert_eq!(health(&mut qemu).restart, Restart::PowerOn);
}

#[test]
fn three_failures_in_a_row_end_the_run_as_failed() {
    let mut qemu = start(false);
    assert_eq!(break_by(PANIC, &mut qemu).restart, Restart::Panic);
    assert_eq!(break_by(UNDEFINED_INSTRUCTION, &mut qemu).restart, Restart::Fault);
    qemu.send(&[PANIC]).unwrap();
    let deadline = Instant::now() + PATIENCE;
    let status = loop {
        assert!(Instant::now() < deadline, "log: {:#?}", qemu.log());
        if let Some(status) = qemu.ended().unwrap() {
            break status;
        }
        std::thread::sleep(Duration::from_millis(5));
    };
    assert!(!status.success());
    assert!(logged(&qemu, "3 failures in a row"), "{:#?}", qemu.log());
    let error = qemu.receive(&mut [0], Duration::from_secs(1)).unwrap_err();
    assert!(error.to_string().contains("QEMU has closed the line"), "{error}");
}

#[test]
fn a_missing_image_is_answered_with_how_to_build_it() {
    let error = Qemu::start(Path::new("no/such/image"), false, false).err().unwrap();
    assert!(format!("{error:#}").contains("sh tests/build-firmware.sh"), "{error:#}");
}
