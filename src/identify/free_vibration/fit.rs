//! Decaying vibrations in noise, fitted by least squares.
//!
//! ```text
//! minimise sum_c 1 / s_c^2 sum_i (y_ci - o_c - sum_k exp(-g_k t_i) (a_ck cos(w_k t_i) + b_ck sin(w_k t_i)))^2
//! s_c^2 = sum_i r_ci^2 / (n_c - its share of the unknowns)                                      channel c's own noise
//! ```
//!
//! The amplitudes `o, a, b` are linear, the pairs `w_k` (rad/s) and `g_k` (1/s) are not, and all channels share these.
//! - **Start.** Each mode that is looked for is tried at frequencies a half-width apart, with the amplitudes solved; the
//!   mode that explains most is taken, all taken ones are fitted, and so on with what is left, until nothing
//!   significant is found.
//! - **Fit.** Gauss-Newton with Levenberg's and Marquardt's damping for all unknowns together. The amplitudes of each
//!   channel are eliminated from its normal equations as soon as these are summed, so only those of the pairs remain;
//!   this is variable projection (Golub and Pereyra 1973) without its second derivatives.
//! - **Deviations.** The square roots of the inverse of what remains, times the residuals' spectrum at the mode's
//!   frequency in units of white noise (never less than 1): noise that has passed a recorder's filter is stronger there
//!   than its mean square says. Where there is next to no noise, `f32` knows a pair to `2^-23` of the sampling rate.
//!
//! The samples are walked through with one complex multiplication a mode and sample: no sine in the loop.

use nalgebra::{SMatrix, SVector};

use super::{ExpectedMode, ModeEstimate, TAIL_MODES};
use crate::capacity::CHANNELS;
use crate::math::{self, Real};

/// Amplitudes of a channel: the offset, and two of each mode.
const AMPLITUDES: usize = 1 + 2 * TAIL_MODES;
/// Unknowns that the channels share: two of each mode.
const SHARED: usize = 2 * TAIL_MODES;
/// Unknowns in a channel's rows.
const ROW: usize = AMPLITUDES + SHARED;

/// A tail of fewer periods of the lowest mode says nothing: an offset, and what is left of the train's own motion, look
/// the same.
const LEAST_PERIODS: f32 = 2.0;
/// A channel with fewer samples does not count: twice its unknowns.
const LEAST_SAMPLES: f32 = (2 * ROW) as f32;
/// Fall of the sum of squares, in variances of the noise, that makes a mode significant. Noise alone makes it fall as
/// chi-squared with up to 8 degrees of freedom (two amplitudes a channel, frequency, decay), beyond 50 once in 20
/// million tries; a search makes less than 200.
const SIGNIFICANT: f32 = 50.0;
/// Frequencies that are tried stand so many of the mode's half-widths `xi fn` apart, ...
const HALF_WIDTHS: f32 = 1.0;
/// ... or this part of the tail's resolution `1 / T`, whichever is more, ...
const RESOLUTION: f32 = 0.25;
/// ... but at least this part of the frequency.
const FINEST: f32 = 0.005;

/// The fit has converged when the next step would lower the sum of squares by less than this many variances of the
/// noise: the estimates would move by a thirtieth of their deviations.
const SMALL_GAIN: f32 = 1e-3;
/// Steps after which the fit stops in any case; it takes about 5.
const MAX_STEPS: usize = 20;
/// First damping of the fit, its smallest and its largest value.
const DAMPING: [f32; 3] = [1e-3, 1e-6, 1e3];
/// A rejected step multiplies the damping by this, a good one divides by it.
const DAMPING_FACTOR: f32 = 10.0;
/// Largest decay, as a part of the circular frequency: damping ratio 0.3.
const LARGEST_DECAY: f32 = 0.3;
/// How far a frequency may stray from its range during the fit, as a part of the range's ends.
const STRAY: [f32; 2] = [0.7, 1.3];

