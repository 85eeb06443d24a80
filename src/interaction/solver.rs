//! One step of the coupled system: predict, eliminate the cars, solve for the bridge, give the cars theirs.
//!
//! With the cars eliminated ([`car`](super::car)), contact `i` of a car bears on the rails with `F_i = F~_i - sum_j Z_ij w_j`, where
//! `w_j = phi_j . a` is what the bridge's unknown accelerations `a` do to contact `j`. What is left is one symmetric system:
//!
//! ```text
//! (E + sum_cars sum_ij phi_i Z_ij phi_j^T) a = sum_i phi_i F~_i - c^ q~' - w^2 q~,    E = 1 + c^ h / 2 + beta (w h)^2
//! ```
//!
//! with `E`, `beta` and `c^` of each mode from [`scheme`](super::scheme). The rail as the contacts feel it is predicted with the cars'
//! own `beta`; that differs from the modes' by some `h^3`, and keeps the matrix symmetric.
//!
//! A car on its approach feels the irregularity of the track but not the bridge. It is not stepped until its first
//! wheelset reaches the bridge; its approach is made up for then, so that no memory is kept for cars that come later. At
//! constant speed all cars of a kind have the same approach, one after the other: it is stepped for the first of them, and the
//! others take its end, shifted by the part of a step by which they come later or earlier ([`Approach`]).
//!
//! Multiplications of a step with `m` modes, a car of `d` degrees of freedom and `s` springs, `n` contacts a car:
//! `m^2 (m - 1) / 2` once (a third of it for many modes), and for each car wholly on the bridge
//! `n m (m / 2 + n + 8) + d (d + 3 s + 5 n)`.

use core::ops::Range;

use nalgebra::SVector;

use super::car::{CarState, CarSteps, Lead};
use super::contact::Modes;
use super::run::{Direction, Kinematics, Run, SetupError, TrainPosition};
use super::scheme::{CORNER_STEPS, ModeSteps, Scheme, corner};
use crate::bridge::ModalBridge;
use crate::capacity::CARS;
use crate::math::{Real, add_scaled, dot, entries};
use crate::track::Track;
use crate::train::{Car, Contact, Motion, Place, Train};

/// The cars of a train, ready for steps of one length: each kind's matrix is factorised once for all runs.
#[derive(Debug, Clone, PartialEq)]
pub struct TrainSteps<T: Real, const D: usize, const C: usize, const K: usize> {
    train: Train<T, D, C, K>,
    kinds: heapless::Vec<CarSteps<T, D, C>, K>,
    scheme: Scheme,
    step_s: T,
}

impl<T: Real, const D: usize, const C: usize, const K: usize> TrainSteps<T, D, C, K> {
    /// Prepares `train` for steps of `step_s`.
    ///
    /// # Errors
    /// [`SetupError`] says what is wrong with step or cars.
    pub fn new(train: Train<T, D, C, K>, scheme: Scheme, step_s: T) -> Result<Self, SetupError> {
        if !(step_s > T::zero() && step_s.is_finite()) {
            return Err(SetupError::NotFinite);
        }
        let ordered = train.cars.is_sorted_by(|a, b| a.behind_m <= b.behind_m);
        if train.cars.is_empty() || !ordered || train.cars.iter().any(|place| place.kind >= train.kinds.len()) {
            return Err(SetupError::Cars);
        }
        let kinds = (train.kinds.iter())
            .map(|car| CarSteps::new(car, scheme, step_s))
            .collect::<Result<_, _>>()?;
        Ok(Self {
            train,
            kinds,
            scheme,
            step_s,
        })
    }

    /// The train.
    pub fn train(&self) -> &Train<T, D, C, K> {
        &self.train
    }

    /// Length of a step, s.
    pub fn step_s(&self) -> T {
        self.step_s
    }

    /// The cars from number `first` on, with their numbers.
    pub(super) fn from(&self, first: usize) -> impl Iterator<Item = (usize, Aboard<'_, T, D, C>)> {
        let kind = |place: &Place<T>| self.train.kinds.get(place.kind).zip(self.kinds.get(place.kind));
        (self.train.cars.iter().enumerate().skip(first))
            .filter_map(move |(index, place)| kind(place).map(|(car, steps)| (index, (place, car, steps))))
    }

