//! The PC side of Spanwatch.

pub mod channel;
pub mod evaluate;
pub mod image;
pub mod model;
pub mod simulate;
