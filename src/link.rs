//! Stub of the link: what comes down the line goes back.

use serde::{Deserialize, Serialize};

/// What the logger needs of the board it runs on.
pub trait Board {
    /// Sends bytes down the line; returns when the last is queued.
    fn send(&mut self, bytes: &[u8]);
    /// A counter that runs with the processor: core clock ticks since the start; 0 where there is none.
    fn ticks(&mut self) -> u64;
    /// State that only the board knows.
    fn health(&mut self) -> Health;
}

/// State that only the board knows.
#[derive(Clone, Copy, Default, PartialEq, Eq, Debug, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Health {
    /// Bytes lost in the receive queue or in the hardware.
    pub overruns: u32,
    /// Deepest stack so far, bytes.
    pub stack_peak_bytes: u32,
    /// Why the logger started.
    pub restart: Restart,
}

/// Why the logger started.
#[derive(Clone, Copy, Default, PartialEq, Eq, Debug, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Restart {
    /// Power came on.
    #[default]
    PowerOn,
    /// The program panicked.
    Panic,
    /// The processor faulted.
    Fault,
    /// The watchdog was not fed.
    Watchdog,
    /// Somebody asked for it.
    Request,
}

/// The logger at the other end of a line.
pub struct RemoteLogger {
    scratch: [u8; 96 * 1024],
}

impl RemoteLogger {
    /// A logger without a model.
    #[allow(clippy::new_without_default)]
    pub const fn new() -> Self {
        Self {
            scratch: [0; 96 * 1024],
        }
    }

    /// Handles bytes from the line.
    pub fn receive(&mut self, bytes: &[u8], board: &mut impl Board) {
        for (kept, byte) in self.scratch.iter_mut().zip(bytes) {
            *kept = *byte;
        }
        board.send(bytes);
    }

    /// One slice of work; true: there is more to do at once.
    pub fn poll(&mut self, _board: &mut impl Board) -> bool {
        false
    }
}
