//! The journal: sectors of a NOR flash that are begun one after the other, and records that are only ever appended.
//!
//! No word is programmed twice between two erasures, so flashes that protect their words with a check code serve as well. A sector
//! that was not erased and given its head in one go is none. After bytes that are no record nothing more is appended to a sector.

use embedded_storage::nor_flash::NorFlash;
use heapless::Vec;

use super::OutboxError;
use super::layout::{
    Kind, MAGIC, PayloadCheck, RECORD_HEAD_BYTES, RecordHead, SECTOR_HEAD_BYTES, STATE_BYTES, SectorHead, State,
    state_bytes, state_of,
};

/// Most sectors of an outbox.
pub const MAX_SECTORS: usize = 32;
/// Bytes that are moved at once; a multiple of every flash's word.
const PIECE_BYTES: usize = 64;
/// So many times a record is written again, each time in another sector, because the flash does not hold it.
const WRITE_TRIES: u32 = 3;

/// A sector of the flash.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Sector {
    /// Of its head; 0: it has none.
    pub(super) order: u32,
    /// How often it was erased, as far as its head can say.
    pub(super) erases: u32,
    /// End of its last record, from its start.
    end: u32,
}

/// Where a record is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Place {
    pub(super) sector: usize,
    at: u32,
    pub(super) head: RecordHead,
}

/// The journal, open.
#[derive(Debug, Clone)]
pub(super) struct Journal<F> {
    flash: F,
    sectors: Vec<Sector, MAX_SECTORS>,
    /// The sector that is appended to.
    open: Option<usize>,
    /// Nothing but erased bytes lie behind its last record.
    blank: bool,
    /// Sectors whose head is no longer one: cut off while they were begun, or rotten.
    headless: u32,
    /// As the newest record of it says.
    pub(super) state: State,
}

impl<F: NorFlash> Journal<F> {
    const ASSERTS: () = assert!(
        PIECE_BYTES.is_multiple_of(F::WRITE_SIZE) && F::WRITE_SIZE.is_multiple_of(F::READ_SIZE),
        "words of the flash are 1 to 64 bytes, and no shorter than what is read at once"
    );

    /// Bytes of a record with so long a payload.
    pub(super) const fn record_bytes(payload: usize) -> u32 {
        (RECORD_HEAD_BYTES + payload).next_multiple_of(F::WRITE_SIZE) as u32
    }

    /// Bytes of a sector that records can have.
    pub(super) const CAPACITY: u32 = (F::ERASE_SIZE - SECTOR_HEAD_BYTES.next_multiple_of(F::WRITE_SIZE)) as u32;

    /// Looks at every sector and every record of the flash.
    pub(super) fn mount(flash: F) -> Result<Self, OutboxError> {
        let () = Self::ASSERTS;
        let count = flash.capacity() / F::ERASE_SIZE;
        let mut journal = Self {
            flash,
            sectors: Vec::new(),
            open: None,
            blank: false,
            headless: 0,
            state: State::default(),
        };
        for index in 0..count.min(MAX_SECTORS) {
            let head = journal.sector_head(index)?;
            if head.is_none() && journal.had_head(index)? {
                journal.headless += 1;
            }
            let sector = head.map_or(Sector::default(), |head| Sector {
                order: head.order,
                erases: head.erases,
                end: Self::first(),
            });
            // There is room: there are no more sectors than that.
            let _ = journal.sectors.push(sector);
            if sector.order > 0 {
                journal.scan(index)?;
                journal.erase_twin(index)?;
            }
        }
        let orders = journal.sectors.iter().map(|sector| sector.order).enumerate();
        let newest = orders.filter(|&(_, order)| order > 0).max_by_key(|&(_, order)| order);
        if let Some((index, _)) = newest
            && let Some(head) = journal.sector_head(index)?
        {
            journal.open = Some(index);
            journal.state = head.state;
            journal.scan(index)?;
        }
        Ok(journal)
    }

    /// Of two sectors of one order, which no outbox has made, that with less in it is erased: it would be collected with the other, or come
    /// back after that.
    fn erase_twin(&mut self, index: usize) -> Result<(), OutboxError> {
        let Some((last, earlier)) = self.sectors.get(..=index).and_then(<[Sector]>::split_last) else {
            return Ok(());
        };
        let Some(twin) = earlier.iter().position(|twin| twin.order == last.order) else {
            return Ok(());
        };
        let fuller = earlier.get(twin).is_some_and(|twin| twin.end >= last.end);
        let less = if fuller { index } else { twin };
        self.flash
            .erase(Self::address(less, 0), Self::address(less + 1, 0))
            .map_err(|_| OutboxError::Flash)?;
        if let Some(sector) = self.sectors.get_mut(less) {
            sector.order = 0;
        }
        Ok(())
    }

