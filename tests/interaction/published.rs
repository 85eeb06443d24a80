//! Against closed forms: speeds at which a bridge stays at rest, or swings most. Single histories and maxima that others have
//! published are rows of the validation chapter (`host-sim/src/validate`).

use super::*;

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
