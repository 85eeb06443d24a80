//! A viaduct with a track that nobody has measured: how well its damage can be told, and how well it is.
//!
//! [`truth`] makes passages.

pub mod truth;
