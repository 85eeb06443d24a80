//! What symmetry, energy and the order of the scheme demand.

use super::*;

#[test]
fn halving_the_step_quarters_the_error() {
    // Loads come and go where the shapes are zero, so nothing jumps and average acceleration keeps its second order.
    // Speed and steps are such that contacts come and go on a step.
    let bridge = GIRDER50.reduced();
    let displacement = |per: usize| {
        let modal = ModalBridge::<f64, 3>::new(&bridge, &damage(&[(5, 0.3)]), &[MID_SPAN]);
        let step_s = 5e-3 / per as f64;
        let found = history(
            modal,
            inspection(1),
            run_at(60.0 / 3.6, Kinematics::Paper),
            step_s,
            1000 * per,
        );
        column(&found.displacement, 0)
            .into_iter()
            .skip(per - 1)
            .step_by(per)
            .collect::<Vec<f64>>()
    };
    let exact = displacement(64);
    let errors = [1, 2, 4, 8].map(|per| relative_rms(&displacement(per), &exact));
    for pair in errors.windows(2) {
        let order = (pair[0] / pair[1]).log2();
        println!("{:.2e} -> {:.2e}: order {order:.3}", pair[0], pair[1]);
        assert!((1.9..2.1).contains(&order), "{order}");
    }
}

#[test]
fn energy_is_neither_made_nor_lost() {
    // One wheel on a spring, no damper anywhere, one mode: what the solver shows of the bridge gives the contact's force
    // F = (q'' + w^2 q) / phi, hence the body's acceleration, and by Newmark's own sums the rest. Then
    //   d/dt (bridge + body + spring) = -W phi q' - k e v phi' q,
    // the work of the weight, and that of the locomotive that pushes the wheel up the slope of the rail.
    // The sums are the trapezoidal rule's, whose error is of the second order as the solver's is.
    const SECOND_ORDER: f64 = 1e-4;
    let beam = Beam {
        length_m: 25.0,
        bending_stiffness_nm2: 2.87e9 * 2.90,
        mass_kgpm: 2303.0,
        damping_ratio: 0.0,
    };
    let (body_kg, stiffness, load_n, v, h) = (5750.0, 1595e3, 5750.0 * GRAVITY_MPS2, 25.0, 1e-4);
    let modal = ModalBridge::<f64, 1>::new(&beam.reduced(), &[0.0; ELEMENTS], &[MID_SPAN]);
    let (w2, at_sensor) = (modal.omega_squared[0], modal.sensors[0][0]);
    let steps = (0.98 / h) as usize;
    let found = history(
        modal.clone(),
        one_wheel(load_n, body_kg, stiffness, 0.0, 0.0),
        run_at(v, Kinematics::Paper),
        h,
        steps,
    );

    let [mut qd, mut y, mut yd] = [0.0; 3];
    let (mut before, mut work) = ([0.0; 3], 0.0);
    let (mut worst_energy, mut largest_energy, mut worst_spring) = (0.0_f64, 0.0_f64, 0.0_f64);
    for n in 0..steps {
        let shape = |order| modal.shape(Motion::Vertical, order, (n + 1) as f64 * v * h)[0];
        let (phi, slope) = (shape(0), shape(1));
        let (q, qdd) = (
            found.displacement[n][0] / at_sensor,
            found.acceleration[n][0] / at_sensor,
        );
        let spring = (qdd + w2 * q) / phi + load_n;
        let ydd = -spring / body_kg;
        let [qdd_before, ydd_before, power_before] = before;
        qd += h / 2.0 * (qdd_before + qdd);
        y += h * yd + h * h / 4.0 * (ydd_before + ydd);
        yd += h / 2.0 * (ydd_before + ydd);
        // The spring is stretched as the body's and the rail's places say.
        worst_spring = worst_spring.max((stiffness * (y - phi * q) - spring).abs() / load_n);
        let power = -load_n * phi * qd - spring * v * slope * q;
        work += h / 2.0 * (power_before + power);
        let energy = 0.5 * (qd * qd + w2 * q * q + body_kg * yd * yd + spring * spring / stiffness);
        largest_energy = largest_energy.max(energy);
        worst_energy = worst_energy.max((energy - work).abs());
        before = [qdd, ydd, power];
    }
    println!(
        "energy {:.1e} of its maximum, spring force {worst_spring:.1e} of the weight",
        worst_energy / largest_energy
    );
    assert!(worst_energy < SECOND_ORDER * largest_energy && worst_spring < SECOND_ORDER);
}

