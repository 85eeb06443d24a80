//! From a code to the damage itself: damped Gauss-Newton within bounds, and the uncertainty of what it finds.
//!
//! ```text
//! minimise |r(p)|^2,  r = recorded - simulated(p),  p_e = 1 / (1 - d_e),  1 <= p_e <= 1 / (1 - 0.7)
//! (J^T J + mu diag(J^T J)) step = J^T r,   J = d simulated / d p        (Levenberg, Marquardt)
//! var(p) = s^2 diag((J^T J)^-1),   s^2 = |r|^2 / (n - elements),   std(d_e) = (1 - d_e)^2 std(p_e)
//! ```
//!
//! The unknowns are the elements' flexibilities `p`, not their losses `d`: the girder's deflection is linear in the
//! flexibilities (exactly so, if it is statically determinate and at rest), and the valley that the descent follows is
//! straight. In the losses it is bent, and the descent took twice the steps.
//!
//! The columns of `J` are differences between the passage simulated with the pattern and with a little more damage in
//! one element. All these simulations run side by side, sample by sample, so `J^T J` and `J^T r` are summed as the samples
//! go by and no Jacobian is stored. That costs `elements + 1` forward solves, and is done only where one solve has shown
//! that the step is a good one.
//!
//! The variances are those of the unbounded problem: an element found at its bound keeps the standard deviation that it
//! would have inside, which errs on the side of doubt. They rest on the derivatives at the last point but one, which lies
//! within the last, negligible step.

use heapless::Vec;
use nalgebra::{SMatrix, SVector};

use super::objective::Problem;
use crate::bridge::{Damage, MAX_DAMAGE};
use crate::capacity::{CHANNELS, ELEMENTS};
use crate::interaction::SetupError;
use crate::math;

/// Step of damage for the differences: large against `f32` rounding (1e-5 of the signal, where half a hundredth of damage
/// changes it by 5e-4 or more), small against the valley's bend: twice the step left the descent short of the bottom in
/// 5 of 400 random cases, this one in none of them and none of 400 others.
const DIFFERENCE: f32 = 0.005;
/// Forward solves after which the descent stops in any case.
const MAX_SOLVES: u32 = 280;
/// Converged when no element's damage moves by more than this, ...
const SMALL_STEP: f32 = 5e-4;
/// ... or the sum of squares falls by less than this part.
const SMALL_GAIN: f32 = 1e-4;
/// Nothing is left to gain when this part of the recording's square is unexplained: the square of what `f32` and the
/// step leave in the solution, 1e-4 of the signal.
const EXPLAINED: f32 = 1e-8;
/// First damping, its smallest and its largest value.
const DAMPING: [f32; 3] = [1e-3, 1e-6, 1e3];
/// A rejected step multiplies the damping by this, one that kept its promise divides by it.
const DAMPING_FACTOR: f32 = 10.0;
/// A step keeps its promise if the sum of squares falls by this part of what the linear model said.
const PROMISE: f32 = 0.5;

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
    /// The forward solves are used up.
    Budget,
}

/// The normal equations at one pattern of flexibilities.
#[derive(Debug, Clone)]
struct Normal {
    flexibility: Vector,
    sum_of_squares: f32,
    jtj: Matrix,
    jtr: Vector,
}

/// What the next slice of the descent does at the trial pattern.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Next {
    /// One solve: is it better?
    Probe,
    /// It is: the normal equations there.
    Linearise,
}

/// State of the descent.
#[derive(Debug, Clone)]
pub struct Refinement {
    trial: Vector,
    next: Next,
    /// Fall of the sum of squares that the linear model promises at the trial pattern.
    promised: f32,
    best: Option<Normal>,
    damping: f32,
    solves: u32,
}

impl Refinement {
    /// A descent that starts from `damage`.
    pub fn new(damage: Damage<f32>) -> Self {
        Self {
            trial: Vector::from(damage.map(flexibility)),
            next: Next::Linearise,
            promised: 0.0,
            best: None,
            damping: DAMPING[0],
            solves: 0,
        }
    }

