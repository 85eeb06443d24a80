//! How well damage can be told at best where the track is unknown: the linear-Gaussian bounds.
//!
//! ```text
//! y_p = J_o o_p + J_d d + J_c c + noise          d losses, c the profile's coefficients: shared; o the passage's own unknowns
//! S_p = J_s^T W J_s - J_s^T W J_o (J_o^T W J_o + P)^-1 J_o^T W J_s            s = (d, c), W the noise's inverse variance
//! Cov(d) = dd block of (sum_monitored S + [0 0; 0 C^-1 + m sum_monitored S_cc])^-1          C: the spectrum's prior
//! ```
//!
//! `m` healthy passages for each monitored one, at the same speeds, tell of the profile alone (`d` = 0 in them). A profile that is known is the
//! limit: `(sum S_dd)^-1`. A passage's own unknowns are speed, entry time and load, with priors as wide as what is told of them, the
//! stiffness of the whole bridge if it varies, and the load of each car by itself if cars are uneven.
//!
//! All is computed with the explaining model, in `f64`, about a healthy bridge on a track by chance: what shakes the bridge is mostly
//! its own track, and a loss shows in how it shakes. The bound of another track of the same class differs by some per cent.

use anyhow::{Context, Result};
use nalgebra::{DMatrix, DVector, SMatrix};
use spanwatch::bridge::{Damage, ReducedBridge};
use spanwatch::capacity::{ELEMENTS, MODES, UNKNOWNS};
use spanwatch::interaction::sensitivity::{CAR_LOADS, ENTRY, LOAD, SPEED, STIFFNESS, wanted};
use spanwatch::interaction::{Hypothesis, Sensitivities, Simulation};
use spanwatch::slot::Slot;
use spanwatch::track::profile::{Knots, Profile, Stretch};
use spanwatch::wire::message::Ranges;

use super::truth::{NOISE, Passage};
use crate::calibrate::linear::{Eliminated, precision_of, responses};
use crate::simulate::Scenario;
use crate::study::noise::bound::observation;
use crate::study::noise::field::MASS_ERROR;

/// A passage's own unknowns besides the loads of its cars.
const OWN: [usize; 4] = [SPEED, ENTRY, LOAD, STIFFNESS];

/// The knots of the design's bounds (its section 6): 120 B-splines, 3 m apart on an approach of 135 m, 0.8 m from there to 52 m.
pub fn design_knots() -> Result<Knots<f64>> {
    let stretch = |from_m, spacing_m, spans| Stretch {
        from_m,
        spacing_m,
        spans,
    };
    Knots::new(&[stretch(-145.0, 3.0, 45), stretch(-10.0, 0.8, 78)]).context("knots that join")
}

/// What is asked of a bound.
#[derive(Debug, Clone)]
pub struct Problem<'a> {
    /// The model that explains.
    pub bridge: &'a ReducedBridge<f64>,
    /// The true track, on the knots of its unknowns.
    pub track: &'a Profile<f64>,
    /// The bridge's losses.
    pub damage: Damage<f64>,
    /// What is told of a run may be off by so much; the stiffness, too.
    pub ranges: Ranges,
    /// Whether each car's load is unknown by itself.
    pub uneven: bool,
}

/// What is known of the profile besides what the monitored passages tell.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Known {
    /// All of it.
    Profile,
    /// Its spectrum, and what so many healthy passages for each monitored one have told.
    Healthy(f64),
}

impl Known {
    /// The columns of the design's table.
    pub const ALL: [Self; 4] = [
        Self::Profile,
        Self::Healthy(0.0),
        Self::Healthy(1.0),
        Self::Healthy(10.0),
    ];

    /// As tables call it.
    pub fn name(self) -> String {
        match self {
            Self::Profile => "profile known".to_owned(),
            Self::Healthy(0.0) => "these passages only".to_owned(),
            Self::Healthy(1.0) => "as many healthy".to_owned(),
            Self::Healthy(many) => format!("{many} x healthy"),
        }
    }
}

