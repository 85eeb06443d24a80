//! Beams, trains and histories that the tests are made of.

use super::*;

/// Sensor place of mid-span: node 6 of 11.
pub const MID_SPAN: usize = 5;

/// The logger's model of a beam.
pub trait Reduced {
    fn reduced(&self) -> ReducedBridge<f64>;
}

impl Reduced for Beam {
    fn reduced(&self) -> ReducedBridge<f64> {
        model::reduce::reduce(&self.file(ELEMENTS, 8)).expect("reduces")
    }
}

pub fn damage(of: &[(usize, f64)]) -> Damage<f64> {
    let mut damage = [0.0; ELEMENTS];
    for &(element, loss) in of {
        damage[element - 1] = loss;
    }
    damage
}

/// One wheel: a body of `body_kg` on a spring and damper above `unsprung_kg`.
pub fn one_wheel(
    load_n: f64,
    body_kg: f64,
    stiffness_npm: f64,
    damping_nspm: f64,
    unsprung_kg: f64,
) -> PlanarTrain<f64> {
    let mut lever = [0.0; CAR_DOFS];
    lever[0] = 1.0;
    let wheel = Contact {
        behind_m: 0.0,
        motion: Motion::Vertical,
        load_n,
        unsprung: unsprung_kg,
        spring: Spring {
            stiffness: stiffness_npm,
            damping: damping_nspm,
            lever,
        },
    };
    let mut inertia = [1.0; CAR_DOFS];
    inertia[0] = body_kg;
    let car = Car {
        inertia,
        springs: heapless::Vec::new(),
        contacts: [wheel].into_iter().collect(),
    };
    Train::uniform(car, 1, 25.0).expect("one car")
}

pub fn inspection<T: Real>(cars: usize) -> PlanarTrain<T> {
    Train::of_kind(TrainKind::Inspection2Dof, cars).expect("1 to 16 cars")
}

pub fn shinkansen<T: Real>(cars: usize) -> PlanarTrain<T> {
    Train::of_kind(TrainKind::Shinkansen3d, cars).expect("1 to 16 cars")
}

pub fn run_at<T: Real>(speed_mps: f64, kinematics: Kinematics) -> Run<T> {
    Run {
        kinematics,
        ..Run::at(T::of(speed_mps))
    }
}

/// Displacement (m) and acceleration (m/s²) at `places`, a row a step, the first after one step.
pub struct History {
    pub displacement: Vec<[f64; 3]>,
    pub acceleration: Vec<[f64; 3]>,
}

pub fn history<T: Real, const M: usize>(
    modal: ModalBridge<T, M>,
    train: impl Borrow<PlanarTrain<T>>,
    run: Run<T>,
    step_s: f64,
    steps: usize,
) -> History {
    history_by(Scheme::AverageAcceleration, modal, train, run, step_s, steps)
}

/// The same by another scheme than the paper's.
pub fn history_by<T: Real, const M: usize>(
    scheme: Scheme,
    modal: ModalBridge<T, M>,
    train: impl Borrow<PlanarTrain<T>>,
    run: Run<T>,
    step_s: f64,
    steps: usize,
) -> History {
    let cars = TrainSteps::new(train.borrow().clone(), scheme, T::of(step_s)).expect("a train");
    let mut solver = PlanarInteraction::new(modal, &Smooth, &cars, run).expect("a run");
    let mut history = History {
        displacement: vec![],
        acceleration: vec![],
    };
    for _ in 0..steps {
        solver.step(&cars, &Smooth);
        history
            .displacement
            .push([0, 1, 2].map(|c| solver.displacement_m(c).into()));
        history
            .acceleration
            .push([0, 1, 2].map(|c| solver.acceleration_mps2(c).into()));
    }
    history
}

/// Mid-span displacement, m, under `train` on an undamaged beam with `M` modes.
pub fn mid_span<const M: usize>(
    beam: &Beam,
    train: impl Borrow<PlanarTrain<f64>>,
    run: Run<f64>,
    step_s: f64,
    duration_s: f64,
) -> Vec<f64> {
    let modal = ModalBridge::<f64, M>::new(&beam.reduced(), &[0.0; ELEMENTS], &[MID_SPAN]);
    let steps = (duration_s / step_s).round() as usize;
    history(modal, train, run, step_s, steps)
        .displacement
        .iter()
        .map(|row| row[0])
        .collect()
}

pub fn column(rows: &[[f64; 3]], channel: usize) -> Vec<f64> {
    rows.iter().map(|row| row[channel]).collect()
}

pub fn relative_rms(found: &[f64], expected: &[f64]) -> f64 {
    assert_eq!(found.len(), expected.len());
    let difference: f64 = found.iter().zip(expected).map(|(f, e)| (f - e) * (f - e)).sum();
    (difference / expected.iter().map(|e| e * e).sum::<f64>()).sqrt()
}

pub fn largest(values: &[f64]) -> f64 {
    values.iter().fold(0.0, |largest, value| value.abs().max(largest))
}