    /// The cars of these numbers.
    pub(super) fn among(&self, cars: Range<usize>) -> impl Iterator<Item = (usize, Aboard<'_, T, D, C>)> {
        self.from(cars.start).take(cars.len())
    }

    /// Whether more than `room` cars are on a bridge of `length_m` at once, `way_m` before and behind it included.
    fn crowds(&self, room: usize, length_m: T, way_m: T) -> bool {
        let cars = &self.train.cars;
        cars.iter().enumerate().any(|(i, first)| {
            let car = self.train.kinds.get(first.kind).map_or(T::zero(), Car::length_m);
            let reach = first.behind_m + car + length_m + way_m + way_m;
            cars.iter().skip(i).take_while(|other| other.behind_m <= reach).count() > room
        })
    }
}

/// A car: where it is in the train, what it is, its steps.
pub(super) type Aboard<'a, T, const D: usize, const C: usize> = (&'a Place<T>, &'a Car<T, D, C>, &'a CarSteps<T, D, C>);

/// The bridge with one damage pattern and a train running over it.
///
/// `M` modes, cars of `D` degrees of freedom and `C` contacts, at most `A` of them on the bridge at once.
///
/// A slow car over one sine mode of a 50 m beam bends it nearly as its standing loads would. A standing train, though, is
/// no run:
///
/// ```
/// use nalgebra::SVector;
/// use spanwatch::bridge::ModalBridge;
/// use spanwatch::interaction::{PlanarInteraction, Run, Scheme, SetupError, TrainSteps};
/// use spanwatch::train::PlanarTrain;
/// use spanwatch::track::Smooth;
/// use spanwatch::wire::message::TrainKind;
///
/// // m = 5000 kg/m, f1 = 3.5 Hz, mass-normalised: sqrt(2 / (m L)) sin(pi x / L), a node every 5 m, a sensor at mid-span.
/// let norm = (2.0 / (5000.0 * 50.0_f64)).sqrt();
/// let wave = std::f64::consts::PI / 50.0;
/// let position_m = std::array::from_fn(|node| 5.0 * node as f64);
/// let omega_squared = (std::f64::consts::TAU * 3.5).powi(2);
/// let bridge = ModalBridge::<f64, 1> {
///     omega_squared: SVector::from([omega_squared]),
///     damping: SVector::from([2.0 * 0.02 * omega_squared.sqrt()]),
///     position_m,
///     nodes: 11,
///     path: position_m.map(|x| [SVector::from([norm * (wave * x).sin()]), SVector::from([norm * wave * (wave * x).cos()])]),
///     sensors: [SVector::from([norm]); 3],
/// };
/// let train = PlanarTrain::of_kind(TrainKind::Inspection2Dof, 1).expect("one car");
/// let cars = TrainSteps::new(train, Scheme::Exact, 1e-3)?;
///
/// let mut solver = PlanarInteraction::new(bridge.clone(), &Smooth, &cars, Run::at(2.0))?;
/// let mut lowest_m = 0.0_f64;
/// for _ in 0..34_000 {
///     solver.step(&cars, &Smooth);
///     lowest_m = lowest_m.min(solver.displacement_m(0));
/// }
/// // Its two loads at 8.75 m before and behind mid-span.
/// let load_n = cars.train().kinds[0].contacts[0].load_n;
/// let standing_m = -2.0 * load_n * norm * norm * (wave * 8.75).cos() / omega_squared;
/// assert!((lowest_m / standing_m - 1.0).abs() < 0.01);
///
/// let standing = PlanarInteraction::new(bridge, &Smooth, &cars, Run::at(0.0));
/// assert_eq!(standing.err(), Some(SetupError::NotFinite));
/// # Ok::<(), SetupError>(())
/// ```
#[derive(Debug, Clone)]
pub struct Interaction<T: Real, B, const M: usize, const D: usize, const C: usize, const A: usize> {
    pub(super) bridge: B,
    pub(super) run: Run<T>,
    /// Static loads of each car, as parts of its kind's.
    loads: [T; CARS],
    pub(super) step_s: T,
    pub(super) steps: u32,
    pub(super) modes: ModeSteps<T, M>,
    pub(super) contact_beta_h2: T,
    /// Length of the bridge, m.
    pub(super) length_m: T,
    /// Distance from an end of the bridge within which its shapes are rounded, m for each m/s.
    pub(super) corner_s: T,
    pub(super) position: SVector<T, M>,
    pub(super) velocity: SVector<T, M>,
    pub(super) acceleration: SVector<T, M>,
    /// States of the cars that touch the bridge, car `c` at place `c % A`.
    cars: [CarState<T, D>; A],
    /// Cars that have reached the bridge so far, and those of them that have left it.
    pub(super) entered: usize,
    left: usize,
    /// The last approach that was stepped.
    pub(super) approach: Option<Approach<T, D>>,
}

