//! Against independent programs.

use super::*;

#[test]
fn both_cars_agree_with_independent_histories() {
    // Asked are 0.2 % of displacement and 1 % of acceleration. The two programs solve the same equations with the same
    // step, so only the files' eight digits and the two eigensolvers stand between them: 4e-6 measured.
    const SAME_EQUATIONS: f64 = 1e-4;
    let bridge = model::reduce::reduce(&model::shipped("girder50").expect("shipped")).expect("reduces");
    for (file, train, speed_kmh, damage) in [
        ("r1_2dof_1car_60kmh_healthy.csv", inspection(1), 60.0, damage(&[])),
        (
            "r2_2dof_1car_60kmh_e1_21_e5_41.csv",
            inspection(1),
            60.0,
            damage(&[(1, 0.21), (5, 0.41)]),
        ),
        (
            "r3_3d_1car_120kmh_e5_11.csv",
            shinkansen(1),
            120.0,
            damage(&[(5, 0.11)]),
        ),
    ] {
        let path = PathBuf::from(env!("CARGO_MANIFEST_DIR"))
            .join("../tests/data/reference")
            .join(file);
        let mut reader = csv::Reader::from_path(path).expect("reference history");
        // The first sample, where the load appears at once, aside.
        let rows: Vec<Vec<f64>> = (reader.records().skip(1))
            .map(|row| row.expect("row").iter().map(|v| v.parse().expect("number")).collect())
            .collect();
        let modal = ModalBridge::<f64, MODES>::new(&bridge, &damage, &[2, 5, 8]);
        let found = history(
            modal,
            &train,
            run_at(speed_kmh / 3.6, Kinematics::Paper),
            1e-3,
            rows.len(),
        );
        for (c, node) in [3, 6, 9].into_iter().enumerate() {
            let expected = |offset: usize| rows.iter().map(|row| row[offset + c]).collect::<Vec<f64>>();
            let displacement_mm: Vec<f64> = column(&found.displacement, c).iter().map(|v| v * 1e3).collect();
            let acceleration = relative_rms(&column(&found.acceleration, c), &expected(1));
            let displacement = relative_rms(&displacement_mm, &expected(4));
            println!("{file} node {node}: acceleration {acceleration:.1e}, displacement {displacement:.1e}");
            assert!(
                acceleration < SAME_EQUATIONS && displacement < SAME_EQUATIONS,
                "{file} node {node}"
            );
        }
    }
}

/// A moving car on `N` sine modes of an exact beam, solved by Runge and Kutta's fourth order: written apart from the
/// solver, from forces and accelerations, as a check of its elimination. Gives mid-span acceleration at each step.
fn runge_kutta<const N: usize>(
    beam: &Beam,
    car: &Car<f64, CAR_DOFS, CONTACTS>,
    run: &Run<f64>,
    step_s: f64,
    steps: usize,
    per_step: usize,
) -> Vec<f64> {
    let norm = (2.0 / (beam.mass_kgpm * beam.length_m)).sqrt();
    let convective = f64::from(u8::from(run.kinematics == Kinematics::Convective));
    let v = run.speed_mps;
    let vc = v * convective;
    let (w1, w2) = (beam.omega(1), beam.omega(2));
    let (p1, p2) = (
        2.0 * beam.damping_ratio * w1 * w2 / (w1 + w2),
        2.0 * beam.damping_ratio / (w1 + w2),
    );

    // State: q, y, q', y'. Gives q'', y''.
    let acceleration = |t: f64, q: &[f64], y: &[f64], qd: &[f64], yd: &[f64]| {
        let mut matrix = nalgebra::DMatrix::<f64>::identity(N, N);
        let mut force = nalgebra::DVector::<f64>::zeros(N);
        for k in 0..N {
            let w = beam.omega(k + 1);
            force[k] = -(p1 + p2 * w * w) * qd[k] - w * w * q[k];
        }
        let mut ydd = [0.0; CAR_DOFS];
        for contact in &car.contacts {
            let x = v * (t - run.entry_time_s) - contact.behind_m;
            let on = (0.0..=beam.length_m).contains(&x);
            let shape = |order: u32| {
                nalgebra::DVector::from_fn(N, |k, _| {
                    let wave = (k as f64 + 1.0) * PI / beam.length_m;
                    let value = match order {
                        0 => (wave * x).sin(),
                        1 => wave * (wave * x).cos(),
                        _ => -wave * wave * (wave * x).sin(),
                    };
                    if on { norm * value } else { 0.0 }
                })
            };
            let (phi, slope, curve) = (shape(0), shape(1), shape(2));
            let along = |s: &nalgebra::DVector<f64>, q: &[f64]| s.iter().zip(q).map(|(s, q)| s * q).sum::<f64>();
            let rail = along(&phi, q);
            let rail_rate = along(&phi, qd) + vc * along(&slope, q);
            let rise: f64 = contact.spring.lever.iter().zip(y).map(|(s, y)| s * y).sum();
            let rate: f64 = contact.spring.lever.iter().zip(yd).map(|(s, y)| s * y).sum();
            let spring = contact.spring.stiffness * (rise - rail) + contact.spring.damping * (rate - rail_rate);
            for (a, s) in ydd.iter_mut().zip(&contact.spring.lever) {
                *a -= s * spring;
            }
            let known = 2.0 * vc * along(&slope, qd) + vc * vc * along(&curve, q);
            force += &phi * (spring - run.load_factor * contact.load_n - contact.unsprung * known);
            matrix += &phi * phi.transpose() * contact.unsprung;
        }
        for (a, m) in ydd.iter_mut().zip(&car.inertia) {
            *a /= m;
        }
        (matrix.cholesky().expect("positive").solve(&force), ydd)
    };
    let size = N + CAR_DOFS;
    let rate = |t: f64, s: &[f64]| {
        let (qdd, ydd) = acceleration(t, &s[..N], &s[N..size], &s[size..size + N], &s[size + N..]);
        s[size..]
            .iter()
            .copied()
            .chain(qdd.iter().copied())
            .chain(ydd)
            .collect::<Vec<f64>>()
    };
    let mut state = vec![0.0; 2 * size];
    let (h, mut out) = (step_s / per_step as f64, vec![]);
    for n in 0..steps * per_step {
        let t = n as f64 * h;
        let plus = |k: &[f64], f: f64| state.iter().zip(k).map(|(s, k)| s + f * k).collect::<Vec<f64>>();
        let k1 = rate(t, &state);
        let k2 = rate(t + h / 2.0, &plus(&k1, h / 2.0));
        let k3 = rate(t + h / 2.0, &plus(&k2, h / 2.0));
        let k4 = rate(t + h, &plus(&k3, h));
        for (i, s) in state.iter_mut().enumerate() {
            *s += h / 6.0 * (k1[i] + 2.0 * k2[i] + 2.0 * k3[i] + k4[i]);
        }
        if (n + 1) % per_step == 0 {
            let (qdd, _) = acceleration(
                t + h,
                &state[..N],
                &state[N..size],
                &state[size..size + N],
                &state[size + N..],
            );
            out.push(
                (0..N)
                    .map(|k| norm * ((k as f64 + 1.0) * PI / 2.0).sin() * qdd[k])
                    .sum(),
            );
        }
    }
    out
}

