//! Two slots on a NOR flash for one thing: the newest that is whole counts.
//!
//! ```text
//! slot   magic u32 | generation u32 | length u32 | CRC-32C of the body u32 | CRC-32C of this head u32 | pad | body      little endian
//! ```
//!
//! The head is written last. No word is programmed twice between two erasures. The magic number carries the version; a slot of another one
//! is empty.

use embedded_storage::nor_flash::NorFlash;

use super::SettingsError;
use crate::wire::CRC32C;

/// "SWS" and the version of this layout.
const MAGIC: u32 = u32::from_le_bytes(*b"SWS\x01");
const HEAD_BYTES: usize = 20;
/// Bytes that are moved at once; a multiple of every flash's word.
const PIECE_BYTES: usize = 64;

/// Where both slots lie, one behind the other: whole sectors.
#[derive(Debug, Clone, Copy)]
pub(super) struct Slots {
    pub(super) at: u32,
    /// Of each.
    pub(super) bytes: u32,
}

/// What lies in a slot, whole.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Whole {
    slot: u32,
    pub(super) generation: u32,
    /// Where its body begins.
    pub(super) at: u32,
    /// Bytes of the body, padding included.
    pub(super) length: u32,
}

/// What is being written into a slot.
#[derive(Debug, Clone)]
pub(super) struct Staged {
    /// Where the slot begins, its body, its end, and where the next byte goes.
    start: u32,
    body: u32,
    end: u32,
    at: u32,
    generation: u32,
}

fn failed<E>(_: E) -> SettingsError {
    SettingsError::Flash
}

/// Reads from any place of the flash.
pub(super) fn read<F: NorFlash>(flash: &mut F, at: u32, bytes: &mut [u8]) -> Result<(), SettingsError> {
    const { assert!(PIECE_BYTES.is_multiple_of(F::WRITE_SIZE) && F::WRITE_SIZE.is_multiple_of(F::READ_SIZE)) };
    let piece_bytes = PIECE_BYTES as u32;
    let mut piece = [0; PIECE_BYTES];
    let mut rest = bytes;
    let mut at = at;
    while !rest.is_empty() {
        // Flashes give whole words; pieces begin at a multiple of their length.
        let skip = (at % piece_bytes) as usize;
        flash.read(at - at % piece_bytes, &mut piece).map_err(failed)?;
        let found = piece.get(skip..).unwrap_or_default();
        let count = found.len().min(rest.len());
        let (now, later) = rest.split_at_mut(count);
        now.iter_mut().zip(found).for_each(|(place, byte)| *place = *byte);
        rest = later;
        at = at.saturating_add(count as u32);
    }
    Ok(())
}

/// The checksum of bytes on the flash.
fn checksum<F: NorFlash>(flash: &mut F, at: u32, length: u32) -> Result<u32, SettingsError> {
    let mut digest = CRC32C.digest();
    let mut piece = [0; PIECE_BYTES];
    let end = at.saturating_add(length);
    let mut at = at;
    while at < end {
        let count = ((end - at) as usize).min(PIECE_BYTES);
        let part = piece.get_mut(..count).ok_or(SettingsError::Flash)?;
        read(flash, at, part)?;
        digest.update(part);
        at = at.saturating_add(count as u32);
    }
    Ok(digest.finalize())
}

impl Slots {
    fn body_offset<F: NorFlash>() -> u32 {
        HEAD_BYTES.next_multiple_of(F::WRITE_SIZE) as u32
    }

    fn start(&self, slot: u32) -> u32 {
        self.at.saturating_add(slot.saturating_mul(self.bytes))
    }

    /// What lies in both, the newest first.
    pub(super) fn whole<F: NorFlash>(&self, flash: &mut F) -> Result<[Option<Whole>; 2], SettingsError> {
        let (first, second) = (self.look(flash, 0)?, self.look(flash, 1)?);
        let generation = |whole: Option<Whole>| whole.map_or(0, |whole| whole.generation);
        Ok(match generation(second) > generation(first) {
            true => [second, first],
            false => [first, second],
        })
    }

