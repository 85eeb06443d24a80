//! The logger's identification: from what is expected of a passage to the damage that explains it, and how surely.
//!
//! | stage | does | passes |
//! |---|---|---|
//! | align | tries speeds over their range, bridge as stiff as its model or softer, and with each all entries and loads | comparisons |
//! | settle | descends with all elements whole to the best speed, entry, load and stiffness | linearisations |
//! | search | the small genetic search finds the basin of the damage, with the best entry and load of each pattern | comparisons |
//! | descend | Gauss-Newton within bounds finds its bottom, all unknowns free; where the track is known, once more with the load of each car | linearisations |
//! | correlate | asks how independent the residuals are; if hardly, descends once more from an entry a car later and earlier | a correlation |
//! | doubt | descends from the mirror image, the most certain element held whole: what else could it be? | linearisations |
//!
//! The first two are passed over if all of speed, entry, load and stiffness are known. [`Hybrid::advance`] does one bounded slice, 7
//! million instructions of the logger at most. Deterministic for a seed.
//!
//! In the first two the stiffness of the whole bridge stands for any damage, whether it is known or not. A softer bridge's free vibration
//! falls behind, and under one that is too stiff the entry that fits best is the true one give or take whole periods of the
//! first mode. Of 300 passages with nothing told but train and cars (both trains, 1 to 16 cars, 60 to 300 km/h, no damage or up to
//! two of 10 to 40 %, 2 to 5 % noise, one sensor and three) 22 ended elsewhere without that, and 14 of these passed for
//! explained. With it 4 do, those in which the first guess of the speed was off by more than its range; all 4 are called unexplained.

use rand_core::SeedableRng;
use rand_xoshiro::Xoshiro128PlusPlus;

use super::CodeSearch;
use super::code::DamageCode;
use super::estimate::{Estimate, Information, TOLD_APART};
use super::micro_ga::MicroGa;
use super::objective::{EXPLAINED, Problem, Squares, Terms};
use super::pass::{Alignment, Comparison, Found, MOST_SHIFTS, Pass, Shifts};
use super::refine::{Refinement, Stop, Want};
use super::unknowns::{Limits, Point, Theta, hypothesis, losses, surprise, with_losses};

use crate::bridge::Damage;
use crate::capacity::{CARS, CHANNELS, ELEMENTS};
use crate::interaction::sensitivity::{ENTRY, LOAD, SPEED, STIFFNESS};
use crate::interaction::{Hypothesis, Run, SetupError};
use crate::math;

pub use super::estimate::{ALARM_DAMAGE, ALARM_DEVIATIONS};

/// Forward solves of the genetic search before the descent begins. An earlier form of the search, tried on 60 random
/// cases of one to three damages up to 65 %, ended elsewhere in 8 of them when it began at the undamaged bridge, in 1 after
/// 16 solves, in none after 24. The present one was settled on 400 such cases, and then found 400 of 400 others.
pub const BASIN_BUDGET: u32 = 40;
/// If what the descent finds does not explain the recording, the genetic search begins again, up to so many rounds in all.
const ROUNDS: u32 = 2;
/// Residuals of which so many say as much as one are not the sensors' noise alone: something is wrong with the answer. White noise
/// gives 1.0 to 1.1.
const NOT_NOISE: f32 = 3.0;
/// Other entries that are tried then: a car later and a car earlier.
const NEIGHBOURS: u32 = 2;
/// Solver steps after which an identification is ended, the pass that is running excepted: at 6,000 instructions each and 168 MHz,
/// two minutes of the three between trains. What it has found by then is no answer ([`Stop::Budget`]).
const MOST_STEPS: u64 = 3_400_000;

/// Part of the recording's power that may remain unexplained; beyond it, the model is not of this passage.
pub const UNEXPLAINED: f32 = 0.1;
/// A loss that a passage can hide and is still said to be healthy; if it can hide more, nothing is decided.
pub const HIDDEN: f32 = 0.5;

