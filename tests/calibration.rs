//! Learning an unknown track from healthy passages, and knowing damage from it.
//!
//! The truth is made by other means than it is explained with: cars in space, twelve modes where the logger has eight, half its step, `f64`.

use std::sync::OnceLock;

use host_sim::calibrate::{Calibration, DRIFT_M, Options, Outcome, Passage, calibrate};
use host_sim::identification::Observed;
use host_sim::model::{self, BridgeFrame, Structure, reduce::reduce};
use host_sim::random::{gaussian, unit};
use host_sim::simulate::{Scenario, simulate};
use host_sim::track::{Profile, Spectrum, Stretch, generate};
use host_sim::train::TrainName;
use rand_core::SeedableRng;
use rand_xoshiro::Xoshiro256PlusPlus;
use rayon::prelude::*;
use spanwatch::capacity::ELEMENTS;
use spanwatch::identify::evidence::{Evidence, Forgetting};
use spanwatch::wire::message::{Ranges, TrainKind};

/// Noise of each sensor, as a part of the RMS of what it records. So much of the power no track can explain.
const NOISE: f64 = 0.05;
/// A passage on the learnt track is explained down to the noise, ...
const DOWN_TO_THE_NOISE: f64 = 0.1;
/// ... where the smooth track leaves so many times as much.
const SMOOTH_LEAVES: f64 = 10.0;
/// Ten elements and a few seeds: a right deviation is exceeded fourfold once in a thousand such tests.
const DEVIATIONS: f64 = 4.0;
/// Passages to learn from.
const PASSAGES: u64 = 12;
/// Elements 3 and 5 of the damaged bridge.
const DAMAGE: [(usize, f64); 2] = [(3, 0.10), (5, 0.20)];

fn girder() -> BridgeFrame {
    model::shipped("girder50").expect("ships")
}

fn track() -> &'static Profile {
    static TRACK: OnceLock<Profile> = OnceLock::new();
    TRACK.get_or_init(|| {
        let stretch = Stretch {
            vertical_only: true,
            ..Stretch::default()
        };
        generate(Spectrum::Fra6, 1, &stretch).expect("a track")
    })
}

/// What is special about a passage.
#[derive(Clone)]
struct Special {
    /// Stiffness of the bridge that it went over, as a part of the model's.
    stiffness_factor: f64,
    nodes: Vec<u16>,
    speeds_kmh: [f64; 2],
    damage: &'static [(usize, f64)],
    /// Cars that came, and that are told.
    cars: [usize; 2],
}

impl Special {
    fn nothing() -> Self {
        Self {
            stiffness_factor: 1.0,
            nodes: vec![3, 6, 9],
            speeds_kmh: [205.0, 270.0],
            damage: &[],
            cars: [4; 2],
        }
    }
}

/// A passage on the track, its run roughly known.
fn passage(special: &Special, seed: u64) -> Passage {
    let mut rng = Xoshiro256PlusPlus::seed_from_u64(seed);
    let [slowest, fastest] = special.speeds_kmh;
    let mut scenario = Scenario {
        train: TrainName::Known(TrainKind::Shinkansen3d),
        cars: Some(special.cars[0]),
        speed_kmh: slowest + (fastest - slowest) * unit(&mut rng),
        track: Some(track().clone()),
        modes: 12,
        step_s: 0.00125,
        noise: NOISE,
        seed,
        nodes: special.nodes.clone(),
        stiffness_factor: special.stiffness_factor,
        lead_s: 0.5 + 0.005 * unit(&mut rng),
        tail_s: 1.0,
        ..Scenario::inspection_car()
    }
    .recorded();
    for &(element, loss) in special.damage {
        scenario.damage[element - 1] = loss;
    }
    let simulated = simulate(&Structure::new(girder()).expect("stands"), &scenario).expect("simulates");
    let samples = (0..simulated.channels[0].len())
        .flat_map(|i| simulated.channels.iter().map(move |channel| channel[i] as f32))
        .collect();
    scenario.cars = Some(special.cars[1]);
    let reduced = reduce(&girder()).expect("reduces").cast();
    let mut observed = Observed::of(reduced, &scenario, samples).expect("observed");
    let run = &mut observed.observation.run;
    run.speed_mps *= 1.0 + 0.01 * gaussian(&mut rng) as f32;
    run.entry_time_s += 0.03 * gaussian(&mut rng) as f32;
    run.load_factor *= 1.0 + 0.02 * gaussian(&mut rng) as f32;
    observed.observation.ranges = Ranges {
        speed: 0.02,
        entry_s: 0.1,
        load: 0.05,
        stiffness: 0.005,
    };
    Passage {
        name: format!("passage {seed}"),
        train: TrainKind::Shinkansen3d,
        observed,
    }
}

fn passages(special: &Special, seeds: std::ops::Range<u64>) -> Vec<Passage> {
    seeds.into_par_iter().map(|seed| passage(special, seed)).collect()
}

fn learn(passages: &[Passage], before: Option<[f64; 2]>, healthy: bool) -> Calibration {
    calibrate(
        passages,
        &Options {
            healthy,
            before,
            drift_m: DRIFT_M,
            seed: 1,
        },
        &|_, _| (),
    )
    .expect("learns")
}

