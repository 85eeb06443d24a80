//! Frames on a serial line.
//!
//! ```text
//! 0x00 | COBS( version u8 | kind u8 | sequence u32 | length u16 | payload | CRC-32C u32 ) | 0x00      little endian
//! ```
//!
//! The payload is one postcard message of [`super::message`], `length` its bytes, counted exactly; the checksum covers
//! all before it. COBS (Cheshire and Baker 1999) takes the zeros out of a frame, so that a zero on the line is always
//! the end of one frame or the start of the next: after any garbage the decoder is back in step at the next zero. A
//! bare CRC-16 would not do: under COBS two flipped bits can pass it.
//!
//! Cost: 14 bytes a frame and one more every 254; the decoder holds one frame.

use serde::Serialize;
use serde::de::DeserializeOwned;

use super::CRC32C;
use super::message::VERSION;
use crate::capacity::PAYLOAD_BYTES;

const HEADER_BYTES: usize = 8;
const CRC_BYTES: usize = 4;
/// What a sealed frame has around its message: kind and number inside, and the seal.
pub const SEALING_BYTES: usize = INNER_BYTES + TAG_BYTES;
const INNER_BYTES: usize = 5;
const TAG_BYTES: usize = 16;
/// Bytes of a frame before it is stuffed.
const BARE_BYTES: usize = HEADER_BYTES + PAYLOAD_BYTES + SEALING_BYTES + CRC_BYTES;
/// Most bytes that a frame can have on the line, both zeros included.
pub const FRAME_BYTES: usize = BARE_BYTES + STUFFING_BYTES;
/// What stuffing adds, and the two zeros.
const STUFFING_BYTES: usize = BARE_BYTES / 254 + 1 + 2;

/// Whose words a frame carries, and so what its sequence number counts.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Kind {
    /// [`super::message::Request`]: numbered by the base station.
    Request = 1,
    /// [`super::message::Answer`]: has the number of its request.
    Answer = 2,
    /// [`super::message::Event`]: numbered by the logger.
    Event = 3,
    /// A frame of one of the other kinds inside, encrypted and authenticated ([`crate::session`]): numbered by its sender.
    Sealed = 4,
    /// [`crate::session::packet::Knock`], in the clear.
    Knock = 5,
    /// [`crate::session::packet::Hello`], in the clear.
    Hello = 6,
    /// [`crate::session::packet::Welcome`], sealed behind the station's nonce.
    Welcome = 7,
    /// A [`Self::Event`] from the outbox, with its number there: inside a sealed frame only.
    Parcel = 8,
    /// [`crate::session::packet::Receipt`]: inside a sealed frame only.
    Receipt = 9,
    /// [`crate::session::packet::Heartbeat`]: inside a sealed frame only.
    Heartbeat = 10,
    /// [`crate::session::packet::Time`]: inside a sealed frame only.
    Time = 11,
}

impl Kind {
    fn of(byte: u8) -> Option<Self> {
        [
            Self::Request,
            Self::Answer,
            Self::Event,
            Self::Sealed,
            Self::Knock,
            Self::Hello,
            Self::Welcome,
            Self::Parcel,
            Self::Receipt,
            Self::Heartbeat,
            Self::Time,
        ]
        .into_iter()
        .find(|&kind| kind as u8 == byte)
    }
}

/// The message does not fit into a frame. No message of [`super::message`] is that long.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct TooLong;

/// Room in which a frame is written: at first bare, as far back as stuffing will move it forward, then stuffed in its place.
#[derive(Debug, Clone)]
pub struct FrameBuffer {
    bytes: [u8; FRAME_BYTES],
}

impl Default for FrameBuffer {
    fn default() -> Self {
        Self::new()
    }
}

impl FrameBuffer {
    /// Empty.
    pub const fn new() -> Self {
        Self {
            bytes: [0; FRAME_BYTES],
        }
    }

    /// Writes the frame of a message; gives the bytes for the line.
    pub fn write(&mut self, kind: Kind, sequence: u32, message: &impl Serialize) -> Result<&[u8], TooLong> {
        self.write_with(kind, sequence, |payload| {
            let room = payload.get_mut(..PAYLOAD_BYTES)?;
            postcard::to_slice(message, room).ok().map(|written| written.len())
        })
    }

