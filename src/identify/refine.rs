//! From a basin to its bottom: damped Gauss-Newton within bounds.
//!
//! ```text
//! minimise Q(theta) = sum_c w_c |r_c|^2 + |s|^2 + sum_i theta_i^2 / range_i^2,   lower <= theta <= upper
//! (A + mu diag A) step = J^T W r + S^T s - P theta,   A = J^T W J + S^T S + P             (Levenberg, Marquardt)
//!
//! r = recorded - simulated(theta),  J = d simulated / d theta;   s, S the same of the free vibration, in its deviations (Terms)
//! ```
//!
//! Each step is the exact minimum of that quadratic within the bounds ([`Quadratic`]). The weights `w_c` of the channels
//! follow the residuals: they are set anew where the descent is linearised.
//!
//! The descent itself simulates nothing. It says what it wants to know ([`Refinement::wants`]), a probe or the normal
//! equations at some `theta`, and is told, with the [`Terms`] of that `theta`. Normal equations cost several forward solves and are wanted only where a probe has
//! shown that the step is a good one.

use nalgebra::SMatrix;

use super::estimate::Information;
use super::objective::{EXPLAINED, Squares, Terms};
use super::pass::Normal;
use super::quadratic::Quadratic;
use super::unknowns::{Limits, Loads, Point, Theta, losses, surprise};
use crate::capacity::{CHANNELS, ELEMENTS, UNKNOWNS};
use crate::interaction::sensitivity::{Wanted, wanted};

/// Probes and linearisations after which the descent stops in any case.
const MOST_TURNS: u32 = 80;
/// Converged when no element's damage moves by more than this and nothing else by more than [`SMALL_SHIFT`], ...
const SMALL_STEP: f32 = 5e-4;
/// A small change of speed, stiffness or load, as a part of them, and of the entry time, s.
const SMALL_SHIFT: f32 = 1e-4;
/// ... or a step lets `Q` fall by less than this: a seventh of a standard deviation.
const SMALL_GAIN: f32 = 0.02;
/// First damping, its smallest and its largest value.
const DAMPING: [f32; 3] = [1e-3, 1e-6, 1e3];
/// A rejected step multiplies the damping by this, one that kept its promise divides by it.
const DAMPING_FACTOR: f32 = 10.0;
/// Sum of squares of terms that are as good as satisfied.
const MET: f32 = 1e-2;
/// A step keeps its promise if `Q` falls by this part of what the linear model said.
const PROMISE: f32 = 0.5;

/// Part of the recording's power that the model itself may be wrong by: the square of 0.1 %, what its step and its number of modes
/// leave (docs/accuracy.md). A record without noise is not believed beyond it.
const MODEL_ERROR: f32 = 1e-6;

/// Why a descent ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Stop {
    /// The last step was negligible, or all is explained.
    Converged,
    /// No step, however short, makes it better.
    NoProgress,
    /// The forward solves are used up.
    Budget,
}

/// What a descent wants to know next.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Want {
    /// The residuals' sums of squares at this point.
    Probe(Point),
    /// The normal equations there.
    Linearise(Point),
}

/// State of a descent.
#[derive(Debug, Clone)]
pub struct Refinement {
    limits: Limits,
    /// How many cars' loads are sought, too.
    cars: usize,
    /// Sums of squares of the recording.
    power: Squares,
    weights: [f32; CHANNELS],
    want: Want,
    /// Fall of `Q` that the linear model promises at the point that is wanted.
    promised: f32,
    damping: f32,
    turns: u32,
    /// The best point so far, its residuals, its `Q`.
    best: Point,
    residuals: Squares,
    q: f32,
    /// The normal equations at the best point, or at the one before, if only a negligible step lies between; terms included.
    normal: Quadratic<UNKNOWNS>,
    /// Where they were set up.
    linearised: Theta,
    /// The loads that are best at the best point, and by what `Q` falls with them.
    rest: (Loads, f32),
}

impl Refinement {
    /// A descent that starts from a point, with the first weights of the channels.
    pub fn new(from: &Point, limits: Limits, power: Squares, weights: [f32; CHANNELS]) -> Self {
        let start = Point {
            theta: limits.nearest(&from.theta),
            ..*from
        };
        Self {
            limits,
            cars: 0,
            power,
            weights,
            want: Want::Linearise(start),
            promised: 0.0,
            damping: DAMPING[0],
            turns: 0,
            best: start,
            residuals: Squares::NONE,
            q: f32::INFINITY,
            normal: Quadratic::ZERO,
            linearised: start.theta,
            rest: (start.loads, 0.0),
        }
    }

