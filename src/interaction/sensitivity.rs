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
//! ln load              dF_i = -W_i
//! ```
//!
//! and for a loss the shapes turn too: those of the modes that are stepped towards each other, which the source does, and towards
//! those that are not, `dphi_i = sum_f u_f g_f(x_i)` with `g_f` of [`Eigenmodes::remainders`], which adds `sum_f u_f sum_i g_f(x_i) F_i` to
//! the source and `sum_f g_f(sensor) u_f . q''` to what the sensor shows. What that does to the cars is left out.
//!
//! So each unknown costs a part of a step, not a step, and carries a state of its own (`Tangent`) through the passage; nothing
//! is stored of the past. What is left out: that `beta` and `c^` of [`scheme`](super::scheme) follow the frequency, the `lambda_k` in
//! `g_f`, and that a corner's width follows the speed. Together they are 0.6 % at most (`tests/sensitivity.rs`).
//!
//! On a smooth track, and with [`Kinematics::Paper`](super::Kinematics::Paper).

use super::car::{CarState, Lead};
use super::contact::{Modes as _, hermite};
use super::run::{SetupError, TrainPosition};
use super::scheme::corner_slope;
use super::simulation::{Hypothesis, Observation, Simulation};
use super::solver::{Coupling, PlanarInteraction, TrainSteps, substitute};
use crate::bridge::modes::Remainder;
use crate::bridge::{Eigenmodes, ReducedBridge};
use crate::capacity::{
    CAR_DOFS, CAR_KINDS, CARS_ON_BRIDGE, CHANNELS, CONTACTS, ELEMENTS, FACTORS, PATH_NODES, UNKNOWNS,
};
use crate::math::{Real, add_scaled, dot, entries};
use crate::recorder::AntiAliasState;
use crate::slot::Slot;
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

type Cars<T> = TrainSteps<T, CAR_DOFS, CONTACTS, CAR_KINDS>;
type Coupled<T, const M: usize> = Coupling<T, M, CONTACTS, CARS_ON_BRIDGE>;
/// A value for each contact of each car aboard.
type AtContacts<V> = [[V; CONTACTS]; CARS_ON_BRIDGE];

/// Derivative of the interaction's state by one unknown.
#[derive(Debug, Clone, Copy)]
struct Tangent<T: Real, const M: usize> {
    position: [T; M],
    velocity: [T; M],
    acceleration: [T; M],
    cars: [CarState<T, CAR_DOFS>; CARS_ON_BRIDGE],
    filters: [AntiAliasState<T>; CHANNELS],
}

/// What drives a tangent, besides itself.
struct Source<'a, T: Real, const M: usize> {
    /// A force on the modes.
    modal: [T; M],
    /// How the shapes under the contacts change with their way, and how far they move.
    turn: Option<(&'a Turn<T>, T)>,
    /// How much of the static loads is added.
    load: T,
}

/// What changed shapes under the contacts make of the bridge's predicted position, velocity and of its acceleration there, per metre.
struct Turn<T> {
    felt: AtContacts<T>,
    felt_rate: AtContacts<T>,
    acceleration: AtContacts<T>,
}

impl<T: Real> Turn<T> {
    fn none() -> Self {
        let zero = [[T::zero(); CONTACTS]; CARS_ON_BRIDGE];
        Self {
            felt: zero,
            felt_rate: zero,
            acceleration: zero,
        }
    }
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
    free: [bool; UNKNOWNS],
    tangents: [Tangent<T, M>; UNKNOWNS],
}

impl<T: Real, const M: usize> Tangent<T, M> {
    const AT_REST: Self = Self {
        position: [T::ZERO; M],
        velocity: [T::ZERO; M],
        acceleration: [T::ZERO; M],
        cars: [CarState::AT_REST; CARS_ON_BRIDGE],
        filters: [AntiAliasState::AT_REST; CHANNELS],
    };

