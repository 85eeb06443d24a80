//! Train-bridge interaction: the bridge's modes and the cars on it, solved together at every step.
//!
//! ```text
//! q'' + C q' + W q = sum_i phi_i F_i                            bridge, m modes, mass-normalised   (paper's Eqs 37, 44)
//! u_i = phi_i . q,  u_i' = phi_i . q' + [v phi_i'. q]           rail under contact i                 (Eqs 26, 27)
//! u_i'' = phi_i . q'' + [2 v phi_i'. q' + v^2 phi_i''. q]         [..]: only with [`Kinematics::Convective`]
//! ```
//!
//! with the cars and the forces `F_i` of [`crate::train`], `phi_i = phi(x_i)` the mode shapes at the contact,
//! `x_i = v (t - t_entry) - d_i`; all positive up. Time integration is Newmark's average acceleration (beta 1/4, gamma
//! 1/2) in the acceleration form: the accelerations are the unknowns, not recovered as differences of displacements,
//! which in `f32` would lose most of their digits.
//!
//! Only cars that touch the bridge are coupled. Each car's own matrix is constant, so its unknowns are eliminated with a
//! compliance that is computed once; what is left each step is one dense `m x m` system for the bridge.
//!
//! [`solver`] steps; [`simulation`] is what a recorder would show of it.

mod contact;
pub mod simulation;
pub mod solver;

pub use simulation::{Observation, Simulation};
pub use solver::{Interaction, Kinematics, Run, SetupError};
