//! The derivatives that an identification descends by: against differences of whole simulations.

use host_sim::model::{self, reduce::reduce};
use spanwatch::bridge::ReducedBridge;
use spanwatch::capacity::{ELEMENTS, MODES, UNKNOWNS};
use spanwatch::interaction::sensitivity::{ENTRY, LOAD, SPEED, STIFFNESS};
use spanwatch::interaction::simulation::{Recorder, Sensor};
use spanwatch::interaction::{Direction, Hypothesis, Observation, Run, Scheme, Sensitivities, Simulation};
use spanwatch::slot::Slot;
use spanwatch::train::PlanarTrain;
use spanwatch::wire::message::{Quantity, TrainKind};

/// Relative RMS error of the derivative by a loss, against central differences: what [`sensitivity`](spanwatch::interaction::sensitivity)
/// leaves out. Measured: 0.6 % at most, for the elements at the supports; 0.01 to 0.2 % for the others.
const BY_LOSS: f64 = 0.01;
/// By all others. Measured: 0.05 % for the stiffness, less for the rest.
const BY_OTHERS: f64 = 1e-3;

fn girder50() -> ReducedBridge<f64> {
    reduce(&model::shipped("girder50").expect("ships")).expect("stands")
}

struct Passage {
    bridge: ReducedBridge<f64>,
    observed: Observation<f64>,
    truth: Hypothesis<f64>,
    samples: usize,
}

fn passage(
    kind: TrainKind,
    cars: usize,
    speed_kmh: f64,
    quantity: Quantity,
    direction: Direction,
    braking: f64,
) -> Passage {
    let bridge = girder50();
    let train = PlanarTrain::of_kind(kind, cars).expect("a train");
    let way_m = bridge.path.length_m() + train.length_m();
    let sensors = [3, 6, 9].map(|node| Sensor {
        place: bridge.sensor_at(node).expect("a place"),
        quantity,
    });
    let recorder = Recorder::new(sensors.into_iter().collect(), 200.0, Some(40.0));
    let run = Run {
        entry_time_s: 1.0031,
        direction,
        acceleration_mps2: braking,
        ..Run::at(speed_kmh / 3.6)
    };
    let observed = Observation::new(train, run, recorder, Scheme::Exact).expect("can be stepped");
    let mut truth = observed.expected();
    truth.damage[0] = 0.21;
    truth.damage[4] = 0.41;
    truth.stiffness = 0.97;
    let left_s = run.time_at_s(way_m).expect("it leaves");
    Passage {
        bridge,
        observed,
        truth,
        samples: ((left_s + 2.0) * 200.0) as usize,
    }
}

impl Passage {
    fn simulate(&self, hypothesis: &Hypothesis<f64>) -> Vec<f64> {
        let mut simulation =
            Simulation::<f64, MODES>::new(&self.bridge, hypothesis, &self.observed).expect("can be solved");
        (0..self.samples)
            .flat_map(|_| simulation.sample(&self.observed))
            .collect()
    }

    /// Signal and derivatives as the logger has them.
    fn derivatives(&self) -> (Vec<f64>, Vec<Vec<f64>>) {
        let mut sensitivities = Sensitivities::<f64, MODES>::NONE;
        let mut place = Slot::Empty;
        sensitivities
            .begin(&self.bridge, &self.truth, &self.observed, &[true; UNKNOWNS], &mut place)
            .expect("can be solved");
        let simulation = place.as_mut().expect("a simulation");
        let (mut signal, mut columns) = (vec![], vec![vec![]; UNKNOWNS]);
        for _ in 0..self.samples {
            let (sample, rows) = sensitivities.sample(simulation, &self.observed);
            for (value, row) in sample.into_iter().zip(rows) {
                signal.push(value);
                for (column, derivative) in columns.iter_mut().zip(row) {
                    column.push(derivative);
                }
            }
        }
        (signal, columns)
    }

    /// The same from two simulations.
    fn difference(&self, unknown: usize) -> Vec<f64> {
        let step = if unknown < ELEMENTS { 1e-4 } else { 1e-5 };
        let [less, more] = [-step, step].map(|step| {
            let mut hypothesis = self.truth;
            match unknown {
                STIFFNESS => hypothesis.stiffness *= f64::exp(step),
                SPEED => hypothesis.run.speed_mps *= f64::exp(step),
                ENTRY => hypothesis.run.entry_time_s += step,
                LOAD => hypothesis.run.load_factor *= f64::exp(step),
                element => hypothesis.damage[element] += step,
            }
            self.simulate(&hypothesis)
        });
        less.iter()
            .zip(more)
            .map(|(less, more)| (more - less) / (2.0 * step))
            .collect()
    }
}

fn relative(value: &[f64], exact: &[f64]) -> f64 {
    let square = |values: &mut dyn Iterator<Item = f64>| values.map(|v| v * v).sum::<f64>();
    (square(&mut value.iter().zip(exact).map(|(v, e)| v - e)) / square(&mut exact.iter().copied())).sqrt()
}

#[test]
fn derivatives_are_those_of_the_simulation() {
    for (kind, cars, speed_kmh, quantity, direction, braking) in [
        (
            TrainKind::Inspection2Dof,
            1,
            60.0,
            Quantity::Acceleration,
            Direction::Forward,
            0.0,
        ),
        (
            TrainKind::Inspection2Dof,
            1,
            270.0,
            Quantity::Acceleration,
            Direction::Forward,
            0.0,
        ),
        (
            TrainKind::Inspection2Dof,
            1,
            60.0,
            Quantity::Displacement,
            Direction::Backward,
            -0.3,
        ),
        (
            TrainKind::Shinkansen3d,
            4,
            270.0,
            Quantity::Acceleration,
            Direction::Backward,
            0.5,
        ),
        (
            TrainKind::Shinkansen3d,
            4,
            60.0,
            Quantity::Acceleration,
            Direction::Forward,
            0.0,
        ),
    ] {
        let passage = passage(kind, cars, speed_kmh, quantity, direction, braking);
        let (signal, columns) = passage.derivatives();
        assert_eq!(
            signal,
            passage.simulate(&passage.truth),
            "the simulation itself is the same, bit for bit"
        );
        let errors: Vec<f64> = (0..UNKNOWNS)
            .map(|unknown| relative(&columns[unknown], &passage.difference(unknown)))
            .collect();
        println!("{kind:?}, {cars} cars, {speed_kmh} km/h, {quantity:?}: {errors:.4?}");
        for (unknown, error) in errors.into_iter().enumerate() {
            let allowed = if unknown < ELEMENTS { BY_LOSS } else { BY_OTHERS };
            assert!(error < allowed, "unknown {unknown}: {error}");
        }
    }
}