    /// Follows a step that `base` has made.
    fn step(
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
                *state = CarState::AT_REST;
            }
            let mut leads = [Lead::still(); CONTACTS];
            for (i, (lead, shape)) in leads.iter_mut().zip(shapes).enumerate().take(on.end).skip(on.start) {
                lead.place = dot(shape, &felt);
                lead.rate = dot(shape, &self.velocity);
                if let Some((turn, by)) = source.turn {
                    lead.place += by * turn.felt[slot][i];
                    lead.rate += by * turn.felt_rate[slot][i];
                }
            }
            let mut loads = [T::zero(); CONTACTS];
            steps.predict(car, state, &leads, &mut loads);
            if let Some((turn, by)) = source.turn {
                for (load, impedance) in loads.iter_mut().zip(&steps.impedance) {
                    *load -= by * dot(impedance, &turn.acceleration[slot]);
                }
            }
            if source.load != T::zero() {
                for (load, contact) in loads.iter_mut().zip(&car.contacts) {
                    *load -= source.load * contact.load_n;
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
            if let Some((turn, by)) = source.turn {
                add_scaled(&mut w, by, &turn.acceleration[slot]);
            }
            steps.correct(car.contacts.len(), &mut self.cars[index % CARS_ON_BRIDGE], &w);
        }
    }
}

/// Forces of the contacts on the bridge in the step that was made, N.
fn forces<T: Real, const M: usize>(
    base: &PlanarInteraction<T, M>,
    cars: &Cars<T>,
    coupling: &Coupled<T, M>,
) -> AtContacts<T> {
    let mut forces = [[T::zero(); CONTACTS]; CARS_ON_BRIDGE];
    for (slot, (_, (_, _, steps))) in cars.among(coupling.aboard.clone()).enumerate() {
        let w = coupling.shapes[slot].map(|shape| dot(&shape, entries(&base.acceleration)));
        for i in coupling.on[slot].clone() {
            forces[slot][i] = coupling.loads[slot][i] - dot(&steps.impedance[i], &w);
        }
    }
    forces
}

impl<T: Real, const M: usize> PlanarInteraction<T, M> {
    /// The forces of the contacts, as forces and moments on the path's nodes.
    fn on_nodes(&self, cars: &Cars<T>, coupling: &Coupled<T, M>, forces: &AtContacts<T>) -> [[T; 2]; PATH_NODES] {
        let mut nodes = [[T::zero(); 2]; PATH_NODES];
        let TrainPosition { way_m, speed_mps } = coupling.now;
        for (slot, (_, (place, car, _))) in cars.among(coupling.aboard.clone()).enumerate() {
            for i in coupling.on[slot].clone() {
                let way = way_m - place.behind_m - car.contacts[i].behind_m;
                let Some((span, part, length)) = self.bridge.span(self.along(way)) else {
                    continue;
                };
                let Some([left, right]) = nodes
                    .get_mut(span..span + 2)
                    .and_then(|ends| ends.first_chunk_mut::<2>())
                else {
                    continue;
                };
                let force = forces[slot][i];
                let [w1, s1, w2, s2] = hermite(0, part, length).map(|weight| weight * force);
                let ends = [left, right];
                for (end, [w, s]) in ends.into_iter().zip([[w1, s1], [w2, s2]]) {
                    end[0] += w;
                    end[1] += s;
                }
                if let Some(rounded) = self.rounded(way, speed_mps) {
                    // The end of the bridge is an end of this span.
                    let end = if part < T::of(0.5) { span } else { span + 1 };
                    nodes[end][1] += rounded.rise_m * force;
                }
            }
        }
        nodes
    }

    /// What a metre of way does to the contacts, and its force on the modes.
    fn moved(&self, cars: &Cars<T>, coupling: &Coupled<T, M>, forces: &AtContacts<T>) -> (Turn<T>, [T; M]) {
        let (mut turn, mut modal) = (Turn::none(), [T::zero(); M]);
        let TrainPosition { way_m, speed_mps } = coupling.now;
        for (slot, (_, (place, car, _))) in cars.among(coupling.aboard.clone()).enumerate() {
            for i in coupling.on[slot].clone() {
                let contact = &car.contacts[i];
                let slope = self.shape_slope(contact, way_m - place.behind_m - contact.behind_m, speed_mps);
                turn.felt[slot][i] = dot(&slope, entries(&coupling.felt));
                turn.felt_rate[slot][i] = dot(&slope, entries(&coupling.felt_rate));
                turn.acceleration[slot][i] = dot(&slope, entries(&self.acceleration));
                add_scaled(&mut modal, forces[slot][i], &slope);
            }
        }
        (turn, modal)
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
        free: [false; UNKNOWNS],
        tangents: [Tangent::AT_REST; UNKNOWNS],
    };

