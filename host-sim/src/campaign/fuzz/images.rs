//! Flashes as age, power cuts and hands leave them: an outbox opens on each, or says why not, and works then.

use std::cell::Cell;
use std::collections::BTreeMap;

use embedded_storage::nor_flash::{ErrorType, NorFlash, NorFlashError, NorFlashErrorKind, ReadNorFlash};
use spanwatch::outbox::{Class, Outbox, OutboxError};
use spanwatch::wire::CRC32C;

use super::mutation::{mutate, whole};
use super::{Counts, must};
use crate::campaign::line::Chance;
use crate::campaign::power::TEARS;
use crate::flash::SimulatedFlash;

const WORD: usize = 4;
const PAGE: usize = 512;
const PAGES: usize = 5;
/// What a start, or a message, may ask of the flash: some ten times what it does.
const OPERATIONS: u32 = 60_000;
/// Longest message.
const MESSAGE_BYTES: u64 = 120;

/// A flash that fails after so many operations: what would be a loop without end becomes an error, and is seen.
pub(super) struct Metered {
    flash: SimulatedFlash<WORD, PAGE>,
    left: Cell<u32>,
}

/// No operations are left.
#[derive(Debug)]
pub(super) struct Spent;

impl NorFlashError for Spent {
    fn kind(&self) -> NorFlashErrorKind {
        NorFlashErrorKind::Other
    }
}

impl Metered {
    fn spend(&self) -> Result<(), Spent> {
        let left = self.left.get().checked_sub(1).ok_or(Spent)?;
        self.left.set(left);
        Ok(())
    }
}

impl ErrorType for Metered {
    type Error = Spent;
}

impl ReadNorFlash for Metered {
    const READ_SIZE: usize = 1;

    fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), Spent> {
        self.spend()?;
        self.flash.read(offset, bytes).map_err(|_| Spent)
    }

    fn capacity(&self) -> usize {
        self.flash.capacity()
    }
}

impl NorFlash for Metered {
    const WRITE_SIZE: usize = WORD;
    const ERASE_SIZE: usize = PAGE;

    fn erase(&mut self, from: u32, to: u32) -> Result<(), Spent> {
        self.spend()?;
        self.flash.erase(from, to).map_err(|_| Spent)
    }

    fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), Spent> {
        self.spend()?;
        self.flash.write(offset, bytes).map_err(|_| Spent)
    }
}

/// An outbox is opened on a flash, used, and opened again.
pub(super) fn run(chance: &mut Chance) -> Result<Counts, String> {
    let cells = image(chance);
    let mut used = Used {
        outbox: open(cells)?,
        confirmed: BTreeMap::new(),
        last: 0,
    };
    used.last = used.contents()?.last_key_value().map_or(0, |(&number, _)| number);
    used.work(4 + chance.below(30), chance)?;
    let starts = used.outbox.starts();
    let acknowledged = used.outbox.acknowledged();
    let cells = used.outbox.into_flash().flash.cells().to_vec();
    used.outbox = open(cells)?;
    must!(
        used.outbox.starts() > starts,
        "start {} follows {starts}",
        used.outbox.starts()
    );
    must!(
        used.outbox.acknowledged() == acknowledged,
        "what was acknowledged is forgotten"
    );
    used.compare("after a start")?;
    used.work(3, chance)?;
    Ok(Counts::of(true))
}

/// Opens an outbox; the flash works, so it opens.
fn open(cells: Vec<u8>) -> Result<Outbox<Metered>, String> {
    let flash = Metered {
        flash: SimulatedFlash::holding(cells, TEARS[0], 0),
        left: Cell::new(OPERATIONS),
    };
    Outbox::open(flash).map_err(|error| format!("it does not open: {error}"))
}

/// An outbox and what must be in it.
struct Used {
    outbox: Outbox<Metered>,
    confirmed: BTreeMap<u32, Vec<u8>>,
    last: u32,
}

impl Used {
    fn contents(&mut self) -> Result<BTreeMap<u32, Vec<u8>>, String> {
        self.outbox.flash_mut().left.set(OPERATIONS);
        let mut contents = BTreeMap::new();
        let mut buffer = [0; 512];
        let mut last = 0;
        loop {
            let next = self.outbox.next_after(last, &mut buffer);
            let Some(parcel) = next.map_err(|error| format!("it cannot be read: {error}"))? else {
                return Ok(contents);
            };
            must!(parcel.sequence > last, "{} follows {last}", parcel.sequence);
            must!(
                parcel.previous < parcel.sequence,
                "{} before {}",
                parcel.previous,
                parcel.sequence
            );
            last = parcel.sequence;
            contents.insert(last, buffer[..parcel.length].to_vec());
        }
    }