/// Speeds to either side of the expected one that are tried at most.
const MOST_SPEEDS: u32 = 80;
/// Speeds are so close that at neither end of a passage the next one is off by more than this part of the first mode's period.
const OUT_OF_STEP: f32 = 0.125;
/// Stiffnesses of the whole bridge that stand for damage while the train is aligned, as parts of the model's, less one: two elements
/// that have lost 40 % lower the first frequency by a tenth. Under the healthy bridge alone the best entry is a period off then.
const SOFTER: [f32; 3] = [0.0, -0.1, -0.2];
/// Solver steps that alignment may take: the rest is for the searches behind it.
const ALIGN_STEPS: u64 = 2 * MOST_STEPS / 5;
/// Solver steps that alignment may take for more than the first of them: a quarter of all. A long and slow train, with its many
/// speeds, needs them least, since its own rhythm tells its entry.
const SOFTER_STEPS: u64 = MOST_STEPS / 4;
/// Deviation of that stiffness while the train is settled.
const SOFTER_DEVIATION: f32 = 0.2;
/// A load is looked for within so many of its ranges.
const LOAD_RANGES: f32 = 2.0;

/// What a search found.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Identification {
    /// Loss of each element, its deviation, its 95 % interval, its significance. The loss is that of the descent, not of
    /// the linear model about it.
    pub estimate: Estimate,
    /// The same for adding up passages.
    pub information: Information,
    /// The damage to the nearest 10 %.
    pub code: DamageCode,
    /// How the train ran.
    pub run: Run<f32>,
    /// Stiffness of the whole bridge, as a part of the model's.
    pub stiffness: f32,
    /// Static loads of the cars, as parts of what their kind says.
    pub cars: [f32; CARS],
    /// Standard deviations of stiffness, speed, entry time and load, in the units of [`unknowns`](super::unknowns); 0 if held.
    pub std: [f32; 4],
    /// Misfit, (m/s²)² (m² for displacements).
    pub objective: f32,
    /// Misfit of the undamaged bridge under the train as it was settled before damage was looked for.
    pub objective_healthy: f32,
    /// Part of the recording's power that is not explained, on average over the channels.
    pub unexplained: f32,
    /// Mean squares of the recording and of its residuals, of each channel, (m/s²)² (m²).
    pub mean_squares: [[f32; 2]; CHANNELS],
    /// The best explanation in which the most certain element is whole.
    pub rival: Option<Rival>,
    /// Forward solves, a derivative at its true cost.
    pub forward_solves: u32,
    /// Generations of the genetic search.
    pub generations: u32,
    /// Why the descent ended.
    pub stop: Stop,
}

/// What else could explain a passage.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Rival {
    /// The element, from 0, that is whole in it.
    pub whole: usize,
    /// Loss of each element.
    pub damage: Damage<f32>,
    /// Standard deviations by which it explains the passage worse.
    pub loses_by: f32,
}

impl Identification {
    /// What it says of the passage.
    pub fn hypothesis(&self) -> Hypothesis<f32> {
        Hypothesis {
            damage: self.estimate.damage,
            stiffness: self.stiffness,
            run: self.run,
            cars: self.cars,
        }
    }

    /// Bit `e` is set where element `e` (from 0) is damaged beyond doubt.
    pub fn certain(&self) -> u16 {
        if !self.explained() || self.stop == Stop::Budget {
            return 0;
        }
        // What a rival explains nearly as well is not beyond doubt.
        let rivalled = self.rival.filter(|rival| rival.loses_by < TOLD_APART);
        self.estimate.certain() & !rivalled.map_or(0, |rival| 1 << rival.whole)
    }

    /// The largest loss of a single element that need not have been found certain.
    pub fn hidden(&self, elements: usize) -> f32 {
        self.estimate.hidden(elements)
    }

