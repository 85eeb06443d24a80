//! A viaduct with a track that nobody has measured: how well its damage can be told, and how well it is.
//!
//! [`truth`] makes passages, [`bound`] says what is possible, [`design`] sets that beside the design's table.

pub mod bound;
pub mod design;
pub mod truth;