    /// What was put into it is there, unless it was dropped and counted.
    fn compare(&mut self, when: &str) -> Result<(), String> {
        let contents = self.contents()?;
        let acknowledged = self.outbox.acknowledged();
        self.confirmed.retain(|&number, _| number > acknowledged);
        for (number, payload) in &self.confirmed {
            must!(
                contents.get(number) == Some(payload),
                "{when}, message {number} is missing or another"
            );
        }
        Ok(())
    }

    fn work(&mut self, times: u64, chance: &mut Chance) -> Result<(), String> {
        for _ in 0..times {
            self.outbox.flash_mut().left.set(OPERATIONS);
            let dropped = |outbox: &Outbox<Metered>| {
                let ledger = outbox.ledger();
                (ledger.alerts_dropped, ledger.reports_dropped)
            };
            let (before, last) = (dropped(&self.outbox), self.last);
            let failed = |error: OutboxError| format!("it opened, and now: {error}");
            match chance.below(8) {
                0 => {
                    let fill = self.outbox.fill().map_err(failed)?;
                    must!(fill.bytes <= fill.capacity, "{} bytes of {}", fill.bytes, fill.capacity);
                    let some = 1 + chance.below(200) as usize;
                    let evidence = chance.bytes(some);
                    match self.outbox.keep_evidence(&evidence) {
                        Ok(()) => {
                            let mut buffer = [0; 256];
                            let kept = self.outbox.evidence(&mut buffer).map_err(failed)?;
                            must!(kept == Some(&evidence[..]), "the evidence is another");
                        }
                        Err(OutboxError::Full) => {}
                        Err(error) => return Err(failed(error)),
                    }
                }
                1 => {
                    let contents: Vec<u32> = self.contents()?.into_keys().collect();
                    if !contents.is_empty() {
                        let upto = chance.pick(&contents);
                        self.outbox.acknowledge(upto).map_err(failed)?;
                        must!(self.outbox.acknowledged() == upto, "{upto} is not acknowledged");
                        let left = self.contents()?;
                        must!(
                            left.keys().all(|&number| number > upto),
                            "what was acknowledged is still there"
                        );
                    }
                }
                _ => {
                    let class = chance.pick(&[Class::Alert, Class::Alert, Class::Report]);
                    let some = 1 + chance.below(MESSAGE_BYTES) as usize;
                    self.append(class, chance.bytes(some))?;
                }
            }
            if dropped(&self.outbox) != before {
                // The oldest have gone, and are counted: not the one that has just come.
                let contents = self.contents()?;
                self.confirmed
                    .retain(|number, _| *number > last || contents.contains_key(number));
            }
        }
        self.compare("after some work")
    }

    fn append(&mut self, class: Class, payload: Vec<u8>) -> Result<(), String> {
        match self.outbox.append(class, &payload) {
            Ok(number) => {
                must!(number > self.last, "number {number} is given behind {}", self.last);
                self.last = number;
                self.confirmed.insert(number, payload);
            }
            Err(OutboxError::Full) if class == Class::Report => {}
            Err(error) => return Err(format!("it opened, and a message is refused: {error}")),
        }
        Ok(())
    }
}

/// What lies on the flash.
fn image(chance: &mut Chance) -> Vec<u8> {
    if chance.once_in(20) {
        return chance.bytes(PAGES * PAGE);
    }
    let mut lives = vec![vec![0xFF; PAGES * PAGE]];
    // A flash that was used, as it was at several times.
    if !chance.once_in(10) {
        let mut flash = SimulatedFlash::<WORD, PAGE>::new(PAGES, TEARS[0], 0);
        for _ in 0..=chance.below(3) {
            let Ok(mut outbox) = Outbox::open(flash) else { break };
            for _ in 0..chance.below(25) {
                let some = 1 + chance.below(MESSAGE_BYTES) as usize;
                let payload = chance.bytes(some);
                let _ = match chance.below(7) {
                    0 => outbox.keep_evidence(&payload),
                    1 => {
                        let acknowledged = outbox.acknowledged();
                        outbox.acknowledge(acknowledged.saturating_add(chance.below(5) as u32))
                    }
                    2 => outbox.name_stream(5),
                    3 | 4 => outbox.append(Class::Report, &payload).map(|_| ()),
                    _ => outbox.append(Class::Alert, &payload).map(|_| ()),
                };
                if chance.once_in(6) {
                    lives.push(outbox.flash_mut().cells().to_vec());
                }
            }
            flash = outbox.into_flash();
            lives.push(flash.cells().to_vec());
        }
    }
    let mut cells = lives.last().cloned().unwrap_or_default();
    for _ in 0..chance.below(5) {
        spoil(&mut cells, &lives, chance);
    }
    cells
}

