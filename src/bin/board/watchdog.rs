//! The watchdog: CMSDK APB watchdog (Arm DDI 0479, section 4.6), at the clock of the processor.
//!
//! When it runs out it raises the non-maskable interrupt, whose handler writes down where the program hung and restarts
//! (`restart.rs`). Should that hang too, the watchdog resets the board itself when it runs out once more.

use super::CLOCK_HZ;
use super::register::Register;

const BASE: usize = 0x4000_8000;
// SAFETY: the registers of the watchdog (Arm DDI 0479, table 4-14).
const LOAD: Register = unsafe { Register::at(BASE) };
// SAFETY: as above.
const CONTROL: Register = unsafe { Register::at(BASE + 0x8) };
// SAFETY: as above.
const CLEAR: Register = unsafe { Register::at(BASE + 0xC) };
// SAFETY: as above.
const LOCK: Register = unsafe { Register::at(BASE + 0xC00) };

const CONTROL_INTERRUPT: u32 = 1 << 0;
const CONTROL_RESET: u32 = 1 << 1;
/// What opens the other registers for writing; anything else closes them.
const KEY: u32 = 0x1ACC_E551;
const CLOSED: u32 = 0;

/// The watchdog, running.
pub struct Watchdog(());

impl Watchdog {
    /// Starts it: from now on [`Watchdog::feed`] must be called at least every `timeout_s` seconds, at most 171.
    pub fn start(timeout_s: u32) -> Self {
        LOCK.write(KEY);
        LOAD.write(timeout_s.saturating_mul(CLOCK_HZ));
        CONTROL.write(CONTROL_INTERRUPT | CONTROL_RESET);
        LOCK.write(CLOSED);
        Self(())
    }

    /// Starts the time over.
    pub fn feed(&mut self) {
        LOCK.write(KEY);
        CLEAR.write(1);
        LOCK.write(CLOSED);
    }
}