/// A mode is looked for in so many of its decay times from the tail's beginning: 0.03 % of its energy come later.
const DECAY_TIMES: f32 = 4.0;
/// A wave that has become this part of itself counts as gone; its squares would not be normal numbers.
const GONE: f32 = 1e-9;

/// A pivot that has lost all but this part of itself is rounding: its unknown is not there, or another stands for it.
const SINGULAR: f32 = 1e-6;
/// Part of a sum of squares that is rounding.
const ROUNDING: f32 = 1e-7;
/// Lags of the residuals' correlation that make up their spectrum, at 200 samples a second smoothed over 10 Hz.
const LAGS: usize = 20;

/// The samples.
#[derive(Clone, Copy)]
pub(super) struct Tail<'a> {
    samples: &'a [f32],
    channels: usize,
    interval_s: f32,
}

/// A decaying vibration.
#[derive(Clone, Copy)]
struct Wave {
    /// Damped circular frequency, rad/s.
    omega: f32,
    /// Decay `xi w`, 1/s.
    decay: f32,
}

/// What the tail is thought to be.
#[derive(Clone)]
struct Motion {
    /// The modes that are taken.
    waves: [Option<Wave>; TAIL_MODES],
    /// The offset and the pairs `a`, `b` of each channel, m/s².
    amplitudes: [[f32; AMPLITUDES]; CHANNELS],
}

/// What a motion leaves of each channel.
#[derive(Clone, Copy)]
struct Unexplained {
    squares: [f32; CHANNELS],
    /// Samples; 0 for a channel that does not count.
    count: [f32; CHANNELS],
}

/// A motion and the normal equations of its shared unknowns there.
pub(super) struct Fitted {
    motion: Motion,
    unexplained: Unexplained,
    matrix: SMatrix<f32, SHARED, SHARED>,
    right: SVector<f32, SHARED>,
}

/// The sums of a channel's normal equations; of the symmetric matrix, what is on and right of the diagonal.
struct Sums<const N: usize> {
    matrix: [[f32; N]; N],
    right: [f32; N],
    squares: f32,
    count: f32,
}

impl<'a> Tail<'a> {
    /// None if there are more channels than a logger has, or none.
    pub(super) fn new(samples: &'a [f32], channels: usize, sample_rate_hz: f32) -> Option<Self> {
        ((1..=CHANNELS).contains(&channels) && sample_rate_hz.is_finite() && sample_rate_hz > 0.0).then_some(Self {
            samples,
            channels,
            interval_s: 1.0 / sample_rate_hz,
        })
    }

    /// The samples of a channel.
    fn channel(&self, channel: usize) -> impl Iterator<Item = f32> {
        let rows = self.samples.chunks_exact(self.channels.max(1));
        rows.map(move |row| row.get(channel).copied().unwrap_or(f32::NAN))
    }

    /// What there is of the first so many seconds.
    fn first(&self, duration_s: f32) -> Self {
        // A cast makes the largest number of what is not finite.
        let values = ((duration_s / self.interval_s) as usize).saturating_mul(self.channels);
        Self {
            samples: self.samples.get(..values).unwrap_or(self.samples),
            ..*self
        }
    }

    /// Time from the first sample with a value to the last, s.
    fn duration_s(&self) -> f32 {
        let mut there = (self.samples.chunks_exact(self.channels.max(1)).enumerate())
            .filter(|(_, row)| row.iter().any(|value| value.is_finite()))
            .map(|(i, _)| i);
        let first = there.next().unwrap_or(0);
        (there.next_back().unwrap_or(first) - first) as f32 * self.interval_s
    }
}

