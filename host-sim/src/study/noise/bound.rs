//! What a recording can tell at best: its Fisher information, by differences of the explaining model in `f64`.
//!
//! ```text
//! I = sum_ic J_ic J_ic^T / sigma_c^2 + diag(1 / prior^2),    J = d simulated / d (damage, stiffness, speed, entry, load)
//! bound_e = sqrt((I^-1)_ee)                                                     (Cramer and Rao)
//! ```
//!
//! `sigma_c` is the standard deviation of channel `c`'s noise. Run and stiffness, where unknown, are unknowns with a Gaussian
//! prior, marginalised by the inverse; where they are held, their rows and columns are left out. The columns of `J` are
//! central differences of [`Simulation`] in `f64`, and share nothing with the search's own derivatives but that; so this
//! is a check of those, too.
//!
//! The bound is that of unbiased estimates without bounds. An estimate that is kept within 0 to 70 % is biased at 0, and may have
//! a smaller error there.
//!
//! Cost: 20 forward solves with all held, 28 with all unknown, in `f64`.

use anyhow::{Context, Result, bail};
use nalgebra::{DMatrix, DVector, SMatrix, SVector};
use spanwatch::bridge::{Damage, ReducedBridge};
use spanwatch::capacity::{ELEMENTS, MODES};
use spanwatch::interaction::simulation::{Recorder, Sensor};
use spanwatch::interaction::{Hypothesis, Observation, Simulation};
use spanwatch::track::profile::Profile;
use spanwatch::train::PlanarTrain;
use spanwatch::wire::message::Ranges;

use super::Point;
use super::truth::Setting;
use crate::simulate::Scenario;
use crate::train::TrainName;

/// The damage of each element, then stiffness of the whole, speed, entry time and load.
pub const UNKNOWNS: usize = ELEMENTS + 4;
/// Half the distance of the two ends of a difference: of damage, of the parts of stiffness, speed and load (parts of
/// their values), of the entry time (s). Half and twice these change no bound by 1 %.
const STEP: [f64; 5] = [2e-3, 1e-3, 1e-5, 1e-4, 1e-2];

/// The model that explains, in `f64`.
#[derive(Debug, Clone)]
pub struct Explaining {
    bridge: ReducedBridge<f64>,
    observation: Observation<f64>,
    track: Profile<f64>,
}

/// A recording looked at from one point: what it says of steps from there.
#[derive(Debug, Clone, PartialEq)]
pub struct Linearised {
    /// The information about each unknown, without any prior.
    pub information: SMatrix<f64, UNKNOWNS, UNKNOWNS>,
    /// `sum J r / sigma^2` of the residuals `r`, recorded less simulated.
    pub score: SVector<f64, UNKNOWNS>,
}

impl Explaining {
    /// The model for a setting's train and sensors.
    ///
    /// # Errors
    /// If the bridge has no such node, or there is no such train.
    pub fn new(bridge: &ReducedBridge<f64>, setting: &Setting) -> Result<Self> {
        Ok(Self {
            bridge: bridge.clone(),
            track: Profile::SMOOTH,
            observation: observation(bridge, &setting.scenario())?,
        })
    }

    /// The passage at a point, as many samples as asked for, m/s², channel after channel.
    ///
    /// # Errors
    /// If the run is none.
    pub fn simulate(&self, at: &Point, samples: usize) -> Result<Vec<f64>> {
        let hypothesis = Hypothesis::new(at.damage, at.stiffness, at.run);
        let channels = self.observation.recorder.sensors.len();
        let mut simulation = Simulation::<f64, MODES>::new(&self.bridge, &hypothesis, &self.observation, &self.track)?;
        Ok((0..samples)
            .flat_map(|_| {
                simulation
                    .sample(&self.observation, &self.track)
                    .into_iter()
                    .take(channels)
            })
            .collect())
    }

    /// Sum of the squares of the residuals, each over its channel's variance: the number of samples, if nothing but noise is left.
    ///
    /// # Errors
    /// As [`Self::simulate`].
    pub fn chi_square(&self, at: &Point, samples: &[f32], sigma: &[f64]) -> Result<f64> {
        let simulated = self.simulate(at, samples.len() / sigma.len())?;
        let residuals = simulated.iter().zip(samples).zip(sigma.iter().cycle());
        Ok(residuals
            .map(|((s, f), sigma)| ((f64::from(*f) - s) / sigma).powi(2))
            .sum())
    }

    /// What a recording says near a point; `ranges` tell which of the unknowns besides the damage are wanted.
    ///
    /// # Errors
    /// As [`Self::simulate`].
    pub fn linearise(&self, at: &Point, samples: &[f32], sigma: &[f64], ranges: &Ranges) -> Result<Linearised> {
        let rows = samples.len() / sigma.len();
        let wanted: Vec<usize> = (0..UNKNOWNS)
            .filter(|&u| prior(ranges, u).is_none_or(|range| range > 0.0))
            .collect();
        let columns = (wanted.iter())
            .map(|&u| {
                let step = STEP[u.saturating_sub(ELEMENTS - 1)];
                let above = self.simulate(&at.moved(u, step), rows)?;
                let below = self.simulate(&at.moved(u, -step), rows)?;
                let column = above.iter().zip(&below).zip(sigma.iter().cycle());
                Ok(DVector::from_iterator(
                    above.len(),
                    column.map(|((a, b), sigma)| (a - b) / (2.0 * step * sigma)),
                ))
            })
            .collect::<Result<Vec<_>>>()?;
        let residual = DVector::from_iterator(
            samples.len(),
            (self.simulate(at, rows)?.iter().zip(samples).zip(sigma.iter().cycle()))
                .map(|((s, f), sigma)| (f64::from(*f) - s) / sigma),
        );
        let mut found = Linearised {
            information: SMatrix::zeros(),
            score: SVector::zeros(),
        };
        for (a, &i) in columns.iter().zip(&wanted) {
            found.score[i] = a.dot(&residual);
            for (b, &j) in columns.iter().zip(&wanted) {
                found.information[(i, j)] = a.dot(b);
            }
        }
        Ok(found)
    }
}