    /// Forward solves made.
    pub fn solves(&self) -> u32 {
        self.solves
    }

    /// One slice, a probe or a linearisation; tells why it was the last, if it was.
    pub fn advance(&mut self, problem: &Problem<'_>) -> Result<Option<Stop>, SetupError> {
        let stop = match self.next {
            Next::Linearise => self.linearise(problem)?,
            Next::Probe => self.probe(problem)?,
        };
        Ok(stop.or((self.solves >= MAX_SOLVES).then_some(Stop::Budget)))
    }

    fn linearise(&mut self, problem: &Problem<'_>) -> Result<Option<Stop>, SetupError> {
        let found = normal_equations(problem, &self.trial)?;
        self.solves += problem.bridge.elements as u32 + 1;
        let explained = explained(problem, found.sum_of_squares);
        self.best = Some(found);
        Ok(if explained {
            Some(Stop::Converged)
        } else {
            self.aim(problem)
        })
    }

    fn probe(&mut self, problem: &Problem<'_>) -> Result<Option<Stop>, SetupError> {
        let sum_of_squares = problem.misfit(&losses(&self.trial))? * problem.count();
        self.solves += 1;
        let Some(best) = &mut self.best else {
            return Ok(Some(Stop::NoProgress));
        };
        let fall = best.sum_of_squares - sum_of_squares;
        if fall.is_nan() || fall <= 0.0 {
            self.damping *= DAMPING_FACTOR;
            return Ok(if self.damping > DAMPING[2] {
                Some(Stop::NoProgress)
            } else {
                self.aim(problem)
            });
        }
        if fall > PROMISE * self.promised {
            self.damping = (self.damping / DAMPING_FACTOR).max(DAMPING[1]);
        }
        let negligible =
            moves_less(&self.trial, &best.flexibility, SMALL_STEP) || fall < SMALL_GAIN * best.sum_of_squares;
        if negligible || explained(problem, sum_of_squares) {
            best.flexibility = self.trial;
            best.sum_of_squares = sum_of_squares;
            return Ok(Some(Stop::Converged));
        }
        self.next = Next::Linearise;
        Ok(None)
    }

    /// Chooses the next trial pattern from the best one; tells if it is the same.
    fn aim(&mut self, problem: &Problem<'_>) -> Option<Stop> {
        let best = self.best.as_ref()?;
        self.trial = bounded_step(best, self.damping, problem.bridge.elements);
        let step = self.trial - best.flexibility;
        self.promised = 2.0 * step.dot(&best.jtr) - step.dot(&product(&best.jtj, &step));
        self.next = Next::Probe;
        moves_less(&self.trial, &best.flexibility, SMALL_STEP / 10.0).then_some(Stop::Converged)
    }

    /// The best damage so far, its standard deviations, and its misfit in (m/s²)²; none before the first slice, or if the
    /// recording says nothing of some element.
    pub fn estimate(&self, problem: &Problem<'_>) -> Option<(Damage<f32>, Damage<f32>, f32)> {
        let best = self.best.as_ref()?;
        let elements = problem.bridge.elements;
        let variance = best.sum_of_squares / (problem.count() - elements as f32).max(1.0);
        let regular = with_identity(best.jtj, |e| e < elements);
        let inverse = regular.cholesky()?.inverse();
        let damage = losses(&best.flexibility);
        let std = core::array::from_fn(|e| {
            if e < elements {
                let left = 1.0 - damage[e];
                left * left * math::sqrt((variance * inverse[(e, e)]).max(0.0))
            } else {
                0.0
            }
        });
        Some((damage, std, best.sum_of_squares / problem.count()))
    }
}

/// Flexibility of an element that has lost the fraction `loss` of its stiffness, in units of the whole one's.
fn flexibility(loss: f32) -> f32 {
    1.0 / (1.0 - loss.clamp(0.0, MAX_DAMAGE as f32))
}