#[test]
fn free_vibration_without_damping_goes_on_for_ever() {
    // Average acceleration keeps the energy of a linear system exactly; rounding over 10^5 steps may add 1e-16 each.
    const ROUNDING: f64 = 1e-9;
    let still = Beam {
        damping_ratio: 0.0,
        ..GIRDER50
    };
    let path = mid_span::<1>(
        &still,
        inspection(1),
        run_at(60.0 / 3.6, Kinematics::Paper),
        1e-3,
        100.0,
    );
    let energy = |n: usize| {
        // q_n^2 + q_(n+1)^2 - 2 cos(theta) q_n q_(n+1) is constant for any oscillation sampled in steps.
        let two_cos = (path[n] + path[n + 2]) / path[n + 1];
        path[n] * path[n] + path[n + 1] * path[n + 1] - two_cos * path[n] * path[n + 1]
    };
    // Taken where the middle value is far from zero, at the crests.
    let crest = |from: usize| {
        (from..)
            .find(|&n| path[n + 1] > path[n] && path[n + 1] > path[n + 2])
            .expect("a crest")
    };
    let (early, late) = (energy(crest(5_000)), energy(crest(99_000)));
    println!("energy after 94 s: {:.1e}", late / early - 1.0);
    assert!((late / early - 1.0).abs() < ROUNDING, "{early} {late}");
}

#[test]
fn twice_the_load_is_twice_the_motion_bit_for_bit() {
    // The equations are linear in the static loads, and doubling is exact in binary.
    let bridge = GIRDER50.reduced().cast::<f32>();
    let run = |load_factor| {
        let modal = ModalBridge::<f32, MODES>::new(&bridge, &[0.1; ELEMENTS], &[MID_SPAN]);
        let run = Run {
            load_factor,
            ..run_at(40.0, Kinematics::Convective)
        };
        history(modal, inspection(3), run, 1e-3, 3500).acceleration
    };
    let (once, twice) = (run(1.0), run(2.0));
    assert!(once.iter().zip(&twice).all(|(a, b)| a.map(|v| 2.0 * v) == *b));
}

#[test]
fn mirrored_damage_on_a_mirrored_bridge_is_the_same_passage() {
    // The same bridge numbered from its other end: the path read backwards, slopes with the other sign.
    let bridge = GIRDER50.reduced();
    let mut mirrored = bridge.clone();
    for node in 0..=ELEMENTS {
        let other = ELEMENTS - node;
        mirrored
            .path
            .displacement
            .set_column(node, &bridge.path.displacement.column(other));
        mirrored.path.slope.set_column(node, &-bridge.path.slope.column(other));
        mirrored.sensors.set_column(node, &bridge.sensors.column(other));
    }
    let of = |bridge: &ReducedBridge<f64>, damaged: usize| {
        let modal = ModalBridge::<f64, MODES>::new(bridge, &damage(&[(damaged, 0.4)]), &[2, 5, 8]);
        history(modal, inspection(2), run_at(33.0, Kinematics::Paper), 1e-3, 4000).acceleration
    };
    let (one, other, unlike) = (of(&bridge, 3), of(&mirrored, 8), of(&bridge, 8));
    // Both models come from one eigenproblem whose modes are symmetric but for its rounding.
    const ROUNDING: f64 = 1e-8;
    for c in 0..3 {
        let error = relative_rms(&column(&other, c), &column(&one, c));
        println!("mirror, sensor {c}: {error:.1e}");
        assert!(error < ROUNDING, "{error}");
        // And the train tells the two ends apart, little as it is at mid-span.
        assert!(relative_rms(&column(&unlike, c), &column(&one, c)) > 1e-3);
    }
}

#[test]
fn a_force_that_stands_still_obeys_maxwell() {
    // Crawling loads: at 1 mm/s the deflection at node b under a load at node a is that at a under the load at b.
    // At a creep the history is the influence line; so compare entry times that put the load on the nodes.
    let bridge = GIRDER50.reduced();
    let creep = 1e-3;
    let deflection = |load_node: usize, sensor_node: usize| {
        let modal = ModalBridge::<f64, MODES>::new(&bridge, &damage(&[(2, 0.5), (5, 0.3)]), &[sensor_node - 1]);
        let reached = (load_node as f64 - 1.0) * 5.0 / creep;
        // The load has stood there, within 3 cm, for half a minute: 8 time constants of the damped first mode.
        let run = Run {
            entry_time_s: 15.0 - reached,
            ..run_at(creep, Kinematics::Paper)
        };
        let found = history(modal, one_wheel(1e5, 1.0, 0.0, 0.0, 0.0), run, 1e-3, 30_000);
        let rest = &found.displacement[10_000..20_000];
        rest.iter().map(|row| row[0]).sum::<f64>() / rest.len() as f64
    };
    for (a, b) in [(3, 6), (2, 9), (5, 8)] {
        let (ab, ba) = (deflection(a, b), deflection(b, a));
        println!("nodes {a} and {b}: {:.6} and {:.6} mm", 1e3 * ab, 1e3 * ba);
        // 15 s of creep move the load by 1.5 cm of 50 m, evenly about the node; what is left is the curve's.
        assert!((ab / ba - 1.0).abs() < 1e-5, "{ab} {ba}");
    }
}
