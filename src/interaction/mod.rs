//! Train-bridge interaction: the bridge's modes and the cars on it, solved together at every step.
//!
//! ```text
//! q'' + C q' + W q = sum_i phi_i F_i                            bridge, m modes, mass-normalised   (paper's Eqs 37, 44)
//! u_i = phi_i . q + r                                           rail under contact i                 (Eqs 24 to 27)
//! u_i' = phi_i . q' + v r' + [v phi_i'. q]                              [..]: only with [`Kinematics::Convective`]
//! u_i'' = phi_i . q'' + v^2 r'' + v' r' + [2 v phi_i'. q' + v^2 phi_i''. q + v' phi_i'. q]
//! ```
//!
//! with the cars and the forces `F_i` of [`crate::train`], `phi_i = phi(x_i)` the mode shapes at the contact, `r` the
//! irregularity of the track, `x_i` the way of the wheel at speed `v`; all positive up. The unknowns of a step are
//! accelerations, not displacements, of which `f32` would lose most digits in the differences.
//!
//! Only cars that touch the bridge are coupled. Each car's own matrix is constant, so its unknowns are eliminated with
//! matrices that are computed once; what is left each step is one dense, symmetric `m x m` system for the bridge.
//!
//! [`run`] says how a train runs, [`scheme`] how time is stepped, [`contact`] what a bridge is, [`car`] steps a car, [`solver`] all
//! of it; [`simulation`] is what a recorder would show, [`sensitivity`] how that changes with damage, speed, entry and loads,
//! [`response`] how with the track.

pub mod car;
pub mod contact;
pub mod response;
pub mod run;
pub mod scheme;
pub mod sensitivity;
pub mod simulation;
pub mod solver;

pub use contact::Modes;
pub use response::Response;
pub use run::{Direction, Kinematics, Run, SetupError};
pub use scheme::Scheme;
pub use sensitivity::Sensitivities;
pub use simulation::{Hypothesis, Observation, Simulation};
pub use solver::{Interaction, PlanarInteraction, TrainSteps};
