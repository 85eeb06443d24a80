//! How the recorded motion changes with each unknown: the equations of a step, differentiated.
//!
//! Differentiating the coupled step by an unknown `p` leaves its matrix, factorised already, on the left:
//!
//! ```text
//! (E + sum_cars sum_ij phi_i Z_ij phi_j^T) da = sum_i (phi_i dF_i + dphi_i F_i) - c^ dq~' - w^2 dq~ + source
//! dF_i = dF~_i - sum_j Z_ij dphi_j . a        F~ of the cars' own changed states and leads
//!
//! loss of element e    source = sum_f u_f (u_f . q + p2 u_f . q')     over its factors f, u_f of [`Eigenmodes::shares`]
//! ln of all stiffness  source = -(w^2 q + p2 w^2 q')
//! ln speed, entry time dphi_i = phi_i' dx_i,  dx_i = v t, -v(t)         (t from the entry)
//! ln load              dF_i = -W_i            of a car's own load, by the part of it: of its contacts alone
//! the track            du_i = the change of the profile under contact i
//! ```
//!
//! Speed and entry time also move the contacts along the irregular rail, `du_i = r'(x_i) dx_i` and its rates, and change the state in
//! which a car comes from its approach.
//!
//! and for a loss the shapes turn too: those of the modes that are stepped towards each other, which the source does, and towards
//! those that are not, `dphi_i = sum_f u_f g_f(x_i)` with `g_f` of [`Eigenmodes::remainders`], which adds `sum_f u_f sum_i g_f(x_i) F_i` to
//! the source and `sum_f g_f(sensor) u_f . q''` to what the sensor shows. What that does to the cars is left out.
//!
//! So each unknown costs a part of a step, not a step, and carries a state of its own (`Tangent`) through the passage; nothing
//! is stored of the past. What is left out: that `beta` and `c^` of [`scheme`](super::scheme) follow the frequency, the `lambda_k` in
//! `g_f`, and that a corner's width follows the speed. Together they are 0.6 % at most (`tests/sensitivity.rs`).
//!
//! With [`Kinematics::Paper`](super::Kinematics::Paper).

use super::car::{CarState, Lead};
use super::contact::{Modes as _, hermite};
use super::response::Response;
use super::run::{Run, SetupError, TrainPosition};
use super::scheme::corner_slope;
use super::simulation::{Hypothesis, Observation, Simulation};
use super::solver::{Approach, Coupling, PlanarInteraction, TrainSteps, substitute};
use crate::bridge::modes::Remainder;
use crate::bridge::{Eigenmodes, ReducedBridge};
use crate::capacity::{
    CAR_DOFS, CAR_KINDS, CARS, CARS_ON_BRIDGE, CHANNELS, CONTACTS, ELEMENTS, FACTORS, PATH_NODES, UNKNOWNS,
};
use crate::math::{Real, add_scaled, dot, entries};
use crate::recorder::AntiAliasState;
use crate::slot::Slot;
use crate::track::Track;
use crate::track::profile::Profile;
use crate::train::Contact;
use crate::wire::message::Quantity;

/// Number of the unknown "logarithm of the stiffness of the whole bridge"; those before it are the elements' losses.
pub const STIFFNESS: usize = ELEMENTS;
/// Number of the unknown "logarithm of the speed".
pub const SPEED: usize = ELEMENTS + 1;
/// Number of the unknown "entry time, s".
pub const ENTRY: usize = ELEMENTS + 2;
/// Number of the unknown "logarithm of the load factor".
pub const LOAD: usize = ELEMENTS + 3;
/// Number of the unknown "load of the first car, as a part of its kind's"; the other cars' follow it.
pub const CAR_LOADS: usize = UNKNOWNS;
/// All that the motion is differentiated by.
pub const DERIVATIVES: usize = UNKNOWNS + CARS;

/// What is differentiated by, in the order of the numbers above.
pub type Wanted = [bool; DERIVATIVES];

/// The unknowns that are `free`, and the loads of the first so many cars.
pub fn wanted(free: &[bool; UNKNOWNS], cars: usize) -> Wanted {
    core::array::from_fn(|i| free.get(i).copied().unwrap_or(i < CAR_LOADS + cars))
}