    /// Whether some damage pattern explains the recording at all.
    pub fn explained(&self) -> bool {
        self.unexplained <= UNEXPLAINED
    }
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Stage {
    Begin,
    Align,
    Settle,
    Search,
    Descend,
    Correlate,
    Doubt,
    Over,
}

/// The best answer so far.
#[derive(Debug, Clone)]
struct Answer {
    identification: Identification,
    at: Point,
    residuals: Squares,
    correlation_time: f32,
}

/// State of an identification.
#[derive(Debug, Clone)]
pub struct Hybrid {
    stage: Stage,
    search: MicroGa<Xoshiro128PlusPlus>,
    descent: Option<Refinement>,
    /// Sums of squares of the recording.
    power: Squares,
    /// Of alignment: the speed that is being tried, and how many there are to either side.
    speed: [u32; 2],
    /// The stiffness, and how many there are of them.
    softer: [usize; 2],
    /// The best of the stage so far, and its weighted sum of squares.
    best: (Theta, f32),
    /// What was found before the search for damage.
    settled: Theta,
    answer: Option<Answer>,
    stop: Stop,
    round: u32,
    /// Other entries from which it has descended.
    neighbours: u32,
    /// It has gone on from a rival that was better.
    turned: bool,
    /// Cost so far, tenths of a solver step.
    tenths: u64,
    objective_healthy: f32,
}

impl Hybrid {
    /// An identification that has not begun.
    pub fn new(seed: u64) -> Self {
        Self {
            stage: Stage::Begin,
            search: MicroGa::new(Xoshiro128PlusPlus::seed_from_u64(seed), BASIN_BUDGET),
            descent: None,
            power: Squares::NONE,
            speed: [0; 2],
            softer: [0, 1],
            best: (Theta::zeros(), f32::INFINITY),
            settled: Theta::zeros(),
            answer: None,
            stop: Stop::Converged,
            round: 1,
            neighbours: 0,
            turned: false,
            tenths: 0,
            objective_healthy: 0.0,
        }
    }

    /// Steps of the solver so far, a derivative at its true cost.
    pub fn solver_steps(&self) -> u64 {
        self.tenths / 10
    }

    /// Does one slice of the work, in the memory of `pass`; gives the result once it is there.
    pub fn advance(&mut self, problem: &Problem<'_>, pass: &mut Pass) -> Result<Option<&Identification>, SetupError> {
        match self.stage {
            Stage::Begin => self.begin(problem),
            Stage::Over => return Ok(self.result()),
            _ => {
                let over = pass.advance(problem);
                self.tenths = self.tenths.saturating_add(pass.take_cost());
                if !over {
                    return Ok(None);
                }
                self.hear(problem, pass.found());
            }
        }
        self.ask(problem, pass)?;
        Ok(self.result())
    }

    /// The result, if it is there.
    pub fn result(&self) -> Option<&Identification> {
        let over = self.stage == Stage::Over;
        self.answer
            .as_ref()
            .filter(|_| over)
            .map(|answer| &answer.identification)
    }

    fn begin(&mut self, problem: &Problem<'_>) {
        self.power = problem.power();
        let ranges = problem.observation.ranges;
        let limits = self.limits(problem);
        let free = limits.free();
        self.stage = if [SPEED, ENTRY, LOAD].into_iter().any(|unknown| free[unknown]) {
            // The time over which a train of another speed falls out of step.
            let way_m = problem.observation.cars.train().length_m() + problem.bridge.path.length_m();
            let first_hz = math::sqrt(problem.bridge.lambda[0]) / core::f32::consts::TAU;
            let spacing = 2.0 * OUT_OF_STEP * problem.observation.run.speed_mps / (first_hz * way_m);
            let speeds = (ranges.speed / spacing + 0.999) as u32;
            // As many as alignment has time for, whatever their spacing is then.
            let affordable = (10 * ALIGN_STEPS / solve(problem)).saturating_sub(1) / 2;
            self.speed = [0, speeds.min(MOST_SPEEDS).min(affordable as u32)];
            let solves = u64::from(2 * self.speed[1] + 1) * solve(problem);
            let stiffnesses = (10 * SOFTER_STEPS).checked_div(solves).unwrap_or(0) as usize;
            self.softer = [0, stiffnesses.clamp(1, SOFTER.len())];
            Stage::Align
        } else if free[STIFFNESS] {
            self.settle(problem);
            Stage::Settle
        } else {
            Stage::Search
        };
    }

    fn limits(&self, problem: &Problem<'_>) -> Limits {
        Limits::new(problem.bridge.elements, problem.observation)
    }

