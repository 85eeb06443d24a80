//! Damage groups: losing stiffness lowers the frequencies of the modes that strain the group, and no others. And what the
//! time solution and the logger get.

use host_sim::model::condensation::Condensed;
use host_sim::model::eigen::{Wanted, frequency_hz, natural_modes, solve};
use host_sim::model::modal::{ModalModel, PathPoint, value};
use host_sim::model::{self, Structure, reduce};
use nalgebra::DMatrix;

fn structure(name: &str) -> Structure {
    Structure::new(model::shipped(name).expect("shipped")).expect("stands")
}

fn frequencies(structure: &Structure, damage: &[(&str, f64)]) -> Vec<f64> {
    let damage = structure.damage(damage).expect("known groups");
    let modes = natural_modes(&structure.stiffness(&damage), structure.mass()).expect("positive");
    modes.omega_squared.iter().map(|&w2| frequency_hz(w2)).collect()
}

#[test]
fn a_damaged_pier_lowers_the_sway_of_its_block() {
    let viaduct = structure("viaduct24");
    let healthy = frequencies(&viaduct, &[]);
    let damaged = frequencies(&viaduct, &[("2.pier3", 0.4)]);
    // No frequency rises (Rayleigh), beyond rounding; the sway modes, the first six, feel it.
    for (k, (h, d)) in healthy.iter().zip(&damaged).take(60).enumerate() {
        assert!(d / h - 1.0 < 1e-9, "mode {}: {h} {d}", k + 1);
    }
    let most = (0..6).map(|k| 1.0 - damaged[k] / healthy[k]).fold(0.0, f64::max);
    assert!(most > 0.005, "{most}");
}

#[test]
fn a_damaged_chord_lowers_the_first_vertical_mode_of_the_truss_more_than_a_damaged_hanger() {
    let truss = structure("rdso45m");
    let vertical = |damage: &[(&str, f64)]| {
        let damage = truss.damage(damage).expect("known groups");
        let model = ModalModel::new(&truss, &damage, Wanted::UpToHz(7.0)).expect("modes");
        let sensor = model
            .sensors
            .iter()
            .position(|sensor| sensor.name == "R.L4 vertical")
            .expect("there");
        let k = (0..model.omega_squared.len())
            .max_by(|&a, &b| {
                let row = &model.sensors[sensor].row;
                row[a].abs().total_cmp(&row[b].abs())
            })
            .expect("a mode");
        frequency_hz(model.omega_squared[k])
    };
    let whole = vertical(&[]);
    let chord = 1.0 - vertical(&[("R.L3L4", 0.5)]) / whole;
    let hanger = 1.0 - vertical(&[("R.L1U1", 0.5)]) / whole;
    println!("f1 vertical {whole:.4} Hz; lowered by a chord {chord:.2e}, by a hanger {hanger:.2e}");
    assert!(chord > 5e-3 && hanger > 0.0 && chord > 3.0 * hanger, "{chord} {hanger}");
}

#[test]
fn damage_is_asked_for_by_names_that_exist() {
    let girder = structure("twospan");
    let sentence = |of: &[(&str, f64)]| girder.damage(of).expect_err("refused").to_string();
    assert!(sentence(&[("pier", 0.1)]).contains("no damage group \"pier\"; its groups are: element 1, element 2"));
    assert!(sentence(&[("element 2", 1.0)]).contains("must be a fraction from 0 to less than 1"));
}

#[test]
fn the_modal_model_has_the_modes_asked_for_and_begins_and_ends_at_rest() {
    for name in ["girder50", "twospan", "viaduct24", "rdso45m"] {
        let bridge = structure(name);
        let model = ModalModel::new(&bridge, &[], Wanted::UpToHz(20.0)).expect("modes");
        let few = ModalModel::new(&bridge, &[], Wanted::Count(2)).expect("modes");
        assert!(few.omega_squared.len() <= 2, "{name}");
        assert!(model.omega_squared.iter().all(|&w2| frequency_hz(w2) <= 20.0), "{name}");
        assert!(model.omega_squared.is_sorted(), "{name}");
        let (first, last) = (&model.path[0], &model.path[model.path.len() - 1]);
        assert_eq!(first.x_m, 0.0, "{name}");
        for end in [first, last] {
            assert!(end.vertical[0].iter().all(|&w| w == 0.0), "{name}");
        }
        for (k, (c, w2)) in model.damping.iter().zip(&model.omega_squared).enumerate() {
            let ratio = c / (2.0 * w2.sqrt());
            assert!((0.005..0.06).contains(&ratio), "{name} mode {k}: {ratio}");
        }
    }
}

