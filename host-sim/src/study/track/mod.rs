//! A viaduct with a track that nobody has measured: how well its damage can be told, and how well it is.
//!
//! [`truth`] makes passages, [`bound`] says what is possible, [`design`] sets that beside the design's table. A [`method`] learns and
//! monitors, [`campaign`] runs it on many viaducts, [`table`] prints.

pub mod bound;
pub mod campaign;
pub mod design;
pub mod method;
pub mod table;
pub mod truth;