    /// Weights with which the recording has a power of 1 a value, in each channel.
    fn weights(&self) -> [f32; CHANNELS] {
        self.power.weights(&self.power)
    }

    // Not inlined, as the next: the answer must not stand on the stack under a pass that begins.
    /// Begins the pass that the stage needs next.
    #[inline(never)]
    fn ask(&mut self, problem: &Problem<'_>, pass: &mut Pass) -> Result<(), SetupError> {
        let weights = self.weights();
        match self.stage {
            Stage::Begin | Stage::Over => Ok(()),
            Stage::Align => {
                // A speed at which the train would stop on its way is passed over.
                while pass
                    .compare(
                        problem,
                        &self.tried_speed(problem).into(),
                        weights,
                        self.shifts(problem),
                    )
                    .is_err()
                {
                    self.next_speed(problem);
                    if self.stage != Stage::Align {
                        return self.ask(problem, pass);
                    }
                }
                Ok(())
            }
            Stage::Search => match self
                .pattern(problem)
                .filter(|_| !self.spent() || self.best.1.is_infinite())
            {
                Some(theta) => pass.compare(problem, &theta.into(), weights, self.shifts(problem)),
                None => {
                    let left = self.best.1 / self.power.values();
                    let weights = weights.map(|weight| weight / left.max(EXPLAINED));
                    self.descent = Some(Refinement::new(
                        &self.best.0.into(),
                        self.limits(problem),
                        self.power,
                        weights,
                    ));
                    self.stage = Stage::Descend;
                    self.ask(problem, pass)
                }
            },
            Stage::Settle | Stage::Descend | Stage::Doubt => {
                let Some(descent) = &self.descent else { return Ok(()) };
                match descent.wants() {
                    Want::Probe(at) => {
                        let begun = pass.compare(problem, &at, descent.weights(), Shifts::NONE);
                        if begun.is_ok() {
                            return begun;
                        }
                        // It cannot be so: as bad as can be.
                        self.hear_probe(problem, &Squares::HOPELESS);
                        self.ask(problem, pass)
                    }
                    Want::Linearise(at) => pass.linearise(problem, &at, descent.weights(), &descent.wanted()),
                }
            }
            Stage::Correlate => {
                let Some(descent) = &self.descent else { return Ok(()) };
                pass.correlate(problem, descent.best(), descent.weights())
            }
        }
    }

    /// Takes what a pass has found.
    #[inline(never)]
    fn hear(&mut self, problem: &Problem<'_>, found: Found<'_>) {
        match (self.stage, found) {
            (Stage::Align, Found::Comparison(comparison)) => self.hear_speed(problem, comparison),
            (Stage::Search, Found::Comparison(comparison)) => self.hear_pattern(problem, comparison),
            (Stage::Settle | Stage::Descend | Stage::Doubt, Found::Comparison(comparison)) => {
                self.hear_probe(problem, &comparison.residuals);
            }
            (Stage::Settle | Stage::Descend | Stage::Doubt, Found::Normal(normal)) => {
                if let Some(descent) = &mut self.descent {
                    let terms = terms(problem, self.stage, descent);
                    let stop = descent.told_normal(normal, &terms);
                    self.go_on(problem, stop);
                }
            }
            (Stage::Correlate, Found::CorrelationTime(time)) => self.conclude(problem, time),
            _ => {}
        }
    }

    fn hear_probe(&mut self, problem: &Problem<'_>, residuals: &Squares) {
        if let Some(descent) = &mut self.descent {
            let terms = terms(problem, self.stage, descent);
            let stop = descent.told(residuals, &terms);
            self.go_on(problem, stop);
        }
    }

    /// Ends the descent if it has stopped, or the time is over.
    fn go_on(&mut self, problem: &Problem<'_>, stop: Option<Stop>) {
        let spent = self.spent().then_some(Stop::Budget);
        if let Some(stop) = stop.or(spent) {
            self.end_descent(problem, stop);
        }
    }

    // ---- align ------------------------------------------------------------------------------------------------------

