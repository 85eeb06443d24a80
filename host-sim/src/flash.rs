//! A NOR flash in memory that loses its power at any byte: what an outbox must live through before it meets a real one.
//!
//! Bits are programmed from 1 to 0 and erased to 1 a page at a time. A cut at byte `k` of an operation leaves `k` of its bytes done: the
//! first `k`, or by chance any `k` of them ([`Tear::shuffled`]), since flashes program and erase in no order that they promise. The byte
//! that was under way, or its whole word ([`Tear::words`]), keeps any of its bits.
//!
//! Programming a word a second time is refused unless the flash allows it ([`SimulatedFlash::allow_second_write`]).

use embedded_storage::nor_flash::{
    ErrorType, MultiwriteNorFlash, NorFlash, NorFlashError, NorFlashErrorKind, ReadNorFlash,
};
use rand_core::{Rng, SeedableRng};
use rand_xoshiro::Xoshiro256PlusPlus;

/// Why the flash did not do it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FlashFault {
    /// There is no power.
    PowerLoss,
    /// The address or length is not that of whole words or pages.
    Alignment,
    /// The word was programmed before.
    SecondWrite,
}

impl NorFlashError for FlashFault {
    fn kind(&self) -> NorFlashErrorKind {
        match self {
            Self::Alignment => NorFlashErrorKind::NotAligned,
            Self::PowerLoss | Self::SecondWrite => NorFlashErrorKind::Other,
        }
    }
}

/// How an operation is torn.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Tear {
    /// The whole word under way is torn, not one byte.
    pub words: bool,
    /// The bytes that are done are any, not the first.
    pub shuffled: bool,
}

/// The flash: words of `WORD` bytes, pages of `PAGE`.
#[derive(Clone)]
pub struct SimulatedFlash<const WORD: usize, const PAGE: usize> {
    cells: Vec<u8>,
    /// Words programmed since they were erased.
    programmed: Vec<bool>,
    erases: Vec<u32>,
    tear: Tear,
    second_write: bool,
    chance: Xoshiro256PlusPlus,
    /// Bytes until the power goes.
    left: Option<u64>,
    powered: bool,
    touched: u64,
}

impl<const WORD: usize, const PAGE: usize> SimulatedFlash<WORD, PAGE> {
    /// An erased flash.
    pub fn new(pages: usize, tear: Tear, seed: u64) -> Self {
        Self {
            cells: vec![0xFF; pages * PAGE],
            programmed: vec![false; pages * PAGE / WORD],
            erases: vec![0; pages],
            tear,
            second_write: false,
            chance: Xoshiro256PlusPlus::seed_from_u64(seed),
            left: None,
            powered: true,
            touched: 0,
        }
    }

    /// A flash that holds these bytes, whole pages of them. What is not erased counts as programmed.
    pub fn holding(cells: Vec<u8>, tear: Tear, seed: u64) -> Self {
        let pages = cells.len() / PAGE;
        let programmed = cells.chunks(WORD).map(|word| word.iter().any(|&byte| byte != 0xFF));
        Self {
            programmed: programmed.collect(),
            cells,
            ..Self::new(pages, tear, seed)
        }
    }

    /// All that it holds.
    pub fn cells(&self) -> &[u8] {
        &self.cells
    }

    /// Words may be programmed twice, as [`MultiwriteNorFlash`] promises.
    pub fn allow_second_write(&mut self) {
        self.second_write = true;
    }

    /// Other chances from here on.
    pub fn reseed(&mut self, seed: u64) {
        self.chance = Xoshiro256PlusPlus::seed_from_u64(seed);
    }

    /// The power goes after so many more bytes that are written or erased.
    pub fn cut_after(&mut self, bytes: u64) {
        self.left = Some(bytes);
    }

    /// The power is back.
    pub fn restore(&mut self) {
        self.left = None;
        self.powered = true;
    }

    /// Whether the power has gone.
    pub fn is_off(&self) -> bool {
        !self.powered
    }

    /// Bytes written and erased so far.
    pub fn touched(&self) -> u64 {
        self.touched
    }

    /// Erasures of each page.
    pub fn erases(&self) -> &[u32] {
        &self.erases
    }

