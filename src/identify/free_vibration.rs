//! What the bridge does after the last axle has left: its natural frequencies and damping ratios, and how surely.
//!
//! ```text
//! y_c(t) = o_c + sum_k exp(-xi_k w_k t) (a_ck cos(w_dk t) + b_ck sin(w_dk t)),   w_dk = w_k sqrt(1 - xi_k^2)
//! fn_k = w_k / 2 pi  [Hz],   c = 1 .. channels,   k = 1 .. 3
//! ```
//!
//! The recorder's filter changes the amplitudes of such a motion and neither its frequencies nor its damping, so it
//! need not be known; only its own transient must be over ([`first_free_sample`]). The module `fit` says how the motion
//! is fitted.
//!
//! The **frequencies** then help to identify damage: [`FreeVibration::frequency_terms`] compares them with those of the
//! bridge model for a damage pattern, with exact derivatives, as rows for a least-squares sum.
//!
//! **Not twice.** These rows and the tail's samples in a comparison of accelerations are the same information. Who adds
//! the rows ([`Compared`]) must end that comparison where the tail begins ([`first_free_sample`]), or take the
//! frequencies from a later stretch of the tail than the samples that are compared; else the result looks surer than it
//! is.
//!
//! **What it cannot tell.**
//! - One frequency is one equation: the first is lowered by 30 % in one element as by less in its neighbours and, on a
//!   symmetric bridge, alike by an element and its mirror image. And the stiffness of the whole bridge (temperature,
//!   ballast) moves it as damage does; each row has a derivative for that.
//! - Damping says almost nothing about damage. The model's is Rayleigh's, `xi = (p1 / w + p2 w) / 2` with the undamaged
//!   bridge's coefficients, and flat: 30 % in a middle element of girder50 lowers the first frequency by 4 % and moves
//!   `xi` from 0.0200 to 0.0205; from the same tail `fn` knows the element's flexibility 80 times better. And a real
//!   bridge's damping differs from the model's by more, whatever its health. So its rows are apart
//!   ([`FreeVibration::damping_terms`]), for who also looks for a factor on the damping.
//! - At its speeds of cancellation (`2 fn L / 3, 5, 7, ..`: 420, 252, 180 km/h on girder50) a single load leaves little
//!   of the first mode; not nothing, because what it did on entering has decayed until it leaves. What is left is told
//!   as surely as its strength allows, and a mode that noise hides is not given.
//! - Two modes whose searched ranges overlap could be taken for each other and are not given; a search near a damage
//!   pattern that is already known ([`expected`] with a narrower range) tells them apart. Nor is a mode given that has
//!   one close above that is not fitted.
//! - A wrong moment of leaving (a speed that is off, a trailing car that was not counted) puts forced motion into the
//!   tail, which is no sum of decays. The deviations do not cover that: who is not sure begins later.
//!
//! ```
//! use spanwatch::identify::free_vibration::{ExpectedMode, SEARCHED, free_vibration};
//! // Five seconds at 200 Hz of 3.36 Hz, where 3.5 Hz was expected.
//! let tail: Vec<f32> = (0..1000)
//!     .map(|i| i as f32 / 200.0)
//!     .map(|t| (-0.42 * t).exp() * (std::f32::consts::TAU * 3.36 * t).cos())
//!     .collect();
//! let looked_for = ExpectedMode {
//!     frequency_hz: 3.5,
//!     damping_ratio: 0.02,
//!     range_hz: SEARCHED.map(|part| part * 3.5),
//!     distinct: true,
//! };
//! let found = free_vibration(&tail, 1, 200.0, &[looked_for]).expect("a vibration");
//! // fn = sqrt(3.36^2 + (0.42 / 2 pi)^2)
//! assert!((found.modes[0].frequency_hz - 3.3607).abs() < 1e-4);
//! assert!(free_vibration(&tail[..100], 1, 200.0, &[looked_for]).is_none(), "half a second says nothing");
//! ```
//!
//! Cost: some 60 walks through the tail (one for each frequency tried, and 2 for each step of the fit), of 100 to 250
//! operations a sample and channel; 5 KB of stack. The rows: an eigenproblem (270,000 operations), 7 KB.