/// What healthy passages taught; among them were a shorter train, one over another bridge, and a sensor at the end of its range.
fn learnt() -> &'static Calibration {
    static LEARNT: OnceLock<Calibration> = OnceLock::new();
    LEARNT.get_or_init(|| {
        let mut all = passages(&Special::nothing(), 100..100 + PASSAGES);
        let shorter = Special {
            cars: [3, 4],
            ..Special::nothing()
        };
        let elsewhere = Special {
            stiffness_factor: 1.2,
            ..Special::nothing()
        };
        let mut saturated = passage(&Special::nothing(), 200);
        let peak = saturated
            .observed
            .samples
            .iter()
            .fold(0.0_f32, |peak, value| peak.max(value.abs()));
        for value in &mut saturated.observed.samples {
            if value.abs() > 0.2 * peak {
                *value = f32::NAN;
            }
        }
        all.extend([passage(&shorter, 201), passage(&elsewhere, 202), saturated]);
        learn(&all, None, true)
    })
}

#[test]
fn passages_that_are_not_like_the_others_are_left_out_with_the_reason() {
    let (used, odd) = learnt().passages.split_at(PASSAGES as usize);
    for outcome in used {
        assert!(matches!(outcome, Outcome::Used { .. }), "{outcome:?}");
    }
    for (outcome, reason) in odd
        .iter()
        .zip(["another train", "another train", "missing or saturated"])
    {
        let Outcome::LeftOut(said) = outcome else {
            panic!("{outcome:?}");
        };
        println!("{said}");
        assert!(said.contains(reason), "{said}");
    }
    assert_eq!(usize::from(learnt().learnt.passages), used.len());
}

#[test]
fn the_learnt_track_explains_new_passages_down_to_the_noise_and_no_element_of_a_healthy_bridge_seems_off() {
    let found: Vec<_> = (passages(&Special::nothing(), 300..306).into_par_iter())
        .map(|passage| {
            let mut whole = passage.observed.clone();
            whole.bridge.elements = 0;
            let smooth = whole.identify(1).expect("identifies").unexplained;
            let on_track = passage.observed.with_track(&learnt().learnt);
            (f64::from(smooth), on_track.identify(1).expect("identifies"))
        })
        .collect();
    let mut evidence = Evidence::new(Forgetting::NEVER);
    let noise = NOISE.powi(2) / (1.0 + NOISE.powi(2));
    for (smooth, found) in &found {
        println!(
            "unexplained {:.3} % smooth, {:.3} % learnt",
            100.0 * smooth,
            100.0 * found.unexplained
        );
        assert!((f64::from(found.unexplained) / noise - 1.0).abs() < DOWN_TO_THE_NOISE);
        assert!(*smooth > SMOOTH_LEAVES * noise);
        evidence.add(&found.information);
    }
    let all = evidence.against(&learnt().learnt);
    let (centre, variances) = (all.centre().expect("a centre"), all.variances().expect("variances"));
    for e in 0..ELEMENTS {
        let deviations = f64::from(centre[e] / variances[e].sqrt());
        println!(
            "element {}: {:.2} points, {deviations:.1} deviations",
            e + 1,
            100.0 * centre[e]
        );
        assert!(deviations.abs() < DEVIATIONS, "element {}: {deviations}", e + 1);
    }
}

#[test]
fn equal_speeds_and_a_single_sensor_teach_less_and_say_so() {
    let equal = Special {
        speeds_kmh: [240.0; 2],
        ..Special::nothing()
    };
    let single = Special {
        nodes: vec![6],
        ..Special::nothing()
    };
    let floor = |calibration: &Calibration| {
        calibration
            .floor_learnt
            .iter()
            .fold(0.0_f64, |most, &floor| most.max(floor))
    };
    let usual = floor(learnt());
    for (what, special) in [("equal speeds", equal), ("a single sensor", single)] {
        let calibration = learn(&passages(&special, 400..400 + PASSAGES), None, true);
        println!(
            "{what}: {:.2} points, usually {:.2}",
            100.0 * floor(&calibration),
            100.0 * usual
        );
        assert_eq!(u64::from(calibration.learnt.passages), PASSAGES, "{what}");
        assert!(floor(&calibration) > usual, "{what}");
    }
}

#[test]
fn a_bridge_that_is_not_held_to_be_healthy_is_learnt_with_its_damage() {
    let damaged = Special {
        damage: &DAMAGE,
        ..Special::nothing()
    };
    let passages = passages(&damaged, 500..500 + PASSAGES);
    let nothing_known = learn(&passages, None, false);
    let before = [learnt().learnt.stiffness, learnt().learnt.damping].map(f64::from);
    let since = learn(&passages, Some(before), false);
    for (what, calibration, most) in [("alone", &nothing_known, 0.1), ("since", &since, 0.045)] {
        for (e, [loss, deviation]) in calibration.damage.iter().enumerate() {
            let truth = DAMAGE
                .iter()
                .find(|(element, _)| *element == e + 1)
                .map_or(0.0, |(_, loss)| *loss);
            println!(
                "{what}: element {}: {:.2} ± {:.2}, true {:.0} points",
                e + 1,
                100.0 * loss,
                100.0 * deviation,
                100.0 * truth
            );
            assert!((loss - truth).abs() < DEVIATIONS * deviation, "element {}", e + 1);
            assert!(*deviation < most, "element {}", e + 1);
        }
    }
}

#[test]
fn too_few_passages_are_no_reference() {
    let error = calibrate(
        &passages(&Special::nothing(), 600..603),
        &Options {
            healthy: true,
            before: None,
            drift_m: DRIFT_M,
            seed: 1,
        },
        &|_, _| (),
    );
    let error = error.expect_err("three are too few").to_string();
    assert!(error.contains("only 3 of 3 passages"), "{error}");
}
