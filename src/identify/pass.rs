//! One pass over the recorded samples, cut into slices: what a search asks of the physics.
//!
//! A pass simulates the passage by a hypothesis and sums something up as the samples go by; nothing of the simulation is stored.
//!
//! | pass | sums | cost, forward solves |
//! |---|---|---|
//! | comparison | residuals, and products with the recording shifted in time | 1, and a tenth for every 120 shifts of a channel at 200 Hz |
//! | linearisation | the normal equations | 1 + [`TANGENT_TENTHS`] for each free unknown |
//! | correlation | products of the residuals with earlier ones | 1 |
//! | growth | the energy by time, for the [first guess](crate::guess) | 1 |

use nalgebra::SMatrix;

use super::growth::{self, Bins, Growth};
use super::objective::{Problem, Squares, residual};
use super::unknowns::{CAR_LOAD, Loads, Point, Theta, derivatives, hypothesis};
use crate::capacity::{CARS, CHANNELS, MODES, UNKNOWNS};
use crate::interaction::sensitivity::{CAR_LOADS, DERIVATIVES, Wanted};
use crate::interaction::{Hypothesis, Sensitivities, SetupError, Simulation};
use crate::slot::Slot;

/// Forward solves, in tenths, that following one derivative through a passage costs (docs/benchmarks.md).
pub const TANGENT_TENTHS: u32 = 7;
/// Products with the recording that cost as much as a tenth of a solver step: ten instructions each, of 6,000.
const SHIFTS_A_TENTH: u32 = 60;
/// Shifts to either side that a comparison looks at, at most.
pub const MOST_SHIFTS: usize = 128;
/// Lags of the residuals' correlation that are looked at: a second at 200 Hz, in which the free vibration of a bridge loses a
/// third.
const LAGS: usize = 200;
/// Solver steps that a slice is worth: some 3 million instructions on the logger.
const SLICE_STEPS: u32 = 500;

/// Memory of a pass. Large: it belongs in static memory.
#[derive(Debug, Clone)]
pub struct Pass {
    simulation: Slot<Simulation<f32, MODES>>,
    sensitivities: Sensitivities<f32, MODES>,
    /// Samples that have gone by.
    row: usize,
    sums: Sums,
    /// Cost so far, tenths of a solver step.
    tenths: u64,
}

#[derive(Debug, Clone)]
#[allow(clippy::large_enum_variant, reason = "one place in static memory, whichever it is")]
enum Sums {
    Nothing,
    Comparison(Comparison),
    Linearisation(Normal, [f32; CHANNELS]),
    Correlation(Correlation),
    Growth(Bins),
}

/// What a pass has found.
#[derive(Debug)]
pub enum Found<'a> {
    /// There was none.
    Nothing,
    /// Of a comparison.
    Comparison(&'a Comparison),
    /// Of a linearisation.
    Normal(&'a Normal),
    /// How many residuals say as much as one independent one.
    CorrelationTime(f32),
    /// When the simulation's energy had grown to each part of its whole.
    Growth(Growth),
}

/// Recorded and simulated motion side by side.
#[derive(Debug, Clone)]
pub struct Comparison {
    /// Of the residuals.
    pub residuals: Squares,
    /// Weights of the channels in what follows.
    weights: [f32; CHANNELS],
    shifts: Shifts,
    /// `sum f_(i + shift) f*_i` of each shift, the earliest first.
    products: [f32; 2 * MOST_SHIFTS + 1],
    /// `sum f*_i^2`.
    energy: f32,
    /// `sum f_i^2`.
    power: f32,
}

/// Shifts in time at which a comparison looks.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Shifts {
    /// To either side, at most [`MOST_SHIFTS`].
    pub half: usize,
    /// Samples from one to the next.
    pub stride: usize,
}

impl Shifts {
    /// None but 0.
    pub const NONE: Self = Self { half: 0, stride: 1 };
}

/// The shift and the load with which a simulation fits best.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Alignment {
    /// Samples by which the recording is later.
    pub samples: isize,
    /// Factor of the simulation.
    pub load: f32,
    /// Weighted sum of squares that is left.
    pub left: f32,
}