    /// The bridge, as stiff and under a train as fast as is to be tried.
    fn tried_speed(&self, problem: &Problem<'_>) -> Theta {
        let [index, half] = self.speed;
        let mut theta = Theta::zeros();
        if half > 0 {
            theta[SPEED] = problem.observation.ranges.speed * (index as f32 - half as f32) / half as f32;
        }
        theta[STIFFNESS] = SOFTER.get(self.softer[0]).copied().unwrap_or(0.0);
        theta
    }

    /// Shifts that cover the range of the entry.
    fn shifts(&self, problem: &Problem<'_>) -> Shifts {
        let samples = problem.observation.ranges.entry_s * problem.observation.recorder.sample_rate_hz;
        let stride = ((samples / MOST_SHIFTS as f32 + 0.999) as usize).max(1);
        Shifts {
            half: (samples / stride as f32 + 0.999) as usize,
            stride,
        }
    }

    fn hear_speed(&mut self, problem: &Problem<'_>, comparison: &Comparison) {
        let tried = self.tried_speed(problem);
        self.keep(problem, tried, comparison);
        self.next_speed(problem);
    }

    /// Goes on to the next speed and stiffness; behind the last, to the next stage.
    fn next_speed(&mut self, problem: &Problem<'_>) {
        self.softer[0] += 1;
        if self.softer[0] >= self.softer[1] {
            self.softer[0] = 0;
            self.speed[0] += 1;
        }
        if self.speed[0] > 2 * self.speed[1] {
            self.settle(problem);
        }
    }

    /// Keeps a hypothesis with its best entry and load, if it is the best; gives what it leaves.
    fn keep(&mut self, problem: &Problem<'_>, mut theta: Theta, comparison: &Comparison) -> f32 {
        let ranges = problem.observation.ranges;
        let alignment = if ranges.entry_s > 0.0 || ranges.load > 0.0 {
            let now = 1.0 + theta[LOAD];
            let loads = [-1.0, 1.0].map(|side| (1.0 + side * LOAD_RANGES * ranges.load).max(0.1) / now);
            comparison.align(loads)
        } else {
            Alignment {
                samples: 0,
                load: 1.0,
                left: comparison.residuals.weighted(&self.weights()),
            }
        };
        theta[ENTRY] += alignment.samples as f32 / problem.observation.recorder.sample_rate_hz;
        theta[LOAD] += (alignment.load - 1.0) * (1.0 + theta[LOAD]);
        if alignment.left < self.best.1 {
            self.best = (theta, alignment.left);
        }
        alignment.left
    }

    // ---- settle -----------------------------------------------------------------------------------------------------

    fn settle(&mut self, problem: &Problem<'_>) {
        let mut limits = self.limits(problem).without_damage();
        limits.lower[STIFFNESS] = -3.0 * SOFTER_DEVIATION;
        limits.prior[STIFFNESS] = 1.0 / (SOFTER_DEVIATION * SOFTER_DEVIATION);
        let left = (self.best.1 / self.power.values()).min(1.0);
        let weights = self.weights().map(|weight| weight / left.max(EXPLAINED));
        self.descent = Some(Refinement::new(&self.best.0.into(), limits, self.power, weights));
        self.stage = Stage::Settle;
    }

    // ---- search -----------------------------------------------------------------------------------------------------

    /// The next pattern of the genetic search under the train as it is settled; none when the search has ended.
    fn pattern(&mut self, problem: &Problem<'_>) -> Option<Theta> {
        let code = self.search.ask()?.within(problem.bridge.elements);
        Some(with_losses(self.settled, &code.damage()))
    }

    fn hear_pattern(&mut self, problem: &Problem<'_>, comparison: &Comparison) {
        let Some(theta) = self.pattern(problem) else { return };
        if self.objective_healthy == 0.0 {
            // The search asks for the undamaged bridge first.
            self.objective_healthy = comparison.residuals.mean();
        }
        let left = self.keep(problem, theta, comparison);
        self.search.tell(left);
    }

    // ---- descend ----------------------------------------------------------------------------------------------------