    /// The same, looking for the loads of the first so many cars, too.
    pub fn weighing(mut self, cars: usize) -> Self {
        self.cars = cars;
        self
    }

    /// Whether it looks for cars' loads.
    pub fn weighs(&self) -> bool {
        self.cars > 0
    }

    /// What it wants to know.
    pub fn wants(&self) -> Want {
        self.want
    }

    /// The unknowns that it looks for, but for the loads.
    pub fn free(&self) -> [bool; UNKNOWNS] {
        self.limits.free()
    }

    /// By what it wants to be differentiated.
    pub fn wanted(&self) -> Wanted {
        wanted(&self.free(), self.cars)
    }

    /// Weights of the channels.
    pub fn weights(&self) -> [f32; CHANNELS] {
        self.weights
    }

    /// The best point so far.
    pub fn best(&self) -> &Point {
        &self.best
    }

    /// The residuals' sums of squares there.
    pub fn residuals(&self) -> &Squares {
        &self.residuals
    }

    /// Where the normal equations were set up that [`Self::information`] is of.
    pub fn linearised(&self) -> &Theta {
        &self.linearised
    }

    /// Takes the residuals and the terms of the point that it wanted to probe; tells why it was the last, if it was.
    pub fn told(&mut self, residuals: &Squares, terms: &Terms) -> Option<Stop> {
        let Want::Probe(trial) = self.want else {
            return Some(Stop::NoProgress);
        };
        let q = self.objective(&trial, residuals, terms);
        let fall = self.q - q;
        if fall.is_nan() || fall <= 0.0 {
            self.damping *= DAMPING_FACTOR;
            return if self.damping > DAMPING[2] {
                Some(Stop::NoProgress)
            } else {
                self.aim(None)
            };
        }
        if fall > PROMISE * self.promised {
            self.damping = (self.damping / DAMPING_FACTOR).max(DAMPING[1]);
        }
        let negligible = fall < SMALL_GAIN || self.is_rested() && alike(&trial.theta, &self.best.theta, 1.0);
        self.best = trial;
        self.residuals = *residuals;
        self.q = q;
        if negligible || self.explained(terms) {
            return Some(Stop::Converged);
        }
        self.weights = residuals.weights(&self.power);
        self.want = Want::Linearise(trial);
        None
    }

    /// Takes the normal equations and the terms of the point that it wanted; tells why they were the last, if they were.
    pub fn told_normal(&mut self, normal: &Normal, terms: &Terms) -> Option<Stop> {
        self.best = normal.at;
        self.linearised = normal.at.theta;
        self.rest = (normal.loads, normal.gain);
        self.residuals = normal.residuals;
        self.normal = Quadratic {
            matrix: normal.matrix,
            vector: normal.vector,
        }
        .mirrored();
        terms.add_to(&mut self.normal, &self.limits.free(), 1.0, &Theta::zeros());
        self.q = self.objective(&normal.at, &normal.residuals, terms);
        if self.explained(terms) {
            return Some(Stop::Converged);
        }
        self.aim(Some(normal))
    }

    /// Whether the loads are as good as those that are best.
    fn is_rested(&self) -> bool {
        self.rest.1 < SMALL_GAIN
    }

    /// `Q`.
    fn objective(&self, at: &Point, residuals: &Squares, terms: &Terms) -> f32 {
        let mut q = residuals.weighted(&self.weights) + terms.squares() + surprise(&at.loads);
        for (&value, &prior) in at.theta.iter().zip(&self.limits.prior) {
            q += prior * value * value;
        }
        q
    }

    fn explained(&self, terms: &Terms) -> bool {
        self.residuals.unexplained(&self.power) < EXPLAINED && terms.squares() < MET
    }

