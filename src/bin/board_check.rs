//! A second image for the same board, which does to it on purpose what must not happen in the field, so that a test can
//! see that the board reports it and starts again. `tests/board.rs` talks to it.
//!
//! Bytes below 0x80 are sent back. The others are orders:
//!
//! | byte | order |
//! |---|---|
//! | 0x80 | send [`Health`](spanwatch::link::Health) as postcard, behind one byte that gives its length |
//! | 0x81 | panic |
//! | 0x82 | execute an undefined instruction |
//! | 0x83 | run over the end of the stack |
//! | 0x84 | hang |
#![no_std]
#![no_main]

mod board;

use board::Board;
use spanwatch::link::Board as _;

/// Short, so that the test need not wait for the hang to be found.
const LONGEST_TURN_S: u32 = 3;
/// From this byte on, an order.
const FIRST_ORDER: u8 = 0x80;

#[cortex_m_rt::entry]
fn main() -> ! {
    let mut board = Board::start(LONGEST_TURN_S);
    let mut chunk = [0; 256];
    loop {
        board.feed_watchdog();
        let bytes = board.take(&mut chunk);
        if bytes.is_empty() {
            board.sleep();
        }
        for part in bytes.split_inclusive(|&byte| byte >= FIRST_ORDER) {
            match part.split_last() {
                Some((&order, before)) if order >= FIRST_ORDER => {
                    board.send(before);
                    obey(order, &mut board);
                }
                _ => board.send(part),
            }
        }
    }
}

fn obey(order: u8, board: &mut Board) {
    match order {
        0x80 => {
            let mut reply = [0; 32];
            if let Ok(health) = postcard::to_slice(&board.health(), &mut reply) {
                board.send(&[health.len() as u8]);
                board.send(health);
            }
        }
        0x81 => panic!("ordered by the test"),
        0x82 => cortex_m::asm::udf(),
        0x83 => {
            descend(u32::from(order));
        }
        0x84 => loop {
            cortex_m::asm::nop();
        },
        _ => {}
    }
}

/// Calls itself until the stack ends; the result depends on each call, so none can be dropped.
#[inline(never)]
#[allow(unconditional_recursion)]
fn descend(depth: u32) -> u32 {
    let frame = core::hint::black_box([depth; 16]);
    descend(depth.wrapping_add(1)).wrapping_add(frame[3])
}
