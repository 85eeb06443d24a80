//! What a failure leaves behind, and how the next start reports it.
//!
//! Panics, faults and a watchdog that ran out end in a [`Record`] in RAM that the start-up code does not clear, and a reset.
//! Nothing is logged before the reset: the failure may have come from within the log. The next start finds the record,
//! logs it once, and says in every status message why it started. After [`FAST_RESTARTS`] failures that each came within
//! [`FAST_TICKS`] it does not start again: QEMU or the debugger is told that the run has failed; where there is none, the
//! watchdog makes it try again when it runs out.
//!
//! MemManage, BusFault and UsageFault are not enabled on their own and so end in HardFault too.
//!
//! The log goes to a debugger by breakpoints. Without a debugger such a breakpoint is a HardFault; the handler answers
//! it ("failed") and goes on, so the same image also runs where nobody reads the log.

use core::arch::naked_asm;
use core::cell::UnsafeCell;
use core::mem::MaybeUninit;
use core::panic::PanicInfo;

use cortex_m::peripheral::SCB;
use cortex_m_semihosting::debug;
use defmt::{error, info};
use spanwatch::link::Restart;

use super::register::Register;
use super::{CLOCK_HZ, clock, stack};

/// So many failures in a row, and the board stops.
const FAST_RESTARTS: u32 = 3;
/// A failure sooner than this after the start counts as in a row with the one before.
const FAST_TICKS: u64 = 10 * CLOCK_HZ as u64;

/// Marks a record: RAM that has just got power holds it with a probability of 2^-64.
const MAGIC: [u32; 2] = [0x5A1B_71D6, 0x0C4E_93AF];
/// Bytes kept of the name of the file that panicked.
const FILE_BYTES: usize = 48;

// SAFETY: the fault registers of the core (Arm DDI 0403, section B3.2).
const FAULT_STATUS: Register = unsafe { Register::at(0xE000_ED28) };
// SAFETY: as above.
const HARD_FAULT_STATUS: Register = unsafe { Register::at(0xE000_ED2C) };
// SAFETY: as above.
const DEBUG_FAULT_STATUS: Register = unsafe { Register::at(0xE000_ED30) };
// SAFETY: as above.
const MEMORY_FAULT_ADDRESS: Register = unsafe { Register::at(0xE000_ED34) };
// SAFETY: as above.
const BUS_FAULT_ADDRESS: Register = unsafe { Register::at(0xE000_ED38) };

/// The processor could not store its registers on the stack.
const STATUS_STACKING: u32 = 1 << 4 | 1 << 12;
const STATUS_MEMORY_ADDRESS_VALID: u32 = 1 << 7;
const STATUS_BUS_ADDRESS_VALID: u32 = 1 << 15;

/// [`Record::kind`]: the program runs, nothing has failed.
const RUNNING: u32 = 1;
const PANIC: u32 = 2;
const FAULT: u32 = 3;
const WATCHDOG: u32 = 4;
const UNEXPECTED: u32 = 5;

/// What is left behind. Any pattern of bits is a valid value, because RAM may hold any.
#[derive(Clone, Copy)]
#[repr(C)]
struct Record {
    magic: [u32; 2],
    kind: u32,
    /// Failures in a row.
    failures: u32,
    /// Where the program was, and where it would have returned to; 0: not known.
    pc: u32,
    lr: u32,
    /// Why the processor faulted (CFSR), and at which address; of an unexpected interrupt its number.
    status: u32,
    address: u32,
    /// Where the program panicked: end of the file's name (bytes of 0 behind it), line.
    file: [u8; FILE_BYTES],
    line: u32,
}

impl Record {
    const fn new(kind: u32) -> Self {
        Self {
            magic: MAGIC,
            kind,
            failures: 0,
            pc: 0,
            lr: 0,
            status: 0,
            address: 0,
            file: [0; FILE_BYTES],
            line: 0,
        }
    }
}

/// A place in RAM that keeps its content over a reset.
struct Kept(UnsafeCell<MaybeUninit<Record>>);

// SAFETY: one core; `read` and `write` are called at the start, before any interrupt is on that calls them, and by the
// handlers that end the run, which nothing but another such handler interrupts.
unsafe impl Sync for Kept {}

#[unsafe(link_section = ".uninit.RECORD")]
static RECORD: Kept = Kept(UnsafeCell::new(MaybeUninit::uninit()));

impl Kept {
    fn read(&self) -> Record {
        // SAFETY: in bounds and aligned; volatile, because the compiler does not see the run that wrote it; every pattern
        // of bits is a `Record`.
        unsafe { self.0.get().cast::<Record>().read_volatile() }
    }