    /// Chooses the next trial point from the best one, with the loads that the normal equations say, if they are there still; tells if
    /// there is none.
    fn aim(&mut self, normal: Option<&Normal>) -> Option<Stop> {
        self.turns += 1;
        if self.turns > MOST_TURNS {
            return Some(Stop::Budget);
        }
        let mut model = self.normal;
        for i in 0..UNKNOWNS {
            model.matrix[(i, i)] += self.limits.prior[i];
            model.matrix[(i, i)] *= 1.0 + self.damping;
            model.vector[i] -= self.limits.prior[i] * self.best.theta[i];
        }
        let lower = core::array::from_fn(|i| self.limits.lower[i] - self.best.theta[i]);
        let upper = core::array::from_fn(|i| self.limits.upper[i] - self.best.theta[i]);
        let Some(minimum) = (model.minimum(&lower, &upper)).or_else(|| model.small_minimum(&lower, &upper)) else {
            return Some(Stop::NoProgress);
        };
        let theta = self.limits.nearest(&(self.best.theta + minimum.at));
        let step = theta - self.best.theta;
        let loads = normal.map_or(self.rest.0, |normal| normal.loads_after(&step));
        // Without what the damping has added to the model.
        let damped = self.damping / (1.0 + self.damping) * model.size(&minimum.at);
        self.promised = self.rest.1 + damped - 2.0 * model.value(&minimum.at);
        let still = self.is_rested() && alike(&theta, &self.best.theta, 0.1);
        self.want = Want::Probe(Point { theta, loads });
        still.then_some(Stop::Converged)
    }

    /// What the passage says of the elements' flexibilities, whatever the other unknowns are; the residuals say as much as
    /// one independent value each `correlation_time`, and `terms` are those at [`Self::linearised`].
    ///
    /// The other unknowns are eliminated (Schur's complement). The residuals' variance is their mean square where the
    /// normal equations were set up, enlarged by `n / (n - free unknowns)` for what the unknowns have explained of it. The
    /// terms know their own deviations and count in full.
    pub fn information(&self, correlation_time: f32, terms: &Terms) -> Information {
        let mut all = self.whole(correlation_time, terms);
        for n in ELEMENTS..UNKNOWNS {
            let pivot = all.matrix[(n, n)];
            if pivot <= 0.0 {
                continue;
            }
            let (column, value) = (all.matrix.column(n).into_owned(), all.vector[n]);
            for j in 0..UNKNOWNS {
                let part = column[j] / pivot;
                for i in 0..UNKNOWNS {
                    all.matrix[(i, j)] -= column[i] * part;
                }
                all.vector[j] -= part * value;
            }
        }
        Information {
            matrix: SMatrix::from_fn(|i, j| all.matrix[(i, j)]),
            vector: nalgebra::SVector::from_fn(|i, _| all.vector[i]),
        }
    }

    /// Standard deviation of each unknown, all others unknown.
    pub fn deviations(&self, correlation_time: f32, terms: &Terms) -> Theta {
        let variances = self.whole(correlation_time, terms).variances();
        variances.map_or(Theta::repeat(f32::INFINITY), |variances| {
            variances.map(crate::math::sqrt)
        })
    }

    /// The information of all unknowns, priors included.
    fn whole(&self, correlation_time: f32, terms: &Terms) -> Quadratic<UNKNOWNS> {
        let free = self.free();
        let unknowns = free.iter().filter(|&&free| free).count() as f32;
        let values = self.power.values();
        let unexplained = self.residuals.unexplained(&self.power).max(EXPLAINED);
        let believed = (unexplained / MODEL_ERROR).min(1.0);
        let scale = believed * ((values - unknowns) / values).max(0.0) / correlation_time;
        // The linear model's right-hand side about 0: A theta + J^T W r, and the slope is A theta - J^T W r.
        let about_zero = self.normal.slope(&self.linearised) + self.normal.vector * 2.0;
        let mut all = Quadratic {
            matrix: self.normal.matrix * scale,
            vector: about_zero * scale,
        };
        // The terms were scaled with the rest: this is what is missing of them.
        terms.add_to(&mut all, &free, 1.0 - scale, &self.linearised);
        for i in 0..UNKNOWNS {
            all.matrix[(i, i)] += self.limits.prior[i];
        }
        all
    }
}

/// Whether `a` and `b` differ by less than `part` of what is small.
fn alike(a: &Theta, b: &Theta, part: f32) -> bool {
    let losses = losses(a).into_iter().zip(losses(b));
    let others = a.iter().zip(b.iter()).skip(ELEMENTS);
    losses.into_iter().all(|(a, b)| (a - b).abs() < part * SMALL_STEP)
        && others.into_iter().all(|(a, b)| (a - b).abs() < part * SMALL_SHIFT)
}