    /// Finds the end of a sector's records, each read whole, and in the newest sector the newest state.
    fn scan(&mut self, index: usize) -> Result<(), OutboxError> {
        let mut at = Self::first();
        let mut end = at;
        while let Some(place) = self.record_at(index, at)? {
            at += Self::record_bytes(place.head.length.into());
            let mut payload = [0; STATE_BYTES];
            if !self.read_payload(&place, &mut payload)? {
                // Cut off while it was written, unless another follows it: then the flash has not kept it.
                continue;
            }
            end = at;
            if self.open == Some(index)
                && place.head.kind == Kind::State
                && let Some(state) = state_of(&payload, self.order(index))
            {
                self.state = state;
            }
        }
        if let Some(sector) = self.sectors.get_mut(index) {
            sector.end = end;
        }
        if self.open == Some(index) {
            self.blank = self.is_blank(index, end)?;
        }
        Ok(())
    }

    /// Gives the flash back.
    pub(super) fn into_flash(self) -> F {
        self.flash
    }

    /// The flash.
    pub(super) fn flash_mut(&mut self) -> &mut F {
        &mut self.flash
    }

    pub(super) fn sectors(&self) -> &[Sector] {
        &self.sectors
    }

    /// The sector that is appended to.
    pub(super) fn newest(&self) -> Option<usize> {
        self.open
    }

    /// Bytes of the open sector that are free.
    pub(super) fn room(&self) -> u32 {
        let sector = self.open.and_then(|open| self.sectors.get(open));
        sector.map_or(0, |sector| match self.blank {
            true => (F::ERASE_SIZE as u32).saturating_sub(sector.end),
            false => 0,
        })
    }

    /// Numbers that may have been given in sectors of which nothing is known any more.
    pub(super) fn forgotten_numbers(&self) -> u32 {
        let of_each = F::ERASE_SIZE / RECORD_HEAD_BYTES;
        self.headless.saturating_mul(of_each as u32)
    }

    fn order(&self, index: usize) -> u32 {
        self.sectors.get(index).map_or(0, |sector| sector.order)
    }

    const fn first() -> u32 {
        F::ERASE_SIZE as u32 - Self::CAPACITY
    }

    const fn address(index: usize, at: u32) -> u32 {
        index as u32 * F::ERASE_SIZE as u32 + at
    }

    /// The record behind `place`, or the first of the sector.
    pub(super) fn next(&mut self, sector: usize, place: Option<&Place>) -> Result<Option<Place>, OutboxError> {
        let at = place.map_or(Self::first(), |place| {
            place.at + Self::record_bytes(place.head.length.into())
        });
        let end = self.sectors.get(sector).filter(|sector| sector.order > 0);
        match end {
            Some(sector_of) if at < sector_of.end => self.record_at(sector, at),
            _ => Ok(None),
        }
    }

    fn sector_head(&mut self, index: usize) -> Result<Option<SectorHead>, OutboxError> {
        let mut bytes = [0; PIECE_BYTES];
        self.read(Self::address(index, 0), &mut bytes)?;
        let head = bytes.first_chunk::<SECTOR_HEAD_BYTES>();
        Ok(head.and_then(SectorHead::from_bytes))
    }

    /// Whether a sector that has no head may have had one.
    fn had_head(&mut self, index: usize) -> Result<bool, OutboxError> {
        let mut bytes = [0; PIECE_BYTES];
        self.read(Self::address(index, 0), &mut bytes)?;
        let same = bytes.iter().zip(MAGIC.to_le_bytes()).filter(|(byte, of)| *byte == of);
        Ok(same.count() >= MAGIC.to_le_bytes().len() - 1)
    }