/// The normal equations of the least squares at one point: `A = J^T W J` and `b = J^T W r`; with cars' loads `c` beside `theta`, those of
/// `theta` whatever the loads are:
///
/// ```text
/// A <- A_uu - A_uc M^-1 A_cu,    b <- b_u - A_uc M^-1 (b_c - P c),    M = A_cc + P
/// c <- c + M^-1 (b_c - P c) - M^-1 A_cu step                          P: their prior
/// ```
#[derive(Debug, Clone)]
pub struct Normal {
    /// Where.
    pub at: Point,
    /// Derivatives of what the physics differentiates by, by `theta`.
    by: Theta,
    /// Of the residuals, not weighted.
    pub residuals: Squares,
    /// `J^T W J`, its lower triangle.
    pub matrix: SMatrix<f32, UNKNOWNS, UNKNOWNS>,
    /// `J^T W r`.
    pub vector: Theta,
    /// `c + M^-1 (b_c - P c)`: the loads that are best at this `theta`.
    pub loads: Loads,
    /// What the weighted squares fall by when the loads become these.
    pub gain: f32,
    /// `A_cu` until the samples have gone by, then `M^-1 A_cu`.
    across: SMatrix<f32, CARS, UNKNOWNS>,
    /// `A_cc`, its lower triangle.
    among: SMatrix<f32, CARS, CARS>,
    /// `b_c`.
    pull: Loads,
}

/// The residuals' correlation in time:
///
/// ```text
/// tau = 1 + 2 sum_k (rho_k^2 - 1/n),   rho_k = sum_i r_i r_i-k / sum_i r_i^2,   k = 1 .. LAGS
/// ```
///
/// near 1 for a sensor's noise, many where the bridge moves otherwise than the model does. The variance of the correlation of two
/// series is `(1 + 2 sum_k rho_k rho'_k) / n` (Bartlett 1946). Here one is the residual and the other what an element's damage
/// does to the record; both are motions of the same bridge, so the same `rho` is taken for both. `1/n` is what the square of an
/// estimated `rho_k` is on average where the true one is 0.
#[derive(Debug, Clone)]
struct Correlation {
    weights: [f32; CHANNELS],
    /// The latest residuals of each channel, newest first, times the root of its weight.
    latest: [[f32; LAGS]; CHANNELS],
    products: [f32; LAGS],
    squares: f32,
    count: f32,
}

// The first guess asks for no memory of its own.
const _: () = assert!(size_of::<Bins>() <= size_of::<Correlation>());

impl Default for Pass {
    fn default() -> Self {
        Self::new()
    }
}

impl Pass {
    /// No pass yet.
    pub const fn new() -> Self {
        Self {
            simulation: Slot::Empty,
            sensitivities: Sensitivities::NONE,
            row: 0,
            sums: Sums::Nothing,
            tenths: 0,
        }
    }

    /// Cost of all passes since the last call of this, tenths of a solver step.
    pub fn take_cost(&mut self) -> u64 {
        core::mem::take(&mut self.tenths)
    }

    /// Begins a comparison with a point.
    pub fn compare(
        &mut self,
        problem: &Problem<'_>,
        at: &Point,
        weights: [f32; CHANNELS],
        shifts: Shifts,
    ) -> Result<(), SetupError> {
        self.simulate(problem, &hypothesis(at, problem.observation))?;
        self.sums = Sums::Comparison(Comparison {
            residuals: Squares::NONE,
            weights,
            shifts: Shifts {
                half: shifts.half.min(MOST_SHIFTS),
                stride: shifts.stride.max(1),
            },
            products: [0.0; 2 * MOST_SHIFTS + 1],
            energy: 0.0,
            power: 0.0,
        });
        Ok(())
    }

    /// Begins a linearisation at a point by what is `wanted`.
    pub fn linearise(
        &mut self,
        problem: &Problem<'_>,
        at: &Point,
        weights: [f32; CHANNELS],
        wanted: &Wanted,
    ) -> Result<(), SetupError> {
        let hypothesis = hypothesis(at, problem.observation);
        let (bridge, observation) = (problem.bridge, problem.observation);
        self.sensitivities.begin(
            bridge,
            &hypothesis,
            observation,
            &problem.track.profile,
            wanted,
            &mut self.simulation,
        )?;
        self.row = 0;
        let normal = Normal {
            at: *at,
            by: derivatives(&at.theta),
            residuals: Squares::NONE,
            matrix: SMatrix::zeros(),
            vector: Theta::zeros(),
            loads: at.loads,
            gain: 0.0,
            across: SMatrix::zeros(),
            among: SMatrix::zeros(),
            pull: Loads::zeros(),
        };
        self.sums = Sums::Linearisation(normal, weights);
        Ok(())
    }

    /// Begins a correlation of the residuals of a point.
    pub fn correlate(&mut self, problem: &Problem<'_>, at: &Point, weights: [f32; CHANNELS]) -> Result<(), SetupError> {
        self.simulate(problem, &hypothesis(at, problem.observation))?;
        self.sums = Sums::Correlation(Correlation {
            weights: weights.map(crate::math::sqrt),
            latest: [[0.0; LAGS]; CHANNELS],
            products: [0.0; LAGS],
            squares: 0.0,
            count: 0.0,
        });
        Ok(())
    }

