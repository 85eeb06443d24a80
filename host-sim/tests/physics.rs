//! The bridge model and the interaction solver, against closed forms and independent histories.

use std::path::PathBuf;

use host_sim::model::{self, beam};
use spanwatch::bridge::{ModalBridge, ReducedBridge};
use spanwatch::interaction::{Interaction, Kinematics, Run};
use spanwatch::train::Train;
use spanwatch::wire::message::TrainKind;

fn girder50() -> ReducedBridge<f64> {
    model::reduce::reduce(&model::shipped("girder50").expect("shipped")).expect("reduces")
}

#[test]
fn girder50_has_its_declared_frequencies() {
    let modal = ModalBridge::<f64, 8>::new(&girder50(), &[0.0; 10], &[]);
    for (k, expected) in [3.50002, 14.0015, 31.5168, 56.0928, 87.8454].iter().enumerate() {
        assert!(
            (modal.frequency_hz(k) / expected - 1.0).abs() < 2e-6,
            "mode {}: {}",
            k + 1,
            modal.frequency_hz(k)
        );
    }
    let mut damage = [0.0; 10];
    damage[4] = 0.30;
    let damaged = ModalBridge::<f64, 8>::new(&girder50(), &damage, &[]);
    assert!((damaged.frequency_hz(0) - 3.363).abs() < 5e-4);
}

#[test]
fn reduced_damage_bends_like_the_full_model() {
    let girder = beam::Girder::new(&model::shipped("girder50").expect("shipped"));
    let bridge = girder50();
    for (element, loss) in [(4, 0.11), (4, 0.41), (4, 0.7), (0, 0.7)] {
        let mut damage = [0.0; 10];
        damage[element] = loss;
        let (lambda, _) = beam::natural_modes(&girder.stiffness(&damage), &girder.mass).expect("positive");
        let modal = ModalBridge::<f64, 8>::new(&bridge, &damage, &[5]);
        let modal32 = ModalBridge::<f32, 8>::new(&bridge.cast(), &damage.map(|d| d as f32), &[5]);
        for k in 0..8 {
            let error = modal.omega_squared[k] / lambda[k] - 1.0;
            let error32 = f64::from(modal32.omega_squared[k]) / modal.omega_squared[k] - 1.0;
            println!(
                "element {} {loss}: mode {} {error:.1e} f32 {error32:.1e}",
                element + 1,
                k + 1
            );
        }
    }
}

fn relative_rms(found: &[f64], expected: &[f64]) -> f64 {
    let (mut difference, mut scale) = (0.0, 0.0);
    for (f, e) in found.iter().zip(expected) {
        difference += (f - e) * (f - e);
        scale += e * e;
    }
    f64::sqrt(difference / scale)
}

#[test]
fn inspection_car_agrees_with_independent_histories() {
    let bridge = girder50();
    for (file, damaged) in [
        ("r1_2dof_1car_60kmh_healthy.csv", vec![]),
        ("r2_2dof_1car_60kmh_e1_21_e5_41.csv", vec![(0, 0.21), (4, 0.41)]),
    ] {
        let path = PathBuf::from(env!("CARGO_MANIFEST_DIR"))
            .join("../tests/data/reference")
            .join(file);
        let mut reader = csv::Reader::from_path(path).expect("reference history");
        let rows: Vec<Vec<f64>> = reader
            .records()
            .map(|r| r.expect("row").iter().map(|v| v.parse().expect("number")).collect())
            .collect();
        let mut damage = [0.0; 10];
        for (element, loss) in damaged {
            damage[element] = loss;
        }
        let modal = ModalBridge::<f64, 8>::new(&bridge, &damage, &[2, 5, 8]);
        let train = Train::of_kind(TrainKind::Inspection2Dof, 1).expect("a car");
        let run = Run {
            speed_mps: 60.0 / 3.6,
            entry_time_s: 0.0,
            load_factor: 1.0,
            kinematics: Kinematics::Paper,
        };
        let mut solver = Interaction::new(modal, train, run, 1e-3).expect("a run");
        let mut found = vec![vec![]; 6];
        for _ in &rows[1..] {
            solver.step();
            for c in 0..3 {
                found[c].push(solver.acceleration_mps2(c));
                found[c + 3].push(solver.displacement_m(c) * 1e3);
            }
        }
        for c in 0..6 {
            let expected: Vec<f64> = rows[1..].iter().map(|row| row[c + 1]).collect();
            println!("{file} {c}: {:.3e}", relative_rms(&found[c], &expected));
        }
    }
}