    fn record_at(&mut self, sector: usize, at: u32) -> Result<Option<Place>, OutboxError> {
        let mut bytes = [0; PIECE_BYTES];
        let left = (F::ERASE_SIZE as u32).saturating_sub(at) as usize;
        let head_bytes = RECORD_HEAD_BYTES.next_multiple_of(F::WRITE_SIZE);
        let Some(piece) = bytes.get_mut(..head_bytes).filter(|piece| piece.len() <= left) else {
            return Ok(None);
        };
        self.read(Self::address(sector, at), piece)?;
        let order = self.order(sector);
        let head = bytes
            .first_chunk::<RECORD_HEAD_BYTES>()
            .and_then(|head| RecordHead::from_bytes(head, order));
        Ok(head
            .filter(|head| Self::record_bytes(head.length.into()) as usize <= left)
            .map(|head| Place { sector, at, head }))
    }

    /// Reads a record's payload, as much of it as `payload` can hold; whether all of it is as it was written.
    pub(super) fn read_payload(&mut self, place: &Place, payload: &mut [u8]) -> Result<bool, OutboxError> {
        let mut check = PayloadCheck::new(self.order(place.sector));
        self.pieces(place, |offset, piece| {
            check.take(piece);
            let places = payload.iter_mut().skip(offset);
            places.zip(piece).for_each(|(place, byte)| *place = *byte);
            Ok(())
        })?;
        Ok(check.finish() == place.head.payload_crc)
    }

    /// Hands out a record's payload piece by piece.
    fn pieces(
        &mut self,
        place: &Place,
        mut take: impl FnMut(usize, &[u8]) -> Result<(), OutboxError>,
    ) -> Result<(), OutboxError> {
        let whole = RECORD_HEAD_BYTES + usize::from(place.head.length);
        let mut from = 0;
        while from < whole {
            let mut bytes = [0; PIECE_BYTES];
            let length = (whole - from).min(PIECE_BYTES);
            if let Some(piece) = bytes.get_mut(..length.next_multiple_of(F::WRITE_SIZE)) {
                self.read(Self::address(place.sector, place.at + from as u32), piece)?;
            }
            let skip = RECORD_HEAD_BYTES.saturating_sub(from);
            take(
                (from + skip).saturating_sub(RECORD_HEAD_BYTES),
                bytes.get(skip..length).unwrap_or_default(),
            )?;
            from += PIECE_BYTES;
        }
        Ok(())
    }

    /// Begins a sector: from here on it is the one that is appended to. What it held is gone.
    pub(super) fn begin(&mut self, index: usize, state: State) -> Result<(), OutboxError> {
        let order = self.open.map_or(0, |open| self.order(open)) + 1;
        let most = self.sectors.iter().map(|sector| sector.erases).max().unwrap_or(0);
        let Some(sector) = self.sectors.get_mut(index) else {
            return Err(OutboxError::Flash);
        };
        // What an interrupted erasure has taken from a head is not more than another sector has.
        let erases = match sector.order {
            0 => most.max(1),
            _ => sector.erases.saturating_add(1),
        };
        *sector = Sector {
            order: 0,
            erases,
            end: Self::first(),
        };
        self.flash
            .erase(Self::address(index, 0), Self::address(index + 1, 0))
            .map_err(|_| OutboxError::Flash)?;
        let head = SectorHead { order, erases, state };
        self.program(Self::address(index, 0), &head.to_bytes(), &[])?;
        if self.sector_head(index)? != Some(head) {
            return Err(OutboxError::Worn);
        }
        if let Some(sector) = self.sectors.get_mut(index) {
            sector.order = order;
            sector.erases = head.erases;
        }
        self.open = Some(index);
        self.blank = true;
        self.state = state;
        Ok(())
    }

    /// Appends a record to the open sector, which must have room for it, and reads it again.
    pub(super) fn append(&mut self, kind: Kind, sequence: u32, payload: &[u8]) -> Result<(), OutboxError> {
        let (Some(index), Ok(length)) = (self.open, u16::try_from(payload.len())) else {
            return Err(OutboxError::TooLong);
        };
        let order = self.order(index);
        let mut check = PayloadCheck::new(order);
        check.take(payload);
        let head = RecordHead {
            length,
            kind,
            sequence,
            payload_crc: check.finish(),
        };
        let at = self.take_room(index, head)?;
        self.program(Self::address(index, at), &head.to_bytes(order), payload)?;
        self.finish(index, at, head)
    }

    /// Appends a newer state.
    pub(super) fn append_state(&mut self, state: State) -> Result<(), OutboxError> {
        self.append(Kind::State, 0, &state_bytes(state))?;
        self.state = state;
        Ok(())
    }

