//! Against closed forms and others' results.

use super::*;

#[test]
fn a_moving_constant_force_does_what_fryba_says() {
    let beam = Beam {
        length_m: 25.0,
        bending_stiffness_nm2: 2.1e7,
        mass_kgpm: 78.5,
        damping_ratio: 0.0,
    };
    let (load_n, speed_mps, step_s) = (1000.0, 10.0, 1e-4);
    let force = one_wheel(load_n, 1.0, 0.0, 0.0, 0.0);
    // A force without mass or damper does not feel how the rail moves under it: both kinematics, one history.
    let [paper, convective] = [Kinematics::Paper, Kinematics::Convective]
        .map(|kinematics| mid_span::<BASIS>(&beam, &force, run_at(speed_mps, kinematics), step_s, 2.5));
    assert_eq!(paper, convective);

    // The published maximum is that of the whole series; eight modes of it give 18.15745 mm at 1.3270 s. All twenty that
    // ten elements have come nearer.
    const PUBLISHED: f64 = 5e-5;
    let (at, deflection) = lowest(&paper);
    let time_s = (at + 1) as f64 * step_s;
    println!("maximum {:.5} mm at {time_s:.5} s", -1e3 * deflection);
    assert!((-deflection / 18.15945e-3 - 1.0).abs() < PUBLISHED, "{deflection}");
    // The maximum is flat: the series is lower by 2e-5 where the girder of ten elements has its own, 1.6 ms later.
    assert!((time_s - 1.32675).abs() < 2e-3, "{time_s}");

    // The whole history: Fryba (1999), chapter 1: w = 2 P / (m L) sum_k sin(k pi x / L) (sin(k W t) - k W / w_k sin(w_k t))
    // / (w_k^2 - (k W)^2), W = pi v / L.
    const SERIES: f64 = 1e-4;
    let series: Vec<f64> = (1..=paper.len())
        .map(|n| {
            let t = n as f64 * step_s;
            let term = |k: usize| {
                let (w, drive) = (beam.omega(k), k as f64 * PI * speed_mps / beam.length_m);
                (k as f64 * PI / 2.0).sin() * ((drive * t).sin() - drive / w * (w * t).sin()) / (w * w - drive * drive)
            };
            -2.0 * load_n / (beam.mass_kgpm * beam.length_m) * (1..=99).map(term).sum::<f64>()
        })
        .collect();
    let error = relative_rms(&paper, &series);
    let flatness = 1.0 - series[at] / lowest(&series).1;
    println!("history against the series: {error:.1e}; the series at that time: {flatness:.1e} below its maximum");
    assert!(error < SERIES && flatness < PUBLISHED, "{error} {flatness}");
}

#[test]
fn a_sprung_mass_does_what_vbi_2d_says() {
    // A spring without damper or mass under it feels only where the rail is, not its rate: both kinematics must agree
    // with the number, and do, as one history.
    const ASKED: f64 = 1e-3;
    let beam = Beam {
        length_m: 25.0,
        bending_stiffness_nm2: 3.5e10 * 1.3901,
        mass_kgpm: 18358.0,
        damping_ratio: 0.0,
    };
    let vehicle = one_wheel(5750.0 * 9.81, 5750.0, 1595e3, 0.0, 0.0);
    let step_s = 2.5e-4;
    let [paper, convective] = [Kinematics::Paper, Kinematics::Convective]
        .map(|kinematics| mid_span::<MODES>(&beam, &vehicle, run_at(25.0, kinematics), step_s, 1.0));
    assert_eq!(paper, convective);
    let (at, extreme) = lowest(&paper);
    println!("extreme {:.6} mm at {:.4} s", extreme * 1e3, (at + 1) as f64 * step_s);
    assert!((extreme / -0.418545e-3 - 1.0).abs() < ASKED, "{extreme}");
    assert!(((at + 1) as f64 * step_s - 0.436).abs() < 1e-3);
    for (time_s, expected_mm) in [
        (0.1, -0.0883320),
        (0.2, -0.2592455),
        (0.25, -0.2564307),
        (0.3, -0.2583230),
        (0.4, -0.3978398),
        (0.5, -0.3673284),
        (0.6, -0.3526330),
        (0.75, -0.2400590),
        (0.9, -0.1572262),
        (1.0, 0.0297320),
    ] {
        let found_mm = 1e3 * paper[(time_s / step_s).round() as usize - 1];
        println!(
            "{time_s} s: {found_mm:.7} mm, {expected_mm}, {:.1e} of the extreme",
            (found_mm - expected_mm).abs() / 0.418545
        );
        assert!(
            (found_mm - expected_mm).abs() < ASKED * 0.418545,
            "{time_s} s: {found_mm} mm"
        );
    }
}