    fn end_descent(&mut self, problem: &Problem<'_>, stop: Stop) {
        let Some(descent) = self.descent.as_ref() else { return };
        match self.stage {
            Stage::Settle => {
                self.settled = descent.best().theta;
                // A loss of stiffness must not hide in the whole bridge's before it has been looked for.
                self.settled[STIFFNESS] = 0.0;
                self.best = (self.settled, f32::INFINITY);
                self.stage = Stage::Search;
            }
            Stage::Descend => {
                let cars = problem.weighable();
                let explained = descent.residuals().unexplained(&self.power) <= UNEXPLAINED;
                if cars > 0 && explained && !descent.weighs() && !self.spent() {
                    let weights = descent.residuals().weights(&self.power);
                    let again = Refinement::new(descent.best(), self.limits(problem), self.power, weights);
                    self.descent = Some(again.weighing(cars));
                    return;
                }
                self.stop = stop;
                self.stage = Stage::Correlate;
            }
            _ => self.answer_doubt(problem),
        }
    }

    /// The descent is over and its residuals' correlation known.
    #[inline(never)]
    fn conclude(&mut self, problem: &Problem<'_>, correlation_time: f32) {
        let Some(descent) = self.descent.as_ref() else { return };
        let weights = descent.weights();
        let better = |earlier: &Answer| earlier.identification.objective <= descent.residuals().mean();
        if !self.answer.as_ref().is_some_and(better) {
            self.answer = Some(Answer {
                identification: self.identification(problem, descent, correlation_time),
                at: *descent.best(),
                residuals: *descent.residuals(),
                correlation_time,
            });
        }
        let Some(answer) = self.answer.as_ref() else { return };
        let (identification, at) = (&answer.identification, answer.at);
        let (whole, significance) = identification.estimate.most_certain();
        let explained = identification.explained();
        if let Some(start) = self.neighbour(problem, answer) {
            let weights = self.weights().map(|weight| weight / identification.unexplained);
            self.neighbours += 1;
            self.descent = Some(Refinement::new(
                &start.into(),
                self.limits(problem),
                self.power,
                weights,
            ));
            self.stage = Stage::Descend;
            return;
        }
        if !explained && self.round < ROUNDS {
            self.round += 1;
            self.search.begin_again(BASIN_BUDGET);
            self.best = (self.settled, f32::INFINITY);
            self.stage = Stage::Search;
            return;
        }
        if significance < TOLD_APART || !explained || self.spent() {
            return self.end(problem, None);
        }
        let elements = problem.bridge.elements.min(ELEMENTS);
        let mut mirrored: Damage<f32> = [0.0; ELEMENTS];
        for (e, &loss) in identification.estimate.damage.iter().enumerate().take(elements) {
            mirrored[elements - 1 - e] = loss;
        }
        let limits = self.limits(problem).with_whole(whole);
        let start = Point {
            theta: with_losses(at.theta, &mirrored),
            ..at
        };
        let descent = Refinement::new(&start, limits, self.power, weights);
        self.descent = Some(descent.weighing(problem.weighable()));
        self.stage = Stage::Doubt;
    }

    /// Another entry from which to descend, if the answer leaves what is no noise: a car later, then a car earlier. A train of equal
    /// cars looks much the same then, but for its ends. A single car may be a period of the first mode off.
    fn neighbour(&self, problem: &Problem<'_>, answer: &Answer) -> Option<Theta> {
        let free = problem.observation.ranges.entry_s > 0.0;
        if !free || answer.correlation_time < NOT_NOISE || self.neighbours >= NEIGHBOURS || self.spent() {
            return None;
        }
        let cars = &problem.observation.cars.train().cars;
        let pitch_s = match (cars.first(), cars.get(1)) {
            (Some(first), Some(second)) => (second.behind_m - first.behind_m) / answer.identification.run.speed_mps,
            _ => core::f32::consts::TAU / math::sqrt(problem.bridge.lambda[0]),
        };
        let mut start = with_losses(answer.at.theta, &[0.0; ELEMENTS]);
        start[STIFFNESS] = 0.0;
        start[ENTRY] += if self.neighbours == 0 { pitch_s } else { -pitch_s };
        Some(start)
    }

