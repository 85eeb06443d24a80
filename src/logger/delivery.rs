//! What is too large for one message: it comes to the logger, or goes from it, in pieces.
//!
//! | item | waits in | its first piece |
//! |---|---|---|
//! | bridge model, learnt track | the [`room`](super::room) of the identification | ends an identification in progress, which is reported as [`Reason::Interrupted`] |
//! | a passage's samples, to the base station | the stream, until the next passage begins | disturbs nothing |
//! | evidence, either way | a buffer of its own, 1,312 bytes | disturbs nothing |
//!
//! Pieces come in order from offset 0 on; a new first piece begins anew. A passage that comes while a model is on its way is identified
//! by the old model, if there is one, and takes the room: the next piece is refused with [`Outcome::Chunk`], and the sender begins again.
//! A model that never becomes whole changes nothing.
//!
//! The last piece that was taken may come again, its answer lost: it is answered as it was the first time, whatever has become of the
//! room meanwhile.

use heapless::Vec;

use super::{Logger, adopt};
use crate::capacity::MODEL_BLOB_BYTES;
use crate::identify::evidence::EVIDENCE_BYTES;
use crate::passage::samples::Samples;
use crate::slot::Slot;
use crate::wire::message::{BLOCK_COUNTS, CHUNK_BYTES, Chunk, Outcome, PassagePiece, Reason, Verdict};

/// What comes in pieces.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Item {
    /// A bridge model, for [`Logger::load`].
    Model,
    /// A learnt track, for [`Logger::load_track`].
    Track,
    /// An evidence, for [`Logger::restore`].
    Evidence,
}

/// What the logger remembers of its deliveries outside the [`room`](super::room).
#[derive(Debug, Clone)]
pub(super) struct Deliveries {
    /// An evidence that is coming, or the copy of the one that is going.
    evidence: Pieces<EVIDENCE_BYTES>,
    /// The last piece that was taken, and what it was answered.
    last: Slot<(Piece, Outcome)>,
}

/// By what a piece is known again.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Piece {
    item: Item,
    offset: u32,
    bytes: usize,
    total: u32,
}

/// The last passage that a learnt track did not explain. Its samples are the stream's, as long as these have not been cleared since.
#[derive(Debug, Clone, Copy)]
pub(super) struct Strange {
    /// Its number; 0: there was none.
    pub(super) passage: u32,
    pub(super) first_sample: u64,
    /// [`Stream::clearings`](crate::passage::Stream::clearings) at that time.
    pub(super) clearings: u32,
}

impl Strange {
    pub(super) const NONE: Self = Self {
        passage: 0,
        first_sample: 0,
        clearings: 0,
    };
}

/// Something as far as it has come.
#[derive(Debug, Clone)]
pub(super) struct Pieces<const N: usize> {
    bytes: Vec<u8, N>,
}

/// What became of a piece.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Taken {
    /// There is more to come.
    Part,
    /// It was the last.
    Whole,
    /// Out of order, or too many bytes.
    Refused,
}

impl Deliveries {
    pub(super) const fn new() -> Self {
        Self {
            evidence: Pieces::new(),
            last: Slot::Empty,
        }
    }
}

impl<const N: usize> Pieces<N> {
    pub(super) const fn new() -> Self {
        Self { bytes: Vec::new() }
    }

    /// Whether what the piece belongs to has room here.
    fn fits(chunk: &Chunk) -> bool {
        let end = (chunk.offset as usize).saturating_add(chunk.bytes.len());
        end <= chunk.total as usize && chunk.total as usize <= N
    }

    fn take(&mut self, chunk: &Chunk) -> Taken {
        if chunk.offset == 0 {
            self.bytes.clear();
        }
        let next = chunk.offset as usize == self.bytes.len();
        if !next || !Self::fits(chunk) || self.bytes.extend_from_slice(&chunk.bytes).is_err() {
            return Taken::Refused;
        }
        if self.bytes.len() < chunk.total as usize {
            Taken::Part
        } else {
            Taken::Whole
        }
    }

    /// The piece from `offset` on.
    fn give(&self, offset: u32) -> Chunk {
        let rest = self.bytes.get(offset as usize..).unwrap_or_default();
        Chunk {
            offset,
            total: self.bytes.len() as u32,
            bytes: rest.iter().take(CHUNK_BYTES).copied().collect(),
        }
    }
}

