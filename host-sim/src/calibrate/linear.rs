//! One passage, linearised: what it says of everything that all passages share.
//!
//! ```text
//! r = recorded - simulated = J_o o + J_s s + noise       o: the passage's own unknowns, s: the shared ones
//! S = J_s^T W J_s - J_s^T W J_o (J_o^T W J_o + P)^-1 J_o^T W J_s        the information about s, whatever o is
//! ```
//!
//! Shared are the elements' losses, stiffness and damping of the whole bridge, and the coefficients of the profile; its own are a
//! passage's speed, entry time and load (with the ranges that it is told as priors), and the load of each car by itself, a few
//! per cent to either side. The record answers to coefficients and to cars' loads in exact proportion.

use anyhow::{Context, Result};
use nalgebra::{DMatrix, DVector};
use spanwatch::bridge::ReducedBridge;
use spanwatch::capacity::{CARS, CHANNELS, ELEMENTS, MODES, UNKNOWNS};
use spanwatch::identify::objective::Squares;
use spanwatch::identify::unknowns::CAR_LOAD;
use spanwatch::interaction::sensitivity::{CAR_LOADS, ENTRY, LOAD, SPEED, STIFFNESS, wanted};
use spanwatch::interaction::{Hypothesis, Response, Run, Sensitivities, Simulation};
use spanwatch::math::Real;
use spanwatch::slot::Slot;
use spanwatch::track::profile::{Knots, Profile};

use crate::identification::Observed;

/// Place of the stiffness among the shared unknowns: the logarithm of it.
pub const SHARED_STIFFNESS: usize = ELEMENTS;
/// Place of the damping: the logarithm of it.
pub const SHARED_DAMPING: usize = ELEMENTS + 1;
/// Place of the first coefficient of the profile, m.
pub const COEFFICIENTS: usize = ELEMENTS + 2;
/// Speed, entry time, load.
const OWN: [usize; 3] = [SPEED, ENTRY, LOAD];
/// Part of the damping by which it is changed for its derivative.
const DAMPING_STEP: f32 = 0.02;

/// How a train passed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Passing {
    /// How it ran.
    pub run: Run<f32>,
    /// Static loads of its cars, as parts of what their kind says.
    pub cars: [f32; CARS],
}

/// What all passages share.
#[derive(Debug, Clone, PartialEq)]
pub struct Shared {
    /// Fraction of stiffness lost by each element.
    pub damage: [f64; ELEMENTS],
    /// Stiffness of the whole bridge, as a part of its model's.
    pub stiffness: f64,
    /// Damping, as a part of its model's.
    pub damping: f64,
    /// Coefficients of the profile, m.
    pub coefficients: Vec<f64>,
}

impl Shared {
    /// A healthy bridge as its model has it, on a smooth track.
    pub fn as_modelled(knots: &Knots<f64>) -> Self {
        Self {
            damage: [0.0; ELEMENTS],
            stiffness: 1.0,
            damping: 1.0,
            coefficients: vec![0.0; knots.coefficients()],
        }
    }

    /// Moves by a step of the shared unknowns.
    pub fn step(&mut self, step: &DVector<f64>) {
        for (loss, by) in self.damage.iter_mut().zip(step.iter()) {
            *loss += by;
        }
        self.stiffness *= step[SHARED_STIFFNESS].exp();
        self.damping *= step[SHARED_DAMPING].exp();
        for (coefficient, by) in self.coefficients.iter_mut().zip(step.iter().skip(COEFFICIENTS)) {
            *coefficient += by;
        }
    }

    /// The profile.
    pub fn profile(&self, knots: &Knots<f32>) -> Profile<f32> {
        let coefficients: Vec<f32> = self.coefficients.iter().map(|&c| c as f32).collect();
        Profile::new(knots.clone(), &coefficients)
    }

    /// `bridge` with the damping.
    pub fn damped(&self, bridge: &ReducedBridge<f32>) -> ReducedBridge<f32> {
        bridge.clone().damped(self.damping as f32)
    }
}

/// What a passage says of the shared unknowns near a point.
#[derive(Debug, Clone)]
pub struct Linear {
    /// What it says of them, its own unknowns eliminated.
    pub own: Eliminated,
    /// Of the residuals.
    pub residuals: Squares,
    /// Of the recording.
    pub power: Squares,
}