/// The end of a car's approach over the irregular track.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Approach<T: Real, const D: usize> {
    /// Which kind of car.
    kind: usize,
    /// Time since its first wheelset was where the irregularity begins, s.
    pub since_s: T,
    /// State at that time.
    state: CarState<T, D>,
    /// Change of its acceleration a second.
    jerk: [T; D],
}

impl<T: Real, const D: usize> Approach<T, D> {
    /// State `later_s` after its end (before, if negative): four terms of Taylor's series. For a part of a step that is as exact as
    /// the step itself.
    pub fn state(&self, later_s: T) -> CarState<T, D> {
        let (half, third) = (T::of(0.5) * later_s, later_s / T::of(3.0));
        let mut state = self.state;
        add_scaled(&mut state.position, later_s, &self.state.velocity);
        add_scaled(&mut state.position, half * later_s, &self.state.acceleration);
        add_scaled(&mut state.position, half * later_s * third, &self.jerk);
        add_scaled(&mut state.velocity, later_s, &self.state.acceleration);
        add_scaled(&mut state.velocity, half * later_s, &self.jerk);
        add_scaled(&mut state.acceleration, later_s, &self.jerk);
        state
    }

    /// How that state changes with time.
    pub fn rate(&self, later_s: T) -> CarState<T, D> {
        let state = self.state(later_s);
        CarState {
            position: state.velocity,
            velocity: state.acceleration,
            acceleration: self.jerk,
        }
    }
}

/// The interaction as the logger has it: vertical motion on a girder.
pub type PlanarInteraction<T, const M: usize> = Interaction<
    T,
    ModalBridge<T, M>,
    M,
    { crate::capacity::CAR_DOFS },
    { crate::capacity::CONTACTS },
    { crate::capacity::CARS_ON_BRIDGE },
>;

/// A rounded corner of the shapes, at an end of the bridge.
pub(super) struct Rounded<T> {
    /// The end, in the bridge's coordinate, m.
    pub end: T,
    /// Distance inwards from it, in steps' ways.
    pub steps: T,
    /// What is added to a shape, per slope of it at the end, m.
    pub rise_m: T,
}

/// The shapes under a car's contacts.
type Shapes<T, const M: usize, const C: usize> = [[T; M]; C];

/// What couples cars and bridge in one step. Slot `s` belongs to the `s`-th car of those aboard.
#[derive(Debug, Clone)]
pub(super) struct Coupling<T: Real, const M: usize, const C: usize, const A: usize> {
    /// The bridge's matrix with the cars eliminated: its upper triangle, a row each; after the step, its triangular factor.
    /// With no car aboard only its diagonal counts, and is not factorised.
    pub matrix: [[T; M]; M],
    /// Shapes under the contacts, zero where they are not on the bridge.
    pub shapes: [Shapes<T, M, C>; A],
    /// Forces of the contacts on the bridge, but for what its acceleration in this step does to them, N.
    pub loads: [[T; C]; A],
    /// Contacts of each car that are on the bridge.
    pub on: [Range<usize>; A],
    /// Cars that touch the bridge.
    pub aboard: Range<usize>,
    /// Cars that had reached the bridge before this step.
    pub entered: usize,
    /// Where the train is.
    pub now: TrainPosition<T>,
    /// The bridge's position as the contacts feel it before its acceleration is known, and its velocity.
    pub felt: SVector<T, M>,
    pub felt_rate: SVector<T, M>,
}

