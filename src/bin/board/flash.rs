//! The flash of outbox and settings: the first 88 KiB of the board's PSRAM, which stand for a NOR flash.
//!
//! The MPS2 has none that QEMU models. Its PSRAM (16 MiB at 0x21000000, Arm DAI 0386, table 3-1) is memory that no variable is in; QEMU can
//! lay it on a file (`-object memory-backend-file,..,share=on -machine ..,memory-backend=..`), so that an image that is killed and
//! started again finds what it has written. This driver gives it the manners of a NOR flash: whole pages are erased to ones, bits are
//! programmed to zero. A board with a flash puts its own driver here; nothing else changes.

use embedded_storage::nor_flash::{ErrorType, NorFlash, NorFlashError, NorFlashErrorKind, ReadNorFlash};

const BASE: usize = 0x2100_0000;
const PAGE_BYTES: usize = 4096;
/// Pages of the outbox, and behind them those of the settings.
const OUTBOX_PAGES: usize = 16;
const SETTINGS_PAGES: usize = 6;

/// Something outside the flash, or no whole words or pages.
#[derive(Debug, Clone, Copy)]
pub struct Misuse;

impl NorFlashError for Misuse {
    fn kind(&self) -> NorFlashErrorKind {
        NorFlashErrorKind::OutOfBounds
    }
}

/// A partition of the flash. There are two ([`Flash::take`]).
pub struct Flash {
    first: usize,
    bytes: usize,
}

impl Flash {
    /// The partitions of outbox and settings, for whoever starts the board, which happens once.
    pub(super) const fn take() -> (Self, Self) {
        let outbox = Self {
            first: 0,
            bytes: OUTBOX_PAGES * PAGE_BYTES,
        };
        let settings = Self {
            first: outbox.bytes,
            bytes: SETTINGS_PAGES * PAGE_BYTES,
        };
        (outbox, settings)
    }

    /// Does something to each byte of a part of the flash.
    fn each(
        &mut self,
        from: u32,
        length: usize,
        mut change: impl FnMut(u8, usize) -> Option<u8>,
    ) -> Result<(), Misuse> {
        let from = from as usize;
        if from.checked_add(length).is_none_or(|end| end > self.bytes) {
            return Err(Misuse);
        }
        for at in 0..length {
            let byte = core::ptr::with_exposed_provenance_mut::<u8>(BASE + self.first + from + at);
            // SAFETY: it lies in the PSRAM, where there is no variable, in this partition, and `self` is the only one to touch that.
            let before = unsafe { byte.read_volatile() };
            if let Some(after) = change(before, at) {
                // SAFETY: as above.
                unsafe { byte.write_volatile(after) };
            }
        }
        Ok(())
    }
}

impl ErrorType for Flash {
    type Error = Misuse;
}

impl ReadNorFlash for Flash {
    const READ_SIZE: usize = 1;

    fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), Misuse> {
        let length = bytes.len();
        self.each(offset, length, |byte, at| {
            if let Some(place) = bytes.get_mut(at) {
                *place = byte;
            }
            None
        })
    }

    fn capacity(&self) -> usize {
        self.bytes
    }
}

impl NorFlash for Flash {
    const WRITE_SIZE: usize = 4;
    const ERASE_SIZE: usize = PAGE_BYTES;

    fn erase(&mut self, from: u32, to: u32) -> Result<(), Misuse> {
        self.each(from, to.checked_sub(from).ok_or(Misuse)? as usize, |_, _| Some(0xFF))
    }

    fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), Misuse> {
        self.each(offset, bytes.len(), |before, at| {
            bytes.get(at).map(|byte| before & byte)
        })
    }
}