pub(super) type Cars<T> = TrainSteps<T, CAR_DOFS, CONTACTS, CAR_KINDS>;
pub(super) type Coupled<T, const M: usize> = Coupling<T, M, CONTACTS, CARS_ON_BRIDGE>;
/// A value for each contact of each car aboard.
pub(super) type AtContacts<V> = [[V; CONTACTS]; CARS_ON_BRIDGE];

/// Derivative of the interaction's state by one unknown.
#[derive(Debug, Clone, Copy)]
pub(super) struct Tangent<T: Real, const M: usize> {
    position: [T; M],
    velocity: [T; M],
    acceleration: [T; M],
    cars: [CarState<T, CAR_DOFS>; CARS_ON_BRIDGE],
    filters: [AntiAliasState<T>; CHANNELS],
}

/// What drives a tangent, besides itself.
pub(super) struct Source<'a, T: Real, const M: usize> {
    /// A force on the modes.
    pub(super) modal: [T; M],
    /// How the shapes under the contacts change with their way, and how far they move.
    pub(super) turn: Option<(&'a AtContacts<Turn<T>>, T)>,
    /// By what part the train's own load factor is larger, of this car alone; of all, if of none.
    pub(super) load: Option<Option<usize>>,
    /// Change of what the irregularity does to the contacts.
    pub(super) rail: Option<&'a AtContacts<Lead<T>>>,
    /// Change of the state in which a car comes from its approach, by its number.
    pub(super) entering: &'a dyn Fn(usize) -> Entering<T>,
}

pub(super) type Entering<T> = CarState<T, CAR_DOFS>;

/// On a smooth track, whatever changes, a car comes at rest.
fn at_rest<T: Real>(_: usize) -> Entering<T> {
    CarState::AT_REST
}

impl<T: Real, const M: usize> Source<'_, T, M> {
    /// A force on the modes, and nothing else.
    pub(super) fn modal(modal: [T; M]) -> Self {
        Self {
            modal,
            turn: None,
            load: None,
            rail: None,
            entering: &at_rest,
        }
    }

    /// How the shapes under the contacts of the car in a slot change with their way, and how far they move.
    fn turn_of(&self, slot: usize) -> Option<(&[Turn<T>; CONTACTS], T)> {
        let (turn, by) = self.turn?;
        Some((turn.get(slot)?, by))
    }
}

/// What changed shapes under a contact make of the bridge's predicted position, velocity and of its acceleration there, per metre.
#[derive(Clone, Copy)]
pub(super) struct Turn<T> {
    felt: T,
    felt_rate: T,
    acceleration: T,
}

impl<T: Real> Turn<T> {
    const NONE: Self = Self {
        felt: T::ZERO,
        felt_rate: T::ZERO,
        acceleration: T::ZERO,
    };
}

/// The derivatives of a [`Simulation`] by the unknowns, followed step by step. Large: it belongs in static memory, and
/// [`Self::begin`] makes it ready in place.
#[derive(Debug, Clone)]
pub struct Sensitivities<T: Real, const M: usize> {
    shares: [[T; M]; FACTORS],
    remainders: [Remainder<T>; FACTORS],
    factor_element: [u8; FACTORS],
    factor_count: usize,
    /// Rayleigh's coefficient of the stiffness, s.
    p2: T,
    wanted: Wanted,
    tangents: [Tangent<T, M>; DERIVATIVES],
    /// Derivative of the last approach by the logarithm of the speed, as if that moved the car about the end of the bridge.
    by_speed: Option<Approach<T, CAR_DOFS>>,
}

impl<T: Real, const M: usize> Tangent<T, M> {
    pub(super) const AT_REST: Self = Self {
        position: [T::ZERO; M],
        velocity: [T::ZERO; M],
        acceleration: [T::ZERO; M],
        cars: [CarState::AT_REST; CARS_ON_BRIDGE],
        filters: [AntiAliasState::AT_REST; CHANNELS],
    };

