//! From a code to the damage itself: damped Gauss-Newton within bounds, and the uncertainty of what it finds.
//!
//! ```text
//! minimise |r(d)|^2,  r = recorded - simulated(d),  0 <= d_e <= 0.7
//! (J^T J + mu diag(J^T J)) step = J^T r,   J = d simulated / d d        (Levenberg, Marquardt)
//! var(d) = s^2 diag((J^T J)^-1),   s^2 = |r|^2 / (n - elements)
//! ```
//!
//! The columns of `J` are differences between the passage simulated with the pattern and with a little more damage in
//! one element. All these simulations run side by side, sample by sample, so `J^T J` and `J^T r` are summed as the samples
//! go by and no Jacobian is stored. One pass costs `elements + 1` forward solves.
//!
//! The variances are those of the unbounded problem: an element found at its bound keeps the standard deviation that it
//! would have inside, which errs on the side of doubt.

use heapless::Vec;
use nalgebra::{SMatrix, SVector};

use super::objective::Problem;
use crate::bridge::{Damage, MAX_DAMAGE};
use crate::capacity::{CHANNELS, ELEMENTS};
use crate::interaction::SetupError;
use crate::math;

/// Forward solves of one pass on a bridge of `elements` elements.
pub const fn solves_per_pass(elements: usize) -> u32 {
    elements as u32 + 1
}

/// Step of damage for the differences: small against what matters (a tenth of a gene's step), large against `f32` rounding
/// (1e-5 of the signal, where a hundredth of damage changes it by 1e-3 or more).
const DIFFERENCE: f32 = 0.01;
/// Passes after which the descent stops in any case.
const MAX_PASSES: u32 = 25;
/// Converged when no element moves by more than this, ...
const SMALL_STEP: f32 = 5e-4;
/// ... or the sum of squares falls by less than this part.
const SMALL_GAIN: f32 = 1e-4;
/// Nothing is left to gain when this part of the recording's square is unexplained: the square of what `f32` and the
/// step leave in the solution, 1e-4 of the signal.
const EXPLAINED: f32 = 1e-8;
/// First damping, its smallest and its largest value.
const DAMPING: [f32; 3] = [1e-3, 1e-6, 1e3];
/// A rejected step multiplies the damping by this, an accepted one divides by it.
const DAMPING_FACTOR: f32 = 10.0;

type Matrix = SMatrix<f32, ELEMENTS, ELEMENTS>;
type Vector = SVector<f32, ELEMENTS>;

/// Why the descent ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Stop {
    /// The last step was negligible.
    Converged,
    /// No step, however short, makes it better.
    NoProgress,
    /// The passes are used up.
    Budget,
}

/// The normal equations at one damage pattern.
#[derive(Debug, Clone)]
struct Normal {
    damage: Damage<f32>,
    sum_of_squares: f32,
    jtj: Matrix,
    jtr: Vector,
}

/// State of the descent.
#[derive(Debug, Clone)]
pub struct Refinement {
    trial: Damage<f32>,
    best: Option<Normal>,
    damping: f32,
    passes: u32,
}

impl Refinement {
    /// A descent that starts from `damage`.
    pub fn new(damage: Damage<f32>) -> Self {
        Self {
            trial: damage,
            best: None,
            damping: DAMPING[0],
            passes: 0,
        }
    }

    /// Passes made.
    pub fn passes(&self) -> u32 {
        self.passes
    }

    /// One pass; tells why it was the last, if it was.
    pub fn advance(&mut self, problem: &Problem<'_>) -> Result<Option<Stop>, SetupError> {
        let found = normal_equations(problem, &self.trial)?;
        self.passes += 1;
        let stop = match &self.best {
            Some(best) if !(found.sum_of_squares < best.sum_of_squares) => {
                self.damping *= DAMPING_FACTOR;
                (self.damping > DAMPING[2]).then_some(Stop::NoProgress)
            }
            best => {
                let negligible = best.as_ref().is_some_and(|best| {
                    let moved = found
                        .damage
                        .iter()
                        .zip(&best.damage)
                        .fold(0.0_f32, |m, (a, b)| m.max((a - b).abs()));
                    moved < SMALL_STEP || best.sum_of_squares - found.sum_of_squares < SMALL_GAIN * best.sum_of_squares
                });
                let explained = found.sum_of_squares < EXPLAINED * problem.mean_square() * problem.count();
                self.damping = (self.damping / DAMPING_FACTOR).max(DAMPING[1]);
                self.best = Some(found);
                (negligible || explained).then_some(Stop::Converged)
            }
        };
        if stop.is_some() {
            return Ok(stop);
        }
        if self.passes == MAX_PASSES {
            return Ok(Some(Stop::Budget));
        }
        if let Some(best) = &self.best {
            self.trial = bounded_step(best, self.damping, problem.bridge.elements);
            let still = self
                .trial
                .iter()
                .zip(&best.damage)
                .all(|(a, b)| (a - b).abs() < SMALL_STEP / 10.0);
            if still {
                return Ok(Some(Stop::Converged));
            }
        }
        Ok(None)
    }

