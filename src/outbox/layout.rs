//! How the journal lies on the flash: the heads of sectors and records, byte by byte, and what makes them valid.
//!
//! ```text
//! sector   magic u32 | order u32 | erases u32 | state 40 bytes | CRC-32C u32 | pad      then records, then 0xFF
//! record   length u16 | kind u8 | 0x5A | sequence u32 | CRC of the payload u32 | CRC of the head u32 | payload | pad
//! state    acknowledged | leased | collected | alerts dropped up to | reports dropped up to | alerts dropped | reports dropped
//!          | starts | stream | 0, each u32                                               little endian
//! ```
//!
//! Everything is padded with 0xFF to whole words of the flash. Each checksum of a record begins with its sector's order, which no two
//! lives of a sector share: what an interrupted erasure leaves of an earlier life is not valid in the next. The magic number
//! carries the version; a flash of another version is taken for empty.

use crate::wire::CRC32C;

/// "SWO" and the version of this layout.
pub(super) const MAGIC: u32 = u32::from_le_bytes(*b"SWO\x01");
/// Bytes of a state.
pub(super) const STATE_BYTES: usize = 40;
/// Bytes of a sector's head before padding.
pub(super) const SECTOR_HEAD_BYTES: usize = 12 + STATE_BYTES + 4;
/// Bytes of a record's head.
pub(super) const RECORD_HEAD_BYTES: usize = 16;
/// In every record's head, so that neither zeros nor ones are one.
const MARK: u8 = 0x5A;

/// Orders, numbers and counts beyond are those of no flash: it wears out before. So sums of one more never turn over.
const MOST: u32 = 3 << 30;

/// What a record is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Kind {
    /// A newer [`State`] than the sector's head has.
    State = 1,
    /// An alert.
    Alert = 2,
    /// A report of a passage, or of the track.
    Report = 3,
    /// What all passages say of the bridge; the newest counts.
    Evidence = 4,
}

impl Kind {
    fn of(byte: u8) -> Option<Self> {
        [Self::State, Self::Alert, Self::Report, Self::Evidence]
            .into_iter()
            .find(|&kind| kind as u8 == byte)
    }
}

/// What the journal must not forget besides its records.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(super) struct State {
    /// Everything up to this number is on the base station's disk.
    pub(super) acknowledged: u32,
    /// Numbers up to this one may have been given.
    pub(super) leased: u32,
    /// The sector of this order was emptied into a later one.
    pub(super) collected: u32,
    /// Alerts up to this number were dropped for lack of room.
    pub(super) alerts_upto: u32,
    /// Reports up to this number were dropped for lack of room.
    pub(super) reports_upto: u32,
    /// So many alerts were dropped.
    pub(super) alerts_dropped: u32,
    /// So many reports were dropped.
    pub(super) reports_dropped: u32,
    /// Starts so far.
    pub(super) starts: u32,
    /// Name of this series of numbers; 0: it has none yet.
    pub(super) stream: u32,
}

impl State {
    /// Whether an outbox can have written it into the sector of this order.
    fn is_believable(&self, order: u32) -> bool {
        let given = [self.acknowledged, self.alerts_upto, self.reports_upto];
        let counts = [self.leased, self.starts, self.alerts_dropped, self.reports_dropped];
        counts.iter().all(|&count| count <= MOST)
            && given.iter().all(|&number| number <= self.leased)
            && self.collected < order
    }

    fn to_bytes(self) -> [u8; STATE_BYTES] {
        let words = [
            self.acknowledged,
            self.leased,
            self.collected,
            self.alerts_upto,
            self.reports_upto,
            self.alerts_dropped,
            self.reports_dropped,
            self.starts,
            self.stream,
            0,
        ];
        let mut bytes = [0; STATE_BYTES];
        for (place, word) in bytes.as_chunks_mut::<4>().0.iter_mut().zip(words) {
            *place = word.to_le_bytes();
        }
        bytes
    }

    fn from_bytes(bytes: &[u8; STATE_BYTES]) -> Self {
        let mut words = bytes.as_chunks::<4>().0.iter().map(|word| u32::from_le_bytes(*word));
        let mut next = || words.next().unwrap_or(0);
        Self {
            acknowledged: next(),
            leased: next(),
            collected: next(),
            alerts_upto: next(),
            reports_upto: next(),
            alerts_dropped: next(),
            reports_dropped: next(),
            starts: next(),
            stream: next(),
        }
    }
}

/// A sector's head.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct SectorHead {
    /// Grows by one with every sector that is begun.
    pub(super) order: u32,
    /// How often the sector was erased.
    pub(super) erases: u32,
    /// The state when it was begun.
    pub(super) state: State,
}