    /// Begins to follow the growth of the energy that `hypothesis` says. It is not given as a `theta`, because a speed that nobody
    /// expects is not a part of an expected one.
    pub fn grow(&mut self, problem: &Problem<'_>, hypothesis: &Hypothesis<f32>) -> Result<(), SetupError> {
        self.simulate(problem, hypothesis)?;
        self.sums = Sums::Growth(Bins::new(problem.recorded().len()));
        Ok(())
    }

    fn simulate(&mut self, problem: &Problem<'_>, hypothesis: &Hypothesis<f32>) -> Result<(), SetupError> {
        let Problem {
            bridge,
            observation,
            track,
            ..
        } = *problem;
        Simulation::begin(bridge, hypothesis, observation, &track.profile, &mut self.simulation)?;
        self.row = 0;
        Ok(())
    }

    /// Does a slice; true when the pass is over.
    pub fn advance(&mut self, problem: &Problem<'_>) -> bool {
        let Some(simulation) = self.simulation.as_mut() else {
            return true;
        };
        let observation = problem.observation;
        let steps_per_sample = observation.recorder.steps_per_sample.max(1);
        let cost = match &self.sums {
            Sums::Linearisation(..) => 10 + TANGENT_TENTHS * self.sensitivities.count(),
            Sums::Comparison(comparison) if comparison.shifts.half > 0 => {
                let products = (2 * comparison.shifts.half + 1) * problem.channels();
                let products = (products as u32).div_ceil(SHIFTS_A_TENTH);
                10 + products.checked_div(steps_per_sample).unwrap_or(products)
            }
            _ => 10,
        };
        let rows = (10 * SLICE_STEPS)
            .checked_div(cost * steps_per_sample)
            .unwrap_or(1)
            .max(1) as usize;
        let mut recorded = problem.recorded().skip(self.row);
        let approached = simulation.last_approach();
        for _ in 0..rows {
            let Some(recorded) = recorded.next() else {
                if let Sums::Linearisation(normal, _) = &mut self.sums {
                    normal.marginalise();
                }
                return true;
            };
            match &mut self.sums {
                Sums::Nothing => return true,
                Sums::Comparison(comparison) => {
                    comparison.add(
                        problem,
                        self.row,
                        &recorded,
                        &simulation.sample(observation, &problem.track.profile),
                    );
                }
                Sums::Linearisation(normal, weights) => {
                    let (sample, rows) = self
                        .sensitivities
                        .sample(simulation, observation, &problem.track.profile);
                    normal.add(&residual(&recorded, &sample), &rows, weights);
                }
                Sums::Correlation(correlation) => {
                    correlation.add(&residual(
                        &recorded,
                        &simulation.sample(observation, &problem.track.profile),
                    ));
                }
                Sums::Growth(bins) => {
                    let simulated: [f32; CHANNELS] = simulation.sample(observation, &problem.track.profile);
                    bins.push(self.row, growth::energy(observation, &recorded, &simulated));
                }
            }
            self.row += 1;
            self.tenths += u64::from(cost * steps_per_sample);
            // A car's approach is made up for at once, and is worth a slice of its own.
            if simulation.last_approach() != approached {
                break;
            }
        }
        false
    }

    /// What the pass that is over has found.
    pub fn found(&self) -> Found<'_> {
        match &self.sums {
            Sums::Nothing => Found::Nothing,
            Sums::Comparison(comparison) => Found::Comparison(comparison),
            Sums::Linearisation(normal, _) => Found::Normal(normal),
            Sums::Correlation(correlation) => Found::CorrelationTime(correlation.time()),
            Sums::Growth(bins) => Found::Growth(bins.growth()),
        }
    }
}

impl Comparison {
    fn add(&mut self, problem: &Problem<'_>, row: usize, recorded: &[f32; CHANNELS], simulated: &[f32; CHANNELS]) {
        self.residuals.add(residual(recorded, simulated));
        let (channels, Shifts { half, stride }) = (problem.channels(), self.shifts);
        let first = row as isize - (half * stride) as isize;
        for (c, (&simulated, &weight)) in simulated.iter().zip(&self.weights).enumerate().take(channels) {
            let recorded = recorded[c];
            if !recorded.is_nan() {
                self.power += weight * recorded * recorded;
            }
            self.energy += weight * simulated * simulated;
            let weighted = weight * simulated;
            for (k, product) in self.products.iter_mut().enumerate().take(2 * half + 1) {
                let Ok(shifted) = usize::try_from(first + (k * stride) as isize) else {
                    continue;
                };
                match problem.samples.get(shifted * channels + c) {
                    Some(f) if !f.is_nan() => *product += weighted * f,
                    _ => {}
                }
            }
        }
    }