impl Motion {
    /// Each sample of a channel that has a value: its time, the waves' cosine and sine parts, and what the motion
    /// leaves of it.
    fn walk(&self, tail: &Tail<'_>, channel: usize, mut visit: impl FnMut(f32, &[[f32; 2]; TAIL_MODES], f32)) {
        let turns = self
            .waves
            .map(|wave| wave.map_or([0.0; 2], |wave| wave.turn(tail.interval_s)));
        let mut parts = self.waves.map(|wave| [if wave.is_some() { 1.0 } else { 0.0 }, 0.0]);
        let amplitudes = self.amplitudes.get(channel).copied().unwrap_or_default();
        let [offset, pairs @ ..] = &amplitudes;
        for (i, value) in tail.channel(channel).enumerate() {
            if value.is_finite() {
                let mut left = value - offset;
                for (&[cos, sin], pair) in parts.iter().zip(pairs.chunks_exact(2)) {
                    left -= pair[0] * cos + pair[1] * sin;
                }
                visit(i as f32 * tail.interval_s, &parts, left);
            }
            for ([cos, sin], [turn_cos, turn_sin]) in parts.iter_mut().zip(&turns) {
                (*cos, *sin) = (*cos * turn_cos - *sin * turn_sin, *sin * turn_cos + *cos * turn_sin);
                if cos.abs() + sin.abs() < GONE {
                    (*cos, *sin) = (0.0, 0.0);
                }
            }
        }
    }

    /// Solves the amplitudes of all channels; tells what is left.
    #[inline(never)]
    fn solve_amplitudes(&mut self, tail: &Tail<'_>) -> Unexplained {
        let mut unexplained = Unexplained {
            squares: [0.0; CHANNELS],
            count: [0.0; CHANNELS],
        };
        for channel in 0..CHANNELS {
            let mut sums = Sums::<AMPLITUDES>::default();
            self.walk(tail, channel, |_, parts, left| sums.add(&amplitude_row(parts), left));
            if sums.count < LEAST_SAMPLES {
                continue;
            }
            let right = sums.right;
            sums.eliminate(AMPLITUDES);
            let change = sums.substitute();
            let fall = math::dot(&right, &change);
            unexplained.squares[channel] = (sums.squares - fall).max(ROUNDING * sums.squares);
            unexplained.count[channel] = sums.count;
            math::add_scaled(&mut self.amplitudes[channel], 1.0, &change);
        }
        unexplained
    }

    /// The same motion with a mode at rest.
    fn without(&self, mode: usize) -> Self {
        let mut rest = self.clone();
        rest.put(mode, None);
        rest
    }

    /// Puts a wave, without amplitude yet, in a mode's place.
    fn put(&mut self, mode: usize, wave: Option<Wave>) {
        if let Some(place) = self.waves.get_mut(mode) {
            *place = wave;
            for amplitudes in &mut self.amplitudes {
                for amplitude in amplitudes.iter_mut().skip(1 + 2 * mode).take(2) {
                    *amplitude = 0.0;
                }
            }
        }
    }
}

/// The derivatives of a sample by its channel's amplitudes.
fn amplitude_row(parts: &[[f32; 2]; TAIL_MODES]) -> [f32; AMPLITUDES] {
    let mut row = [1.0; AMPLITUDES];
    for (entry, part) in row.iter_mut().skip(1).zip(parts.as_flattened()) {
        *entry = *part;
    }
    row
}

impl Wave {
    /// `exp((-decay + i omega) h)`.
    fn turn(self, interval_s: f32) -> [f32; 2] {
        let (sin, cos) = (self.omega * interval_s).sin_cos_exact();
        let radius = (-self.decay * interval_s).exp_m1_exact() + 1.0;
        [radius * cos, radius * sin]
    }
}

impl Unexplained {
    /// How much less `after` leaves than this, in variances of the noise that it leaves.
    fn gain(&self, after: &Self) -> f32 {
        let squares = self.squares.iter().zip(&after.squares).zip(&after.count);
        squares.fold(0.0, |gain, ((before, after), count)| {
            gain + count * (before - after) / after.max(f32::MIN_POSITIVE)
        })
    }

    /// The reciprocal of each channel's noise's variance, 0 for a channel that does not count.
    fn weights(&self, waves: usize) -> [f32; CHANNELS] {
        let counting = self.count.iter().filter(|&&count| count > 0.0).count().max(1);
        let unknowns = (1 + 2 * waves) as f32 + 2.0 * waves as f32 / counting as f32;
        core::array::from_fn(|channel| {
            if self.count[channel] > 0.0 {
                (self.count[channel] - unknowns) / self.squares[channel].max(f32::MIN_POSITIVE)
            } else {
                0.0
            }
        })
    }
}