#[test]
fn yang_and_yau_s_car_bends_the_bridge_as_they_say() {
    const ASKED: f64 = 1e-3;
    let beam = Beam {
        length_m: 25.0,
        bending_stiffness_nm2: 2.87e9 * 2.90,
        mass_kgpm: 2303.0,
        damping_ratio: 0.0,
    };
    let vehicle = one_wheel(5750.0 * 9.81, 5750.0, 1595e3, 0.0, 0.0);
    let step_s = 1e-4;
    let found = mid_span::<10>(&beam, &vehicle, run_at(100.0 / 3.6, Kinematics::Paper), step_s, 0.9);
    let (at, extreme) = lowest(&found);
    println!("{:.6} mm at {:.4} s", -1e3 * extreme, (at + 1) as f64 * step_s);
    assert!((extreme / -2.407549e-3 - 1.0).abs() < ASKED, "{extreme}");
    assert!(((at + 1) as f64 * step_s - 0.3709).abs() < 1e-3);
}

#[test]
fn at_cancellation_speeds_a_force_leaves_the_first_mode_at_rest() {
    // v = 2 f1 L / (2 n + 1): the force leaves in step with the vibration that its coming made.
    let still = Beam {
        damping_ratio: 0.0,
        ..GIRDER50
    };
    let force = one_wheel(1e5, 1.0, 0.0, 0.0, 0.0);
    let left_over = |speed_kmh: f64| {
        let step_s = 2.5e-4;
        let crossing_s = 50.0 / (speed_kmh / 3.6);
        let path = mid_span::<1>(
            &still,
            &force,
            run_at(speed_kmh / 3.6, Kinematics::Paper),
            step_s,
            crossing_s + 1.0,
        );
        largest(&path[(crossing_s / step_s) as usize + 2..]) / largest(&path)
    };
    for speed_kmh in [252.0, 180.0, 140.0] {
        let (at, around) = (
            left_over(speed_kmh),
            left_over(1.05 * speed_kmh).min(left_over(0.95 * speed_kmh)),
        );
        println!("{speed_kmh} km/h leaves {at:.1e} of the maximum, 5 % beside it {around:.1e}");
        // The step moves the frequency by (omega h)^2 / 24 = 1e-6 and the exit by a quarter of a millisecond.
        assert!(at < 5e-4 && around > 20.0 * at, "{speed_kmh}: {at} {around}");
    }
}

/// Speed (km/h), of those given, at which a train of 16 cars bends girder50 most at mid-span.
fn worst_speed_kmh(train: PlanarTrain<f64>, speeds_kmh: impl Iterator<Item = f64>) -> f64 {
    let bridge = GIRDER50.reduced();
    let bent = |speed_kmh: f64| {
        let modal = ModalBridge::<f64, MODES>::new(&bridge, &[0.0; ELEMENTS], &[MID_SPAN]);
        let speed_mps = speed_kmh / 3.6;
        let steps = ((train.length_m() + 50.0) / speed_mps / 1e-3) as usize;
        largest(&column(
            &history(modal, &train, run_at(speed_mps, Kinematics::Paper), 1e-3, steps).displacement,
            0,
        ))
    };
    let scan: Vec<(f64, f64)> = speeds_kmh.map(|speed| (speed, bent(speed))).collect();
    for (speed_kmh, deflection) in &scan {
        println!("{speed_kmh:.1} km/h: {:.2} mm", 1e3 * deflection);
    }
    scan.iter().max_by(|a, b| a.1.total_cmp(&b.1)).expect("speeds").0
}

#[test]
fn sixteen_loads_25_m_apart_shake_the_bridge_most_at_315_km_h() {
    // One car's loads every 25 m at f1 25 m = 87.5 m/s. The scan's other resonances would be 157.5 and 105 km/h.
    let mut loads = inspection::<f64>(16);
    for contact in &mut loads.kinds[0].contacts {
        contact.unsprung = 0.0;
        contact.spring.stiffness = 0.0;
        contact.spring.damping = 0.0;
    }
    let at = worst_speed_kmh(
        loads,
        (0..23).map(|i| 95.0 + 15.0 * f64::from(i) - 5.0 * f64::from(i % 3)),
    );
    assert!((at - 315.0).abs() <= 5.0, "{at} km/h");
}

#[test]
fn the_inspection_cars_bogies_and_springs_bring_the_resonance_down_to_309_km_h() {
    // Over 50 m, contacts 25 m apart always have sin^2 + cos^2 = 1 under the first mode, so two rows of them add a constant
    // 2 * 4.4 t to its 125 t, and two springs k to its stiffness, each a little stiffer for the body that swings against it:
    // k / (1 - (f_body / f)^2), f_body = 1.17 Hz.
    let contact = inspection::<f64>(1).kinds[0].contacts[0];
    let (modal_kg, w2) = (125e3, GIRDER50.omega(1).powi(2));
    let dynamic_npm = contact.spring.stiffness / (1.0 - (1.17_f64 / 3.44).powi(2));
    let loaded_w2 = (w2 * modal_kg + 2.0 * dynamic_npm) / (modal_kg + 2.0 * contact.unsprung);
    let loaded_kmh = 315.0 * (loaded_w2 / w2).sqrt();
    assert!((loaded_kmh - 309.4).abs() < 0.1, "{loaded_kmh}");
    let at = worst_speed_kmh(inspection(16), (0..23).map(|i| 264.0 + 3.5 * f64::from(i)));
    // The scan has steps of 3.5 km/h.
    assert!((at - loaded_kmh).abs() < 3.5, "{at} km/h, {loaded_kmh} expected");
}