    /// Appends a copy of a record of another sector. One that the flash has not kept is left behind: false.
    pub(super) fn copy(&mut self, place: &Place) -> Result<bool, OutboxError> {
        let Some(index) = self.open else {
            return Err(OutboxError::Flash);
        };
        if !self.read_payload(place, &mut [])? {
            return Ok(false);
        }
        let order = self.order(index);
        let mut check = PayloadCheck::new(order);
        self.pieces(place, |_, piece| {
            check.take(piece);
            Ok(())
        })?;
        let head = RecordHead {
            payload_crc: check.finish(),
            ..place.head
        };
        let at = self.take_room(index, head)?;
        let whole = RECORD_HEAD_BYTES + usize::from(head.length);
        let mut from = 0;
        while from < whole {
            let mut bytes = [0xFF; PIECE_BYTES];
            let length = (whole - from).min(PIECE_BYTES);
            let padded = length.next_multiple_of(F::WRITE_SIZE);
            if let Some(piece) = bytes.get_mut(..padded) {
                self.read(Self::address(place.sector, place.at + from as u32), piece)?;
            }
            if from == 0
                && let Some(place) = bytes.first_chunk_mut::<RECORD_HEAD_BYTES>()
            {
                *place = head.to_bytes(order);
            }
            self.write(
                Self::address(index, at + from as u32),
                bytes.get(..padded).unwrap_or_default(),
            )?;
            from += PIECE_BYTES;
        }
        self.finish(index, at, head)?;
        Ok(true)
    }

    /// Takes the room of a record in the open sector; where it begins.
    fn take_room(&mut self, index: usize, head: RecordHead) -> Result<u32, OutboxError> {
        let bytes = Self::record_bytes(head.length.into());
        if bytes > self.room() {
            return Err(OutboxError::Full);
        }
        let at = self.sectors.get(index).map_or(0, |sector| sector.end);
        // Until it is known to be whole, nothing may follow it.
        self.blank = false;
        Ok(at)
    }

    /// Reads what was written; only then it counts.
    fn finish(&mut self, index: usize, at: u32, head: RecordHead) -> Result<(), OutboxError> {
        let written = self.record_at(index, at)?.filter(|place| place.head == head);
        let whole = match written {
            Some(place) => self.read_payload(&place, &mut [])?,
            None => false,
        };
        if !whole {
            return Err(OutboxError::Worn);
        }
        if let Some(sector) = self.sectors.get_mut(index) {
            sector.end = at + Self::record_bytes(head.length.into());
        }
        self.blank = true;
        Ok(())
    }

    /// How often a record may be tried in another sector.
    pub(super) const fn tries() -> u32 {
        WRITE_TRIES
    }

    fn is_blank(&mut self, sector: usize, from: u32) -> Result<bool, OutboxError> {
        let mut at = from;
        while at < F::ERASE_SIZE as u32 {
            let mut bytes = [0; PIECE_BYTES];
            let length = (F::ERASE_SIZE - at as usize).min(PIECE_BYTES);
            let Some(piece) = bytes.get_mut(..length) else { break };
            self.read(Self::address(sector, at), piece)?;
            if piece.iter().any(|&byte| byte != 0xFF) {
                return Ok(false);
            }
            at += length as u32;
        }
        Ok(true)
    }

    /// Programs a head and what follows it, padded to whole words.
    fn program(&mut self, address: u32, head: &[u8], rest: &[u8]) -> Result<(), OutboxError> {
        let mut all = head.iter().chain(rest);
        let whole = head.len() + rest.len();
        let mut from = 0;
        while from < whole {
            let mut bytes = [0xFF; PIECE_BYTES];
            let length = (whole - from).min(PIECE_BYTES).next_multiple_of(F::WRITE_SIZE);
            bytes
                .iter_mut()
                .zip(all.by_ref())
                .for_each(|(place, byte)| *place = *byte);
            self.write(address + from as u32, bytes.get(..length).unwrap_or_default())?;
            from += PIECE_BYTES;
        }
        Ok(())
    }

    fn read(&mut self, address: u32, bytes: &mut [u8]) -> Result<(), OutboxError> {
        self.flash.read(address, bytes).map_err(|_| OutboxError::Flash)
    }

    fn write(&mut self, address: u32, bytes: &[u8]) -> Result<(), OutboxError> {
        self.flash.write(address, bytes).map_err(|_| OutboxError::Flash)
    }
}