impl<T: Real, const M: usize, const C: usize, const A: usize> Coupling<T, M, C, A> {
    pub fn none() -> Self {
        Self {
            matrix: [[T::zero(); M]; M],
            shapes: [[[T::zero(); M]; C]; A],
            loads: [[T::zero(); C]; A],
            on: core::array::from_fn(|_| 0..0),
            aboard: 0..0,
            entered: 0,
            now: TrainPosition {
                way_m: T::zero(),
                speed_mps: T::zero(),
            },
            felt: SVector::zeros(),
            felt_rate: SVector::zeros(),
        }
    }
}

impl<T, B, const M: usize, const D: usize, const C: usize, const A: usize> Interaction<T, B, M, D, C, A>
where
    T: Real,
    B: Modes<T, M>,
{
    /// Bridge and train at rest at time 0. A train whose entry lies before time 0 stands where its way has brought it, and its
    /// loads appear at once; one that enters less than [`CORNER_STEPS`] steps after time 0 has a part of its first rounded corner
    /// cut off.
    ///
    /// # Errors
    /// [`SetupError`] says which of speed, load factor, times and cars cannot be solved.
    pub fn new<const K: usize>(
        bridge: B,
        track: &(impl Track<T> + ?Sized),
        cars: &TrainSteps<T, D, C, K>,
        run: Run<T>,
    ) -> Result<Self, SetupError> {
        let positive = |value: T| value > T::zero() && value.is_finite();
        if ![run.speed_mps, run.load_factor].into_iter().all(positive)
            || ![run.entry_time_s, run.acceleration_mps2]
                .into_iter()
                .all(|value| value.is_finite())
        {
            return Err(SetupError::NotFinite);
        }
        let (h, length_m) = (cars.step_s, bridge.length_m());
        let corner_s = if cars.scheme.rounds_corners() {
            T::of(CORNER_STEPS) * h
        } else {
            T::zero()
        };
        let last = length_m + cars.train.length_m();
        let leaving = run.time_at_s(last).ok_or(SetupError::Stops)?;
        let fastest = run.speed_mps + (run.acceleration_mps2 * (leaving - run.entry_time_s)).max(T::zero());
        if cars.crowds(A, length_m, corner_s * fastest) {
            return Err(SetupError::TooManyOnBridge);
        }
        let this = Self {
            modes: ModeSteps::new(cars.scheme, h, bridge.omega_squared(), bridge.damping()),
            contact_beta_h2: cars.scheme.contact_beta::<T>() * h * h,
            bridge,
            run,
            loads: [T::one(); CARS],
            step_s: h,
            steps: 0,
            length_m,
            corner_s,
            position: SVector::zeros(),
            velocity: SVector::zeros(),
            acceleration: SVector::zeros(),
            cars: [CarState::AT_REST; A],
            entered: 0,
            left: 0,
            approach: None,
        };
        if run.time_at_s(this.first_way(track).unwrap_or(T::zero())).is_none() {
            return Err(SetupError::Stops);
        }
        Ok(this)
    }

    /// The same with cars of which each has such a part of its kind's static loads.
    pub fn with_loads(mut self, loads: [T; CARS]) -> Self {
        self.loads = loads;
        self
    }

    /// Factor of car `index`'s static loads.
    pub(super) fn load_of(&self, index: usize) -> T {
        self.run.load_factor * self.loads.get(index).copied().unwrap_or(T::one())
    }

    /// Modal displacements, kg^1/2 m.
    pub fn position(&self) -> &SVector<T, M> {
        &self.position
    }

    /// Modal velocities, kg^1/2 m/s.
    pub fn velocity(&self) -> &SVector<T, M> {
        &self.velocity
    }

    /// Modal accelerations, kg^1/2 m/s².
    pub fn acceleration(&self) -> &SVector<T, M> {
        &self.acceleration
    }

    /// Car `index` (from 0, front first) after the last step in which it touched the bridge; none before it has reached the
    /// bridge, and none once its memory has gone to a later car.
    pub fn car(&self, index: usize) -> Option<&CarState<T, D>> {
        let kept = index < self.entered && self.entered - index <= A;
        self.cars.get(index % A).filter(|_| kept)
    }

    /// By what the approach that was stepped last is known: it changes in the step that makes up for a car's approach, which costs as
    /// much as a hundred others.
    pub(super) fn last_approach(&self) -> Option<(usize, T)> {
        self.approach.as_ref().map(|approach| (approach.kind, approach.since_s))
    }

    /// Advances by one step. `cars` and `track` are those that the interaction began with.
    pub fn step<const K: usize>(&mut self, cars: &TrainSteps<T, D, C, K>, track: &(impl Track<T> + ?Sized)) {
        self.step_coupled(cars, track, &mut Coupling::none());
    }

    /// Advances by one step, and leaves in `coupling` what a sensitivity needs to follow it.
    #[inline(always)]
    pub(super) fn step_coupled<const K: usize>(
        &mut self,
        cars: &TrainSteps<T, D, C, K>,
        track: &(impl Track<T> + ?Sized),
        coupling: &mut Coupling<T, M, C, A>,
    ) {
        self.steps += 1;
        let h = self.step_s;
        let now = self.run.after(self.steps as i32, h);
        let corner_m = self.corner_s * now.speed_mps;
        coupling.now = now;
        coupling.aboard = self.left..self.left;
        coupling.entered = self.entered;
        if self.entered == 0 && now.way_m < -corner_m {
            // Nothing has happened yet.
            return;
        }
        let half_h = T::of(0.5) * h;
        let half_h2 = half_h * h;

        // The bridge, predicted: as the contacts feel it, and as its modes go.
        let drift = self.position + self.velocity * h;
        coupling.felt = drift + self.acceleration * (half_h2 - self.contact_beta_h2);
        self.position = drift
            + self
                .acceleration
                .zip_map(&self.modes.beta_h2, |a, beta_h2| a * (half_h2 - beta_h2));
        self.velocity += self.acceleration * half_h;
        coupling.felt_rate = self.velocity;
        let omega_squared = self.bridge.omega_squared();
        let mut force: [T; M] =
            core::array::from_fn(|k| -(self.modes.damping[k] * self.velocity[k] + omega_squared[k] * self.position[k]));
        for (k, row) in coupling.matrix.iter_mut().enumerate() {
            row[k] = self.modes.effective[k];
        }

        // The cars on it: predicted, and eliminated.
        for (index, (place, car, steps)) in cars.from(self.left) {
            let front = now.way_m - place.behind_m;
            if front < -corner_m {
                break;
            }
            // Until its last contact has left: on a bridge shorter than the car, the body swings on while none touches.
            if front - steps.length_m > self.length_m + corner_m {
                if coupling.aboard.is_empty() {
                    self.left = index + 1;
                    coupling.aboard = self.left..self.left;
                }
                continue;
            }
            if index >= self.entered {
                self.cars[index % A] = self.approached(place, car, steps, track);
                self.entered = index + 1;
            }
            let slot = index - coupling.aboard.start;
            coupling.aboard.end = index + 1;
            let (Some(shapes), Some(loads), Some(on)) = (
                coupling.shapes.get_mut(slot),
                coupling.loads.get_mut(slot),
                coupling.on.get_mut(slot),
            ) else {
                break;
            };
            let felt = [&coupling.felt, &coupling.felt_rate];
            *on = self.couple(index, car, steps, track, front, now.speed_mps, felt, shapes, loads);
            for (shape, &load) in shapes.iter().zip(loads.iter()).take(on.end).skip(on.start) {
                add_scaled(&mut force, load, shape);
            }
            steps.burden(on.clone(), shapes, &mut coupling.matrix);
        }

        if coupling.aboard.is_empty() {
            for (force, &effective) in force.iter_mut().zip(self.modes.effective.iter()) {
                *force /= effective;
            }
        } else {
            eliminate(&mut coupling.matrix, &mut force);
        }
        self.acceleration = SVector::from(force);
        for (position, (&a, &beta_h2)) in
            (self.position.iter_mut()).zip(self.acceleration.iter().zip(self.modes.beta_h2.iter()))
        {
            *position += a * beta_h2;
        }
        self.velocity += self.acceleration * half_h;

        for (shapes, (index, (_, car, steps))) in coupling.shapes.iter().zip(cars.among(coupling.aboard.clone())) {
            let mut w = [T::zero(); C];
            for (w, shape) in w.iter_mut().zip(shapes).take(car.contacts.len()) {
                *w = dot(shape, &force);
            }
            steps.correct(car.contacts.len(), &mut self.cars[index % A], &w);
        }
    }

    /// Predicts a car whose front is `front` m from the end that it enters by, with the bridge's predicted position and velocity
    /// as the contacts feel them. Fills in the shapes under its contacts, zero where they are not on the bridge, and their forces
    /// on it; gives which of them are.
    #[allow(
        clippy::too_many_arguments,
        reason = "a bundle of them would be copied at every car and step"
    )]
    fn couple(
        &mut self,
        index: usize,
        car: &Car<T, D, C>,
        steps: &CarSteps<T, D, C>,
        track: &(impl Track<T> + ?Sized),
        front: T,
        speed: T,
        [felt, felt_rate]: [&SVector<T, M>; 2],
        shapes: &mut Shapes<T, M, C>,
        loads: &mut [T; C],
    ) -> Range<usize> {
        let mut on = 0..0;
        let mut leads = [Lead::still(); C];
        let corner_m = self.corner_s * speed;
        for (i, ((contact, shape), lead)) in car.contacts.iter().zip(shapes.iter_mut()).zip(&mut leads).enumerate() {
            let way = front - contact.behind_m;
            *lead = self.irregularity(track, contact.motion, way, speed);
            if way < -corner_m || way > self.length_m + corner_m {
                continue;
            }
            // Contacts stand one behind the other, so those on the bridge are neighbours.
            on = if on.is_empty() { i } else { on.start }..i + 1;
            *shape = self.shape(contact, way, speed);
            lead.place += dot(shape, entries(felt));
            lead.rate += dot(shape, entries(felt_rate));
            if self.run.kinematics == Kinematics::Convective {
                self.roll_over(contact, way, speed, felt, lead);
            }
        }
        steps.predict(car, &mut self.cars[index % A], &leads, loads);
        let factor = self.load_of(index);
        for (load, contact) in loads.iter_mut().zip(&car.contacts) {
            *load -= factor * contact.load_n;
        }
        on
    }

    /// The shape under a contact `way` m from the end that the train enters by.
    fn shape(&self, contact: &Contact<T, D>, way: T, speed: T) -> [T; M] {
        let mut shape = self.bridge.shape(contact.motion, 0, self.along(way));
        if let Some(rounded) = self.rounded(way, speed) {
            let slope = self.bridge.shape(contact.motion, 1, rounded.end);
            add_scaled(&mut shape, rounded.rise_m, &slope);
        }
        shape
    }

    /// The corner that rounds the shapes at `way` m from the end that the train enters by, if there is one.
    pub(super) fn rounded(&self, way: T, speed: T) -> Option<Rounded<T>> {
        let to_go = self.length_m - way;
        let (from_end, end) = if way < to_go {
            (way, T::zero())
        } else {
            (to_go, self.length_m)
        };
        if from_end >= self.corner_s * speed {
            return None;
        }
        let step_m = speed * self.step_s;
        let steps = from_end / step_m;
        let end = self.along(end);
        let inward = if end == T::zero() { T::one() } else { -T::one() };
        Some(Rounded {
            end,
            steps,
            rise_m: inward * step_m * corner(steps),
        })
    }

    /// What the deflected rail's slope and curve do to a wheel that rolls over it, from the state as it is predicted.
    fn roll_over(&self, contact: &Contact<T, D>, way: T, speed: T, felt: &SVector<T, M>, lead: &mut Lead<T>) {
        let half_h = T::of(0.5) * self.step_s;
        let (along, x) = (self.signed(speed), self.along(way));
        let [slope, curvature] = [1, 2].map(|order| self.bridge.shape(contact.motion, order, x));
        // The accelerations at the end of the step are not known yet; those at its beginning stand in.
        let rate = dot(&slope, entries(&self.velocity)) + half_h * dot(&slope, entries(&self.acceleration));
        let incline = dot(&slope, entries(felt));
        lead.rate += along * incline;
        lead.acceleration += T::of(2.0) * along * rate
            + along * along * dot(&curvature, entries(felt))
            + self.signed(self.run.acceleration_mps2) * incline;
    }

    /// What the irregularity does to a contact `way` m from the end that the train enters by.
    pub(super) fn irregularity(&self, track: &(impl Track<T> + ?Sized), motion: Motion, way: T, speed: T) -> Lead<T> {
        if track.extent_m().is_none() {
            return Lead::still();
        }
        let r = track.at(motion, self.along(way));
        let along = self.signed(speed);
        Lead {
            place: r.value,
            rate: along * r.slope,
            acceleration: along * along * r.curvature + self.signed(self.run.acceleration_mps2) * r.slope,
        }
    }

    /// Change of that with the contact's way and the train's speed, for `way_by` m and `speed_by` m/s of them.
    pub(super) fn irregularity_by(
        &self,
        track: &(impl Track<T> + ?Sized),
        motion: Motion,
        [way, way_by]: [T; 2],
        [speed, speed_by]: [T; 2],
    ) -> Lead<T> {
        let r = track.at(motion, self.along(way));
        let (along, x_by, along_by) = (self.signed(speed), self.signed(way_by), self.signed(speed_by));
        Lead {
            place: r.slope * x_by,
            rate: along * r.curvature * x_by + r.slope * along_by,
            acceleration: along * along * r.curvature_rate * x_by
                + T::of(2.0) * along * along_by * r.curvature
                + self.signed(self.run.acceleration_mps2) * r.curvature * x_by,
        }
    }

    /// State of a car that has just reached the bridge, after its approach over the irregular track.
    fn approached(
        &mut self,
        place: &Place<T>,
        car: &Car<T, D, C>,
        steps: &CarSteps<T, D, C>,
        track: &(impl Track<T> + ?Sized),
    ) -> CarState<T, D> {
        let Some(since_s) = self.since_begin_s(place, track) else {
            return CarState::AT_REST;
        };
        if let Some((approach, later_s)) = self.shared(self.approach.as_ref(), place, since_s) {
            return approach.state(later_s);
        }
        let approach = self.approach(place, car, steps, since_s, |contact, way, speed| {
            self.irregularity(track, contact.motion, way, speed)
        });
        self.approach = Some(approach);
        approach.state
    }

    /// Time since a car's first wheelset was where the irregularity begins, as the last step ended, s; none on a smooth track.
    pub(super) fn since_begin_s(&self, place: &Place<T>, track: &(impl Track<T> + ?Sized)) -> Option<T> {
        let start_s = self.run.time_at_s(self.first_way(track)? + place.behind_m)?;
        Some(T::counted(self.steps as i32 - 1) * self.step_s - start_s)
    }

    /// An approach, if it is that of this car, too, and how much later this one's ends, s.
    pub(super) fn shared<'a>(
        &self,
        approach: Option<&'a Approach<T, D>>,
        place: &Place<T>,
        since_s: T,
    ) -> Option<(&'a Approach<T, D>, T)> {
        let approach = approach.filter(|last| self.shares(last, place, since_s))?;
        Some((approach, since_s - approach.since_s))
    }

    /// Whether an approach is that of this car, too, but for a part of a step.
    pub(super) fn shares(&self, approach: &Approach<T, D>, place: &Place<T>, since_s: T) -> bool {
        let part_of_step = (since_s - approach.since_s).abs() <= self.step_s;
        approach.kind == place.kind
            && (self.run.acceleration_mps2 == T::zero() || approach.since_s == since_s)
            && part_of_step
    }

    /// The end of a car's approach over rails that lead its contacts as `lead` says, of contact, way and speed. It has been under way for
    /// `since_s`.
    pub(super) fn approach(
        &self,
        place: &Place<T>,
        car: &Car<T, D, C>,
        steps: &CarSteps<T, D, C>,
        since_s: T,
        lead: impl Fn(&Contact<T, D>, T, T) -> Lead<T>,
    ) -> Approach<T, D> {
        let (mut state, mut before) = (CarState::AT_REST, CarState::<T, D>::AT_REST);
        let count = (since_s / self.step_s).max(T::zero()).whole();
        let first = (self.steps as i32 - 1).saturating_sub(count as i32);
        for step in first..self.steps as i32 {
            before = state;
            let TrainPosition { way_m, speed_mps } = self.run.after(step, self.step_s);
            let mut leads = [Lead::still(); C];
            for (contact, to) in car.contacts.iter().zip(&mut leads) {
                *to = lead(contact, way_m - place.behind_m - contact.behind_m, speed_mps);
            }
            steps.predict(car, &mut state, &leads, &mut [T::zero(); C]);
            steps.correct(0, &mut state, &[T::zero(); C]);
        }
        let inverse = self.step_s.recip();
        Approach {
            kind: place.kind,
            since_s,
            state,
            jerk: core::array::from_fn(|d| (state.acceleration[d] - before.acceleration[d]) * inverse),
        }
    }

    /// Where the irregularity begins, m from the end that the train enters by; none on a smooth track.
    fn first_way(&self, track: &(impl Track<T> + ?Sized)) -> Option<T> {
        let [begin, end] = track.extent_m()?;
        Some(match self.run.direction {
            Direction::Forward => begin,
            Direction::Backward => self.length_m - end,
        })
    }

    /// From the distance to the end that the train enters by to the bridge's coordinate.
    pub(super) fn along(&self, way: T) -> T {
        match self.run.direction {
            Direction::Forward => way,
            Direction::Backward => self.length_m - way,
        }
    }

    /// A speed or acceleration of the train in the bridge's coordinate.
    pub(super) fn signed(&self, speed: T) -> T {
        match self.run.direction {
            Direction::Forward => speed,
            Direction::Backward => -speed,
        }
    }
}