    /// Writes a frame around a payload that `fill` writes into the room that it is given; it gives the payload's length.
    pub fn write_with(
        &mut self,
        kind: Kind,
        sequence: u32,
        fill: impl FnOnce(&mut [u8]) -> Option<usize>,
    ) -> Result<&[u8], TooLong> {
        let bare = self.bytes.get_mut(STUFFING_BYTES..).ok_or(TooLong)?;
        let (header, rest) = bare.split_first_chunk_mut::<HEADER_BYTES>().ok_or(TooLong)?;
        let room = rest.get_mut(..PAYLOAD_BYTES + SEALING_BYTES).ok_or(TooLong)?;
        let length = fill(room).ok_or(TooLong)?;
        let [s0, s1, s2, s3] = sequence.to_le_bytes();
        let [l0, l1] = (length as u16).to_le_bytes();
        *header = [VERSION, kind as u8, s0, s1, s2, s3, l0, l1];
        let end = HEADER_BYTES + length;
        let crc = CRC32C.checksum(bare.get(..end).ok_or(TooLong)?);
        let slot = bare.get_mut(end..end + CRC_BYTES).ok_or(TooLong)?;
        slot.copy_from_slice(&crc.to_le_bytes());
        let bytes = stuff(&mut self.bytes, end + CRC_BYTES).ok_or(TooLong)?;
        self.bytes.get(..bytes).ok_or(TooLong)
    }

    /// Writes a sealed frame, number `counter` of its sender, around a message of `kind` with the number `sequence`; `seal` encrypts what it
    /// is given in its place and gives the tag.
    pub fn write_sealed(
        &mut self,
        counter: u32,
        kind: Kind,
        sequence: u32,
        message: impl FnOnce(&mut [u8]) -> Option<usize>,
        seal: impl FnOnce(&mut [u8]) -> Option<[u8; TAG_BYTES]>,
    ) -> Result<&[u8], TooLong> {
        self.write_with(Kind::Sealed, counter, |payload| {
            let (head, rest) = payload.split_first_chunk_mut::<INNER_BYTES>()?;
            let [s0, s1, s2, s3] = sequence.to_le_bytes();
            *head = [kind as u8, s0, s1, s2, s3];
            let end = INNER_BYTES + message(rest.get_mut(..PAYLOAD_BYTES)?)?;
            let tag = seal(payload.get_mut(..end)?)?;
            payload.get_mut(end..end + TAG_BYTES)?.copy_from_slice(&tag);
            Some(end + TAG_BYTES)
        })
    }
}

/// COBS between two zeros, of `length` bytes behind the first [`STUFFING_BYTES`]; gives the bytes written from the start, or none if there
/// is no room. A byte is never written before the one that lay there was read: each moves forward, by one less after each full block.
fn stuff(buffer: &mut [u8], length: usize) -> Option<usize> {
    *buffer.first_mut()? = 0;
    // Each block: a count, then so many bytes without a zero; a count below 255 stands for a zero after them as well.
    let (mut count, mut end) = (1, 2);
    for place in STUFFING_BYTES..STUFFING_BYTES + length {
        let byte = *buffer.get(place)?;
        if end - count == 255 {
            *buffer.get_mut(count)? = 255;
            (count, end) = (end, end + 1);
        }
        if byte == 0 {
            *buffer.get_mut(count)? = (end - count) as u8;
            (count, end) = (end, end + 1);
        } else {
            *buffer.get_mut(end)? = byte;
            end += 1;
        }
    }
    *buffer.get_mut(count)? = (end - count) as u8;
    *buffer.get_mut(end)? = 0;
    Some(end + 1)
}

/// What was refused, by reason; each count saturates.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Rejections {
    /// More bytes between two zeros than a frame can have.
    pub too_long: u32,
    /// Fewer bytes than an empty frame has, or a COBS block cut off.
    pub too_short: u32,
    /// The checksum does not fit.
    pub checksum: u32,
    /// Another version of the messages.
    pub version: u32,
    /// Not a kind of frame that this end reads.
    pub kind: u32,
    /// The header's length is not that of the payload.
    pub length: u32,
    /// The payload is not a message.
    pub payload: u32,
}

impl Rejections {
    /// All of them.
    pub fn total(&self) -> u32 {
        self.by_reason().into_iter().fold(0, u32::saturating_add)
    }

    /// Each of them, in the order of the fields.
    pub fn by_reason(&self) -> [u32; 7] {
        let Self {
            too_long,
            too_short,
            checksum,
            version,
            kind,
            length,
            payload,
        } = *self;
        [too_long, too_short, checksum, version, kind, length, payload]
    }
}

/// A frame that has passed every check but that of its payload.
#[derive(Debug, PartialEq, Eq)]
pub struct Frame<'a> {
    /// Whose words.
    pub kind: Kind,
    /// Its number.
    pub sequence: u32,
    pub(crate) payload: &'a mut [u8],
}

impl<'a> Frame<'a> {
    /// The message; none if the payload is not exactly one. The caller tells the decoder ([`Decoder::refuse`]).
    pub fn message<M: DeserializeOwned>(&self) -> Option<M> {
        match postcard::take_from_bytes(self.payload) {
            Ok((message, [])) => Some(message),
            _ => None,
        }
    }

    /// The payload.
    pub fn payload(&self) -> &[u8] {
        self.payload
    }