mod fit;

use heapless::Vec;

use crate::bridge::modes::FrequencySlopes;
use crate::bridge::{Damage, ReducedBridge};
use crate::capacity::ELEMENTS;
use crate::interaction::Observation;
use crate::math;

/// Modes of the free vibration.
pub const TAIL_MODES: usize = 3;
/// The part of the model's frequency in which the bridge's is looked for: down to a fifth less and some room,
/// up to what a stiffness of a tenth above the model's makes of it.
pub const SEARCHED: [f32; 2] = [0.78, 1.05];
/// Time in cycles of its cut-off after which the recorder's filter has forgotten: 4 at 40 Hz are 0.1 s, in which its
/// slowest part falls to `exp(-2 pi 4 cos(3 pi / 8)) = 7e-5`.
const FILTER_CYCLES: f32 = 4.0;
/// A frequency with a larger standard deviation, as a part of itself, is not worth giving: 2 % of girder50's first are
/// 17 % lost of a middle element.
const LARGEST_DEVIATION: f32 = 0.02;
/// A mode must be below this part of the frequency of the next one that is not fitted. What there is of that is taken
/// for noise, and the closer, the less it is: at 4/5 it moved a frequency by five deviations, at girder50's 5/9 it is
/// not seen.
const ALONE: f32 = 2.0 / 3.0;
/// What the model's frequency is at best worth, as a part of itself. No bridge keeps to its model more closely; and in
/// `f32` sums, rows that are stronger still would drown what the samples say of all that leaves the frequency as it is.
const FINEST: f32 = 5e-5;
/// Damping that is not this many standard deviations from zero is no sign of a free vibration; a machine hums so.
const DECAYS: f32 = 2.0;

/// A mode that is looked for.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ExpectedMode {
    /// Natural frequency of the model, Hz.
    pub frequency_hz: f32,
    /// Damping ratio of the model.
    pub damping_ratio: f32,
    /// Where its frequency is looked for, Hz.
    pub range_hz: [f32; 2],
    /// Whether no other mode is looked for in this range, and none that is not fitted is near. Else the mode is fitted,
    /// so that it does not disturb the others, but not given.
    pub distinct: bool,
}

/// A mode as it was found.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ModeEstimate {
    /// Which one, from 0, of those that were looked for, and so of the bridge.
    pub mode: usize,
    /// Natural frequency `fn`, Hz.
    pub frequency_hz: f32,
    /// Its standard deviation, Hz.
    pub frequency_std_hz: f32,
    /// Damping ratio `xi`.
    pub damping_ratio: f32,
    /// Its standard deviation.
    pub damping_ratio_std: f32,
}

/// The modes that rise above the noise, ascending; at least one.
#[derive(Debug, Clone, PartialEq)]
pub struct FreeVibration {
    /// One for each.
    pub modes: Vec<ModeEstimate, TAIL_MODES>,
}

/// A free vibration that an identification compares with the model's, besides its samples.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Compared<'a> {
    /// As it was found. The samples must end where its tail begins.
    pub vibration: &'a FreeVibration,
    /// Whether the damping ratios are compared, too. The model's damping is then taken for the bridge's own.
    pub damping: bool,
}

/// One row of a least-squares sum: a measured quantity against the model's, all in standard deviations of the measured
/// one.
///
/// The sign is that of the other residuals here, `r = measured - model(p)`, `J = d model / d p`: a normal equation gets
/// `J^T J` and `J^T r`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Term {
    /// The mode that it is of, from 0.
    pub mode: usize,
    /// Measured less model.
    pub residual: f32,
    /// Derivative of the model by each element's added flexibility `x_e = 1 / (1 - d_e) - 1`.
    pub by_flexibility: [f32; ELEMENTS],
    /// Derivative of the model by the factor on the whole bridge's stiffness.
    pub by_stiffness: f32,
    /// Derivative of the model by the factor on its damping.
    pub by_damping: f32,
}

