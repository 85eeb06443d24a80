//! Learning an unknown track from healthy passages.

use host_sim::calibrate::{Options, Passage, calibrate};
use host_sim::identification::Observed;
use host_sim::model::{self, Structure, reduce::reduce};
use host_sim::random::{gaussian, unit};
use host_sim::simulate::{Scenario, simulate};
use host_sim::track::{Profile, Spectrum, Stretch, generate};
use host_sim::train::TrainName;
use rand_core::SeedableRng;
use rand_xoshiro::Xoshiro256PlusPlus;
use rayon::prelude::*;
use spanwatch::bridge::ReducedBridge;
use spanwatch::interaction::Scheme;
use spanwatch::wire::message::{Ranges, TrainKind};

fn observe(reduced: &ReducedBridge<f32>, track: &Profile, damage: &[(usize, f64)], seed: u64) -> Passage {
    let girder = model::shipped("girder50").expect("ships");
    let mut rng = Xoshiro256PlusPlus::seed_from_u64(seed);
    let mut scenario = Scenario {
        train: TrainName::Known(TrainKind::Shinkansen3d),
        cars: Some(16),
        speed_kmh: 205.0 + 65.0 * unit(&mut rng),
        track: Some(track.clone()),

        scheme: Scheme::Exact,
        noise: 0.05,
        seed,
        nodes: vec![3, 6, 9],
        lead_s: 1.0 + 0.005 * unit(&mut rng),
        ..Scenario::inspection_car()
    }
    .recorded();
    let var = |name: &str, or: f64| std::env::var(name).ok().map_or(or, |v| v.parse().expect("a number"));
    scenario.modes = var("MODES", 12.0) as usize;
    scenario.step_s = 1e-3 * var("STEP_MS", 1.25);
    scenario.noise = var("NOISE", 0.05);
    for &(element, loss) in damage {
        scenario.damage[element - 1] = loss;
    }
    let passage = simulate(&Structure::new(girder).expect("stands"), &scenario).expect("simulates");
    let samples = (0..passage.channels[0].len())
        .flat_map(|i| passage.channels.iter().map(move |channel| channel[i] as f32))
        .collect();
    let mut observed = Observed::of(reduced.clone(), &scenario, samples).expect("observed");
    observed.observation.run.speed_mps *= 1.0 + 0.01 * gaussian(&mut rng) as f32;
    observed.observation.run.entry_time_s += 0.03 * gaussian(&mut rng) as f32;
    observed.observation.run.load_factor *= 1.0 + 0.02 * gaussian(&mut rng) as f32;
    observed.observation.ranges = Ranges {
        speed: 0.02,
        entry_s: 0.1,
        load: 0.05,
        stiffness: 0.005,
    };
    let sub = var("SUB", 2.0) as u32;
    let r = &observed.observation.recorder;
    let recorder = spanwatch::interaction::simulation::Recorder {
        steps_per_sample: sub,
        ..r.clone()
    };
    let (ranges, run) = (observed.observation.ranges, observed.observation.run);
    observed.observation = spanwatch::interaction::Observation::new(
        observed.observation.cars.train().clone(),
        run,
        recorder,
        Scheme::Exact,
    )
    .expect("o");
    observed.observation.ranges = ranges;
    Passage {
        name: format!("passage {seed}"),
        train: TrainKind::Shinkansen3d,
        observed,
    }
}

