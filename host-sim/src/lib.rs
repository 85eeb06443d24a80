//! The PC side of Spanwatch.

pub mod model;