#[test]
fn all_modes_together_give_the_static_deflection_and_those_left_out_are_not_missed() {
    // w_sensor = sum_k sensor_k path_k / omega_k^2 for a unit load on the path, against K^-1. Left out are modes of a part
    // of 1e-3 at both ends, so 1e-6 each; several hundred of them, of either sign and with rising stiffness.
    const LEFT_OUT: f64 = 1e-5;
    for (name, sensor) in [("girder50", 6), ("rdso45m", 4), ("viaduct24", 3)] {
        let bridge = structure(name);
        let model = ModalModel::new(&bridge, &[], Wanted::Count(usize::MAX)).expect("modes");
        let place = bridge
            .sensors
            .iter()
            .position(|place| place.number == sensor)
            .expect("there");
        let point = bridge.path.len() / 2;
        let mut load = DMatrix::zeros(bridge.matrices.freedoms(), 1);
        for &(freedom, factor) in &bridge.path[point].vertical[0] {
            load[(freedom, 0)] += factor;
        }
        let exact = value(
            &bridge.sensors[place].row,
            solve(&bridge.stiffness(&[]), &load).expect("positive").column(0),
        );
        let found: f64 = (0..model.omega_squared.len())
            .map(|k| model.sensors[place].row[k] * model.path[point].vertical[0][k] / model.omega_squared[k])
            .sum();
        let below = |hz: f64| model.omega_squared.iter().filter(|&&w2| frequency_hz(w2) <= hz).count();
        let all = natural_modes(&bridge.stiffness(&[]), bridge.mass())
            .expect("positive")
            .omega_squared;
        println!(
            "{name}: {exact:.6e} m/N, {:.1e} off; below 40 Hz {} of {} modes are kept, in all {} of {}",
            found / exact - 1.0,
            below(40.0),
            all.iter().filter(|&&w2| frequency_hz(w2) <= 40.0).count(),
            model.omega_squared.len(),
            all.len()
        );
        assert!((found / exact - 1.0).abs() < LEFT_OUT, "{name}: {found:e} {exact:e}");
    }
}

#[test]
fn slopes_of_the_path_are_those_of_its_values() {
    // In slow modes the path is smooth, so its slopes and the differences of its values agree; a wrong sign would put them
    // apart by twice the slope.
    const DIFFERENCE: f64 = 0.4;
    type Pick = fn(&PathPoint, usize) -> [f64; 2];
    let vertical: Pick = |point, k| [point.vertical[0][k], point.vertical[1][k]];
    let lateral: Pick = |point, k| [point.lateral[0][k], point.lateral[1][k]];
    let roll: Pick = |point, k| [point.roll[0][k], point.roll[1][k]];
    for (name, pick) in [
        ("rdso45m", vertical),
        ("rdso45m", roll),
        ("viaduct24", lateral),
        ("girder50", vertical),
    ] {
        let bridge = structure(name);
        let model = ModalModel::new(&bridge, &[], Wanted::UpToHz(6.0)).expect("modes");
        assert!(!model.omega_squared.is_empty(), "{name}");
        // Inside the bridge, away from the ramps at its ends.
        let inside = &model.path[2..model.path.len() - 2];
        for k in 0..model.omega_squared.len() {
            let largest = inside.iter().map(|point| pick(point, k)[1].abs()).fold(0.0, f64::max);
            for pair in inside.windows(2) {
                // The rails bend sharply between the viaduct's blocks.
                if name == "viaduct24" && pair[0].x_m % 24.0 == 0.0 {
                    continue;
                }
                let ([a, slope_a], [b, slope_b]) = (pick(&pair[0], k), pick(&pair[1], k));
                let off = (b - a) / (pair[1].x_m - pair[0].x_m) - 0.5 * (slope_a + slope_b);
                assert!(
                    off.abs() <= DIFFERENCE * largest,
                    "{name} mode {k} at {} m: {off:e} of {largest:e}",
                    pair[0].x_m
                );
            }
        }
    }
}

#[test]
fn a_two_span_girder_fits_a_logger_and_a_viaduct_says_why_not() {
    let reduced = reduce::reduce(&model::shipped("twospan").expect("shipped")).expect("fits");
    assert_eq!(
        (reduced.elements, reduced.path.nodes, reduced.sensor_count),
        (10, 11, 11)
    );
    assert!(model::from_blob(&model::to_blob(&reduced).expect("room")).is_ok());
    let sentence = reduce::reduce(&model::shipped("viaduct24").expect("shipped"))
        .expect_err("too large")
        .to_string();
    assert_eq!(
        sentence,
        "bridge \"viaduct24\" has 30 damage groups, but a logger has memory for 10: put more elements into one group"
    );
}

#[test]
fn condensation_keeps_the_slow_modes_and_raises_their_frequencies_a_little() {
    for (name, slow_modes) in [("viaduct24", 9), ("rdso45m", 4)] {
        let bridge = structure(name);
        let full = natural_modes(&bridge.stiffness(&[]), bridge.mass()).expect("positive");
        let condensed = Condensed::new(&bridge).expect("condenses");
        let errors = condensed.errors(&full).expect("modes");
        println!(
            "{name}: {} of {} kept, errors {:.4?}",
            condensed.kept.len(),
            bridge.matrices.freedoms(),
            &errors[..16]
        );
        for (k, error) in errors[..slow_modes].iter().enumerate() {
            assert!(
                error.is_some_and(|error| (-1e-9..0.01).contains(&error)),
                "{name} mode {}: {error:?}",
                k + 1
            );
        }
        // By the separation theorem none can be lower, in ascending order.
        let own = condensed.natural_modes().expect("modes").omega_squared;
        assert!(
            own.iter()
                .zip(&full.omega_squared)
                .all(|(own, full)| own / full > 1.0 - 1e-9),
            "{name}"
        );
    }
}

#[test]
fn condensation_to_everything_changes_nothing() {
    let mut bridge = structure("twospan");
    bridge.bridge.masters = (0..11).flat_map(|node| [(node, 2), (node, 4)]).collect();
    let full = natural_modes(&bridge.stiffness(&[]), bridge.mass()).expect("positive");
    let condensed = Condensed::new(&bridge).expect("condenses");
    assert_eq!(condensed.kept.len(), 19);
    for error in condensed.errors(&full).expect("modes").into_iter().take(10) {
        assert!(error.is_some_and(|error| error.abs() < 1e-9), "{error:?}");
    }
}
