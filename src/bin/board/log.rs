//! Where the log goes: defmt's frames, by semihosting, to a debugger or QEMU. Where nobody listens, `restart.rs` answers for them.
//!
//! The crate `defmt-semihosting` does the same, but panics where one log statement runs inside another, and the image must hold no panic.
//! Here the inner one is left out.

use core::cell::UnsafeCell;

use cortex_m::interrupt;
use cortex_m::register::primask;
use cortex_m_semihosting::hio::{self, HostStream};
use defmt::Encoder;

#[defmt::global_logger]
struct Log;

struct State {
    /// Log statements under way: more than one if a statement runs inside another.
    depth: u32,
    /// Interrupts were on before the first of them.
    interrupts: bool,
    encoder: Encoder,
    /// None until somebody has listened.
    host: Option<HostStream>,
}

struct Guarded(UnsafeCell<State>);

// SAFETY: one core; `acquire` turns interrupts off until `release`, and the handlers that come all the same log nothing.
unsafe impl Sync for Guarded {}

static STATE: Guarded = Guarded(UnsafeCell::new(State {
    depth: 0,
    interrupts: false,
    encoder: Encoder::new(),
    host: None,
}));

impl State {
    /// Lets `encode` write to the host, unless it is for a statement inside another.
    fn encode(&mut self, encode: impl FnOnce(&mut Encoder, &mut dyn FnMut(&[u8]))) {
        let Self {
            depth: 1,
            encoder,
            host: Some(host),
            ..
        } = self
        else {
            return;
        };
        // Whoever has gone away hears nothing.
        encode(encoder, &mut |bytes| _ = host.write_all(bytes));
    }
}

/// # Safety
/// Interrupts are off, and no other reference to the state exists.
#[allow(clippy::mut_from_ref, reason = "the caller promises that it is the only one")]
unsafe fn state() -> &'static mut State {
    // SAFETY: as promised by the caller.
    unsafe { &mut *STATE.0.get() }
}

// SAFETY: the frames of two statements do not mix: interrupts are off while one is written, and one inside another is left out.
unsafe impl defmt::Logger for Log {
    fn acquire() {
        let interrupts = primask::read().is_active();
        interrupt::disable();
        // SAFETY: interrupts are off; each of these functions gives its reference up before it returns, and calls none of the others.
        let state = unsafe { state() };
        if state.depth == 0 {
            state.interrupts = interrupts;
            if state.host.is_none() {
                state.host = hio::hstdout().ok();
            }
        }
        state.depth = state.depth.saturating_add(1);
        state.encode(|encoder, write| encoder.start_frame(write));
    }

    unsafe fn flush() {
        // The host has what it was given.
    }

    unsafe fn release() {
        // SAFETY: as in `acquire`, which came before.
        let state = unsafe { state() };
        state.encode(|encoder, write| encoder.end_frame(write));
        state.depth = state.depth.saturating_sub(1);
        if state.depth == 0 && state.interrupts {
            // SAFETY: they were on before.
            unsafe { interrupt::enable() };
        }
    }

    unsafe fn write(bytes: &[u8]) {
        // SAFETY: as in `acquire`, which came before.
        let state = unsafe { state() };
        state.encode(|encoder, write| encoder.write(bytes, write));
    }
}
