//! The PC side of Spanwatch.

pub mod evaluate;
pub mod model;
pub mod simulate;
