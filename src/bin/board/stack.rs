//! The stack: how deep it went, and the guard below it.
//!
//! cortex-m-rt paints the stack before the program runs (feature `paint-stack`); the words that still have the colour
//! were never used. `memory.x` puts the stack below the variables, at the lower end of the RAM.

use cortex_m::peripheral::MPU;
use cortex_m_rt::STACK_PAINT_VALUE;

/// Bytes below the stack that nobody may touch. There is no RAM, so they cost nothing; frames larger than this could
/// jump over it.
const GUARD_BYTES: u32 = 64 * 1024;

unsafe extern "C" {
    /// One past the stack's first word, its upper end (`memory.x`).
    static _stack_start: u32;
    /// The stack's last word, its lower end (`memory.x`).
    static _stack_end: u32;
}

/// Upper end of the stack, where it begins.
pub fn top() -> *const u32 {
    &raw const _stack_start
}

/// Lower end of the stack.
pub fn bottom() -> *const u32 {
    &raw const _stack_end
}

/// Is `address` in the guard?
pub fn guards(address: u32) -> bool {
    let end = bottom().addr() as u32;
    (end.wrapping_sub(GUARD_BYTES)..end).contains(&address)
}

/// Makes an access below the stack a fault.
pub fn guard(mpu: &mut MPU) {
    const REGION_ENABLE: u32 = 1;
    const NEVER_EXECUTE: u32 = 1 << 28;
    const SIZE: u32 = (GUARD_BYTES.ilog2() - 1) << 1;
    const ENABLE: u32 = 1;
    /// What no region covers stays as the architecture has it.
    const KEEP_DEFAULT_MAP: u32 = 1 << 2;
    let base = (bottom().addr() as u32).wrapping_sub(GUARD_BYTES);
    // SAFETY: the region is aligned to its size and lies outside the RAM; no variable and no register is in it. Its
    // access permission is 0: none.
    unsafe {
        mpu.rnr.write(0);
        mpu.rbar.write(base);
        mpu.rasr.write(NEVER_EXECUTE | SIZE | REGION_ENABLE);
        mpu.ctrl.write(KEEP_DEFAULT_MAP | ENABLE);
    }
    cortex_m::asm::dsb();
    cortex_m::asm::isb();
}

/// Deepest stack since the start, bytes. Reads the unused part of the stack: some 3 instructions a word.
pub fn peak_bytes() -> u32 {
    let mut word = bottom();
    // SAFETY: from the lower to the upper end all words are RAM, aligned, and written at least by the paint.
    while word < top() && unsafe { word.read_volatile() } == STACK_PAINT_VALUE {
        word = word.wrapping_add(1);
    }
    (top().addr() - word.addr()) as u32
}
