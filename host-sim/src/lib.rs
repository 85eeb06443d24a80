//! The PC side of Spanwatch: what the binary `host-sim` is made of.

pub mod evaluate;
pub mod model;
pub mod output;
pub mod picture;
pub mod recording;
pub mod simulate;
pub mod terminal;
pub mod toml_text;
pub mod train_name;
