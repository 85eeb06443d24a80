//! Time since the start, in ticks of the processor's clock.
//!
//! SysTick counts 24 bits down, from 0 to its largest value and on; an interrupt counts the rounds of 0.67 s. Under
//! QEMU's `-icount shift=0` an instruction lasts 1 ns, so a tick of 25 MHz is exactly 40 instructions.

use core::cell::Cell;
use core::sync::atomic::{AtomicU32, Ordering};

use cortex_m::interrupt::Mutex;
use cortex_m::peripheral::syst::SystClkSource;
use cortex_m::peripheral::{SCB, SYST};

/// Bits of the counter.
const BITS: u32 = 24;
/// Its largest value.
const RELOAD: u32 = (1 << BITS) - 1;

/// Rounds of the counter: 32 bits of them last for 91 years.
static ROUNDS: AtomicU32 = AtomicU32::new(0);
/// The last answer of [`ticks`].
static LAST: Mutex<Cell<u64>> = Mutex::new(Cell::new(0));

/// Starts to count.
pub fn start(systick: &mut SYST) {
    systick.set_clock_source(SystClkSource::Core);
    systick.set_reload(RELOAD);
    systick.clear_current();
    systick.enable_counter();
    systick.enable_interrupt();
}

/// Ticks since the start; never less than the answer before. May be called anywhere, with interrupts on or off, as long
/// as they are never off for a whole round.
pub fn ticks() -> u64 {
    cortex_m::interrupt::free(|token| {
        let before = SYST::get_current();
        // A round that has ended since the interrupts went off is not yet counted. Whether the counter was read before or
        // after its end is not known, so it is read again.
        let (count, pending) = if SCB::is_pendst_pending() {
            (SYST::get_current(), 1)
        } else {
            (before, 0)
        };
        let rounds = u64::from(ROUNDS.load(Ordering::Relaxed)) + pending;
        // The counter stands at 0 when a round begins, then at RELOAD, and so on downwards.
        let now = (rounds << BITS) | u64::from(count.wrapping_neg() & RELOAD);
        // QEMU without -icount may show the 0 of a new round a moment before it makes the interrupt pending.
        let last = LAST.borrow(token);
        last.set(last.get().max(now));
        last.get()
    })
}

/// A round has ended.
#[cortex_m_rt::exception]
fn SysTick() {
    // The only writer.
    ROUNDS.store(ROUNDS.load(Ordering::Relaxed).wrapping_add(1), Ordering::Relaxed);
}
