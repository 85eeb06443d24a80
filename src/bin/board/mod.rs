//! The board: Arm's MPS2 with the Cortex-M4F image AN386, as QEMU 7.2 models it (`-M mps2-an386`).
//!
//! | part | where | file |
//! |---|---|---|
//! | line to the base station: CMSDK UART0 | 0x40004000, interrupt 0 | `line.rs` |
//! | time: SysTick, 25 MHz | core | `clock.rs` |
//! | flash of outbox and settings: the PSRAM's beginning | 0x21000000 | `flash.rs` |
//! | watchdog: CMSDK APB watchdog, 25 MHz | 0x40008000, non-maskable interrupt | `watchdog.rs` |
//! | stack, and the guard below it: MPU | core | `stack.rs` |
//! | what is left behind by a failure | a few bytes of RAM | `restart.rs` |
//! | log: defmt over semihosting | debugger or QEMU | `restart.rs` answers where nobody listens |
//!
//! Sources: Arm DAI 0386 (memory map, interrupts), Arm DDI 0479 (CMSDK peripherals), Arm DDI 0403 (ARMv7-M). Nothing but
//! this folder uses `unsafe`. No function panics.

mod clock;
mod flash;
mod line;
mod log;
mod register;
mod restart;
mod stack;
mod watchdog;

use cortex_m::peripheral::Peripherals;
pub use flash::Flash;
use line::Line;
use spanwatch::link::{self, Health, Restart};
use watchdog::Watchdog;

/// Clock of the processor and of the peripherals, Hz (Arm DAI 0386, section 3.3).
const CLOCK_HZ: u32 = 25_000_000;

/// The board, running.
pub struct Board {
    line: Line,
    watchdog: Watchdog,
    restart: Restart,
}

impl Board {
    /// Starts every part, and reports how the run before this one ended. To be called once: a second call does not
    /// return.
    ///
    /// The main loop must call [`Board::feed_watchdog`] at least every `longest_turn_s` seconds.
    pub fn start(longest_turn_s: u32) -> Self {
        let Some(mut core) = Peripherals::take() else {
            restart::stop();
        };
        stack::guard(&mut core.MPU);
        clock::start(&mut core.SYST);
        let watchdog = Watchdog::start(longest_turn_s);
        let restart = restart::report();
        let Some(line) = Line::start() else {
            restart::stop();
        };
        Self {
            line,
            watchdog,
            restart,
        }
    }

    /// The flash of the outbox and that of the settings; asked for once.
    #[allow(dead_code, reason = "only the logger has them")]
    pub fn flash() -> (Flash, Flash) {
        Flash::take()
    }

    /// Starts again, as after a failure: what lies on the flash is looked at anew.
    #[allow(dead_code, reason = "only the logger has an outbox")]
    pub fn start_again() -> ! {
        cortex_m::peripheral::SCB::sys_reset()
    }

    /// Says that the main loop is alive.
    pub fn feed_watchdog(&mut self) {
        self.watchdog.feed();
    }

    /// Moves what has been received into `chunk`, as much as fits, and returns it.
    pub fn take<'a>(&mut self, chunk: &'a mut [u8]) -> &'a [u8] {
        self.line.take(chunk)
    }

    /// Waits for an interrupt, unless something has been received already. The clock interrupts at least every 0.7 s.
    pub fn sleep(&mut self) {
        // With interrupts off, one that comes between the question and `wfi` stays pending, and `wfi` does not wait.
        cortex_m::interrupt::free(|_| {
            if self.line.is_empty() {
                cortex_m::asm::wfi();
            }
        });
    }
}

impl link::Board for Board {
    fn send(&mut self, bytes: &[u8]) {
        self.line.send(bytes);
    }

    fn ticks(&mut self) -> u64 {
        clock::ticks()
    }

    fn now_ms(&mut self) -> u64 {
        clock::ticks() / u64::from(CLOCK_HZ / 1000)
    }

    fn health(&mut self) -> Health {
        Health {
            overruns: line::overruns(),
            stack_peak_bytes: stack::peak_bytes(),
            restart: self.restart,
        }
    }

    fn restart(&mut self) {
        Self::start_again();
    }
}

// Log lines carry the time since the start, s.
defmt::timestamp!("{=u64:us}", clock::ticks() / (CLOCK_HZ as u64 / 1_000_000));

/// Interrupts without a handler of their own.
#[cortex_m_rt::exception]
unsafe fn DefaultHandler(number: i16) {
    match number {
        line::RECEIVED => line::on_received(),
        _ => restart::unexpected(number),
    }
}