impl<T, const M: usize, const D: usize, const C: usize, const A: usize> Interaction<T, ModalBridge<T, M>, M, D, C, A>
where
    T: Real,
{
    /// Acceleration at observed sensor `channel`, m/s², positive up.
    pub fn acceleration_mps2(&self, channel: usize) -> T {
        self.bridge.sensors[channel].dot(&self.acceleration)
    }

    /// Displacement at observed sensor `channel`, m, positive up.
    pub fn displacement_m(&self, channel: usize) -> T {
        self.bridge.sensors[channel].dot(&self.position)
    }
}

/// Modes up to which a row is short.
const SHORT_ROW: usize = 16;

/// Solves `matrix x = rhs` in place, `matrix` symmetric, positive and given by its upper triangle, by elimination. Leaves the
/// triangular factor in `matrix`, the inverse of each pivot in its place, for [`substitute`].
///
/// Short rows are worked on whole, though half of each is not needed: loops of fixed length become straight code.
fn eliminate<T: Real, const M: usize>(matrix: &mut [[T; M]; M], rhs: &mut [T; M]) {
    for p in 0..M {
        let pivot = matrix[p];
        let inverse = pivot[p].recip();
        matrix[p][p] = inverse;
        let above = rhs[p];
        for r in p + 1..M {
            let factor = pivot[r] * inverse;
            if M <= SHORT_ROW {
                add_scaled(&mut matrix[r], -factor, &pivot);
            } else {
                for (target, &source) in matrix[r][r..].iter_mut().zip(&pivot[r..]) {
                    *target -= factor * source;
                }
            }
            rhs[r] -= factor * above;
        }
    }
    back_substitute(matrix, rhs);
}

/// Solves for another right-hand side with what [`eliminate`] left in `factor`.
pub(super) fn substitute<T: Real, const M: usize>(factor: &[[T; M]; M], rhs: &mut [T; M]) {
    for p in 0..M {
        let above = rhs[p] * factor[p][p];
        for r in p + 1..M {
            rhs[r] -= factor[p][r] * above;
        }
    }
    back_substitute(factor, rhs);
}

fn back_substitute<T: Real, const M: usize>(factor: &[[T; M]; M], rhs: &mut [T; M]) {
    for p in (0..M).rev() {
        let mut value = rhs[p];
        for c in p + 1..M {
            value -= factor[p][c] * rhs[c];
        }
        rhs[p] = value * factor[p][p];
    }
}