impl Linear {
    /// Linearises a passage at how the train passed and what is shared.
    ///
    /// # Errors
    /// If the passage cannot be simulated.
    pub fn of(observed: &Observed, passing: &Passing, shared: &Shared, knots: &Knots<f32>) -> Result<Self> {
        let bridge = shared.damped(&observed.bridge);
        let track = shared.profile(knots);
        let hypothesis = Hypothesis {
            damage: shared.damage.map(|loss| loss as f32),
            stiffness: shared.stiffness as f32,
            run: passing.run,
            cars: passing.cars,
        };
        let problem = observed.problem();
        let observation = problem.observation;
        let (channels, cars) = (problem.channels(), observation.cars.train().cars.len());
        let mut free = [true; UNKNOWNS];
        let ranges = [
            observation.ranges.speed,
            observation.ranges.entry_s,
            observation.ranges.load,
        ];
        for (unknown, range) in OWN.into_iter().zip(ranges) {
            free[unknown] = range > 0.0;
        }
        let mut responses = responses(knots);
        let mut sensitivities = Box::new(Sensitivities::<f32, MODES>::NONE);
        let mut place = Slot::Empty;
        sensitivities.begin(
            &bridge,
            &hypothesis,
            observation,
            &track,
            &wanted(&free, cars),
            &mut place,
        )?;
        let simulation = place.as_mut().context("a simulation that has begun")?;
        let damped = bridge.clone().damped(1.0 + DAMPING_STEP);
        let mut more = Simulation::<f32, MODES>::new(&damped, &hypothesis, observation, &track)?;

        let own = OWN.len() + cars;
        let all = own + COEFFICIENTS + knots.coefficients();
        let rows = problem.recorded().len();
        let mut jacobian = DMatrix::<f64>::zeros(all, rows * channels);
        let mut residual = DVector::<f64>::zeros(rows * channels);
        let (mut residuals, mut power) = (Squares::NONE, Squares::NONE);
        for (row, recorded) in problem.recorded().enumerate() {
            let (sample, by) = sensitivities.sample_with(simulation, observation, &track, &mut responses);
            let damped: [f32; CHANNELS] = more.sample(observation, &track);
            power.add(recorded.iter().copied());
            residuals.add(recorded.iter().zip(&sample).map(|(recorded, sample)| recorded - sample));
            for (c, recorded) in recorded.iter().enumerate() {
                if recorded.is_nan() {
                    continue;
                }
                let mut column = jacobian.column_mut(row * channels + c);
                let own_values = OWN.map(|unknown| by[c][unknown]);
                let shared_values = by[c].iter().take(ELEMENTS + 1).copied();
                let damping = (damped[c] - sample[c]) / DAMPING_STEP;
                let values = own_values
                    .into_iter()
                    .chain(by[c].iter().skip(CAR_LOADS).take(cars).copied())
                    .chain(shared_values)
                    .chain([damping])
                    .chain(responses.iter().map(|response| response.sample[c]));
                for (to, value) in column.iter_mut().zip(values) {
                    *to = value.into();
                }
                residual[row * channels + c] = (recorded - sample[c]).into();
            }
        }
        let weights = residuals.weights(&power).map(f64::from);
        let mut weighted = jacobian.clone();
        for (i, mut column) in weighted.column_iter_mut().enumerate() {
            column *= weights[i % channels];
        }
        let matrix = &weighted * jacobian.transpose();
        let vector = weighted * residual;

        let (run, expected) = (&passing.run, &observation.run);
        let offsets = [
            run.speed_mps / expected.speed_mps - 1.0,
            run.entry_time_s - expected.entry_time_s,
            run.load_factor / expected.load_factor - 1.0,
        ];
        let of_run = (ranges.into_iter().zip(offsets)).map(|(range, offset)| [precision_of(range), offset.into()]);
        let priors: Vec<[f64; 2]> = of_run
            .chain((passing.cars.iter().take(cars)).map(|car| [f64::from(CAR_LOAD).powi(-2), f64::from(car - 1.0)]))
            .collect();
        Ok(Self {
            own: Eliminated::of(&matrix, &vector, &priors)?,
            residuals,
            power,
        })
    }

    /// How the train passed, after a step of the shared unknowns.
    pub fn passing(&self, Passing { run, mut cars }: Passing, step: &DVector<f64>) -> Passing {
        let own = &self.own.at_rest - &self.own.by_shared * step;
        for (car, by) in cars.iter_mut().zip(own.iter().skip(OWN.len())) {
            *car += *by as f32;
        }
        let run = Run {
            speed_mps: run.speed_mps * own[0].exp() as f32,
            entry_time_s: run.entry_time_s + own[1] as f32,
            load_factor: run.load_factor * own[2].exp() as f32,
            ..run
        };
        Passing { run, cars }
    }
}

/// Normal equations of which the first unknowns, the passage's own, are eliminated.
#[derive(Debug, Clone)]
pub struct Eliminated {
    /// Information about the others.
    pub information: DMatrix<f64>,
    /// Gradient of the logarithm of the likelihood by them.
    pub gradient: DVector<f64>,
    /// How the eliminated ones follow: `own = at_rest - by_shared step`.
    at_rest: DVector<f64>,
    by_shared: DMatrix<f64>,
}

impl Eliminated {
    /// Eliminates as many unknowns as there are `priors`: their precision, and how far they are from what is expected.
    ///
    /// # Errors
    /// If nothing is known of one of them.
    pub fn of(matrix: &DMatrix<f64>, vector: &DVector<f64>, priors: &[[f64; 2]]) -> Result<Self> {
        let own = priors.len();
        let shared = vector.len() - own;
        let mut own_matrix = matrix.view((0, 0), (own, own)).into_owned();
        let mut own_vector = vector.rows(0, own).into_owned();
        for (i, [precision, offset]) in priors.iter().enumerate() {
            own_matrix[(i, i)] += precision;
            own_vector[i] -= precision * offset;
        }
        let across = matrix.view((0, own), (own, shared)).into_owned();
        let factor = own_matrix
            .cholesky()
            .context("a passage that says nothing of its own run")?;
        let (by_shared, at_rest) = (factor.solve(&across), factor.solve(&own_vector));
        Ok(Self {
            information: matrix.view((own, own), (shared, shared)) - across.transpose() * &by_shared,
            gradient: vector.rows(own, shared) - across.transpose() * &at_rest,
            at_rest,
            by_shared,
        })
    }
}

/// Precision of an unknown of this range. What is held has no derivative; its prior keeps the matrix regular.
pub fn precision_of(range: f32) -> f64 {
    if range > 0.0 { f64::from(range).powi(-2) } else { 1.0 }
}

/// Responses to each coefficient of a profile.
pub fn responses<T: Real>(knots: &Knots<T>) -> Vec<Response<T, MODES>> {
    (0..knots.coefficients())
        .filter_map(|k| {
            let support = knots.support(k)?;
            Some(Response::to(Profile::bspline(knots.clone(), k), support))
        })
        .collect()
}

// The stiffness of the logger's unknowns follows the elements' losses, as it does here.
const _: () = assert!(STIFFNESS == SHARED_STIFFNESS);