    /// The frame inside a sealed one; `open` decrypts what it is given in its place, and says whether the tag fits.
    pub fn open(self, open: impl FnOnce(&mut [u8], &[u8; TAG_BYTES]) -> bool) -> Option<Frame<'a>> {
        let (sealed, tag) = self.payload.split_last_chunk_mut::<TAG_BYTES>()?;
        if sealed.len() < INNER_BYTES || !open(sealed, tag) {
            return None;
        }
        let (head, payload) = sealed.split_first_chunk_mut::<INNER_BYTES>()?;
        let [kind, s0, s1, s2, s3] = *head;
        Some(Frame {
            kind: Kind::of(kind)?,
            sequence: u32::from_le_bytes([s0, s1, s2, s3]),
            payload,
        })
    }
}

/// Why a complete frame is not taken after all.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Refusal {
    /// This end does not read frames of that kind.
    Kind,
    /// The payload is not a message.
    Payload,
}

/// Finds frames in a stream of bytes. Any bytes may come: it never fails, it counts what it refuses.
#[derive(Debug, Clone)]
pub struct Decoder {
    bare: [u8; BARE_BYTES],
    length: usize,
    /// Bytes left in the current COBS block.
    left: u8,
    /// Whether a zero follows the current block.
    zero_follows: bool,
    overflow: bool,
    rejections: Rejections,
}

impl Default for Decoder {
    fn default() -> Self {
        Self::new()
    }
}

impl Decoder {
    /// A decoder that waits for its first frame.
    pub const fn new() -> Self {
        Self {
            bare: [0; BARE_BYTES],
            length: 0,
            left: 0,
            zero_follows: false,
            overflow: false,
            rejections: Rejections {
                too_long: 0,
                too_short: 0,
                checksum: 0,
                version: 0,
                kind: 0,
                length: 0,
                payload: 0,
            },
        }
    }

    /// What was refused so far.
    pub fn rejections(&self) -> &Rejections {
        &self.rejections
    }

    /// Counts a frame that the caller could not use.
    pub fn refuse(&mut self, refusal: Refusal) {
        let count = match refusal {
            Refusal::Kind => &mut self.rejections.kind,
            Refusal::Payload => &mut self.rejections.payload,
        };
        *count = count.saturating_add(1);
    }

    /// Takes one byte of the line; gives a frame when that byte completes one.
    pub fn push(&mut self, byte: u8) -> Option<Frame<'_>> {
        if byte == 0 {
            return self.end();
        }
        if self.left == 0 {
            // The count of a new block; the zero of the last one turns out to be inside the frame.
            if self.zero_follows {
                self.append(0);
            }
            self.left = byte - 1;
            self.zero_follows = byte < 255;
        } else {
            self.append(byte);
            self.left -= 1;
        }
        None
    }

    fn append(&mut self, byte: u8) {
        match self.bare.get_mut(self.length) {
            Some(slot) => {
                *slot = byte;
                self.length += 1;
            }
            None => self.overflow = true,
        }
    }

    /// A zero on the line.
    fn end(&mut self) -> Option<Frame<'_>> {
        let (length, cut, overflow) = (self.length, self.left > 0, self.overflow);
        let nothing = length == 0 && !cut && !self.zero_follows;
        self.length = 0;
        self.left = 0;
        self.zero_follows = false;
        self.overflow = false;
        if nothing {
            return None;
        }
        match check(&mut self.bare, length, cut, overflow, &mut self.rejections) {
            Ok(frame) => Some(frame),
            Err(count) => {
                *count = count.saturating_add(1);
                None
            }
        }
    }
}

/// The frame in the first `length` bytes, or the count that its refusal adds to.
fn check<'b, 'r>(
    bare: &'b mut [u8; BARE_BYTES],
    length: usize,
    cut: bool,
    overflow: bool,
    rejections: &'r mut Rejections,
) -> Result<Frame<'b>, &'r mut u32> {
    if overflow {
        return Err(&mut rejections.too_long);
    }
    let parts = bare.get_mut(..length).and_then(|all| {
        let (checked, crc) = all.split_last_chunk_mut::<CRC_BYTES>()?;
        let sound = CRC32C.checksum(checked).to_le_bytes() == *crc;
        let (header, payload) = checked.split_first_chunk_mut::<HEADER_BYTES>()?;
        Some((sound, *header, payload))
    });
    let Some((sound, header, payload)) = parts.filter(|_| !cut) else {
        return Err(&mut rejections.too_short);
    };
    if !sound {
        return Err(&mut rejections.checksum);
    }
    let [version, kind, s0, s1, s2, s3, l0, l1] = header;
    if version != VERSION {
        return Err(&mut rejections.version);
    }
    let Some(kind) = Kind::of(kind) else {
        return Err(&mut rejections.kind);
    };
    if usize::from(u16::from_le_bytes([l0, l1])) != payload.len() {
        return Err(&mut rejections.length);
    }
    let sequence = u32::from_le_bytes([s0, s1, s2, s3]);
    Ok(Frame {
        kind,
        sequence,
        payload,
    })
}