    fn write(&self, record: Record) {
        // SAFETY: in bounds and aligned; nobody else writes, see `Sync`.
        unsafe { self.0.get().cast::<Record>().write_volatile(record) }
    }
}

/// Logs how the run before this one ended, forgets it, and returns why this one started. Does not return when restarting
/// does not help.
pub fn report() -> Restart {
    let record = RECORD.read();
    if record.magic != MAGIC {
        RECORD.write(Record::new(RUNNING));
        info!("started: power on");
        return Restart::PowerOn;
    }
    let failures = record.failures;
    let restart = match record.kind {
        PANIC => {
            let used = record.file.split(|&byte| byte == 0).next().unwrap_or_default();
            let file = core::str::from_utf8(used).unwrap_or("?");
            error!("started after a panic at {=str}:{=u32}", file, record.line);
            Restart::Panic
        }
        FAULT => {
            error!(
                "started after a fault at pc {=u32:#010x}, called from {=u32:#010x}: CFSR {=u32:#010x}, address {=u32:#010x}",
                record.pc, record.lr, record.status, record.address
            );
            if record.status & STATUS_STACKING != 0 || stack::guards(record.address) {
                error!("the fault: the stack ran over its end");
            }
            Restart::Fault
        }
        WATCHDOG => {
            error!(
                "started by the watchdog: hung at pc {=u32:#010x}, called from {=u32:#010x}",
                record.pc, record.lr
            );
            Restart::Watchdog
        }
        UNEXPECTED => {
            error!(
                "started after an interrupt that nobody expects: number {=i32}",
                record.status as i32
            );
            Restart::Fault
        }
        _ => {
            info!("started: reset from outside");
            Restart::Request
        }
    };
    let failures = if restart == Restart::Request { 0 } else { failures };
    RECORD.write(Record {
        failures,
        ..Record::new(RUNNING)
    });
    if failures >= FAST_RESTARTS {
        error!(
            "{=u32} failures in a row, each within 10 s of the start: stopped",
            failures
        );
        // What went wrong stays on record until the watchdog ends the stop, and is told then.
        RECORD.write(Record { failures: 0, ..record });
        stop();
    }
    restart
}

/// Ends the run for good, as failed.
pub fn stop() -> ! {
    debug::exit(debug::EXIT_FAILURE);
    // Nobody listened. The watchdog is not fed any more.
    loop {
        cortex_m::asm::wfi();
    }
}

/// Leaves `record` behind and resets.
fn restart(record: Record) -> ! {
    let before = RECORD.read();
    let in_a_row = before.magic == MAGIC && clock::ticks() < FAST_TICKS;
    let failures = if in_a_row { before.failures.saturating_add(1) } else { 1 };
    RECORD.write(Record { failures, ..record });
    SCB::sys_reset()
}

/// In the logger's image nothing calls this, and the linker drops it (`tests/image.rs`); the compiler asks for it, and `board-check` panics.
#[panic_handler]
fn panicked(panic: &PanicInfo) -> ! {
    cortex_m::interrupt::disable();
    let mut record = Record::new(PANIC);
    if let Some(location) = panic.location() {
        // The end of the name tells more than its beginning.
        let name = location.file().as_bytes();
        for (kept, byte) in record
            .file
            .iter_mut()
            .zip(name.iter().skip(name.len().saturating_sub(FILE_BYTES)))
        {
            *kept = *byte;
        }
        record.line = location.line();
    }
    restart(record)
}

/// Ends the run: interrupt `number` came, and nothing here asked for it.
pub fn unexpected(number: i16) -> ! {
    let mut record = Record::new(UNEXPECTED);
    record.status = i32::from(number) as u32;
    restart(record)
}

unsafe extern "C" {
    /// First byte of the image's code (`link.x` of cortex-m-rt).
    static __stext: u8;
    /// One past its last byte.
    static __etext: u8;
}

/// What the processor stores on the stack when an exception begins (Arm DDI 0403, section B1.5.6).
#[derive(Clone, Copy)]
#[repr(C)]
struct Frame {
    r: [u32; 4],
    r12: u32,
    lr: u32,
    pc: u32,
    xpsr: u32,
}

/// The exception's frame, if there is one at `frame`: the stack may have been at its end.
///
/// # Safety
/// `frame` is the stack pointer at the beginning of an exception handler, and no reference to the frame exists.
unsafe fn frame_at(frame: *mut Frame) -> Option<Frame> {
    let room = (top_address().checked_sub(frame.addr())?) >= size_of::<Frame>();
    let fits = room && frame.addr() >= stack::bottom().addr() && frame.is_aligned();
    // SAFETY: it lies on the stack, and the caller promised that the processor wrote it there.
    fits.then(|| unsafe { frame.read_volatile() })
}