/// One thing that happens to a flash.
fn spoil(cells: &mut [u8], lives: &[Vec<u8>], chance: &mut Chance) {
    let page = |chance: &mut Chance| {
        let start = chance.below(PAGES as u64) as usize * PAGE;
        start..start + PAGE
    };
    let (one, other) = (page(chance), page(chance));
    match chance.below(10) {
        // Bits age.
        0 | 1 => {
            for _ in 0..=chance.below(6) {
                let at = chance.below(cells.len() as u64) as usize;
                cells[at] ^= 1 << chance.below(8);
            }
        }
        2 => cells[one].fill(chance.pick(&[0, 0xFF])),
        // Sectors are copied, whole or in part, and exchanged.
        3 => {
            let copied = cells[other].to_vec();
            let length = 1 + chance.below(PAGE as u64) as usize;
            cells[one][..length].copy_from_slice(&copied[..length]);
        }
        4 => {
            let (first, second) = (cells[one.clone()].to_vec(), cells[other.clone()].to_vec());
            cells[one].copy_from_slice(&second);
            cells[other].copy_from_slice(&first);
        }
        // One comes back as it was before.
        5 => {
            let life = &lives[chance.below(lives.len() as u64) as usize];
            let from = one.start + chance.below(PAGE as u64) as usize;
            let from = if chance.once_in(2) { one.start } else { from };
            cells[from..one.end].copy_from_slice(&life[from..one.end]);
        }
        6 => {
            let mut bytes = cells[one.clone()].to_vec();
            mutate(&mut bytes, &lives[0], chance);
            cells[one].iter_mut().zip(bytes).for_each(|(cell, byte)| *cell = byte);
        }
        // A head that is sound and says anything.
        7 => {
            let head = head(chance);
            let length = if chance.once_in(2) { head.len() } else { PAGE };
            let mut sector = head.clone();
            sector.resize(length.max(head.len()), 0xFF);
            cells[one].iter_mut().zip(sector).for_each(|(cell, byte)| *cell = byte);
        }
        // The checksum of a changed head is right again.
        8 => {
            let at = one.start + 4 + 4 * chance.below(12) as usize;
            cells[at..at + 4].copy_from_slice(&(whole(chance) as u32).to_le_bytes());
            let crc = CRC32C.checksum(&cells[one.start..one.start + HEAD_BYTES - 4]);
            cells[one.start + HEAD_BYTES - 4..one.start + HEAD_BYTES].copy_from_slice(&crc.to_le_bytes());
        }
        _ => record(&mut cells[one], chance),
    }
}

/// Bytes of a sector's head.
const HEAD_BYTES: usize = 56;

fn head(chance: &mut Chance) -> Vec<u8> {
    let mut head = b"SWO\x01".to_vec();
    for _ in 0..12 {
        head.extend((whole(chance) as u32).to_le_bytes());
    }
    let crc = CRC32C.checksum(&head);
    head.extend(crc.to_le_bytes());
    head
}

/// A record that is sound and says anything, behind the head of a sector.
fn record(sector: &mut [u8], chance: &mut Chance) {
    let Some(order) = sector.get(4..8).map(<[u8]>::to_vec) else {
        return;
    };
    let seeded = |bytes: &[u8]| CRC32C.checksum(&[&order, bytes].concat());
    let length = chance.below(100) as usize;
    let payload = match chance.below(3) {
        0 => (0..10).flat_map(|_| (whole(chance) as u32).to_le_bytes()).collect(),
        _ => chance.bytes(length),
    };
    let said = if chance.once_in(6) {
        whole(chance) as u16
    } else {
        payload.len() as u16
    };
    let mut record = said.to_le_bytes().to_vec();
    record.extend([chance.below(6) as u8, 0x5A]);
    record.extend((whole(chance) as u32).to_le_bytes());
    record.extend(seeded(&payload).to_le_bytes());
    let crc = seeded(&record);
    record.extend(crc.to_le_bytes());
    record.extend(payload);
    let first = HEAD_BYTES;
    sector
        .iter_mut()
        .skip(first)
        .zip(record)
        .for_each(|(cell, byte)| *cell = byte);
}
