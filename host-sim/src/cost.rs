//! Instructions that parts of the logger cost, counted by the image `step-cost` in QEMU.

use std::time::{Duration, Instant};

use anyhow::{Context, bail};
use serde::de::DeserializeOwned;

use crate::channel::{Channel, Qemu, built_image};

/// With counted instructions an instruction lasts 1 ns, so a tick of the board's 25 MHz is 40 of them.
pub const INSTRUCTIONS_PER_TICK: u64 = 40;

/// What is counted takes less than a second; a loaded machine may take a while.
const PATIENCE: Duration = Duration::from_secs(60);

/// Instructions that a frame costs, and its bytes on the line.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct FrameCost {
    /// Bytes on the line.
    pub bytes: u32,
    /// Instructions to write it.
    pub write: u64,
    /// Instructions to read it, byte by byte.
    pub read: u64,
}

/// What an alert costs on its way from the outbox: sealed by a session, and the same in the clear.
///
/// # Errors
/// QEMU or the image `step-cost` is missing, or does not answer.
pub fn of_an_alert() -> anyhow::Result<[FrameCost; 2]> {
    let (rounds, costs): (u32, [(u32, u64, u64); 2]) = count(b'l')?;
    let one = |ticks: u64| (ticks * INSTRUCTIONS_PER_TICK).checked_div(rounds.into());
    let cost = |(bytes, write, read)| {
        Some(FrameCost {
            bytes,
            write: one(write)?,
            read: one(read)?,
        })
    };
    let [sealed, clear] = costs.map(cost);
    sealed
        .zip(clear)
        .map(<[FrameCost; 2]>::from)
        .context("the image step-cost has counted nothing")
}

/// What the image `step-cost` answers to an order.
///
/// # Errors
/// QEMU or the image is missing, or does not answer.
pub fn count<T: DeserializeOwned>(order: u8) -> anyhow::Result<T> {
    let mut qemu = Qemu::start(&built_image("step-cost"), true, false)
        .context("`sh tests/build-firmware.sh step-cost` builds the image that counts")?;
    qemu.send(&[order])?;
    let deadline = Instant::now() + PATIENCE;
    let mut answer = Vec::new();
    // Its first byte tells how many follow.
    while answer.first().is_none_or(|&length| answer.len() <= usize::from(length)) {
        if Instant::now() >= deadline {
            bail!("the image step-cost does not answer; its log: {:#?}", qemu.log());
        }
        let mut chunk = [0; 128];
        let count = qemu.receive(&mut chunk, Duration::from_millis(100))?;
        answer.extend_from_slice(&chunk[..count]);
    }
    postcard::from_bytes(&answer[1..]).context("the image step-cost is of another version; build it again")
}