/// Information of a passage about losses and coefficients, its own unknowns eliminated.
///
/// # Errors
/// If the passage cannot be simulated.
pub fn information(problem: &Problem<'_>, scenario: &Scenario) -> Result<DMatrix<f64>> {
    let observed = observation(problem.bridge, scenario)?;
    let hypothesis = Hypothesis::new(problem.damage, 1.0, observed.run);
    let ranges = [
        problem.ranges.speed,
        problem.ranges.entry_s,
        problem.ranges.load,
        problem.ranges.stiffness,
    ];
    let mut free = [true; UNKNOWNS];
    for (unknown, range) in OWN.into_iter().zip(ranges) {
        free[unknown] = range > 0.0;
    }
    let knots = problem.track.knots();
    let cars = if problem.uneven {
        observed.cars.train().cars.len()
    } else {
        0
    };
    let mut responses = responses(knots);
    let mut sensitivities = Box::new(Sensitivities::<f64, MODES>::NONE);
    let mut place: Slot<Simulation<f64, MODES>> = Slot::Empty;
    let track = problem.track;
    sensitivities.begin(
        problem.bridge,
        &hypothesis,
        &observed,
        track,
        &wanted(&free, cars),
        &mut place,
    )?;
    let simulation = place.as_mut().context("a simulation that has begun")?;

    let length_m = observed.cars.train().length_m() + problem.bridge.path.length_m();
    let left_s = observed.run.time_at_s(length_m).context("a train that does not stop")?;
    let rows = ((left_s + scenario.tail_s) / scenario.sample_interval_s()).ceil() as usize;
    let channels = observed.recorder.sensors.len();
    let own = OWN.len() + cars;
    let all = own + ELEMENTS + knots.coefficients();
    let mut jacobian = DMatrix::<f64>::zeros(all, rows * channels);
    let mut squares = vec![0.0; channels];
    for row in 0..rows {
        let (sample, by) = sensitivities.sample_with(simulation, &observed, track, &mut responses);
        for c in 0..channels {
            squares[c] += sample[c] * sample[c];
            let values = (OWN.into_iter().map(|unknown| by[c][unknown]))
                .chain(by[c].iter().skip(CAR_LOADS).take(cars).copied())
                .chain(by[c].iter().take(ELEMENTS).copied())
                .chain(responses.iter().map(|response| response.sample[c]));
            for (to, value) in jacobian.column_mut(row * channels + c).iter_mut().zip(values) {
                *to = value;
            }
        }
    }
    for (i, mut column) in jacobian.column_iter_mut().enumerate() {
        column /= NOISE * (squares[i % channels] / rows as f64).sqrt();
    }
    let matrix = &jacobian * jacobian.transpose();
    let priors = (ranges.into_iter().map(precision_of)).chain((0..cars).map(|_| MASS_ERROR.powi(-2)));
    let priors: Vec<[f64; 2]> = priors.map(|precision| [precision, 0.0]).collect();
    Ok(Eliminated::of(&matrix, &DVector::zeros(all), &priors)?.information)
}

/// Covariance of the losses, `monitored` the sum of the informations of passages.
///
/// # Errors
/// If the passages leave some combination of elements open.
pub fn covariance_of_losses(
    monitored: &DMatrix<f64>,
    precision: &DMatrix<f64>,
    known: Known,
) -> Result<SMatrix<f64, ELEMENTS, ELEMENTS>> {
    let losses = monitored.view((0, 0), (ELEMENTS, ELEMENTS)).into_owned();
    let of_losses = match known {
        Known::Profile => losses,
        Known::Healthy(many) => {
            let n = precision.nrows();
            let of_profile = monitored.view((ELEMENTS, ELEMENTS), (n, n)) * (1.0 + many) + precision;
            let across = monitored.view((ELEMENTS, 0), (n, ELEMENTS)).into_owned();
            let factor = of_profile.cholesky().context("a profile that passages tell of")?;
            losses - across.transpose() * factor.solve(&across)
        }
    };
    let covariance = of_losses
        .cholesky()
        .context("passages that tell of all elements")?
        .inverse();
    Ok(covariance.fixed_view::<ELEMENTS, ELEMENTS>(0, 0).into_owned())
}

/// Standard deviations of the losses.
///
/// # Errors
/// As [`covariance_of_losses`].
pub fn bound(monitored: &DMatrix<f64>, precision: &DMatrix<f64>, known: Known) -> Result<Damage<f64>> {
    let covariance = covariance_of_losses(monitored, precision, known)?;
    Ok(std::array::from_fn(|e| covariance[(e, e)].max(0.0).sqrt()))
}

impl Problem<'_> {
    /// Information of a recorded passage, as it truly ran, through the sensors at `nodes`.
    ///
    /// # Errors
    /// As [`information`].
    pub fn of(&self, passage: &Passage, nodes: &[u16]) -> Result<DMatrix<f64>> {
        let scenario = Scenario {
            nodes: nodes.to_vec(),
            ..passage.scenario.clone()
        };
        information(self, &scenario)
    }
}