    /// What the recorder keeps of channel `c`, `more` added to what its sensor feels of the modes.
    pub(super) fn recorded(
        &mut self,
        base: &PlanarInteraction<T, M>,
        observed: &Observation<T>,
        c: usize,
        quantity: Quantity,
        more: T,
    ) -> T {
        let modal = match quantity {
            Quantity::Acceleration => &self.acceleration,
            Quantity::Displacement => &self.position,
        };
        let raw = dot(entries(&base.bridge.sensors[c]), modal) + more;
        observed.filter.apply(&mut self.filters[c], raw)
    }

    /// Follows a step that `base` has made.
    pub(super) fn step(
        &mut self,
        base: &PlanarInteraction<T, M>,
        cars: &Cars<T>,
        coupling: &Coupled<T, M>,
        source: &Source<'_, T, M>,
    ) {
        let h = base.step_s;
        let half_h = T::of(0.5) * h;
        let half_h2 = half_h * h;
        let omega_squared = base.bridge.omega_squared;
        let mut felt = self.position;
        add_scaled(&mut felt, h, &self.velocity);
        self.position = felt;
        add_scaled(&mut felt, half_h2 - base.contact_beta_h2, &self.acceleration);
        add_scaled(&mut self.velocity, half_h, &self.acceleration);
        let mut force = source.modal;
        for k in 0..M {
            self.position[k] += (half_h2 - base.modes.beta_h2[k]) * self.acceleration[k];
            force[k] -= base.modes.damping[k] * self.velocity[k] + omega_squared[k] * self.position[k];
        }

        let slots = || {
            let coupled = coupling.shapes.iter().zip(&coupling.on).enumerate();
            cars.among(coupling.aboard.clone()).zip(coupled)
        };
        for ((index, (_, car, steps)), (slot, (shapes, on))) in slots() {
            let state = &mut self.cars[index % CARS_ON_BRIDGE];
            if index >= coupling.entered {
                *state = (source.entering)(index);
            }
            let rail = source.rail.and_then(|rail| rail.get(slot));
            let turn = source.turn_of(slot);
            let mut leads = rail.copied().unwrap_or([Lead::still(); CONTACTS]);
            for (lead, shape) in leads.iter_mut().zip(shapes).take(on.end).skip(on.start) {
                lead.place += dot(shape, &felt);
                lead.rate += dot(shape, &self.velocity);
            }
            if let Some((turn, by)) = turn {
                for (lead, turn) in leads.iter_mut().zip(turn).take(on.end).skip(on.start) {
                    lead.place += by * turn.felt;
                    lead.rate += by * turn.felt_rate;
                }
            }
            let mut loads = [T::zero(); CONTACTS];
            steps.predict(car, state, &leads, &mut loads);
            if let Some((turn, by)) = turn {
                let acceleration = turn.map(|turn| turn.acceleration);
                for (load, impedance) in loads.iter_mut().zip(&steps.impedance) {
                    *load -= by * dot(impedance, &acceleration);
                }
            }
            let added = match source.load {
                Some(Some(car)) if car == index => base.run.load_factor,
                Some(None) => base.load_of(index),
                _ => T::zero(),
            };
            if added != T::zero() {
                for (load, contact) in loads.iter_mut().zip(&car.contacts) {
                    *load -= added * contact.load_n;
                }
            }
            for (&load, shape) in loads.iter().zip(shapes).take(on.end).skip(on.start) {
                add_scaled(&mut force, load, shape);
            }
        }

        if coupling.aboard.is_empty() {
            for (force, &effective) in force.iter_mut().zip(base.modes.effective.iter()) {
                *force /= effective;
            }
        } else {
            substitute(&coupling.matrix, &mut force);
        }
        self.acceleration = force;
        for (k, &acceleration) in force.iter().enumerate() {
            self.position[k] += base.modes.beta_h2[k] * acceleration;
        }
        add_scaled(&mut self.velocity, half_h, &force);

        for ((index, (_, car, steps)), (slot, (shapes, on))) in slots() {
            let mut w = [T::zero(); CONTACTS];
            for (w, shape) in w.iter_mut().zip(shapes).take(on.end).skip(on.start) {
                *w = dot(shape, &force);
            }
            if let Some((turn, by)) = source.turn_of(slot) {
                add_scaled(&mut w, by, &turn.map(|turn| turn.acceleration));
            }
            steps.correct(car.contacts.len(), &mut self.cars[index % CARS_ON_BRIDGE], &w);
        }
    }
}