/// Fractions of stiffness lost, from flexibilities.
fn losses(flexibility: &Vector) -> Damage<f32> {
    core::array::from_fn(|e| (1.0 - 1.0 / flexibility[e]).clamp(0.0, MAX_DAMAGE as f32))
}

/// Whether no element's damage differs by `limit` or more.
fn moves_less(a: &Vector, b: &Vector, limit: f32) -> bool {
    losses(a).iter().zip(&losses(b)).all(|(a, b)| (a - b).abs() < limit)
}

fn explained(problem: &Problem<'_>, sum_of_squares: f32) -> bool {
    sum_of_squares < EXPLAINED * problem.mean_square() * problem.count()
}

/// `matrix vector`, written out so that no kernel fuses it.
fn product(matrix: &Matrix, vector: &Vector) -> Vector {
    let mut sum = Vector::zeros();
    for (column, &factor) in matrix.column_iter().zip(vector.iter()) {
        sum.axpy(factor, &column, 1.0);
    }
    sum
}

/// Simulates the pattern and its neighbours side by side and sums the normal equations.
// Not inlined: its frame, a simulation for each element, must not stand on the stack while anything else runs.
#[inline(never)]
fn normal_equations(problem: &Problem<'_>, at: &Vector) -> Result<Normal, SetupError> {
    let elements = problem.bridge.elements.min(ELEMENTS);
    let damage = losses(at);
    let mut base = problem.simulate(&damage)?;
    let mut neighbours: Vec<_, ELEMENTS> = Vec::new();
    let mut differences = [0.0; ELEMENTS];
    for (element, difference) in differences.iter_mut().enumerate().take(elements) {
        let mut pattern = damage;
        pattern[element] += if damage[element] + DIFFERENCE > MAX_DAMAGE as f32 {
            -DIFFERENCE
        } else {
            DIFFERENCE
        };
        *difference = flexibility(pattern[element]) - flexibility(damage[element]);
        // There is room for every element.
        let _ = neighbours.push(problem.simulate(&pattern)?);
    }
    let mut normal = Normal {
        flexibility: *at,
        sum_of_squares: 0.0,
        jtj: Matrix::zeros(),
        jtr: Vector::zeros(),
    };
    for recorded in problem.recorded() {
        let simulated = base.sample(problem.observation);
        let mut rows = [Vector::zeros(); CHANNELS];
        for (element, neighbour) in neighbours.iter_mut().enumerate() {
            for ((row, value), centre) in rows
                .iter_mut()
                .zip(neighbour.sample(problem.observation))
                .zip(simulated)
            {
                row[element] = (value - centre) / differences[element];
            }
        }
        for ((row, f), simulated) in rows.iter().zip(recorded).zip(simulated) {
            if f.is_nan() {
                continue;
            }
            let residual = f - simulated;
            normal.sum_of_squares += residual * residual;
            normal.jtr.axpy(residual, row, 1.0);
            normal.jtj.ger(1.0, row, row, 1.0);
        }
    }
    Ok(normal)
}

/// The flexibilities after the best damped step within the bounds: elements that would leave them are held there, one
/// after the other.
fn bounded_step(at: &Normal, damping: f32, elements: usize) -> Vector {
    let bounds = [flexibility(0.0), flexibility(MAX_DAMAGE as f32)];
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
            return at.flexibility;
        };
        let solution = factor.solve(&right);
        let mut worst: Option<(usize, f32, f32)> = None;
        let mut moved = at.flexibility;
        for e in 0..elements {
            let goal = at.flexibility[e] + held[e].unwrap_or(solution[e]);
            moved[e] = goal.clamp(bounds[0], bounds[1]);
            let beyond = (goal - moved[e]).abs();
            if held[e].is_none() && beyond > worst.map_or(0.0, |(_, beyond, _)| beyond) {
                worst = Some((e, beyond, moved[e] - at.flexibility[e]));
            }
        }
        match worst {
            None => return moved,
            Some((e, _, step)) => held[e] = Some(step),
        }
    }
    at.flexibility
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
