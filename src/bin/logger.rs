//! The image for the logger: what comes down the line goes to [`RemoteLogger`], and the idle time too.
#![no_std]
#![no_main]

mod board;

use board::{Board, Flash};
use spanwatch::link::RemoteLogger;

/// A turn of the loop longer than this is a hang. The longest slice of work takes 7 million instructions: at 25 MHz and one to two
/// clocks each, about half a second.
const LONGEST_TURN_S: u32 = 10;
/// Bytes handed on at once.
const CHUNK_BYTES: usize = 256;

#[cortex_m_rt::entry]
fn main() -> ! {
    // In a static: it is most of the RAM.
    static mut LOGGER: RemoteLogger<Flash> = RemoteLogger::new();

    let mut board = Board::start(LONGEST_TURN_S);
    run(LOGGER, &mut board)
}

/// Not part of `main`, whose stack frame must be small: what goes wrong is recorded only once the board has started.
#[inline(never)]
fn run(logger: &mut RemoteLogger<Flash>, board: &mut Board) -> ! {
    open(logger);
    let mut chunk = [0; CHUNK_BYTES];
    loop {
        board.feed_watchdog();
        let bytes = board.take(&mut chunk);
        if !bytes.is_empty() {
            logger.receive(bytes, board);
        } else if !logger.poll(board) {
            board.sleep();
        }
        if logger.has_failed() {
            defmt::error!("the flash has failed");
            Board::start_again();
        }
    }
}

/// Opens the outbox and the line. Without a flash an alert could be lost, so there is no line then either; the watchdog tries again.
#[inline(never)]
fn open(logger: &mut RemoteLogger<Flash>) {
    loop {
        let (outbox, settings) = Board::flash();
        match logger.open(outbox, settings) {
            Ok(identity) if identity.key.is_demo() => {
                defmt::warn!("nobody gave this logger a key: it uses the DEMO KEY, which everybody knows");
                return;
            }
            Ok(identity) => {
                defmt::info!("logger {=u32}, key {=u8}", identity.device, identity.key_number);
                return;
            }
            Err(_) => defmt::error!("the flash does not answer"),
        }
    }
}