/// Change of a contact's way, m, and of its speed, m/s, per unit of the unknown speed or entry time.
fn moves<T: Real>(unknown: usize, run: &Run<T>, now: &TrainPosition<T>, since_entry_s: T) -> (T, T) {
    if unknown == ENTRY {
        (-now.speed_mps, -run.acceleration_mps2)
    } else {
        (run.speed_mps * since_entry_s, run.speed_mps)
    }
}

/// Forces of the contacts on the bridge in the step that was made, N.
fn forces<T: Real, const M: usize>(
    base: &PlanarInteraction<T, M>,
    cars: &Cars<T>,
    coupling: &Coupled<T, M>,
) -> AtContacts<T> {
    let mut forces = [[T::zero(); CONTACTS]; CARS_ON_BRIDGE];
    let slots = (coupling.shapes.iter().zip(&coupling.on)).zip(coupling.loads.iter().zip(&mut forces));
    for ((_, (_, _, steps)), ((shapes, on), (loads, forces))) in cars.among(coupling.aboard.clone()).zip(slots) {
        let w = shapes.map(|shape| dot(&shape, entries(&base.acceleration)));
        let contacts = forces.iter_mut().zip(loads).zip(&steps.impedance);
        for ((force, &load), impedance) in contacts.take(on.end).skip(on.start) {
            *force = load - dot(impedance, &w);
        }
    }
    forces
}

impl<T: Real, const M: usize> PlanarInteraction<T, M> {
    /// The forces of the contacts, as forces and moments on the path's nodes.
    fn on_nodes(&self, cars: &Cars<T>, coupling: &Coupled<T, M>, forces: &AtContacts<T>) -> [[T; 2]; PATH_NODES] {
        let mut nodes = [[T::zero(); 2]; PATH_NODES];
        let TrainPosition { way_m, speed_mps } = coupling.now;
        let slots = coupling.on.iter().zip(forces);
        for ((_, (place, car, _)), (on, forces)) in cars.among(coupling.aboard.clone()).zip(slots) {
            for (contact, &force) in car.contacts.iter().zip(forces).take(on.end).skip(on.start) {
                let way = way_m - place.behind_m - contact.behind_m;
                let Some((span, part, length)) = self.bridge.span(self.along(way)) else {
                    continue;
                };
                let Some([left, right]) = nodes
                    .get_mut(span..span + 2)
                    .and_then(|ends| ends.first_chunk_mut::<2>())
                else {
                    continue;
                };
                let [w1, s1, w2, s2] = hermite(0, part, length).map(|weight| weight * force);
                for (end, [w, s]) in [(&mut *left, [w1, s1]), (&mut *right, [w2, s2])] {
                    end[0] += w;
                    end[1] += s;
                }
                if let Some(rounded) = self.rounded(way, speed_mps) {
                    // The end of the bridge is an end of this span.
                    let [_, moment] = if part < T::of(0.5) { left } else { right };
                    *moment += rounded.rise_m * force;
                }
            }
        }
        nodes
    }

    /// What a metre of way does to the contacts, and its force on the modes.
    fn moved(&self, cars: &Cars<T>, coupling: &Coupled<T, M>, forces: &AtContacts<T>) -> (AtContacts<Turn<T>>, [T; M]) {
        let mut turns = [[Turn::NONE; CONTACTS]; CARS_ON_BRIDGE];
        let mut modal = [T::zero(); M];
        let TrainPosition { way_m, speed_mps } = coupling.now;
        let slots = coupling.on.iter().zip(forces.iter().zip(&mut turns));
        for ((_, (place, car, _)), (on, (forces, turns))) in cars.among(coupling.aboard.clone()).zip(slots) {
            let contacts = car.contacts.iter().zip(forces.iter().zip(turns));
            for (contact, (&force, turn)) in contacts.take(on.end).skip(on.start) {
                let slope = self.shape_slope(contact, way_m - place.behind_m - contact.behind_m, speed_mps);
                *turn = Turn {
                    felt: dot(&slope, entries(&coupling.felt)),
                    felt_rate: dot(&slope, entries(&coupling.felt_rate)),
                    acceleration: dot(&slope, entries(&self.acceleration)),
                };
                add_scaled(&mut modal, force, &slope);
            }
        }
        (turns, modal)
    }

