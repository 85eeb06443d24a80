//! Which loss of stiffness, in which elements, makes the bridge move as recorded?
//!
//! A damage pattern is judged by simulating the passage with it ([`objective`], the paper's Eq. 46). Two genetic searches
//! propose patterns as codes of tenths ([`code`]): [`paper_ga`] as published, for comparison, and [`micro_ga`], small
//! enough for the logger. Both only *ask* for the next pattern's misfit and are *told* it, so a search can be cut
//! into slices of one forward solve each. [`refine`] goes from the best code to the least-squares damage and its
//! uncertainty; [`hybrid`] puts the small search and the refinement together, and is what the logger runs.

pub mod code;
pub mod free_vibration;
pub mod hybrid;
pub mod micro_ga;
pub mod objective;
pub mod paper_ga;
mod population;
mod random;
pub mod refine;

pub use code::DamageCode;
pub use hybrid::{Hybrid, Identification};
pub use micro_ga::MicroGa;
pub use objective::Problem;
pub use paper_ga::PaperGa;

/// A search over damage codes that asks for misfits.
pub trait CodeSearch {
    /// The pattern whose misfit is wanted next; none when the search has ended.
    fn ask(&mut self) -> Option<DamageCode>;
    /// The misfit of the pattern last asked for, (m/s²)².
    fn tell(&mut self, misfit: f32);
    /// The best pattern so far and its misfit.
    fn best(&self) -> (DamageCode, f32);
    /// Generations begun.
    fn generations(&self) -> u32;
    /// Generation, from 1, in which the best pattern appeared.
    fn best_since(&self) -> u32;
}