impl<const N: usize> Default for Sums<N> {
    fn default() -> Self {
        Self {
            matrix: [[0.0; N]; N],
            right: [0.0; N],
            squares: 0.0,
            count: 0.0,
        }
    }
}

impl<const N: usize> Sums<N> {
    /// Adds a sample: its derivatives by the unknowns, and what is left of it.
    fn add(&mut self, row: &[f32; N], left: f32) {
        for i in 0..N {
            for j in i..N {
                self.matrix[i][j] += row[i] * row[j];
            }
        }
        math::add_scaled(&mut self.right, left, row);
        self.squares += left * left;
        self.count += 1.0;
    }

    /// Eliminates the first unknowns from the equations of the later ones.
    fn eliminate(&mut self, first: usize) {
        let diagonal: [f32; N] = core::array::from_fn(|i| self.matrix[i][i]);
        for p in 0..first.min(N) {
            let row = self.matrix[p];
            if row[p] <= SINGULAR * diagonal[p] {
                self.matrix[p] = [0.0; N];
                continue;
            }
            for i in p + 1..N {
                let factor = row[i] / row[p];
                for (entry, &other) in self.matrix[i].iter_mut().zip(&row).skip(i) {
                    *entry -= factor * other;
                }
                self.right[i] -= factor * self.right[p];
            }
        }
    }

    /// The unknowns, after all have been eliminated; 0 for one that is not there.
    fn substitute(&self) -> [f32; N] {
        let mut unknowns = [0.0; N];
        for p in (0..N).rev() {
            let row = &self.matrix[p];
            if row[p] > 0.0 {
                unknowns[p] = (self.right[p] - math::dot(row, &unknowns)) / row[p];
            }
        }
        unknowns
    }
}

/// Looks for the modes and fits those that are significant; none if there is none.
pub(super) fn fit(tail: &Tail<'_>, expected: &[ExpectedMode]) -> Option<Fitted> {
    let lowest = expected.first()?;
    let duration_s = tail.duration_s();
    if duration_s * lowest.frequency_hz < LEAST_PERIODS {
        return None;
    }
    let mut motion = Motion {
        waves: [None; TAIL_MODES],
        amplitudes: [[0.0; AMPLITUDES]; CHANNELS],
    };
    let mut fitted = None;
    for _ in 0..TAIL_MODES {
        let mut best = (SIGNIFICANT, None);
        for (mode, looked_for) in expected.iter().enumerate() {
            if !matches!(motion.waves.get(mode), Some(None)) {
                continue;
            }
            let decay = core::f32::consts::TAU * looked_for.frequency_hz * looked_for.damping_ratio;
            let alive = tail.first(DECAY_TIMES / decay);
            let before = motion.clone().solve_amplitudes(&alive);
            for wave in tries(looked_for, duration_s) {
                let mut trial = motion.clone();
                trial.put(mode, Some(wave));
                let gain = before.gain(&trial.solve_amplitudes(&alive));
                if gain > best.0 {
                    best = (gain, Some((mode, wave)));
                }
            }
        }
        let Some((mode, wave)) = best.1 else { break };
        motion.put(mode, Some(wave));
        let found = descend(tail, motion, expected);
        motion = found.motion.clone();
        fitted = Some(found);
    }
    fitted
}

/// The waves that are tried for a mode.
fn tries(mode: &ExpectedMode, duration_s: f32) -> impl Iterator<Item = Wave> {
    let [lowest, highest] = mode.range_hz;
    let step_hz = (HALF_WIDTHS * mode.damping_ratio * mode.frequency_hz)
        .max(RESOLUTION / duration_s)
        .max(FINEST * mode.frequency_hz);
    let ratio = mode.damping_ratio.clamp(0.0, LARGEST_DECAY);
    // A cast makes 0 of what is not a number.
    let steps = ((highest - lowest) / step_hz) as u16 + 1;
    (0..=steps).map(move |i| {
        let omega = core::f32::consts::TAU * (lowest + (highest - lowest) * (f32::from(i) / f32::from(steps)));
        Wave {
            omega,
            decay: ratio * omega,
        }
    })
}