    // Not inlined: the eigenproblem must leave the stack.
    /// Begins with a hypothesis, to be differentiated by the unknowns that are `free`; puts its simulation into `simulation`.
    #[inline(never)]
    pub fn begin(
        &mut self,
        bridge: &ReducedBridge<T>,
        hypothesis: &Hypothesis<T>,
        observed: &Observation<T>,
        free: &[bool; UNKNOWNS],
        simulation: &mut Slot<Simulation<T, M>>,
    ) -> Result<(), SetupError> {
        let modes = Eigenmodes::new(bridge, &hypothesis.damage);
        modes.shares(bridge, &mut self.shares);
        modes.remainders(bridge, M, &observed.places(), &mut self.remainders);
        let root = hypothesis.stiffness.sqrt();
        for (share, remainder) in self.shares.iter_mut().zip(&mut self.remainders) {
            *share = share.map(|u| u * root);
            remainder.path = remainder.path.map(|node| node.map(|g| g / root));
            remainder.sensors = remainder.sensors.map(|g| g / root);
        }
        self.factor_element = bridge.factor_element;
        self.factor_count = bridge.factor_count.min(FACTORS);
        self.p2 = bridge.rayleigh[1];
        self.free = *free;
        self.tangents.fill(Tangent::AT_REST);
        Simulation::begin_with(&modes, bridge, hypothesis, observed, simulation)
    }

    /// Number of unknowns that are differentiated by.
    pub fn free(&self) -> u32 {
        self.free.iter().map(|&free| u32::from(free)).sum()
    }

    /// The next sample of all channels of the simulation, m/s² (m), and its derivatives by each unknown, zero by those that are
    /// not free.
    pub fn sample(
        &mut self,
        simulation: &mut Simulation<T, M>,
        observed: &Observation<T>,
    ) -> ([T; CHANNELS], [[T; UNKNOWNS]; CHANNELS]) {
        let mut sample = [T::zero(); CHANNELS];
        let mut rows = [[T::zero(); UNKNOWNS]; CHANNELS];
        if simulation.start() {
            for _ in 0..observed.recorder.steps_per_sample {
                self.step(&mut simulation.interaction, observed, &mut rows);
                simulation.record(observed, &mut sample);
            }
        }
        (sample, rows)
    }

    fn step(
        &mut self,
        base: &mut PlanarInteraction<T, M>,
        observed: &Observation<T>,
        rows: &mut [[T; UNKNOWNS]; CHANNELS],
    ) {
        let mut coupling = Coupling::none();
        let cars = &observed.cars;
        base.step_coupled(cars, &mut coupling);
        let base = &*base;
        if base.entered == 0 {
            return;
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
                let modal = match sensor.quantity {
                    Quantity::Acceleration => &tangent.acceleration,
                    Quantity::Displacement => &tangent.position,
                };
                let raw = dot(entries(&base.bridge.sensors[channel]), modal) + *seen;
                row[unknown] = observed.filter.apply(&mut tangent.filters[channel], raw);
            }
        };
        let still = [T::zero(); CHANNELS];

        let on_nodes = base.on_nodes(cars, &coupling, &forces);
        let mut strained = *entries(q);
        add_scaled(&mut strained, self.p2, entries(v));
        for element in (0..ELEMENTS).filter(|&element| self.free[element]) {
            let (mut modal, mut seen) = ([T::zero(); M], still);
            for f in (0..self.factor_count).filter(|&f| usize::from(self.factor_element[f]) == element) {
                let (share, remainder) = (&self.shares[f], &self.remainders[f]);
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
            let source = Source {
                modal,
                turn: None,
                load: T::zero(),
            };
            follow(element, &source, &seen);
        }
        if self.free[STIFFNESS] {
            let modal = core::array::from_fn(|k| -base.bridge.omega_squared[k] * (q[k] + self.p2 * v[k]));
            let source = Source {
                modal,
                turn: None,
                load: T::zero(),
            };
            follow(STIFFNESS, &source, &still);
        }
        if self.free[SPEED] || self.free[ENTRY] {
            let (turn, modal) = base.moved(cars, &coupling, &forces);
            let since_entry = T::counted(base.steps as i32) * base.step_s - base.run.entry_time_s;
            for (unknown, way) in [
                (SPEED, base.run.speed_mps * since_entry),
                (ENTRY, -coupling.now.speed_mps),
            ] {
                if self.free[unknown] {
                    let source = Source {
                        modal: modal.map(|force| way * force),
                        turn: Some((&turn, way)),
                        load: T::zero(),
                    };
                    follow(unknown, &source, &still);
                }
            }
        }
        if self.free[LOAD] {
            let source = Source {
                modal: [T::zero(); M],
                turn: None,
                load: base.run.load_factor,
            };
            follow(LOAD, &source, &still);
        }
    }
}