    /// The best damage so far, its standard deviations, and its misfit in (m/s²)²; none before the first pass.
    pub fn estimate(&self, problem: &Problem<'_>) -> Option<(Damage<f32>, Damage<f32>, f32)> {
        let best = self.best.as_ref()?;
        let elements = problem.bridge.elements;
        let variance = best.sum_of_squares / (problem.count() - elements as f32).max(1.0);
        let regular = with_identity(best.jtj, |e| e < elements);
        let inverse = regular.cholesky()?.inverse();
        let std = core::array::from_fn(|e| {
            if e < elements {
                math::sqrt((variance * inverse[(e, e)]).max(0.0))
            } else {
                0.0
            }
        });
        Some((best.damage, std, best.sum_of_squares / problem.count()))
    }
}

/// Simulates the pattern and its neighbours side by side and sums the normal equations.
fn normal_equations(problem: &Problem<'_>, damage: &Damage<f32>) -> Result<Normal, SetupError> {
    let elements = problem.bridge.elements.min(ELEMENTS);
    let mut base = problem.simulate(damage)?;
    let mut neighbours: Vec<_, ELEMENTS> = Vec::new();
    let mut differences = [0.0; ELEMENTS];
    for (element, difference) in differences.iter_mut().enumerate().take(elements) {
        let mut pattern = *damage;
        *difference = if damage[element] + DIFFERENCE > MAX_DAMAGE as f32 {
            -DIFFERENCE
        } else {
            DIFFERENCE
        };
        pattern[element] += *difference;
        // There is room for every element.
        let _ = neighbours.push(problem.simulate(&pattern)?);
    }
    let mut normal = Normal {
        damage: *damage,
        sum_of_squares: 0.0,
        jtj: Matrix::zeros(),
        jtr: Vector::zeros(),
    };
    for recorded in problem.recorded() {
        let simulated = base.sample();
        let mut rows = [Vector::zeros(); CHANNELS];
        for (element, neighbour) in neighbours.iter_mut().enumerate() {
            for ((row, value), centre) in rows.iter_mut().zip(neighbour.sample()).zip(simulated) {
                row[element] = (value - centre) / differences[element];
            }
        }
        for ((row, f), simulated) in rows.iter().zip(recorded).zip(simulated) {
            let residual = f - simulated;
            if residual.is_nan() {
                continue;
            }
            normal.sum_of_squares += residual * residual;
            normal.jtr.axpy(residual, row, 1.0);
            normal.jtj.ger(1.0, row, row, 1.0);
        }
    }
    Ok(normal)
}

/// The best damped step within the bounds: elements that would leave them are held there, one after the other.
fn bounded_step(at: &Normal, damping: f32, elements: usize) -> Damage<f32> {
    let mut held: [Option<f32>; ELEMENTS] = core::array::from_fn(|e| (e >= elements).then_some(0.0));
    for _ in 0..=ELEMENTS {
        let mut matrix = at.jtj;
        let mut right = at.jtr;
        for e in 0..ELEMENTS {
            matrix[(e, e)] *= 1.0 + damping;
        }
        for (e, step) in held.iter().enumerate() {
            if let Some(step) = step {
                right.axpy(-step, &at.jtj.column(e), 1.0);
            }
        }
        for (e, step) in held.iter().enumerate() {
            if step.is_some() {
                right[e] = 0.0;
            }
        }
        let Some(factor) = with_identity(matrix, |e| held[e].is_none()).cholesky() else {
            return at.damage;
        };
        let solution = factor.solve(&right);
        let mut worst: Option<(usize, f32, f32)> = None;
        let mut moved = at.damage;
        for e in 0..elements {
            let goal = at.damage[e] + held[e].unwrap_or(solution[e]);
            moved[e] = goal.clamp(0.0, MAX_DAMAGE as f32);
            let beyond = (goal - moved[e]).abs();
            if held[e].is_none() && beyond > worst.map_or(0.0, |(_, beyond, _)| beyond) {
                worst = Some((e, beyond, moved[e] - at.damage[e]));
            }
        }
        match worst {
            None => return moved,
            Some((e, _, step)) => held[e] = Some(step),
        }
    }
    at.damage
}

/// The matrix with the rows and columns of those that are not free replaced by the identity's.
fn with_identity(mut matrix: Matrix, free: impl Fn(usize) -> bool) -> Matrix {
    for e in (0..ELEMENTS).filter(|&e| !free(e)) {
        for other in 0..ELEMENTS {
            matrix[(e, other)] = 0.0;
            matrix[(other, e)] = 0.0;
        }
        matrix[(e, e)] = 1.0;
    }
    matrix
}