    /// What `lead` says of each contact of the cars aboard and of its way, m from the end that the train enters by.
    pub(super) fn rail(
        &self,
        cars: &Cars<T>,
        coupling: &Coupled<T, M>,
        lead: impl Fn(&Contact<T, CAR_DOFS>, T) -> Lead<T>,
    ) -> AtContacts<Lead<T>> {
        let mut rail = [[Lead::still(); CONTACTS]; CARS_ON_BRIDGE];
        let way_m = coupling.now.way_m;
        for (leads, (_, (place, car, _))) in rail.iter_mut().zip(cars.among(coupling.aboard.clone())) {
            for (to, contact) in leads.iter_mut().zip(&car.contacts) {
                *to = lead(contact, way_m - place.behind_m - contact.behind_m);
            }
        }
        rail
    }

    /// Derivative of car `index`'s approach by the logarithm of the speed, its first wheelset's way counted from the end of the
    /// bridge; `last`, if that is it. None on a smooth track, and where the speed changes on the way: there it is left out.
    fn approach_by_speed(
        &self,
        index: usize,
        cars: &Cars<T>,
        track: &Profile<T>,
        last: Option<Approach<T, CAR_DOFS>>,
    ) -> Option<Approach<T, CAR_DOFS>> {
        if self.run.acceleration_mps2 != T::zero() {
            return None;
        }
        self.approach_of(index, cars, track, last, |contact, way, speed| {
            self.irregularity_by(track, contact.motion, [way, way + contact.behind_m], [speed, speed])
        })
    }

    /// The approach of car `index`, which has reached the bridge in this step, over rails that lead as `lead` says from the
    /// beginning of `track` on; `last`, if that is it.
    pub(super) fn approach_of(
        &self,
        index: usize,
        cars: &Cars<T>,
        track: &Profile<T>,
        last: Option<Approach<T, CAR_DOFS>>,
        lead: impl Fn(&Contact<T, CAR_DOFS>, T, T) -> Lead<T>,
    ) -> Option<Approach<T, CAR_DOFS>> {
        let (_, (place, car, steps)) = cars.from(index).next()?;
        let since_s = self.since_begin_s(place, track)?;
        let fits = |last: &Approach<T, CAR_DOFS>| self.shares(last, place, since_s);
        last.filter(fits)
            .or_else(|| Some(self.approach(place, car, steps, since_s, lead)))
    }

    /// Derivative by `unknown` of the state in which car `index` comes from its approach; `by_speed` is its derivative by the speed.
    ///
    /// All that is due to the entry time is a shift in time. A change `dv` of the speed moves the car's front by `dv / v` of its way from
    /// the end of the bridge, as `by_speed` has it, and by `dv / v` of its distance behind the first car's, again a shift in time.
    fn entering_by(
        &self,
        unknown: usize,
        index: usize,
        cars: &Cars<T>,
        track: &Profile<T>,
        by_speed: Option<&Approach<T, CAR_DOFS>>,
    ) -> Entering<T> {
        let approached = || {
            let (_, (place, _, _)) = cars.from(index).next()?;
            let since_s = self.since_begin_s(place, track)?;
            let (approach, later_s) = self.shared(self.approach.as_ref(), place, since_s)?;
            let rate = approach.rate(later_s);
            if unknown == ENTRY {
                return Some(rate.scaled(-T::one()));
            }
            let (by_speed, later_s) = self.shared(by_speed, place, since_s)?;
            let mut state = by_speed.state(later_s);
            state.add_scaled(place.behind_m / self.run.speed_mps, &rate);
            Some(state)
        };
        approached().unwrap_or(CarState::AT_REST)
    }