/// Gauss-Newton from a motion.
fn descend(tail: &Tail<'_>, motion: Motion, expected: &[ExpectedMode]) -> Fitted {
    let mut best = Fitted::at(tail, motion);
    let mut damping = DAMPING[0];
    for _ in 0..MAX_STEPS {
        let Some(step) = best.step(damping) else { break };
        if step.dot(&best.right) < SMALL_GAIN {
            break;
        }
        let trial = Fitted::at(tail, best.moved(&step, expected));
        let before = best.unexplained.squares.iter().zip(&trial.unexplained.squares);
        let fall =
            (before.zip(best.weights())).fold(0.0, |fall, ((before, after), weight)| fall + weight * (before - after));
        if fall > 0.0 {
            best = trial;
            damping = (damping / DAMPING_FACTOR).max(DAMPING[1]);
        } else {
            damping *= DAMPING_FACTOR;
            if damping > DAMPING[2] {
                break;
            }
        }
    }
    best
}

impl Fitted {
    /// Solves the amplitudes and sums the normal equations of the shared unknowns.
    #[inline(never)]
    fn at(tail: &Tail<'_>, mut motion: Motion) -> Self {
        let mut unexplained = motion.solve_amplitudes(tail);
        let waves = motion.waves.iter().flatten().count();
        let mut matrix = SMatrix::zeros();
        let mut right = SVector::zeros();
        for channel in 0..CHANNELS {
            if unexplained.count[channel] == 0.0 {
                continue;
            }
            let pairs = motion.amplitudes[channel];
            let mut sums = Sums::<ROW>::default();
            motion.walk(tail, channel, |t, parts, left| sums.add(&row(t, parts, &pairs), left));
            // What the walk left is exact where the amplitudes' sums had cancelled.
            unexplained.squares[channel] = sums.squares;
            sums.eliminate(AMPLITUDES);
            let weight = unexplained.weights(waves)[channel];
            for i in 0..SHARED {
                for j in 0..SHARED {
                    matrix[(i, j)] += weight * sums.matrix[AMPLITUDES + i.min(j)][AMPLITUDES + i.max(j)];
                }
                right[i] += weight * sums.right[AMPLITUDES + i];
            }
        }
        for (mode, wave) in motion.waves.iter().enumerate() {
            if wave.is_none() {
                matrix[(2 * mode, 2 * mode)] = 1.0;
                matrix[(2 * mode + 1, 2 * mode + 1)] = 1.0;
            }
        }
        Self {
            motion,
            unexplained,
            matrix,
            right,
        }
    }

    fn weights(&self) -> [f32; CHANNELS] {
        self.unexplained.weights(self.motion.waves.iter().flatten().count())
    }

    /// The damped step of the shared unknowns.
    fn step(&self, damping: f32) -> Option<SVector<f32, SHARED>> {
        let mut matrix = self.matrix;
        for i in 0..SHARED {
            matrix[(i, i)] *= 1.0 + damping;
        }
        Some(matrix.cholesky()?.solve(&self.right))
    }

    /// The motion after a step.
    fn moved(&self, step: &SVector<f32, SHARED>, expected: &[ExpectedMode]) -> Motion {
        let mut motion = self.motion.clone();
        for ((wave, step), mode) in motion
            .waves
            .iter_mut()
            .zip(step.as_slice().chunks_exact(2))
            .zip(expected)
        {
            if let Some(wave) = wave {
                let [lowest, highest] = mode.range_hz.map(|hz| core::f32::consts::TAU * hz);
                wave.omega = (wave.omega + step[0]).max(STRAY[0] * lowest).min(STRAY[1] * highest);
                wave.decay = (wave.decay + step[1]).max(0.0).min(LARGEST_DECAY * wave.omega);
            }
        }
        motion
    }

