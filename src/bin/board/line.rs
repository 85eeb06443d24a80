//! The line to the base station: CMSDK UART0 (Arm DDI 0479, section 4.3).
//!
//! An interrupt a byte fills a queue, which the main loop empties; the UART itself holds one byte. A queue that is full,
//! or an interrupt that comes too late, loses bytes: they are counted, and the frame that they were in fails its check.
//! Sending waits for the line: 87 us a byte at 115200 baud, while reception goes on.

use core::cell::Cell;
use core::sync::atomic::{AtomicU32, Ordering};

use cortex_m::interrupt::{InterruptNumber, Mutex};
use cortex_m::peripheral::NVIC;
use defmt::warn;
use heapless::spsc::{Consumer, Producer, Queue};

use super::register::Register;
use super::{CLOCK_HZ, clock};

/// Bytes of the receive queue: 0.18 s of a full line at 115200 baud.
const QUEUE_BYTES: usize = 2048;
/// Speed of the line, bits a second.
const BAUD: u32 = 115_200;
/// A line that takes no byte for this long is dead (a UART's line never is; QEMU's waits for whoever reads it).
const DEAD_LINE_TICKS: u64 = 5 * CLOCK_HZ as u64;

/// Number of the receive interrupt (Arm DAI 0386, table 3-5).
pub const RECEIVED: i16 = 0;

const BASE: usize = 0x4000_4000;
// SAFETY: the registers of UART0 (Arm DDI 0479, table 4-4). Reading DATA takes the byte out of the UART, no more.
const DATA: Register = unsafe { Register::at(BASE) };
// SAFETY: as above.
const STATE: Register = unsafe { Register::at(BASE + 0x4) };
// SAFETY: as above.
const CONTROL: Register = unsafe { Register::at(BASE + 0x8) };
// SAFETY: as above.
const INTERRUPT_CLEAR: Register = unsafe { Register::at(BASE + 0xC) };
// SAFETY: as above.
const BAUD_DIVIDER: Register = unsafe { Register::at(BASE + 0x10) };

const STATE_SEND_FULL: u32 = 1 << 0;
const STATE_RECEIVE_FULL: u32 = 1 << 1;
const STATE_RECEIVE_OVERRUN: u32 = 1 << 3;
const CONTROL_SEND: u32 = 1 << 0;
const CONTROL_RECEIVE: u32 = 1 << 1;
const CONTROL_RECEIVE_INTERRUPT: u32 = 1 << 3;
const INTERRUPT_RECEIVE: u32 = 1 << 1;

type Sink = Producer<'static, u8>;

/// The end of the queue that the interrupt fills.
static SINK: Mutex<Cell<Option<Sink>>> = Mutex::new(Cell::new(None));
/// Bytes lost.
static OVERRUNS: AtomicU32 = AtomicU32::new(0);

#[derive(Clone, Copy)]
struct ReceiveInterrupt;

// SAFETY: the number is that of UART0's receive interrupt and never changes.
unsafe impl InterruptNumber for ReceiveInterrupt {
    fn number(self) -> u16 {
        RECEIVED as u16
    }
}

/// The line, open.
pub struct Line {
    source: Consumer<'static, u8>,
    /// Took no bytes when it was last tried: the next ones are dropped without another wait.
    dead: bool,
}

impl Line {
    /// Opens the line, once; afterwards none.
    pub fn start() -> Option<Self> {
        let queue = cortex_m::singleton!(: Queue<u8, QUEUE_BYTES> = Queue::new())?;
        let (sink, source) = queue.split();
        cortex_m::interrupt::free(|token| SINK.borrow(token).set(Some(sink)));
        BAUD_DIVIDER.write(CLOCK_HZ / BAUD);
        CONTROL.write(CONTROL_SEND | CONTROL_RECEIVE | CONTROL_RECEIVE_INTERRUPT);
        // SAFETY: no critical section is open that relies on this interrupt being masked.
        unsafe { NVIC::unmask(ReceiveInterrupt) };
        Some(Self { source, dead: false })
    }

    /// Nothing has been received that was not taken.
    pub fn is_empty(&self) -> bool {
        !self.source.ready()
    }

    /// Moves what has been received into `chunk`, as much as fits, and returns it.
    pub fn take<'a>(&mut self, chunk: &'a mut [u8]) -> &'a [u8] {
        let mut taken = 0;
        for place in chunk.iter_mut() {
            let Some(byte) = self.source.dequeue() else { break };
            *place = byte;
            taken += 1;
        }
        chunk.get(..taken).unwrap_or_default()
    }

    /// Sends `bytes`; returns when the last is in the UART. On a dead line the rest is dropped: the receiver refuses the
    /// stump, and asks again.
    pub fn send(&mut self, bytes: &[u8]) {
        for &byte in bytes {
            if STATE.read() & STATE_SEND_FULL != 0 {
                if self.dead {
                    return;
                }
                let since = clock::ticks();
                while STATE.read() & STATE_SEND_FULL != 0 {
                    if clock::ticks() - since > DEAD_LINE_TICKS {
                        warn!(
                            "the line takes no bytes; the rest of {=usize} bytes is dropped",
                            bytes.len()
                        );
                        self.dead = true;
                        return;
                    }
                }
            }
            self.dead = false;
            DATA.write(byte.into());
        }
    }
}

/// Bytes lost since the start, in the queue or in the UART. The UART only tells that it lost bytes, not how many: that
/// counts as one.
pub fn overruns() -> u32 {
    OVERRUNS.load(Ordering::Relaxed)
}

/// The receive interrupt.
pub fn on_received() {
    // First, so that a byte that comes from here on interrupts again.
    INTERRUPT_CLEAR.write(INTERRUPT_RECEIVE);
    cortex_m::interrupt::free(|token| {
        let place = SINK.borrow(token);
        let mut sink = place.take();
        let mut lost = 0_u32;
        loop {
            let state = STATE.read();
            if state & STATE_RECEIVE_OVERRUN != 0 {
                STATE.write(STATE_RECEIVE_OVERRUN);
                lost = lost.saturating_add(1);
            }
            if state & STATE_RECEIVE_FULL == 0 {
                break;
            }
            let byte = DATA.read() as u8;
            if sink.as_mut().is_none_or(|sink| sink.enqueue(byte).is_err()) {
                lost = lost.saturating_add(1);
            }
        }
        place.set(sink);
        // The only writer.
        OVERRUNS.store(OVERRUNS.load(Ordering::Relaxed).saturating_add(lost), Ordering::Relaxed);
    });
}
