//! What a logger is told once and keeps over every restart: who it is, and the bridge, track and configuration that it watches with.
//!
//! ```text
//! flash    identity, two slots of a sector | setup, two slots of half the rest
//! identity device u32 | number of the key u8 | key, 32 bytes
//! setup    items, each: kind u8 | 0 u8 | 0 u16 | length u32 | bytes        little endian, each part padded to whole words
//! ```
//!
//! Both lie in [two slots](slots): what is new is written into the one that does not count, read back, and counts with the last word that is
//! written. A power cut leaves the old or the new. A setup that the logger refuses at its start is passed over for the one before.

mod slots;

use core::fmt;

use embedded_storage::nor_flash::NorFlash;
use serde::{Deserialize, Serialize};

use crate::session::seal::KEY_BYTES;
use crate::session::{Device, Key};
use crate::wire::fingerprint;
use slots::{Slots, Staged, Whole};

/// Sectors of the flash that both identities take.
const IDENTITY_SECTORS: u32 = 2;
/// Bytes of an identity.
const IDENTITY_BYTES: usize = 4 + 1 + KEY_BYTES;
/// Bytes of an item's head.
const ITEM_HEAD_BYTES: usize = 8;

/// Why settings were not kept.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum SettingsError {
    /// The flash does not answer, or does not hold what is written to it.
    Flash,
    /// There is no room for it.
    Full,
    /// It was not begun, or something of it was refused.
    NotBegun,
    /// There is no such item.
    Nothing,
    /// None of the setups on the flash is one that this logger takes; or the key is for another logger, or not known to the base station.
    Refused,
}

impl fmt::Display for SettingsError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Flash => "the flash does not answer, or does not hold what is written to it",
            Self::Full => "there is no room for it on the flash",
            Self::NotBegun => "the setup was not begun, or a part of it was refused; begin it again",
            Self::Nothing => "the logger keeps no such thing",
            Self::Refused => "it is not one that may be used here",
        })
    }
}

impl core::error::Error for SettingsError {}

/// Who a logger is.
#[derive(Debug, Clone)]
pub struct Identity {
    /// Its number.
    pub device: Device,
    /// The number of its key.
    pub key_number: u8,
    /// Its key.
    pub key: Key,
}

impl Identity {
    /// Who a logger is that nobody has told: it has the key that everybody knows.
    pub const DEMO: Self = Self {
        device: 1,
        key_number: 0,
        key: Key::DEMO,
    };

    fn to_bytes(&self) -> [u8; IDENTITY_BYTES] {
        let mut bytes = [0; IDENTITY_BYTES];
        let parts = (self.device.to_le_bytes().into_iter())
            .chain([self.key_number])
            .chain(*self.key.bytes());
        bytes.iter_mut().zip(parts).for_each(|(place, byte)| *place = byte);
        bytes
    }

    fn from_bytes(bytes: &[u8; IDENTITY_BYTES]) -> Option<Self> {
        let (device, rest) = bytes.split_first_chunk::<4>()?;
        let (&key_number, key) = rest.split_first()?;
        Some(Self {
            device: u32::from_le_bytes(*device),
            key_number,
            key: Key::new(*key.first_chunk()?),
        })
    }
}

/// A part of a setup.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Part {
    /// The bridge model's blob.
    Model = 1,
    /// The learnt track's blob.
    Track = 2,
    /// The [`Configuration`](crate::wire::message::Configuration), as postcard.
    Configuration = 3,
}

/// A setup on the flash.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Setup(Whole);

impl Setup {
    /// Setups that were kept up to this one.
    pub fn generation(&self) -> u32 {
        self.0.generation
    }
}

/// Bytes on the flash.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Extent {
    at: u32,
    /// How many.
    pub length: u32,
}

/// The settings, on a flash of their own or a partition of one.
#[derive(Debug, Clone)]
pub struct Settings<F> {
    flash: F,
    staged: Option<Staged>,
    /// What was staged last, by its kind and fingerprint.
    last: Option<(Part, u32)>,
}

impl<F: NorFlash> Settings<F> {
    /// The settings on the whole of `flash`, of six sectors at least.
    pub const fn new(flash: F) -> Self {
        Self {
            flash,
            staged: None,
            last: None,
        }
    }

    /// The flash. Whoever writes to it through this breaks the promises.
    pub fn flash_mut(&mut self) -> &mut F {
        &mut self.flash
    }

    fn identities() -> Slots {
        Slots {
            at: 0,
            bytes: F::ERASE_SIZE as u32,
        }
    }