/// How a scenario's passage is observed.
///
/// # Errors
/// If the bridge has no such node, or a logger no such train.
pub fn observation(bridge: &ReducedBridge<f64>, scenario: &Scenario) -> Result<Observation<f64>> {
    let TrainName::Known(kind) = &scenario.train else {
        bail!("train \"{}\" is none that a logger knows", scenario.train.name());
    };
    let train = (scenario.cars)
        .and_then(|cars| PlanarTrain::of_kind(*kind, cars))
        .context("a train of 1 to 16 cars")?;
    let quantity = scenario.quantity;
    let sensors = (scenario.nodes.iter())
        .map(|&node| {
            let place = bridge.sensor_at(node);
            let place = place.with_context(|| format!("the bridge has no node {node}"))?;
            Ok(Sensor { place, quantity })
        })
        .collect::<Result<_>>()?;
    let recorder = Recorder::new(sensors, scenario.sample_interval_s().recip(), scenario.antialias_hz);
    Ok(Observation::new(train, scenario.run(), recorder, scenario.scheme)?)
}

impl Point {
    /// The point with one unknown moved: damage by the step, stiffness, speed and load by that part, the entry by that time, s.
    fn moved(&self, unknown: usize, step: f64) -> Self {
        let mut moved = *self;
        match unknown.checked_sub(ELEMENTS) {
            None => moved.damage[unknown] += step,
            Some(0) => moved.stiffness += step,
            Some(1) => moved.run.speed_mps *= 1.0 + step,
            Some(2) => moved.run.entry_time_s += step,
            Some(_) => moved.run.load_factor *= 1.0 + step,
        }
        moved
    }
}

/// Standard deviation of what is known of an unknown before; 0: it is held; none for damage, of which nothing is known.
pub fn prior(ranges: &Ranges, unknown: usize) -> Option<f64> {
    let of = [ranges.stiffness, ranges.speed, ranges.entry_s, ranges.load];
    unknown.checked_sub(ELEMENTS).map(|k| f64::from(of[k]))
}

/// Adds what is known before to an information, but for unknowns that are held.
pub fn with_prior(information: &mut SMatrix<f64, UNKNOWNS, UNKNOWNS>, ranges: &Ranges) {
    for u in 0..UNKNOWNS {
        if let Some(range) = prior(ranges, u).filter(|&range| range > 0.0) {
            information[(u, u)] += range.powi(-2);
        }
    }
}

/// The smallest standard deviation of each element's damage that an unbiased estimate can have; infinite where the information
/// leaves some combination of elements open.
pub fn bound(information: &SMatrix<f64, UNKNOWNS, UNKNOWNS>) -> Damage<f64> {
    match covariance(information) {
        Some(covariance) => std::array::from_fn(|e| covariance[(e, e)].max(0.0).sqrt()),
        None => [f64::INFINITY; ELEMENTS],
    }
}

/// What is left of an information about damage where the other unknowns may be anything; nothing if it leaves some combination of
/// elements open.
pub fn marginal(information: &SMatrix<f64, UNKNOWNS, UNKNOWNS>) -> SMatrix<f64, ELEMENTS, ELEMENTS> {
    covariance(information)
        .and_then(|covariance| covariance.try_inverse())
        .unwrap_or_default()
}

/// Covariance of the damage; none if the information leaves some combination of elements open.
fn covariance(information: &SMatrix<f64, UNKNOWNS, UNKNOWNS>) -> Option<SMatrix<f64, ELEMENTS, ELEMENTS>> {
    // What is held says nothing; all elements are wanted.
    let free: Vec<usize> = (0..UNKNOWNS)
        .filter(|&u| u < ELEMENTS || information[(u, u)] > 0.0)
        .collect();
    let matrix = DMatrix::from_fn(free.len(), free.len(), |i, j| information[(free[i], free[j])]);
    let inverse = matrix.cholesky()?.inverse();
    Some(inverse.fixed_view::<ELEMENTS, ELEMENTS>(0, 0).into_owned())
}

/// The bound of each element's damage in a passage of so many samples, `ranges` telling what is unknown besides.
///
/// # Errors
/// As [`Explaining::linearise`].
pub fn bound_of(
    explaining: &Explaining,
    truth: &Point,
    samples: usize,
    sigma: &[f64],
    ranges: &Ranges,
) -> Result<Damage<f64>> {
    let nothing = vec![0.0; samples * sigma.len()];
    let mut information = explaining.linearise(truth, &nothing, sigma, ranges)?.information;
    with_prior(&mut information, ranges);
    Ok(bound(&information))
}
