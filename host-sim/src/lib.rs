//! The PC side of Spanwatch.

pub mod model;
pub mod evaluate;
pub mod simulate;