    /// The best shift, and the best load between `loads[0]` and `loads[1]`.
    ///
    /// ```text
    /// sum w (f_(i + shift) - k f*_i)^2 = power - 2 k product + k^2 energy,   least at k = product / energy
    /// ```
    ///
    /// On a smooth track all motion is proportional to the load. What is shifted out of the recording counts as not explained.
    pub fn align(&self, loads: [f32; 2]) -> Alignment {
        let mut best = Alignment {
            samples: 0,
            load: 1.0,
            left: f32::INFINITY,
        };
        let energy = self.energy.max(f32::MIN_POSITIVE);
        for (k, &product) in self.products.iter().enumerate().take(2 * self.shifts.half + 1) {
            let load = (product / energy).max(loads[0]).min(loads[1]);
            let left = self.power - load * (2.0 * product - load * energy);
            if left < best.left {
                best = Alignment {
                    samples: (k as isize - self.shifts.half as isize) * self.shifts.stride as isize,
                    load,
                    left,
                };
            }
        }
        best
    }
}

impl Normal {
    /// Adds a sample.
    fn add(&mut self, residual: &[f32; CHANNELS], rows: &[[f32; DERIVATIVES]; CHANNELS], weights: &[f32; CHANNELS]) {
        self.residuals.add(*residual);
        for ((&r, row), &weight) in residual.iter().zip(rows).zip(weights) {
            if r.is_nan() || weight == 0.0 {
                continue;
            }
            let (row, cars) = row.split_at(CAR_LOADS);
            // From derivatives by what the physics knows to derivatives by `theta`.
            let row: [f32; UNKNOWNS] = core::array::from_fn(|i| row[i] * self.by[i]);
            for ((j, &left), mut among) in cars.iter().enumerate().zip(self.among.column_iter_mut()) {
                if left == 0.0 {
                    continue;
                }
                let weighted = weight * left;
                self.pull[j] += weighted * r;
                for (i, &right) in row.iter().enumerate() {
                    self.across[(j, i)] += weighted * right;
                }
                for (sum, &right) in among.as_mut_slice().iter_mut().zip(cars).skip(j) {
                    *sum += weighted * right;
                }
            }
            for ((j, &left), mut column) in row.iter().enumerate().zip(self.matrix.column_iter_mut()) {
                if left == 0.0 {
                    continue;
                }
                let weighted = weight * left;
                self.vector[j] += weighted * r;
                for (sum, &right) in column.as_mut_slice().iter_mut().zip(&row).skip(j) {
                    *sum += weighted * right;
                }
            }
        }
    }

    // Not inlined: the factor must not stand on the stack of the pass.
    /// Eliminates the cars' loads, of which all is known now.
    #[inline(never)]
    fn marginalise(&mut self) {
        if self.among.diagonal() == Loads::zeros() {
            // No car was weighed.
            return;
        }
        let prior = 1.0 / (CAR_LOAD * CAR_LOAD);
        let mut own = self.among;
        for car in 0..CARS {
            own[(car, car)] += prior;
        }
        let Some(factor) = own.cholesky() else {
            // Numbers that are none: no load follows from them.
            self.across.fill(0.0);
            return;
        };
        self.pull.axpy(-prior, &self.at.loads, 1.0);
        let mut rest = self.pull;
        factor.solve_mut(&mut rest);
        self.gain = rest.dot(&self.pull);
        self.loads += rest;
        for j in 0..UNKNOWNS {
            let mut by = self.across.column(j).into_owned();
            factor.solve_mut(&mut by);
            self.vector[j] -= by.dot(&self.pull);
            for i in j..UNKNOWNS {
                self.matrix[(i, j)] -= by.dot(&self.across.column(i));
            }
            self.across.set_column(j, &by);
        }
    }

    /// The loads that are best after a step of `theta`.
    pub fn loads_after(&self, step: &Theta) -> Loads {
        let mut loads = self.loads;
        for (column, &by) in self.across.column_iter().zip(step) {
            loads.axpy(-by, &column, 1.0);
        }
        loads
    }
}

impl Correlation {
    fn add(&mut self, residual: &[f32; CHANNELS]) {
        for ((&residual, &weight), latest) in residual.iter().zip(&self.weights).zip(&mut self.latest) {
            let known = !residual.is_nan();
            let residual = if known { weight * residual } else { 0.0 };
            self.count += if known { 1.0 } else { 0.0 };
            self.squares += residual * residual;
            for (product, earlier) in self.products.iter_mut().zip(latest.iter()) {
                *product += residual * earlier;
            }
            latest.copy_within(..LAGS - 1, 1);
            if let Some(newest) = latest.first_mut() {
                *newest = residual;
            }
        }
    }

    fn time(&self) -> f32 {
        let chance = self.count.max(1.0).recip();
        let sum = self.products.iter().fold(0.0, |sum, product| {
            let rho = product / self.squares.max(f32::MIN_POSITIVE);
            sum + rho * rho - chance
        });
        1.0 + 2.0 * sum.max(0.0)
    }
}
