//! The passages that are timed: girder50, 8 modes, a train at 270 km/h, only the steps from its first wheelset's entry to its last
//! one's leaving.

use std::fmt;

use host_sim::crossing::{Crossing, State};
use host_sim::model::eigen::Wanted;
use host_sim::model::modal::ModalModel;
use host_sim::model::reduce::reduce;
use host_sim::model::{self, Structure};
use host_sim::train::TrainName;
use spanwatch::bridge::ModalBridge;
use spanwatch::capacity::{CAR_DOFS, CAR_KINDS, CONTACTS, ELEMENTS, MODES};
use spanwatch::interaction::{PlanarInteraction, Run, Scheme, TrainSteps};
use spanwatch::math::Real;
use spanwatch::track::Smooth;
use spanwatch::train::PlanarTrain;
use spanwatch::wire::message::TrainKind;

pub const BRIDGE: &str = "girder50";
/// 270 km/h.
pub const SPEED_MPS: f64 = 75.0;
/// Sensor place of node 6, mid-span.
const MID_SPAN: usize = 5;

/// A train that the logger knows.
#[derive(Debug, Clone, Copy)]
pub struct Traffic {
    pub kind: TrainKind,
    pub cars: usize,
}

impl Traffic {
    pub fn name(self) -> TrainName {
        TrainName::Known(self.kind)
    }

    /// Time from the first wheelset's entry to the last one's leaving, s.
    pub fn on_bridge_s(self) -> f64 {
        let train = PlanarTrain::<f64>::of_kind(self.kind, self.cars).expect("1 to 16 cars");
        (girder::<f64>().length_m() + train.length_m()) / SPEED_MPS
    }
}

impl fmt::Display for Traffic {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} x {}", self.cars, self.name().name())
    }
}

/// The undamaged girder as the logger steps it, observed at mid-span.
pub fn girder<T: Real>() -> ModalBridge<T, MODES> {
    let reduced = reduce(&model::shipped(BRIDGE).expect("ships")).expect("stands");
    ModalBridge::new(&reduced.cast(), &[T::zero(); ELEMENTS], &[MID_SPAN])
}

/// The train, ready for steps of `step_s`.
pub fn cars<T: Real>(traffic: Traffic, scheme: Scheme, step_s: f64) -> TrainSteps<T, CAR_DOFS, CONTACTS, CAR_KINDS> {
    let train = PlanarTrain::of_kind(traffic.kind, traffic.cars).expect("1 to 16 cars");
    TrainSteps::new(train, scheme, T::of(step_s)).expect("can be stepped")
}

/// A passage that begins again when the train has left.
pub struct Endless<'a, T: Real> {
    cars: &'a TrainSteps<T, CAR_DOFS, CONTACTS, CAR_KINDS>,
    start: PlanarInteraction<T, MODES>,
    now: PlanarInteraction<T, MODES>,
    /// Steps of a passage.
    pub steps: u32,
    done: u32,
}

impl<'a, T: Real> Endless<'a, T> {
    pub fn new(traffic: Traffic, cars: &'a TrainSteps<T, CAR_DOFS, CONTACTS, CAR_KINDS>) -> Self {
        let run = Run::at(T::of(SPEED_MPS));
        let start = PlanarInteraction::new(girder(), &Smooth, cars, run).expect("can be solved");
        let step_s: f64 = cars.step_s().into();
        Self {
            cars,
            now: start.clone(),
            start,
            steps: (traffic.on_bridge_s() / step_s) as u32,
            done: 0,
        }
    }

    /// The next step; the displacement of mid-span after it, m.
    pub fn step(&mut self) -> T {
        if self.done == self.steps {
            self.now.clone_from(&self.start);
            self.done = 0;
        }
        self.now.step(self.cars, &Smooth);
        self.done += 1;
        self.now.displacement_m(0)
    }
}

/// The same train in space: 15 degrees of freedom a car.
pub struct InSpace {
    model: ModalModel,
    train: host_sim::train::SpatialTrain,
    scheme: Scheme,
    step_s: f64,
    /// Steps of a passage.
    pub steps: usize,
}

impl InSpace {
    pub fn new(traffic: Traffic, scheme: Scheme, step_s: f64) -> Self {
        let girder = Structure::new(model::shipped(BRIDGE).expect("ships")).expect("stands");
        Self {
            model: ModalModel::new(&girder, &[], Wanted::Count(MODES)).expect("has modes"),
            train: traffic.name().train(Some(traffic.cars)).expect("1 to 16 cars"),
            scheme,
            step_s,
            steps: (traffic.on_bridge_s() / step_s) as usize,
        }
    }

    /// A whole passage, its preparation included.
    pub fn solve(&self, each: &mut dyn FnMut(State<'_>)) {
        Crossing {
            model: &self.model,
            train: &self.train,
            run: Run::at(SPEED_MPS),
            track: None,
            scheme: self.scheme,
            step_s: self.step_s,
        }
        .solve(self.steps, each)
        .expect("can be solved");
    }
}