#[test]
fn both_kinematics_agree_with_runge_and_kutta_on_sines() {
    // Newmark at 0.5 ms with three modes, f3 = 31.5 Hz: its period is too long by (omega h)^2 / 12 = 8e-4, and sines
    // differ from the girder's shapes by some 1e-4; the raw acceleration feels both over its whole length.
    const STEP_ERROR: f64 = 5e-3;
    let step_s = 5e-4;
    for kinematics in [Kinematics::Paper, Kinematics::Convective] {
        for speed_kmh in [60.0, 270.0] {
            let run = run_at(speed_kmh / 3.6, kinematics);
            let train = inspection::<f64>(1);
            let steps = ((train.length_m() + 50.0) / run.speed_mps / step_s) as usize + 500;
            let modal = ModalBridge::<f64, 3>::new(&GIRDER50.reduced(), &[0.0; ELEMENTS], &[MID_SPAN]);
            let found = column(&history(modal, &train, run, step_s, steps).acceleration, 0);
            let expected = runge_kutta::<3>(&GIRDER50, &train.kinds[0], &run, step_s, steps, 4);
            let error = relative_rms(&found, &expected);
            println!("{kinematics:?}, {speed_kmh} km/h: acceleration {error:.1e}");
            assert!(error < STEP_ERROR, "{kinematics:?} {speed_kmh}: {error}");
        }
    }
}

#[test]
fn a_car_longer_than_the_bridge_swings_on_while_no_wheel_touches_it() {
    // Bogies 17.5 m apart over 12 m: for 5.5 m the car is between its front and its rear bogie.
    const STEP_ERROR: f64 = 1e-3;
    let short = Beam {
        length_m: 12.0,
        bending_stiffness_nm2: 2e9,
        mass_kgpm: 3000.0,
        damping_ratio: 0.02,
    };
    let (run, train, step_s) = (run_at(20.0, Kinematics::Paper), inspection::<f64>(1), 2.5e-4);
    let modal = ModalBridge::<f64, 2>::new(&short.reduced(), &[0.0; ELEMENTS], &[MID_SPAN]);
    let steps = (2.0 / step_s) as usize;
    let found = column(&history(modal, &train, run, step_s, steps).acceleration, 0);
    let expected = runge_kutta::<2>(&short, &train.kinds[0], &run, step_s, steps, 4);
    let error = relative_rms(&found, &expected);
    println!("short bridge: acceleration {error:.1e}");
    assert!(error < STEP_ERROR, "{error}");
}