    /// A mode's estimate, if it was taken and is significant.
    pub(super) fn estimate(&self, tail: &Tail<'_>, mode: usize) -> Option<ModeEstimate> {
        let wave = (*self.motion.waves.get(mode)?)?;
        if self.motion.without(mode).solve_amplitudes(tail).gain(&self.unexplained) < SIGNIFICANT {
            return None;
        }
        let covariance = self.matrix.cholesky()?.inverse();
        let of = |i: usize, j: usize| covariance.get((2 * mode + i, 2 * mode + j)).copied();
        let [[omega_omega, omega_decay], [_, decay_decay]] = [[of(0, 0)?, of(0, 1)?], [of(1, 0)?, of(1, 1)?]];
        let variance = |[by_omega, by_decay]: [f32; 2]| {
            by_omega * by_omega * omega_omega
                + 2.0 * by_omega * by_decay * omega_decay
                + by_decay * by_decay * decay_decay
        };
        let natural = math::sqrt(wave.omega * wave.omega + wave.decay * wave.decay);
        let ratio = wave.decay / natural;
        // d w = (w_d d w_d + g d g) / w,   d xi = (d g - xi d w) / w
        let by_omega = wave.omega / natural;
        let colour = self.colour(tail, wave.omega);
        // A wave's turn from one sample to the next is rounded, and with it the pair that is known of it.
        let rounding = f32::EPSILON / tail.interval_s;
        let std = |slopes| math::sqrt((colour * variance(slopes)).max(0.0) + rounding * rounding);
        Some(ModeEstimate {
            mode,
            frequency_hz: natural / core::f32::consts::TAU,
            frequency_std_hz: std([by_omega, ratio]) / core::f32::consts::TAU,
            damping_ratio: ratio,
            damping_ratio_std: std([-ratio * by_omega, 1.0 - ratio * ratio]) / natural,
        })
    }

    /// The residuals' spectrum at a circular frequency in units of white noise of the same mean square, at least 1.
    ///
    /// ```text
    /// S(w) = 1 + 2 sum_k (1 - k / (K + 1)) rho_k cos(k w h),   k = 1 .. K        (Bartlett)
    /// ```
    #[inline(never)]
    fn colour(&self, tail: &Tail<'_>, omega: f32) -> f32 {
        let mut products = [0.0_f32; LAGS];
        let mut squares = 0.0;
        for (channel, weight) in self.weights().into_iter().enumerate() {
            let mut latest = [0.0_f32; LAGS];
            // Over a gap samples stand side by side that did not; that makes their noise look no worse than it is.
            self.motion.walk(tail, channel, |_, _, left| {
                squares += weight * left * left;
                math::add_scaled(&mut products, weight * left, &latest);
                latest.copy_within(..LAGS - 1, 1);
                latest[0] = left;
            });
        }
        let mut sum = 1.0;
        for (k, product) in (1..).zip(products) {
            let lag = k as f32;
            let (_, cos) = (lag * omega * tail.interval_s).sin_cos_exact();
            sum += 2.0 * (1.0 - lag / (LAGS + 1) as f32) * cos * product / squares.max(f32::MIN_POSITIVE);
        }
        sum.max(1.0)
    }
}

/// The derivatives of a sample by its channel's amplitudes, and by each wave's circular frequency and decay.
fn row(t: f32, parts: &[[f32; 2]; TAIL_MODES], amplitudes: &[f32; AMPLITUDES]) -> [f32; ROW] {
    let [_, pairs @ ..] = amplitudes;
    let mut row = [1.0; ROW];
    let (amplitude, shared) = row.split_at_mut(AMPLITUDES);
    amplitude.copy_from_slice(&amplitude_row(parts));
    for ((entries, [cos, sin]), pair) in shared.chunks_exact_mut(2).zip(parts).zip(pairs.chunks_exact(2)) {
        entries[0] = t * (pair[1] * cos - pair[0] * sin);
        entries[1] = -t * (pair[0] * cos + pair[1] * sin);
    }
    row
}