    /// Changes a byte, as age does.
    pub fn corrupt(&mut self, address: usize, bits: u8) {
        if let Some(cell) = self.cells.get_mut(address) {
            *cell ^= bits;
        }
    }

    /// Does an operation on `range` byte by byte until the power goes; `done` makes a byte what it is to be.
    fn operate(&mut self, range: std::ops::Range<usize>, done: impl Fn(usize, u8) -> u8) -> Result<(), FlashFault> {
        if !self.powered {
            return Err(FlashFault::PowerLoss);
        }
        let length = range.len() as u64;
        let left = self.left.unwrap_or(u64::MAX);
        if left >= length {
            self.left = self.left.map(|left| left - length);
            self.touched += length;
            for address in range {
                self.cells[address] = done(address, self.cells[address]);
            }
            return Ok(());
        }
        self.powered = false;
        self.touched += left;
        let mut order: Vec<usize> = range.collect();
        if self.tear.shuffled {
            for place in 0..=left as usize {
                let other = place + (self.chance.next_u64() % (order.len() - place) as u64) as usize;
                order.swap(place, other);
            }
        }
        let (whole, rest) = order.split_at(left as usize);
        for &address in whole {
            self.cells[address] = done(address, self.cells[address]);
        }
        let torn = rest[0];
        let word = torn / WORD;
        for &address in rest {
            if address == torn || self.tear.words && address / WORD == word {
                let (before, after) = (self.cells[address], done(address, self.cells[address]));
                // Each bit is the one or the other.
                let bits = self.chance.next_u64() as u8;
                self.cells[address] = before & !bits | after & bits;
            }
        }
        Err(FlashFault::PowerLoss)
    }
}

impl<const WORD: usize, const PAGE: usize> ErrorType for SimulatedFlash<WORD, PAGE> {
    type Error = FlashFault;
}

impl<const WORD: usize, const PAGE: usize> ReadNorFlash for SimulatedFlash<WORD, PAGE> {
    const READ_SIZE: usize = 1;

    fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), FlashFault> {
        if !self.powered {
            return Err(FlashFault::PowerLoss);
        }
        let from = offset as usize;
        let cells = self.cells.get(from..from + bytes.len()).ok_or(FlashFault::Alignment)?;
        bytes.copy_from_slice(cells);
        Ok(())
    }

    fn capacity(&self) -> usize {
        self.cells.len()
    }
}

impl<const WORD: usize, const PAGE: usize> NorFlash for SimulatedFlash<WORD, PAGE> {
    const WRITE_SIZE: usize = WORD;
    const ERASE_SIZE: usize = PAGE;

    fn erase(&mut self, from: u32, to: u32) -> Result<(), FlashFault> {
        let (from, to) = (from as usize, to as usize);
        if !from.is_multiple_of(PAGE) || !to.is_multiple_of(PAGE) || to > self.cells.len() || from > to {
            return Err(FlashFault::Alignment);
        }
        for page in from / PAGE..to / PAGE {
            self.erases[page] += 1;
            let range = page * PAGE..(page + 1) * PAGE;
            self.operate(range, |_, _| 0xFF)?;
            self.programmed[page * PAGE / WORD..(page + 1) * PAGE / WORD].fill(false);
        }
        Ok(())
    }

    fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), FlashFault> {
        let from = offset as usize;
        let to = from + bytes.len();
        if !from.is_multiple_of(WORD) || !to.is_multiple_of(WORD) || to > self.cells.len() {
            return Err(FlashFault::Alignment);
        }
        if !self.powered {
            return Err(FlashFault::PowerLoss);
        }
        let words = from / WORD..to / WORD;
        let written_before = self.programmed[words.clone()].contains(&true);
        if written_before && !self.second_write {
            return Err(FlashFault::SecondWrite);
        }
        // One that no bit of was programmed cannot be told from one that was not, by anyone.
        let before = self.cells[from..to].to_vec();
        let result = self.operate(from..to, |address, cell| cell & bytes[address - from]);
        for word in words {
            let cells = word * WORD..(word + 1) * WORD;
            let changed = self.cells[cells.clone()] != before[cells.start - from..cells.end - from];
            self.programmed[word] |= changed || result.is_ok();
        }
        result
    }
}

impl<const WORD: usize, const PAGE: usize> MultiwriteNorFlash for SimulatedFlash<WORD, PAGE> {}