    fn look<F: NorFlash>(&self, flash: &mut F, slot: u32) -> Result<Option<Whole>, SettingsError> {
        let mut head = [0; HEAD_BYTES];
        read(flash, self.start(slot), &mut head)?;
        let Some((body, check)) = head.split_last_chunk::<4>() else {
            return Ok(None);
        };
        let mut words = body.as_chunks::<4>().0.iter().map(|word| u32::from_le_bytes(*word));
        let (Some(MAGIC), Some(generation), Some(length), Some(crc)) =
            (words.next(), words.next(), words.next(), words.next())
        else {
            return Ok(None);
        };
        let room = self.bytes.saturating_sub(Self::body_offset::<F>());
        let at = self.start(slot).saturating_add(Self::body_offset::<F>());
        if CRC32C.checksum(body).to_le_bytes() != *check || length > room || checksum(flash, at, length)? != crc {
            return Ok(None);
        }
        Ok(Some(Whole {
            slot,
            generation,
            at,
            length,
        }))
    }

    /// Clears the slot that does not count.
    pub(super) fn begin<F: NorFlash>(&self, flash: &mut F) -> Result<Staged, SettingsError> {
        let [newest, _] = self.whole(flash)?;
        let slot = newest.map_or(0, |newest| 1 - newest.slot.min(1));
        let start = self.start(slot);
        let end = start.saturating_add(self.bytes);
        if self.bytes == 0 || end as usize > flash.capacity() {
            return Err(SettingsError::Full);
        }
        flash.erase(start, end).map_err(failed)?;
        let body = start.saturating_add(Self::body_offset::<F>());
        Ok(Staged {
            start,
            body,
            end,
            at: body,
            generation: newest.map_or(0, |newest| newest.generation).saturating_add(1),
        })
    }

    /// What was written counts from now on; its generation.
    pub(super) fn commit<F: NorFlash>(&self, flash: &mut F, staged: Staged) -> Result<u32, SettingsError> {
        let length = staged.at - staged.body;
        let crc = checksum(flash, staged.body, length)?;
        let words = [MAGIC, staged.generation, length, crc].map(u32::to_le_bytes);
        let mut head = [0; HEAD_BYTES];
        let parts = words.as_flattened().iter().copied();
        let check = CRC32C.checksum(words.as_flattened()).to_le_bytes();
        head.iter_mut()
            .zip(parts.chain(check))
            .for_each(|(place, byte)| *place = byte);
        write(flash, staged.start, &head)?;
        match self.whole(flash)? {
            [Some(newest), _] if newest.generation == staged.generation => Ok(staged.generation),
            _ => Err(SettingsError::Flash),
        }
    }
}

impl Staged {
    /// Adds bytes, padded to whole words.
    pub(super) fn append<F: NorFlash>(&mut self, flash: &mut F, bytes: &[u8]) -> Result<(), SettingsError> {
        let padded = bytes.len().next_multiple_of(F::WRITE_SIZE) as u32;
        if padded > self.end - self.at {
            return Err(SettingsError::Full);
        }
        write(flash, self.at, bytes)?;
        self.at += padded;
        Ok(())
    }
}

/// Writes bytes at the beginning of a word, padded to whole words, and reads them back.
fn write<F: NorFlash>(flash: &mut F, at: u32, bytes: &[u8]) -> Result<(), SettingsError> {
    let mut at = at;
    for part in bytes.chunks(PIECE_BYTES) {
        let mut piece = [0xFF; PIECE_BYTES];
        piece.iter_mut().zip(part).for_each(|(place, byte)| *place = *byte);
        let padded = part.len().next_multiple_of(F::WRITE_SIZE);
        let words = piece.get(..padded).ok_or(SettingsError::Flash)?;
        flash.write(at, words).map_err(failed)?;
        let mut found = [0; PIECE_BYTES];
        let found = found.get_mut(..padded).ok_or(SettingsError::Flash)?;
        flash.read(at, found).map_err(failed)?;
        if found != words {
            return Err(SettingsError::Flash);
        }
        at = at.saturating_add(padded as u32);
    }
    Ok(())
}