/// What the whole bridge has otherwise than its model; 1 is as modelled.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Factors {
    /// On the stiffness: `K = stiffness K(d)`.
    pub stiffness: f32,
    /// On the damping: `C = damping (p1 M + p2 K)`.
    pub damping: f32,
}

impl Default for Factors {
    fn default() -> Self {
        Self {
            stiffness: 1.0,
            damping: 1.0,
        }
    }
}

/// The modes of `bridge` with `damage` below `band_hz`, to be looked for in the part `searched` of their frequencies
/// ([`SEARCHED`], from the undamaged bridge, if the damage is not known).
pub fn expected(
    bridge: &ReducedBridge<f32>,
    damage: &Damage<f32>,
    band_hz: f32,
    searched: [f32; 2],
) -> Vec<ExpectedMode, TAIL_MODES> {
    // One more than can be fitted, since it can be taken for the last.
    let slopes = FrequencySlopes::<f32, { TAIL_MODES + 1 }>::new(bridge, damage);
    let [p1, p2] = bridge.rayleigh;
    let [lowest, highest] = searched;
    let mut modes = Vec::<ExpectedMode, { TAIL_MODES + 1 }>::new();
    for &omega_squared in slopes.omega_squared.iter().take(slopes.modes) {
        let omega = math::sqrt(omega_squared);
        let frequency_hz = omega / core::f32::consts::TAU;
        let mut mode = ExpectedMode {
            frequency_hz,
            damping_ratio: 0.5 * (p1 / omega + p2 * omega),
            range_hz: [lowest * frequency_hz, highest * frequency_hz],
            distinct: true,
        };
        if let Some(below) = modes.last_mut()
            && below.range_hz[1] >= mode.range_hz[0]
        {
            below.distinct = false;
            mode.distinct = false;
        }
        // There is room for every mode.
        let _ = modes.push(mode);
    }
    let fitted = |(k, mode): (usize, &ExpectedMode)| k < TAIL_MODES && mode.frequency_hz < band_hz;
    let beyond = modes.iter().enumerate().find(|&mode| !fitted(mode));
    let limit_hz = beyond.map_or(f32::INFINITY, |(_, mode)| ALONE * mode.frequency_hz);
    let fitted = modes.iter().enumerate().take_while(|&mode| fitted(mode));
    fitted
        .map(|(_, mode)| ExpectedMode {
            distinct: mode.distinct && mode.frequency_hz < limit_hz,
            ..*mode
        })
        .collect()
}

/// Index of the first sample after the last axle has left and the recorder's filter has forgotten it: where the tail
/// begins. Where speed and entry are not known, the last axle is as late as their ranges say. None if the train does
/// not leave.
pub fn first_free_sample(bridge: &ReducedBridge<f32>, observation: &Observation<f32>) -> Option<usize> {
    let way_m = observation.cars.train().length_m() + bridge.path.length_m();
    let mut latest = observation.run;
    latest.speed_mps *= 1.0 - observation.ranges.speed;
    latest.entry_time_s += observation.ranges.entry_s;
    let left_s = latest.time_at_s(way_m)?;
    let forgotten_s = observation.recorder.antialias_hz.map_or(0.0, |hz| FILTER_CYCLES / hz);
    // A cast rounds down; the sample at or after that moment is wanted.
    Some(((left_s + forgotten_s) * observation.recorder.sample_rate_hz) as usize + 1)
}