#[test]
fn experiment() {
    let var = |name: &str, or: f64| std::env::var(name).ok().map_or(or, |v| v.parse().expect("a number"));
    let girder = model::shipped("girder50").expect("ships");
    let reduced: ReducedBridge<f32> = reduce(&girder).expect("reduces").cast();
    let class = if var("CLASS", 6.0) == 4.0 {
        Spectrum::Fra4
    } else {
        Spectrum::Fra6
    };
    let track = generate(
        class,
        var("TRACK", 1.0) as u64,
        &Stretch {
            vertical_only: true,
            ..Stretch::default()
        },
    )
    .expect("a track");
    let start = std::time::Instant::now();
    let passages: Vec<Passage> = (0..var("N", 20.0) as u64)
        .into_par_iter()
        .map(|seed| observe(&reduced, &track, &[], 100 + seed))
        .collect();
    println!("simulated {:.1?}", start.elapsed());
    {
        use host_sim::track::prior::{covariance, fit};
        let knots = host_sim::calibrate::knots(50.0).expect("knots");
        let c = fit(&track, &knots);
        let cov = covariance(Spectrum::Fra6, &knots);
        let v = nalgebra::DVector::from_row_slice(&c);
        println!(
            "true coefficients: level {:.2}, largest {:.2} mm",
            v.dot(&cov.cholesky().expect("pd").solve(&v)) / c.len() as f64,
            1e3 * v.amax()
        );
        let stretches: Vec<_> = knots
            .stretches()
            .iter()
            .map(|s| spanwatch::track::profile::Stretch {
                from_m: s.from_m as f32,
                spacing_m: s.spacing_m as f32,
                spans: s.spans,
            })
            .collect();
        let profile = spanwatch::track::profile::Profile::new(
            spanwatch::track::profile::Knots::new(&stretches).expect("k"),
            &c.iter().map(|&c| c as f32).collect::<Vec<_>>(),
        );
        for passage in passages.iter().take(6) {
            let mut observed = passage.observed.clone();
            observed.track.profile = profile.clone();
            let f = observed.identify(1).expect("identifies");
            println!(
                "true fit {:.1} m/s: u {:.5} centre {:.1?} contradiction {:.1}",
                f.run.speed_mps,
                f.unexplained,
                f.information
                    .centre()
                    .map(|c| c.map(|c| 100.0 * c))
                    .expect("c")
                    .as_slice(),
                f.estimate.contradiction
            );
        }
        if var("STOP", 0.0) > 0.0 {
            return;
        }
    }
    let start = std::time::Instant::now();
    let options = Options { healthy: true, seed: 1 };
    let found = calibrate(&passages, &options, &|done, of| {
        println!("{done} of {of} {:.1?}", start.elapsed())
    })
    .expect("learns");
    println!(
        "{:.1?}: level {:.2}, {} steps, stiffness {:.4} +- {:.4}, damping {:.3} +- {:.3}",
        start.elapsed(),
        found.level,
        found.steps,
        found.learnt.stiffness,
        found.bridge_std[0],
        found.learnt.damping,
        found.bridge_std[1]
    );
    println!(
        "unexplained {:?} scatter {:.3}",
        found.learnt.unexplained, found.learnt.scatter
    );
    println!("floor {:.2?} points", found.floor.map(|f| 100.0 * f));
    for outcome in found.passages.iter().take(8) {
        println!("{outcome:?}");
    }
    let std: Vec<f64> = (0..found.coefficients.len())
        .step_by(6)
        .map(|k| 1e3 * found.covariance[(k, k)].sqrt())
        .collect();
    println!("std mm {std:.3?}");
    // Monitoring.
    let damage = vec![(5, 0.10)];
    let results: Vec<_> = (0..12u64)
        .into_par_iter()
        .map(|seed| {
            let damaged = observe(&reduced, &track, if seed < 6 { &[] } else { &damage }, 9000 + seed);
            let observed = damaged.observed.with_track(&found.learnt);
            let f = observed.identify(1).expect("identifies");
            (f, found.learnt.misfit(&f.mean_squares))
        })
        .collect();
    for (f, z) in &results {
        println!(
            "u {:.5} z {z:.1} damage {:.1?} std {:.1?} sig {:.1?} contradiction {:.1}",
            f.unexplained,
            f.estimate.damage.map(|d| 100.0 * d),
            f.estimate.std.map(|d| 100.0 * d),
            f.estimate.significance,
            f.estimate.contradiction
        );
    }
    for half in results.chunks(6) {
        let mut evidence =
            spanwatch::identify::evidence::Evidence::new(spanwatch::identify::evidence::Forgetting::NEVER);
        for (f, _) in half {
            evidence.add(&f.information);
        }
        let e = evidence.estimate(10);
        println!(
            "six: damage {:.2?} std {:.2?} sig {:.1?}",
            e.damage.map(|d| 100.0 * d),
            e.std.map(|d| 100.0 * d),
            e.significance
        );
        let centre = evidence.information().centre().expect("centre");
        println!("   centre {:.2?}", centre.map(|d| 100.0 * d).as_slice());
    }
}