impl Logger {
    // Not inlined: what reads a whole model or evidence must not stand on the stack under a passage that has come.
    /// Takes a piece of `item`, and the whole once the last piece is there.
    #[inline(never)]
    pub fn take_piece(&mut self, item: Item, chunk: &Chunk) -> Outcome {
        let piece = Piece {
            item,
            offset: chunk.offset,
            bytes: chunk.bytes.len(),
            total: chunk.total,
        };
        match self.deliveries.last.as_ref() {
            // A first piece is never passed over: another item may begin as the last one ended.
            Some((last, outcome)) if *last == piece && piece.offset > 0 => return *outcome,
            _ => {}
        }
        let outcome = match item {
            Item::Model | Item::Track => self.take_into_room(item, chunk),
            Item::Evidence => match self.deliveries.evidence.take(chunk) {
                Taken::Part => Outcome::Done,
                Taken::Whole => self.restore_delivered(),
                Taken::Refused => Outcome::Chunk,
            },
        };
        if outcome != Outcome::Chunk {
            self.deliveries.last = Slot::Full((piece, outcome));
        }
        outcome
    }

    /// What has come of `item`, as long as nothing else has taken its room.
    pub fn delivered(&mut self, item: Item) -> Option<&[u8]> {
        self.room.delivery(item).map(|pieces| pieces.bytes.as_slice())
    }

    /// A piece of what all passages say of the bridge; all pieces are of the state that was at the first, unless a passage has come since.
    pub fn give_evidence(&mut self, offset: u32) -> Chunk {
        if offset == 0 {
            self.evidence_bytes();
        }
        self.deliveries.evidence.give(offset)
    }

    /// What all passages say of the bridge. It has the place of an evidence that is coming in pieces, which begins again then.
    pub fn evidence_bytes(&mut self) -> &[u8] {
        let copy = &mut self.deliveries.evidence.bytes;
        // There is room for the whole of it.
        let _ = copy.resize_default(EVIDENCE_BYTES);
        let basis = self.rails.basis(self.model_crc);
        let evidence = self.evidence.to_bytes(&basis, self.rails.watch, copy);
        let used = evidence.map_or(0, <[u8]>::len);
        copy.truncate(used);
        copy
    }

    /// Goes on from what `read` writes into the buffer, and tells how long it is, if it is an evidence of the same bridge and track.
    pub fn restore_from(&mut self, read: impl FnOnce(&mut [u8]) -> usize) -> bool {
        let copy = &mut self.deliveries.evidence.bytes;
        let _ = copy.resize_default(EVIDENCE_BYTES);
        let used = read(copy);
        copy.truncate(used);
        self.restore_delivered() == Outcome::Done
    }

    /// Samples of the last passage that a learnt track did not explain, from value `offset` on; none once the next passage has begun.
    pub fn give_passage(&self, offset: u32) -> PassagePiece {
        let samples = match self.strange.clearings == self.stream.clearings() && self.strange.passage > 0 {
            true => self.stream.passage_samples(),
            false => Samples::Plain(&[]),
        };
        PassagePiece {
            passage: if samples.is_empty() { 0 } else { self.strange.passage },
            first_sample: self.strange.first_sample,
            channels: self.configuration.as_ref().map_or(0, |c| c.channels.len()) as u8,
            total: samples.len() as u32,
            offset,
            values: (offset as usize..samples.len())
                .map_while(|place| samples.get(place))
                .take(BLOCK_COUNTS)
                .collect(),
        }
    }

    // Not inlined, as the next: neither must stand on the stack under the other.
    /// Takes a piece of something that needs the room of the identification.
    #[inline(never)]
    fn take_into_room(&mut self, item: Item, chunk: &Chunk) -> Outcome {
        if chunk.offset == 0 {
            if !Pieces::<MODEL_BLOB_BYTES>::fits(chunk) {
                return Outcome::Chunk;
            }
            self.end_work(Verdict::NotIdentified(Reason::Interrupted));
            self.room.begin_delivery(item);
        }
        // Without the room the beginning is gone.
        let Some(pieces) = self.room.delivery(item) else {
            return Outcome::Chunk;
        };
        match pieces.take(chunk) {
            Taken::Refused => Outcome::Chunk,
            Taken::Part => Outcome::Done,
            Taken::Whole if item == Item::Track => {
                (self
                    .rails
                    .adopt(&pieces.bytes, &mut self.bridge, self.model_crc, &mut self.evidence))
                .map_or_else(Outcome::Track, |()| Outcome::Done)
            }
            Taken::Whole => {
                let before = self.model_crc;
                match adopt(&pieces.bytes, &mut self.bridge, &mut self.model_crc, &mut self.evidence) {
                    Ok(()) => {
                        self.rails.follow(&mut self.bridge, before == self.model_crc);
                        Outcome::Done
                    }
                    Err(error) => Outcome::Model(error),
                }
            }
        }
    }

    #[inline(never)]
    fn restore_delivered(&mut self) -> Outcome {
        let bytes = &self.deliveries.evidence.bytes;
        (self.rails.restore(bytes, self.model_crc, &mut self.evidence))
            .map_or_else(Outcome::Evidence, |()| Outcome::Done)
    }
}