/// The free vibration in `tail`: accelerations or displacements, channel after channel within a sample, not-a-number
/// where there is none, a constant offset allowed. The modes that are looked for are `expected`, ascending. None if no mode can be
/// told.
///
/// The standard deviations hold for noise that is independent from channel to channel; its spectrum need not be flat.
pub fn free_vibration(
    tail: &[f32],
    channels: usize,
    sample_rate_hz: f32,
    expected: &[ExpectedMode],
) -> Option<FreeVibration> {
    let tail = fit::Tail::new(tail, channels, sample_rate_hz)?;
    let expected = expected.get(..expected.len().min(TAIL_MODES))?;
    let fitted = fit::fit(&tail, expected)?;
    let mut modes = Vec::new();
    for (mode, looked_for) in expected.iter().enumerate() {
        let Some(found) = fitted.estimate(&tail, mode) else {
            continue;
        };
        let [lowest, highest] = looked_for.range_hz;
        let believed = looked_for.distinct
            && (lowest..=highest).contains(&found.frequency_hz)
            && found.frequency_std_hz <= LARGEST_DEVIATION * found.frequency_hz
            && found.damping_ratio >= DECAYS * found.damping_ratio_std;
        if believed {
            // There is room for every mode.
            let _ = modes.push(found);
        }
    }
    (!modes.is_empty()).then_some(FreeVibration { modes })
}

impl FreeVibration {
    /// The rows that the natural frequencies add to a sum of squares at one damage pattern. They do not depend on the
    /// damping.
    pub fn frequency_terms(
        &self,
        bridge: &ReducedBridge<f32>,
        damage: &Damage<f32>,
        factors: Factors,
    ) -> Vec<Term, TAIL_MODES> {
        self.terms(bridge, damage, factors, |found, model| {
            let hz = core::f32::consts::TAU.recip();
            let std_hz = found.frequency_std_hz.max(FINEST * found.frequency_hz);
            ([found.frequency_hz, std_hz], [model.omega * hz, hz, 0.0])
        })
    }

    /// The rows that the damping ratios add; the module's text says why they are best left out.
    pub fn damping_terms(
        &self,
        bridge: &ReducedBridge<f32>,
        damage: &Damage<f32>,
        factors: Factors,
    ) -> Vec<Term, TAIL_MODES> {
        self.terms(bridge, damage, factors, |found, model| {
            let [p1, p2] = bridge.rayleigh;
            let undamped = 0.5 * (p1 / model.omega + p2 * model.omega);
            let slope = 0.5 * factors.damping * (p2 - p1 / (model.omega * model.omega));
            (
                [found.damping_ratio, found.damping_ratio_std],
                [factors.damping * undamped, slope, undamped],
            )
        })
    }

    /// The rows of a quantity that depends on a mode's circular frequency: `quantity` gives its measured value and
    /// standard deviation; the model's value, its derivative by the circular frequency and by the factor on the
    /// damping.
    fn terms(
        &self,
        bridge: &ReducedBridge<f32>,
        damage: &Damage<f32>,
        factors: Factors,
        quantity: impl Fn(&ModeEstimate, &ModelMode) -> ([f32; 2], [f32; 3]),
    ) -> Vec<Term, TAIL_MODES> {
        let slopes = FrequencySlopes::<f32, TAIL_MODES>::new(bridge, damage);
        let models = slopes.omega_squared.iter().zip(&slopes.by_damage).take(slopes.modes);
        let mut terms = Vec::new();
        for (mode, (&omega_squared, by_damage)) in models.enumerate() {
            let Some(found) = self.modes.iter().find(|found| found.mode == mode) else {
                continue;
            };
            let model = ModelMode {
                omega: math::sqrt(factors.stiffness * omega_squared),
            };
            let ([measured, std], [value, by_omega, by_damping]) = quantity(found, &model);
            // d w = d(w^2) / 2 w, and d d_e = (1 - d_e)^2 d x_e.
            let by_square = 0.5 * by_omega / (model.omega * std);
            let mut by_flexibility = [0.0; ELEMENTS];
            for ((by_flexibility, &slope), &loss) in by_flexibility.iter_mut().zip(by_damage).zip(damage) {
                *by_flexibility = by_square * factors.stiffness * slope * (1.0 - loss) * (1.0 - loss);
            }
            // There is room for every mode.
            let _ = terms.push(Term {
                mode,
                residual: (measured - value) / std,
                by_flexibility,
                by_stiffness: by_square * omega_squared,
                by_damping: by_damping / std,
            });
        }
        terms
    }
}

/// A mode of the model.
struct ModelMode {
    /// Circular frequency, rad/s.
    omega: f32,
}