    /// Change of the shape under a contact per metre of its way.
    fn shape_slope(&self, contact: &Contact<T, CAR_DOFS>, way: T, speed: T) -> [T; M] {
        let mut slope = [T::zero(); M];
        let forward = self.signed(T::one());
        if way >= T::zero() && way <= self.length_m {
            let here = self.bridge.shape(contact.motion, 1, self.along(way));
            add_scaled(&mut slope, forward, &here);
        }
        if let Some(rounded) = self.rounded(way, speed) {
            // At the far end the slope inwards and the distance from the end both change their sign.
            let at_end = self.bridge.shape(contact.motion, 1, rounded.end);
            add_scaled(&mut slope, forward * corner_slope(rounded.steps), &at_end);
        }
        slope
    }
}

impl<T: Real, const M: usize> Sensitivities<T, M> {
    /// Of nothing yet.
    pub const NONE: Self = Self {
        shares: [[T::ZERO; M]; FACTORS],
        remainders: [Remainder::NONE; FACTORS],
        factor_element: [0; FACTORS],
        factor_count: 0,
        p2: T::ZERO,
        wanted: [false; DERIVATIVES],
        tangents: [Tangent::AT_REST; DERIVATIVES],
        by_speed: None,
    };

    // Not inlined: the eigenproblem must leave the stack.
    /// Begins with a hypothesis, to be differentiated by what is `wanted`; puts its simulation into `simulation`.
    #[inline(never)]
    pub fn begin(
        &mut self,
        bridge: &ReducedBridge<T>,
        hypothesis: &Hypothesis<T>,
        observed: &Observation<T>,
        track: &Profile<T>,
        wanted: &Wanted,
        simulation: &mut Slot<Simulation<T, M>>,
    ) -> Result<(), SetupError> {
        let modes = Eigenmodes::new(bridge, &hypothesis.damage);
        modes.shares(bridge, &mut self.shares);
        modes.remainders(bridge, M, observed.places(), &mut self.remainders);
        let root = hypothesis.stiffness.sqrt();
        for (share, remainder) in self.shares.iter_mut().zip(&mut self.remainders) {
            *share = share.map(|u| u * root);
            remainder.path = remainder.path.map(|node| node.map(|g| g / root));
            remainder.sensors = remainder.sensors.map(|g| g / root);
        }
        self.factor_element = bridge.factor_element;
        self.factor_count = bridge.factor_count.min(FACTORS);
        self.p2 = bridge.rayleigh[1];
        self.wanted = *wanted;
        self.tangents.fill(Tangent::AT_REST);
        self.by_speed = None;
        Simulation::begin_with(&modes, bridge, hypothesis, observed, track, simulation)
    }

    /// Number of derivatives.
    pub fn count(&self) -> u32 {
        self.wanted.iter().map(|&wanted| u32::from(wanted)).sum()
    }

    /// The next sample of all channels of the simulation, m/s² (m), and its derivatives, zero by what is not
    /// wanted.
    pub fn sample(
        &mut self,
        simulation: &mut Simulation<T, M>,
        observed: &Observation<T>,
        track: &Profile<T>,
    ) -> ([T; CHANNELS], [[T; DERIVATIVES]; CHANNELS]) {
        self.sample_with(simulation, observed, track, &mut [])
    }

    /// The same, and lets `responses` follow.
    pub fn sample_with(
        &mut self,
        simulation: &mut Simulation<T, M>,
        observed: &Observation<T>,
        track: &Profile<T>,
        responses: &mut [Response<T, M>],
    ) -> ([T; CHANNELS], [[T; DERIVATIVES]; CHANNELS]) {
        let mut sample = [T::zero(); CHANNELS];
        let mut rows = [[T::zero(); DERIVATIVES]; CHANNELS];
        if simulation.start() {
            for _ in 0..observed.recorder.steps_per_sample {
                self.step(&mut simulation.interaction, observed, track, &mut rows, responses);
                simulation.record(observed, &mut sample);
            }
        }
        (sample, rows)
    }

