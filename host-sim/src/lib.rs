//! The PC side of Spanwatch: what the binary `host-sim` is made of.

pub mod batch;
pub mod calibrate;
pub mod campaign;
pub mod channel;
pub mod cost;
pub mod crossing;
pub mod evaluate;
pub mod flash;
pub mod identification;
pub mod image;
pub mod model;
pub mod number_table;
pub mod output;
pub mod picture;
pub mod prediction;
pub mod random;
pub mod recording;
pub mod replay;
pub mod simulate;
pub mod station;
pub mod study;
pub mod terminal;
pub mod toml_text;
pub mod track;
pub mod train;
pub mod validate;