fn top_address() -> usize {
    stack::top().addr()
}

/// HardFault. A fault for lack of stack leaves none to write it down with, so the real handler starts on a fresh stack.
///
/// # Safety
/// Called by the processor only.
#[unsafe(no_mangle)]
#[unsafe(naked)]
#[unsafe(link_section = ".HardFault.logger")]
unsafe extern "C" fn HardFault() {
    naked_asm!(
        "mov r0, sp",
        // Is there stack left to ask whether it was a breakpoint of the log? 128 bytes are plenty.
        "movw r1, #:lower16:_stack_end",
        "movt r1, #:upper16:_stack_end",
        "add r1, r1, #128",
        "cmp r0, r1",
        "blo 1f",
        "push {{r0, lr}}",
        "bl {answered}",
        "cmp r0, #0",
        "pop {{r0, lr}}",
        "it ne",
        "bxne lr",
        "1:",
        "movw r1, #:lower16:_stack_start",
        "movt r1, #:upper16:_stack_start",
        "mov sp, r1",
        "b {faulted}",
        answered = sym answered,
        faulted = sym faulted,
    )
}

/// The watchdog ran out.
///
/// # Safety
/// Called by the processor only.
#[unsafe(no_mangle)]
#[unsafe(naked)]
unsafe extern "C" fn NonMaskableInt() {
    naked_asm!(
        "mov r0, sp",
        "movw r1, #:lower16:_stack_start",
        "movt r1, #:upper16:_stack_start",
        "mov sp, r1",
        "b {hung}",
        hung = sym hung,
    )
}

/// Was the fault a semihosting breakpoint that no debugger took? Then it is answered with -1, "failed", and skipped.
///
/// # Safety
/// As [`frame_at`].
unsafe extern "C" fn answered(place: *mut Frame) -> bool {
    const SEMIHOSTING: u16 = 0xBEAB;
    const DEBUG_EVENT: u32 = 1 << 31;
    const BREAKPOINT: u32 = 1 << 1;
    // SAFETY: as promised by the caller.
    let Some(mut frame) = (unsafe { frame_at(place) }) else {
        return false;
    };
    // A fault may come from a jump to where there is nothing to read.
    let code = (&raw const __stext).addr()..(&raw const __etext).addr();
    let instruction = core::ptr::with_exposed_provenance::<u16>(frame.pc as usize);
    // SAFETY: it is an aligned half-word of the image's code, which never changes.
    if !code.contains(&instruction.addr()) || unsafe { instruction.read_volatile() } != SEMIHOSTING {
        return false;
    }
    [frame.r[0], frame.pc] = [u32::MAX, frame.pc.wrapping_add(2)];
    // SAFETY: `frame_at` has found it to lie on the stack.
    unsafe { place.write_volatile(frame) };
    // Both are cleared by writing ones; QEMU 7.2 does not set them.
    HARD_FAULT_STATUS.write(DEBUG_EVENT);
    DEBUG_FAULT_STATUS.write(BREAKPOINT);
    true
}

/// # Safety
/// As [`frame_at`].
unsafe extern "C" fn faulted(frame: *mut Frame) -> ! {
    let status = FAULT_STATUS.read();
    let mut record = Record::new(FAULT);
    record.status = status;
    if status & STATUS_MEMORY_ADDRESS_VALID != 0 {
        record.address = MEMORY_FAULT_ADDRESS.read();
    } else if status & STATUS_BUS_ADDRESS_VALID != 0 {
        record.address = BUS_FAULT_ADDRESS.read();
    }
    if status & STATUS_STACKING == 0 {
        // SAFETY: as promised by the caller.
        if let Some(frame) = unsafe { frame_at(frame) } {
            (record.pc, record.lr) = (frame.pc, frame.lr);
        }
    }
    restart(record)
}

/// # Safety
/// As [`frame_at`].
unsafe extern "C" fn hung(frame: *mut Frame) -> ! {
    let before = RECORD.read();
    if before.magic == MAGIC && before.kind != RUNNING {
        // It did not hang: it has stopped.
        SCB::sys_reset();
    }
    let mut record = Record::new(WATCHDOG);
    // SAFETY: as promised by the caller.
    if let Some(frame) = unsafe { frame_at(frame) } {
        (record.pc, record.lr) = (frame.pc, frame.lr);
    }
    restart(record)
}
