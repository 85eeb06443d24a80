//! The logger's largest room, 10 kB: an identification and a delivery share it, since no passage is identified by a model that is
//! just being replaced.
//!
//! Whoever comes last has it. A delivery ends the identification, which is reported; a passage ends the delivery, whose sender is told
//! at its next piece and begins again. So neither waits for the other, and a delivery that was broken off blocks nothing.

use super::delivery::{Item, Pieces};
use crate::capacity::MODEL_BLOB_BYTES;
use crate::identify::Pass;

/// Its tag is its own, and 0 when it is empty, for the reason that [`Slot`](crate::slot::Slot) has. It is as wide as its alignment: with
/// bytes between tag and content the compiler makes the content on the stack, all 9 kB of it, and copies it into its place.
#[derive(Debug, Clone)]
#[repr(u64)]
#[allow(clippy::large_enum_variant, reason = "one place in static memory, whichever it is")]
pub(super) enum Room {
    /// Nobody needs it.
    Empty = 0,
    /// The simulation of a passage that is being identified.
    Pass(Pass) = 1,
    /// What is on its way.
    Delivery(Item, Pieces<MODEL_BLOB_BYTES>) = 2,
}

// A delivery asks for no memory of its own.
const _: () = assert!(size_of::<Pieces<MODEL_BLOB_BYTES>>() <= size_of::<Pass>());

impl Room {
    // Not inlined, as the next: so the compiler clears the place itself and needs no copy of it on the stack.
    /// Clears the room for an identification.
    #[inline(never)]
    pub(super) fn begin_pass(&mut self) {
        *self = Self::Pass(Pass::new());
    }

    /// Clears the room for a delivery.
    #[inline(never)]
    pub(super) fn begin_delivery(&mut self, item: Item) {
        *self = Self::Delivery(item, Pieces::new());
    }

    /// The memory of the identification, if it has the room.
    pub(super) fn pass(&mut self) -> Option<&mut Pass> {
        match self {
            Self::Pass(pass) => Some(pass),
            _ => None,
        }
    }

    /// The pieces of `item`, if it has the room.
    pub(super) fn delivery(&mut self, item: Item) -> Option<&mut Pieces<MODEL_BLOB_BYTES>> {
        match self {
            Self::Delivery(of, pieces) if *of == item => Some(pieces),
            _ => None,
        }
    }
}