    fn identification(&self, problem: &Problem<'_>, descent: &Refinement, correlation_time: f32) -> Identification {
        let terms = problem.terms(descent.linearised());
        let information = descent.information(correlation_time, &terms);
        let damage = losses(&descent.best().theta);
        let hypothesis = hypothesis(descent.best(), problem.observation);
        let (deviations, free) = (descent.deviations(correlation_time, &terms), descent.free());
        Identification {
            estimate: Estimate {
                damage,
                ..problem.track.relative(&information).estimate(problem.bridge.elements)
            },
            information,
            code: DamageCode::nearest(&damage),
            run: hypothesis.run,
            stiffness: hypothesis.stiffness,
            cars: hypothesis.cars,
            std: core::array::from_fn(|i| {
                if free[ELEMENTS + i] {
                    deviations[ELEMENTS + i]
                } else {
                    0.0
                }
            }),
            objective: descent.residuals().mean(),
            objective_healthy: self.objective_healthy,
            unexplained: descent.residuals().unexplained(&self.power),
            mean_squares: core::array::from_fn(|c| [&self.power, descent.residuals()].map(|of| of.mean_of(c))),
            rival: None,
            forward_solves: 0,
            generations: 0,
            stop: self.stop,
        }
    }

    // ---- doubt ------------------------------------------------------------------------------------------------------

    /// The descent with the most certain element whole is over.
    fn answer_doubt(&mut self, problem: &Problem<'_>) {
        let (Some(descent), Some(answer)) = (self.descent.as_ref(), self.answer.as_ref()) else {
            return;
        };
        let (limits, other, best) = (self.limits(problem), descent.best(), &answer.at);
        // Twice the logarithm of the ratio of likelihoods, noise of unknown variance in each channel.
        let mut worse = 0.0;
        for c in 0..CHANNELS {
            let least = EXPLAINED * self.power.sum[c];
            let [rival, best] = [descent.residuals(), &answer.residuals].map(|of| of.sum[c].max(least));
            if best > 0.0 {
                worse += self.power.count[c] * math::ln(rival / best);
            }
        }
        for ((prior, rival), best) in limits.prior.iter().zip(&other.theta).zip(&best.theta) {
            worse += prior * (rival * rival - best * best);
        }
        worse += surprise(&other.loads) - surprise(&best.loads);
        worse /= answer.correlation_time;
        worse += problem.terms(&other.theta).squares() - problem.terms(&best.theta).squares();
        if worse < 0.0 && !self.turned {
            // It is the better explanation: what was found was not the bottom.
            self.turned = true;
            let again = Refinement::new(other, limits, self.power, descent.weights());
            self.descent = Some(again.weighing(problem.weighable()));
            self.answer = None;
            self.stage = Stage::Descend;
            return;
        }
        let rival = Rival {
            whole: answer.identification.estimate.most_certain().0,
            damage: losses(&other.theta),
            loses_by: math::sqrt(worse.max(0.0)),
        };
        self.end(problem, Some(rival));
    }

    fn spent(&self) -> bool {
        self.tenths > 10 * MOST_STEPS
    }

    /// The answer is complete, with what it has cost.
    fn end(&mut self, problem: &Problem<'_>, rival: Option<Rival>) {
        if let Some(answer) = &mut self.answer {
            let identification = &mut answer.identification;
            identification.rival = rival;
            identification.forward_solves = u32::try_from(self.tenths.div_ceil(solve(problem))).unwrap_or(u32::MAX);
            identification.generations = self.search.generations();
        }
        self.stage = Stage::Over;
    }
}

/// Cost of a forward solve, tenths of a solver step; at least 1.
fn solve(problem: &Problem<'_>) -> u64 {
    let samples = problem.recorded().len() as u64;
    (10 * samples * u64::from(problem.observation.recorder.steps_per_sample)).max(1)
}

/// What the free vibration says of the point that the descent has asked for.
fn terms(problem: &Problem<'_>, stage: Stage, descent: &Refinement) -> Terms {
    if stage == Stage::Settle {
        // Before damage has been looked for, a frequency that is low says nothing of the whole bridge.
        return Terms::NONE;
    }
    let (Want::Probe(at) | Want::Linearise(at)) = descent.wants();
    problem.terms(&at.theta)
}