    fn setup_slots(&self) -> Slots {
        let sectors = self.flash.capacity() / F::ERASE_SIZE;
        let half = (sectors as u32).saturating_sub(IDENTITY_SECTORS) / 2;
        let sector_bytes = F::ERASE_SIZE as u32;
        Slots {
            at: IDENTITY_SECTORS * sector_bytes,
            bytes: half * sector_bytes,
        }
    }

    /// Who the logger is; none: nobody has told it.
    pub fn identity(&mut self) -> Result<Option<Identity>, SettingsError> {
        let [newest, _] = Self::identities().whole(&mut self.flash)?;
        let Some(whole) = newest.filter(|whole| whole.length as usize >= IDENTITY_BYTES) else {
            return Ok(None);
        };
        let mut bytes = [0; IDENTITY_BYTES];
        slots::read(&mut self.flash, whole.at, &mut bytes)?;
        Ok(Identity::from_bytes(&bytes))
    }

    /// Tells the logger who it is. It has the old identity or the new one, whatever happens.
    pub fn set_identity(&mut self, identity: &Identity) -> Result<(), SettingsError> {
        let slots = Self::identities();
        let mut staged = slots.begin(&mut self.flash)?;
        staged.append(&mut self.flash, &identity.to_bytes())?;
        slots.commit(&mut self.flash, staged).map(|_| ())
    }

    /// The setups on the flash, the newest first.
    pub fn setups(&mut self) -> Result<[Option<Setup>; 2], SettingsError> {
        let slots = self.setup_slots();
        Ok(slots.whole(&mut self.flash)?.map(|whole| whole.map(Setup)))
    }

    /// Begins a new setup. The one that counts stays as it is.
    pub fn begin(&mut self) -> Result<(), SettingsError> {
        (self.staged, self.last) = (None, None);
        self.staged = Some(self.setup_slots().begin(&mut self.flash)?);
        Ok(())
    }

    /// A setup is being written.
    pub fn is_begun(&self) -> bool {
        self.staged.is_some()
    }

    /// Nothing comes of the setup that was begun.
    pub fn abandon(&mut self) {
        self.staged = None;
    }

    /// Adds a part to the setup that was begun; of two of a kind the second counts. The last one once more, as its answer was lost, is passed
    /// over.
    pub fn stage(&mut self, part: Part, bytes: &[u8]) -> Result<(), SettingsError> {
        let staged = self.staged.as_mut().ok_or(SettingsError::NotBegun)?;
        let this = Some((part, fingerprint(bytes)));
        if self.last == this {
            return Ok(());
        }
        self.last = this;
        let [l0, l1, l2, l3] = (bytes.len() as u32).to_le_bytes();
        let head: [u8; ITEM_HEAD_BYTES] = [part as u8, 0, 0, 0, l0, l1, l2, l3];
        staged.append(&mut self.flash, &head)?;
        staged.append(&mut self.flash, bytes)
    }

    /// The setup that was begun counts from now on; which one it is.
    pub fn commit(&mut self) -> Result<u32, SettingsError> {
        let staged = self.staged.take().ok_or(SettingsError::NotBegun)?;
        self.setup_slots().commit(&mut self.flash, staged)
    }

    /// Where a part of a setup is; none: it has none.
    pub fn find(&mut self, setup: Setup, part: Part) -> Result<Option<Extent>, SettingsError> {
        let padded = |length: u32| length.next_multiple_of(F::WRITE_SIZE as u32);
        let Setup(whole) = setup;
        let (mut at, end) = (whole.at, whole.at.saturating_add(whole.length));
        let mut found = None;
        while at < end {
            let mut head = [0; ITEM_HEAD_BYTES];
            slots::read(&mut self.flash, at, &mut head)?;
            let [kind, _, _, _, l0, l1, l2, l3] = head;
            let length = u32::from_le_bytes([l0, l1, l2, l3]);
            at = at.saturating_add(padded(ITEM_HEAD_BYTES as u32));
            if length > end.saturating_sub(at) {
                break;
            }
            if kind == part as u8 {
                found = Some(Extent { at, length });
            }
            at = at.saturating_add(padded(length));
        }
        Ok(found)
    }

    /// Reads what an extent has from `offset` on, as much as `buffer` holds; the part of it that was filled.
    pub fn read<'b>(&mut self, extent: Extent, offset: u32, buffer: &'b mut [u8]) -> Result<&'b [u8], SettingsError> {
        let left = extent.length.saturating_sub(offset) as usize;
        let count = left.min(buffer.len());
        let part = buffer.get_mut(..count).ok_or(SettingsError::Nothing)?;
        slots::read(&mut self.flash, extent.at.saturating_add(offset), part)?;
        Ok(part)
    }
}
