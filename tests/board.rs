//! What the board promises, shown on QEMU with an image that breaks it on purpose (`src/bin/board_check.rs`).
//!
//! `sh tests/build-firmware.sh board-check` builds the image; without it these tests fail.

use std::path::Path;
use std::time::{Duration, Instant};

use host_sim::channel::qemu::Qemu;
use host_sim::channel::{Channel, built_image};
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

/// Fifty times the receive queue; QEMU passes some 20 000 bytes a second.
const ECHO_BYTES: usize = 100_000;

/// A board under test.
struct Board {
    qemu: Qemu,
    /// Runs that have begun: each logs one line with this word.
    runs: usize,
}

const RUN_BEGINS: &str = "started";

impl Board {
    fn start(icount: bool) -> Self {
        let qemu = Qemu::start(&built_image("board-check"), icount, false).unwrap();
        let mut board = Self { qemu, runs: 0 };
        board.wait_for_next_run();
        board
    }

    /// The next `count` bytes.
    fn receive(&mut self, count: usize) -> Vec<u8> {
        let deadline = Instant::now() + PATIENCE;
        let mut received = Vec::with_capacity(count);
        while received.len() < count {
            assert!(
                Instant::now() < deadline,
                "{} of {count} bytes, log: {:#?}",
                received.len(),
                self.qemu.log()
            );
            let mut chunk = vec![0; count - received.len()];
            let count = self.qemu.receive(&mut chunk, Duration::from_millis(100)).unwrap();
            received.extend_from_slice(&chunk[..count]);
        }
        received
    }

    fn health(&mut self) -> Health {
        self.qemu.send(&[HEALTH]).unwrap();
        let length = self.receive(1)[0];
        postcard::from_bytes(&self.receive(length.into())).unwrap()
    }

    /// Gives an order that ends the run, and waits until the next one has begun.
    fn break_by(&mut self, order: u8) -> Health {
        self.qemu.send(&[order]).unwrap();
        self.wait_for_next_run();
        self.health()
    }

    fn wait_for_next_run(&mut self) {
        self.runs += 1;
        let deadline = Instant::now() + PATIENCE;
        while self.qemu.log().iter().filter(|line| line.contains(RUN_BEGINS)).count() < self.runs {
            assert!(Instant::now() < deadline, "log: {:#?}", self.qemu.log());
            std::thread::sleep(Duration::from_millis(5));
        }
    }

    #[track_caller]
    fn assert_logged(&self, words: &str) {
        let log = self.qemu.log();
        assert!(log.iter().any(|line| line.contains(words)), "no {words:?} in {log:#?}");
    }
}

/// Sends `total` bytes below 0x80 as fast as the line takes them, and compares what comes back.
fn echo(board: &mut Board, total: usize) {
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
            board.qemu.send(&(sent..end).map(byte).collect::<Vec<_>>()).unwrap();
            sent = end;
        }
        let count = board.qemu.receive(&mut chunk, Duration::from_millis(1)).unwrap();
        for &came in &chunk[..count] {
            assert_eq!(came, byte(received), "byte {received}");
            received += 1;
        }
    }
    assert_eq!(board.health().overruns, 0);
}

#[test]
fn an_echo_at_full_speed_loses_nothing() {
    echo(&mut Board::start(false), ECHO_BYTES);
}

#[test]
fn nothing_is_lost_when_instructions_are_counted_either() {
    echo(&mut Board::start(true), ECHO_BYTES);
}

#[test]
fn a_fresh_board_starts_from_power_on_with_a_measured_stack() {
    let mut board = Board::start(false);
    let health = board.health();
    assert_eq!(health.restart, Restart::PowerOn);
    let stack = Sizes::of(&built_image("board-check")).unwrap().stack;
    assert!(
        (1..stack).contains(&health.stack_peak_bytes.into()),
        "{health:?} of {stack}"
    );
    board.assert_logged("power on");
}

#[test]
fn a_panic_is_logged_reported_and_restarted() {
    let mut board = Board::start(false);
    assert_eq!(board.break_by(PANIC).restart, Restart::Panic);
    board.assert_logged("panic at src/bin/board_check.rs:");
}

#[test]
fn a_fault_is_logged_reported_and_restarted() {
    let mut board = Board::start(false);
    assert_eq!(board.break_by(UNDEFINED_INSTRUCTION).restart, Restart::Fault);
    // UNDEFINSTR
    board.assert_logged("CFSR 0x00010000");
}

#[test]
fn a_stack_that_overflows_is_a_fault_and_not_a_ruined_variable() {
    let mut board = Board::start(false);
    assert_eq!(board.break_by(OVERFLOW_STACK).restart, Restart::Fault);
    board.assert_logged("the stack ran over its end");
}

#[test]
fn a_hang_is_found_by_the_watchdog() {
    let mut board = Board::start(false);
    assert_eq!(board.break_by(HANG).restart, Restart::Watchdog);
    board.assert_logged("hung at pc 0x0000");
}

#[test]
fn an_idle_board_feeds_its_watchdog() {
    let mut board = Board::start(false);
    // Half as long again as the watchdog allows.
    std::thread::sleep(Duration::from_millis(4500));
    assert_eq!(board.health().restart, Restart::PowerOn);
}

#[test]
fn three_failures_in_a_row_end_the_run_as_failed() {
    let mut board = Board::start(false);
    assert_eq!(board.break_by(PANIC).restart, Restart::Panic);
    assert_eq!(board.break_by(UNDEFINED_INSTRUCTION).restart, Restart::Fault);
    board.qemu.send(&[PANIC]).unwrap();
    let deadline = Instant::now() + PATIENCE;
    let status = loop {
        assert!(Instant::now() < deadline, "log: {:#?}", board.qemu.log());
        if let Some(status) = board.qemu.ended().unwrap() {
            break status;
        }
        std::thread::sleep(Duration::from_millis(5));
    };
    assert!(!status.success());
    board.assert_logged("3 failures in a row");
    let error = board.qemu.receive(&mut [0], Duration::from_secs(1)).unwrap_err();
    assert!(error.to_string().contains("QEMU has closed the line"), "{error}");
}

#[test]
fn a_missing_image_is_answered_with_how_to_build_it() {
    let error = Qemu::start(Path::new("no/such/image"), false, false).err().unwrap();
    assert!(format!("{error:#}").contains("sh tests/build-firmware.sh"), "{error:#}");
}