    fn step(
        &mut self,
        base: &mut PlanarInteraction<T, M>,
        observed: &Observation<T>,
        track: &Profile<T>,
        rows: &mut [[T; DERIVATIVES]; CHANNELS],
        responses: &mut [Response<T, M>],
    ) {
        let mut coupling = Coupling::none();
        let cars = &observed.cars;
        base.step_coupled(cars, track, &mut coupling);
        let base = &*base;
        if base.entered == 0 {
            return;
        }
        if self.wanted[SPEED] && coupling.aboard.end > coupling.entered {
            self.by_speed = base.approach_by_speed(coupling.entered, cars, track, self.by_speed.take());
        }
        let forces = forces(base, cars, &coupling);
        let (q, v, a) = (&base.position, &base.velocity, &base.acceleration);
        let mut follow = |unknown: usize, source: &Source<'_, T, M>, seen: &[T; CHANNELS]| {
            let Some(tangent) = self.tangents.get_mut(unknown) else {
                return;
            };
            tangent.step(base, cars, &coupling, source);
            let channels = observed.recorder.sensors.iter().zip(rows.iter_mut()).zip(seen);
            for (channel, ((sensor, row), seen)) in channels.enumerate() {
                row[unknown] = tangent.recorded(base, observed, channel, sensor.quantity, *seen);
            }
        };
        let wanted = |unknown: usize| self.wanted.get(unknown).is_some_and(|&wanted| wanted);
        let still = [T::zero(); CHANNELS];
        let by_speed = self.by_speed.as_ref();

        let on_nodes = base.on_nodes(cars, &coupling, &forces);
        let mut strained = *entries(q);
        add_scaled(&mut strained, self.p2, entries(v));
        for element in (0..ELEMENTS).filter(|&element| wanted(element)) {
            let (mut modal, mut seen) = ([T::zero(); M], still);
            let factors = self.factor_element.iter().enumerate().take(self.factor_count);
            let own = factors.filter(|&(_, &of)| usize::from(of) == element);
            for (share, remainder) in own.filter_map(|(f, _)| self.shares.get(f).zip(self.remainders.get(f))) {
                let mut pull = dot(share, &strained);
                if !coupling.aboard.is_empty() {
                    for (on, g) in on_nodes.iter().zip(&remainder.path) {
                        pull += on[0] * g[0] + on[1] * g[1];
                    }
                }
                add_scaled(&mut modal, pull, share);
                let [position, acceleration] = [q, a].map(|modal| dot(share, entries(modal)));
                for ((seen, g), sensor) in seen.iter_mut().zip(remainder.sensors).zip(&observed.recorder.sensors) {
                    *seen += g * match sensor.quantity {
                        Quantity::Acceleration => acceleration,
                        Quantity::Displacement => position,
                    };
                }
            }
            follow(element, &Source::modal(modal), &seen);
        }
        if wanted(STIFFNESS) {
            let modal = core::array::from_fn(|k| -base.bridge.omega_squared[k] * (q[k] + self.p2 * v[k]));
            follow(STIFFNESS, &Source::modal(modal), &still);
        }
        if wanted(SPEED) || wanted(ENTRY) {
            let (turn, modal) = base.moved(cars, &coupling, &forces);
            let since_entry = T::counted(base.steps as i32) * base.step_s - base.run.entry_time_s;
            for unknown in [SPEED, ENTRY].into_iter().filter(|&unknown| wanted(unknown)) {
                let (way_by, speed_by) = moves(unknown, &base.run, &coupling.now, since_entry);
                let speed = [coupling.now.speed_mps, speed_by];
                let rail = track.extent_m().map(|_| {
                    base.rail(cars, &coupling, |contact, way| {
                        base.irregularity_by(track, contact.motion, [way, way_by], speed)
                    })
                });
                let source = Source {
                    modal: modal.map(|force| way_by * force),
                    turn: Some((&turn, way_by)),
                    rail: rail.as_ref(),
                    entering: &|index| base.entering_by(unknown, index, cars, track, by_speed),
                    ..Source::modal([T::zero(); M])
                };
                follow(unknown, &source, &still);
            }
        }
        if wanted(LOAD) {
            let source = Source {
                load: Some(None),
                ..Source::modal([T::zero(); M])
            };
            follow(LOAD, &source, &still);
        }
        // Before a car has come its load moves nothing.
        for car in (0..base.entered).filter(|&car| wanted(CAR_LOADS + car)) {
            let source = Source {
                load: Some(Some(car)),
                ..Source::modal([T::zero(); M])
            };
            follow(CAR_LOADS + car, &source, &still);
        }
        for response in responses {
            response.step(base, observed, &coupling);
        }
    }
}
