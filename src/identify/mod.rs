//! Which loss of stiffness, in which elements, makes the bridge move as recorded?
//!
//! A hypothesis (damage, and how the train ran: [`unknowns`]) is judged by simulating the passage with it ([`objective`], the
//! paper's Eq. 46), in a [`pass`] over the samples that can be cut into slices. Two genetic searches propose damage as
//! codes of tenths ([`code`]): [`paper_ga`] as published, for comparison, and [`micro_ga`], small enough for the logger.
//! [`refine`] goes from the best code to the least squares. None of these simulates anything: they *ask* and are *told*.
//! [`hybrid`] puts them together, and is what the logger runs. ([`growth`] is what the [first guess](crate::guess) asks a pass for.)
//!
//! What comes out is a Gaussian about the elements ([`estimate`], on [`quadratic`] and [`interval`]), and [`evidence`] adds those
//! of many passages up.

pub mod code;
pub mod estimate;
pub mod evidence;
pub mod free_vibration;
pub mod growth;
pub mod hybrid;
pub mod interval;
pub mod micro_ga;
pub mod objective;
pub mod paper_ga;
pub mod pass;
mod population;
pub mod quadratic;
mod random;
pub mod refine;
pub mod unknowns;

pub use code::DamageCode;
pub use hybrid::{Hybrid, Identification};
pub use micro_ga::MicroGa;
pub use objective::Problem;
pub use paper_ga::PaperGa;
pub use pass::Pass;

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