impl SectorHead {
    pub(super) fn to_bytes(self) -> [u8; SECTOR_HEAD_BYTES] {
        let mut bytes = [0; SECTOR_HEAD_BYTES];
        let parts = [MAGIC, self.order, self.erases].map(u32::to_le_bytes);
        let body = parts.as_flattened().iter().copied().chain(self.state.to_bytes());
        bytes.iter_mut().zip(body).for_each(|(place, byte)| *place = byte);
        if let Some((body, crc)) = bytes.split_last_chunk_mut::<4>() {
            *crc = CRC32C.checksum(body).to_le_bytes();
        }
        bytes
    }

    pub(super) fn from_bytes(bytes: &[u8; SECTOR_HEAD_BYTES]) -> Option<Self> {
        let (body, crc) = bytes.split_last_chunk::<4>()?;
        let (magic, rest) = body.split_first_chunk::<4>()?;
        let (order, rest) = rest.split_first_chunk::<4>()?;
        let (erases, rest) = rest.split_first_chunk::<4>()?;
        let state = rest.first_chunk::<STATE_BYTES>()?;
        let valid = u32::from_le_bytes(*magic) == MAGIC && CRC32C.checksum(body).to_le_bytes() == *crc;
        let head = Self {
            order: u32::from_le_bytes(*order),
            erases: u32::from_le_bytes(*erases),
            state: State::from_bytes(state),
        };
        (valid && head.order <= MOST && head.state.is_believable(head.order)).then_some(head)
    }
}

/// A record's head.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct RecordHead {
    pub(super) length: u16,
    pub(super) kind: Kind,
    pub(super) sequence: u32,
    /// Checksum of the payload, as [`PayloadCheck`] makes it.
    pub(super) payload_crc: u32,
}

impl RecordHead {
    pub(super) fn to_bytes(self, order: u32) -> [u8; RECORD_HEAD_BYTES] {
        let [l0, l1] = self.length.to_le_bytes();
        let [s0, s1, s2, s3] = self.sequence.to_le_bytes();
        let [p0, p1, p2, p3] = self.payload_crc.to_le_bytes();
        let body = [l0, l1, self.kind as u8, MARK, s0, s1, s2, s3, p0, p1, p2, p3];
        let [c0, c1, c2, c3] = seeded(order, &body).to_le_bytes();
        let [b0, b1, b2, b3, b4, b5, b6, b7, b8, b9, b10, b11] = body;
        [b0, b1, b2, b3, b4, b5, b6, b7, b8, b9, b10, b11, c0, c1, c2, c3]
    }

    pub(super) fn from_bytes(bytes: &[u8; RECORD_HEAD_BYTES], order: u32) -> Option<Self> {
        let (body, crc) = bytes.split_last_chunk::<4>()?;
        if seeded(order, body).to_le_bytes() != *crc {
            return None;
        }
        let [l0, l1, kind, MARK, s0, s1, s2, s3, p0, p1, p2, p3, ..] = *bytes else {
            return None;
        };
        let sequence = u32::from_le_bytes([s0, s1, s2, s3]);
        if sequence > MOST {
            return None;
        }
        Some(Self {
            length: u16::from_le_bytes([l0, l1]),
            kind: Kind::of(kind)?,
            sequence,
            payload_crc: u32::from_le_bytes([p0, p1, p2, p3]),
        })
    }
}

fn seeded(order: u32, bytes: &[u8]) -> u32 {
    let mut check = PayloadCheck::new(order);
    check.take(bytes);
    check.finish()
}

/// The checksum of a payload, taken piece by piece.
pub(super) struct PayloadCheck(crc::Digest<'static, u32>);

impl PayloadCheck {
    pub(super) fn new(order: u32) -> Self {
        let mut digest = CRC32C.digest();
        digest.update(&order.to_le_bytes());
        Self(digest)
    }

    pub(super) fn take(&mut self, bytes: &[u8]) {
        self.0.update(bytes);
    }

    pub(super) fn finish(self) -> u32 {
        self.0.finalize()
    }
}

/// The state of a record of kind [`Kind::State`] in the sector of this order.
pub(super) fn state_of(payload: &[u8], order: u32) -> Option<State> {
    let state = payload.first_chunk().map(State::from_bytes);
    state.filter(|state| state.is_believable(order))
}

/// The payload of a record of kind [`Kind::State`].
pub(super) fn state_bytes(state: State) -> [u8; STATE_BYTES] {
    state.to_bytes()
}
