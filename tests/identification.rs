//! Identification: the logger's search finds the paper's eight cases and hundreds of others, says how sure it is, and the
//! genetic searches' operators do what they promise.

use std::collections::HashMap;
use std::convert::Infallible;

use host_sim::evaluate::{Case, Signal, cases};
use host_sim::identification::{Known, Method, Observed, search};
use host_sim::model::{self, BridgeFrame, Structure, reduce::reduce};
use host_sim::random::gaussian;
use host_sim::simulate::{Scenario, simulate_train};
use host_sim::study::noise::field::{MASS_ERROR, uneven};
use host_sim::study::track::truth::{ANNOUNCED, NOISE};
use host_sim::train::{SpatialTrain, TrainName};
use host_sim::validate::beam::GIRDER50;
use host_sim::validate::compare::rms;
use rand_core::{Rng, SeedableRng, TryRng};
use rand_xoshiro::{Xoshiro128PlusPlus, Xoshiro256PlusPlus};
use spanwatch::capacity::{ELEMENTS, MODES};
use spanwatch::identify::code::CODE_BITS;
use spanwatch::identify::refine::Stop;
use spanwatch::identify::{
    CodeSearch, DamageCode, Hybrid, Identification, MicroGa, PaperGa, Pass, Problem, micro_ga, paper_ga,
};
use spanwatch::interaction::Direction;
use spanwatch::passage::samples::Samples;
use spanwatch::track::learnt::{LearntTrack, UNLEARNT};
use spanwatch::wire::message::{Ranges, TrainKind};

fn girder50() -> BridgeFrame {
    model::shipped("girder50").expect("shipped")
}

fn case(number: u32) -> Case {
    Case::numbered(number, TrainKind::Inspection2Dof).expect("a case of the paper")
}

fn code(of: &[(usize, u8)]) -> DamageCode {
    of.iter().fold(DamageCode::default(), |code, &(element, gene)| {
        code.with(element - 1, gene)
    })
}

fn misfit(problem: &Problem<'_>, code: DamageCode) -> f32 {
    problem.misfit(&code.damage()).expect("a forward solve")
}

fn identify(problem: &Problem<'_>, seed: u64) -> Identification {
    let (mut search, mut pass) = (Hybrid::new(seed), Pass::new());
    loop {
        if let Some(found) = search.advance(problem, &mut pass).expect("a forward solve") {
            return *found;
        }
    }
}

fn xoshiro(seed: u64) -> Xoshiro128PlusPlus {
    Xoshiro128PlusPlus::seed_from_u64(seed)
}

// ---- the logger's identification ------------------------------------------------------------------------------------

#[test]
fn hybrid_finds_all_sixteen_cases_of_the_paper() {
    // The goal; measured over 20 seeds: docs/searches.md. The paper's population judges 50 codes a generation.
    const SOLVES: u32 = 200;
    // Without noise the damage is known to the square root of what counts as explained, and the valley's flatness.
    const POINTS: f32 = 0.005;
    let bridge = girder50();
    for case in [TrainKind::Inspection2Dof, TrainKind::Shinkansen3d]
        .into_iter()
        .flat_map(cases)
    {
        let recording = Observed::simulated(&bridge, &case.scenario(Signal::Recorded)).expect("simulates");
        let problem = recording.problem();
        for seed in 1..=if case.cars == 1 { 3 } else { 1 } {
            let found = identify(&problem, seed);
            let truth = case.scenario(Signal::Recorded).damage;
            let off =
                (found.estimate.damage.iter().zip(truth)).fold(0.0_f32, |off, (d, t)| off.max((d - t as f32).abs()));
            println!(
                "case {} of {:?}: {:?}, off by {off:.4}, {} solves",
                case.number,
                case.train,
                found.code.genes(),
                found.forward_solves
            );
            assert_eq!(found.code, case.code(), "case {}, seed {seed}", case.number);
            assert!(
                off < POINTS && found.forward_solves <= SOLVES,
                "case {}, seed {seed}: {off}",
                case.number
            );
        }
    }
}

#[test]
fn hybrid_finds_damage_that_it_was_not_made_for() {
    // One to three damages of 5 to 65 % anywhere, at 60 to 270 km/h, from mid-span alone.
    const SCENARIOS: u64 = 60;
    const POINTS: f64 = 0.01;
    let bridge = girder50();
    for seed in 0..SCENARIOS {
        let mut rng = Xoshiro256PlusPlus::seed_from_u64(seed);
        let mut unit = || f64::from(rng.next_u32()) / f64::from(u32::MAX);
        let mut scenario = Scenario {
            speed_kmh: 60.0 + 210.0 * unit(),
            ..Scenario::inspection_car()
        }
        .recorded();
        for _ in 0..1 + (3.0 * unit()) as usize {
            let element = ((ELEMENTS as f64 * unit()) as usize).min(ELEMENTS - 1);
            scenario.damage[element] = 0.05 + 0.6 * unit();
        }
        let recording = Observed::simulated(&bridge, &scenario).expect("simulates");
        let found = identify(&recording.problem(), seed);
        let off = (found.estimate.damage.iter().zip(&scenario.damage))
            .fold(0.0, |off: f64, (d, t)| off.max((f64::from(*d) - t).abs()));
        assert!(
            off < POINTS,
            "seed {seed}: {:?}, found {:?}",
            scenario.damage,
            found.estimate.damage
        );
    }
}

#[test]
fn a_train_that_comes_from_the_other_end_and_brakes_is_explained_as_it_runs() {
    let mut scenario = Scenario {
        direction: Direction::Backward,
        acceleration_mps2: -0.5,
        nodes: vec![3, 6, 9],
        ..Scenario::inspection_car()
    }
    .recorded();
    scenario.damage[1] = 0.3;
    let recording = Observed::simulated(&girder50(), &scenario).expect("simulates");
    let found = identify(&recording.problem(), 1);
    assert!(
        (found.estimate.damage[1] - 0.3).abs() < 0.01 && found.certain() == 0b10,
        "{:?}",
        found.estimate.damage
    );
}

#[test]
fn a_bridge_of_fewer_elements_has_no_damage_in_those_that_it_has_not() {
    // The search draws ten genes for any bridge; those of elements that do not exist move nothing and must not be believed.
    for elements in [3, 6, 9] {
        let file = GIRDER50.file(elements, elements.min(8));
        let bridge = BridgeFrame::from(&file);
        for loss in [0.0, 0.3] {
            let mut damage = vec![0.0; elements];
            damage[1] = loss;
            let scenario = Scenario {
                nodes: vec![2, 3],
                damage,
                noise: 0.05,
                modes: MODES.min(2 * elements),
                ..Scenario::inspection_car()
            }
            .recorded();
            let recording = Observed::simulated(&bridge, &scenario).expect("simulates");
            for seed in 1..=4 {
                let found = identify(&recording.problem(), seed);
                let expected = if loss > 0.0 { 0b10 } else { 0 };
                assert_eq!(
                    found.certain(),
                    expected,
                    "{elements} elements, loss {loss}: {:?}",
                    found.estimate.damage
                );
                assert!(found.estimate.damage[elements..].iter().all(|&loss| loss == 0.0));
                assert_eq!(found.code, found.code.within(elements));
            }
        }
    }
}

#[test]
fn the_stated_deviations_are_the_cramer_rao_bounds() {
    // The design's section 6: 5 % noise, inspection car, node 6: median / worst element 3.4 / 6.2 points in case 1 and 7.6 /
    // 14.3 in case 6. They were computed from another program's derivatives at the true damage; these here come from
    // one-sided differences at the damage found, which noise has moved, and the noise's strength is itself estimated from
    // some 1000 samples (2 %).
    const AGREEMENT: f32 = 0.10;
    let bridge = girder50();
    for (number, bounds) in [(1, [0.034, 0.062]), (6, [0.076, 0.143])] {
        let scenario = Scenario {
            noise: 0.05,
            seed: 11,
            ..case(number).scenario(Signal::Recorded)
        };
        let recording = Observed::simulated(&bridge, &scenario).expect("simulates");
        let found = identify(&recording.problem(), 1);
        let mut std = found.estimate.std;
        std.sort_by(f32::total_cmp);
        let (median, worst) = ((std[4] + std[5]) / 2.0, std[ELEMENTS - 1]);
        println!("case {number}: {median:.4} / {worst:.4}, bounds {bounds:?}");
        assert!((median / bounds[0] - 1.0).abs() < AGREEMENT && (worst / bounds[1] - 1.0).abs() < AGREEMENT);
        for (e, (d, t)) in found.estimate.damage.iter().zip(&scenario.damage).enumerate() {
            assert!(
                (d - *t as f32).abs() < 5.0 * found.estimate.std[e],
                "element {}: {d}",
                e + 1
            );
        }
    }
}

#[test]
fn a_wrong_first_guess_of_speed_entry_and_load_ends_in_the_right_basin() {
    // Speed off by 5 %, entry by 0.3 s, load by 20 %, each to either side, in each of the sixteen cases with 5 % noise at three
    // sensors. What is found may be off by noise only: by this many of the stated deviations, which one in a million exceeds.
    const DEVIATIONS: f32 = 5.0;
    let bridge = girder50();
    for (i, case) in [TrainKind::Inspection2Dof, TrainKind::Shinkansen3d]
        .into_iter()
        .flat_map(cases)
        .enumerate()
    {
        let scenario = Scenario {
            noise: 0.05,
            seed: i as u64,
            nodes: vec![3, 6, 9],
            ..case.scenario(Signal::Recorded)
        };
        let truth = scenario.run::<f32>();
        let mut recording = Observed::simulated(&bridge, &scenario).expect("simulates");
        let side = |bit: usize| if i >> bit & 1 == 0 { 1.0_f32 } else { -1.0 };
        let run = &mut recording.observation.run;
        run.speed_mps *= 1.0 + 0.05 * side(0);
        run.entry_time_s += 0.3 * side(1);
        run.load_factor *= 1.0 + 0.2 * side(2);
        recording.observation.ranges = Ranges {
            speed: 0.06,
            entry_s: 0.4,
            load: 0.3,
            stiffness: 0.0,
        };
        let found = identify(&recording.problem(), 1);
        let off = [
            (found.run.speed_mps / truth.speed_mps - 1.0) / found.std[1],
            (found.run.entry_time_s - truth.entry_time_s) / found.std[2],
            (found.run.load_factor / truth.load_factor - 1.0) / found.std[3],
        ];
        println!(
            "case {} of {:?}: {:.3?} +- {:.3?}; speed, entry, load off by {off:.1?} deviations of {:.5?}; {} solves, {:?}, rival {:?}",
            case.number,
            case.train,
            found.estimate.damage,
            found.estimate.std,
            &found.std[1..],
            found.forward_solves,
            found.stop,
            found.rival.map(|r| (r.whole, r.loses_by)),
        );
        let (damage, std) = (found.estimate.damage, found.estimate.std);
        for (e, (d, t)) in damage.iter().zip(&scenario.damage).enumerate() {
            assert!((d - *t as f32).abs() < DEVIATIONS * std[e], "element {}: {d}", e + 1);
        }
        assert!(off.iter().all(|off| off.abs() < DEVIATIONS));
    }
}

#[test]
fn noise_alone_is_not_damage() {
    let bridge = girder50();
    for seed in 1..=10 {
        let scenario = Scenario {
            noise: 0.05,
            seed,
            ..Scenario::inspection_car()
        }
        .recorded();
        let recording = Observed::simulated(&bridge, &scenario).expect("simulates");
        let found = identify(&recording.problem(), seed);
        assert!(
            found.explained() && found.certain() == 0,
            "seed {seed}: {:?}",
            found.estimate.damage
        );
    }
}

#[test]
fn what_no_damage_explains_is_not_called_explained() {
    // A record of something else: a steady hum of 6 Hz.
    let bridge = girder50();
    let recording = Observed::simulated(&bridge, &case(1).scenario(Signal::Recorded)).expect("simulates");
    let problem = recording.problem();
    let hum: Vec<f32> = (0..problem.samples.len())
        .map(|i| 0.05 * (i as f32 * 0.03 * std::f32::consts::TAU).sin())
        .collect();
    let found = identify(
        &Problem {
            samples: Samples::Plain(&hum),
            ..problem
        },
        1,
    );
    assert!(!found.explained() && found.certain() == 0, "{found:?}");
}

/// Cars in space, each with masses of its own, over a known track: what the loads would hide is found all the same, and they are, too.
#[test]
fn each_car_is_weighed_where_the_track_is_known() {
    /// A car is weighed to so much of its load.
    const WEIGHED: f32 = 0.01;
    let mut rng = Xoshiro256PlusPlus::seed_from_u64(5);
    let scenario = Scenario {
        train: TrainName::Known(TrainKind::Shinkansen3d),
        cars: Some(8),
        speed_kmh: 230.0,
        nodes: vec![3, 6, 9],
        damage: vec![0.0, 0.0, 0.0, 0.0, 0.1],
        ..Scenario::inspection_car()
    }
    .recorded();
    let model = scenario.train.train(scenario.cars).expect("a train");
    let train = uneven(&model, MASS_ERROR, &mut rng);
    let load = |train: &SpatialTrain, car: usize| train.kinds[train.cars[car].kind].contacts[0].load_n;
    let structure = Structure::new(girder50()).expect("stands");
    let clean = simulate_train(&structure, &scenario, &train, &mut |_, _| ())
        .expect("simulates")
        .channels;
    let sigma: Vec<f64> = clean.iter().map(|channel| NOISE * rms(channel)).collect();
    let samples = (0..clean[0].len()).flat_map(|i| {
        clean
            .iter()
            .zip(&sigma)
            .map(move |(channel, sigma)| (channel[i], sigma))
    });
    let samples: Vec<f32> = samples
        .map(|(value, sigma)| (value + sigma * gaussian(&mut rng)) as f32)
        .collect();

    let mut observed =
        Observed::of(reduce(&girder50()).expect("reduces").cast(), &scenario, samples).expect("observed");
    observed.observation.ranges = ANNOUNCED;
    let unknown = observed.identify(1).expect("identifies");
    let known = observed
        .with_track(&LearntTrack {
            passages: 60,
            ..UNLEARNT.clone()
        })
        .identify(1)
        .expect("identifies");
    println!(
        "unexplained {} with equal cars, {} weighed; losses {:?}",
        unknown.unexplained, known.unexplained, known.estimate.damage
    );
    for car in 0..8 {
        let truth = (load(&train, car) / load(&model, car)) as f32;
        let total = known.run.load_factor * known.cars[car];
        println!("car {}: {truth:.4}, weighed {total:.4}", car + 1);
        assert!((total - truth).abs() < WEIGHED, "car {}", car + 1);
    }
    let noise = (NOISE * NOISE) as f32;
    assert!(unknown.unexplained > 1.3 * noise && known.unexplained < 1.1 * noise);
    for (e, &loss) in known.estimate.damage.iter().enumerate() {
        let truth = if e == 4 { 0.1 } else { 0.0 };
        assert!(
            (loss - truth).abs() < OFF * known.estimate.std[e],
            "element {}: {loss}",
            e + 1
        );
    }
}

#[test]
fn an_identification_is_the_same_for_the_same_seed() {
    let bridge = girder50();
    let recording = Observed::simulated(&bridge, &case(2).scenario(Signal::Recorded)).expect("simulates");
    assert_eq!(identify(&recording.problem(), 7), identify(&recording.problem(), 7));
}

// ---- records that are not whole -------------------------------------------------------------------------------------

/// What is found may be off the truth by so many of the stated deviations, which one element in a million exceeds by chance.
const OFF: f32 = 5.0;

/// Case 4 with 5 % noise at nodes 3, 6 and 9.
fn three_sensors() -> (Observed, Vec<f64>) {
    let scenario = Scenario {
        noise: 0.05,
        seed: 4,
        nodes: vec![3, 6, 9],
        ..case(4).scenario(Signal::Recorded)
    };
    let observed = Observed::simulated(&girder50(), &scenario).expect("simulates");
    (observed, scenario.damage)
}

/// The same record without one of its channels.
fn without(observed: &Observed, channel: usize) -> Observed {
    let channels = observed.observation.recorder.sensors.len();
    let mut left = observed.clone();
    left.observation.recorder.sensors.remove(channel);
    left.samples = (observed.samples.iter().enumerate())
        .filter(|(i, _)| i % channels != channel)
        .map(|(_, &sample)| sample)
        .collect();
    left
}

/// Largest distance of a found damage from another, in deviations.
fn apart(found: &Identification, from: impl IntoIterator<Item = f32>) -> f32 {
    (found.estimate.damage.iter().zip(from).zip(&found.estimate.std)).fold(0.0, |most: f32, ((damage, from), std)| {
        most.max((damage - from).abs() / std)
    })
}

fn as_f32(damage: &[f64]) -> impl Iterator<Item = f32> {
    damage.iter().map(|&loss| loss as f32)
}

#[test]
fn gaps_cost_what_they_hid_and_nothing_else() {
    // A tenth of all rows is missing, in gaps of 1, 20 and 50 rows, one of them while the car is on the bridge.
    let (mut observed, truth) = three_sensors();
    let whole = identify(&observed.problem(), 1);
    let rows = observed.samples.len() / 3;
    let gaps = [300..350, 500..520]
        .into_iter()
        .chain((0..rows).step_by(20).map(|row| row..row + 1));
    for gap in gaps {
        observed.samples[3 * gap.start..3 * gap.end].fill(f32::NAN);
    }
    let found = identify(&observed.problem(), 1);
    println!("{:?} +- {:?}", found.estimate.damage, found.estimate.std);
    assert!(found.explained() && found.certain() == whole.certain());
    assert!(apart(&found, as_f32(&truth)) < OFF);
    // No surer than with all of it, and not much less sure: root(1 / 0.9) where every row says as much as any other.
    for (of_all, of_some) in whole.estimate.std.iter().zip(&found.estimate.std) {
        assert!((0.95..1.25).contains(&(of_some / of_all)), "{of_some} {of_all}");
    }
}

#[test]
fn a_dead_channel_is_as_if_it_were_not_there() {
    let (mut observed, _) = three_sensors();
    for dead in 0..3 {
        let left = identify(&without(&observed, dead).problem(), 1);
        let mut kept = observed.samples.clone();
        observed
            .samples
            .iter_mut()
            .skip(dead)
            .step_by(3)
            .for_each(|sample| *sample = f32::NAN);
        let found = identify(&observed.problem(), 1);
        assert_eq!(
            (found.estimate, found.stop),
            (left.estimate, left.stop),
            "channel {dead}"
        );
        core::mem::swap(&mut observed.samples, &mut kept);
    }
}

#[test]
fn what_a_saturated_sensor_has_not_seen_does_not_count() {
    // Node 6 saturates at half of its peak. Its samples there are not known; taken for true at the limit they would be wrong.
    let (mut observed, truth) = three_sensors();
    let mid_span = || observed.samples.iter().skip(1).step_by(3);
    let limit = mid_span().fold(0.0, |most: f32, sample| most.max(sample.abs())) / 2.0;
    let mut lost = 0;
    for sample in observed
        .samples
        .iter_mut()
        .skip(1)
        .step_by(3)
        .filter(|sample| sample.abs() >= limit)
    {
        *sample = f32::NAN;
        lost += 1;
    }
    let found = identify(&observed.problem(), 1);
    println!("{lost} lost: {:?} +- {:?}", found.estimate.damage, found.estimate.std);
    assert!(lost > 20 && found.explained());
    assert!(apart(&found, as_f32(&truth)) < OFF);
}

#[test]
fn a_channel_ten_times_noisier_changes_no_more_than_it_says() {
    let (mut observed, truth) = three_sensors();
    for poor in 0..3 {
        let left = identify(&without(&observed, poor).problem(), 1);
        let kept = observed.samples.clone();
        let mut rng = xoshiro(poor as u64);
        let power = kept
            .iter()
            .skip(poor)
            .step_by(3)
            .map(|sample| sample * sample)
            .sum::<f32>();
        let rms = (3.0 * power / kept.len() as f32).sqrt();
        for sample in observed.samples.iter_mut().skip(poor).step_by(3) {
            // Half of its RMS, even between two borders that are root(3) deviations away.
            let even = 2.0 * (rng.next_u32() as f32 / u32::MAX as f32) - 1.0;
            *sample += 0.5 * rms * 3.0_f32.sqrt() * even;
        }
        let found = identify(&observed.problem(), 1);
        observed.samples = kept;
        println!(
            "channel {poor}: {:?} +- {:?}",
            found.estimate.damage, found.estimate.std
        );
        println!("without it: {:?} +- {:?}", left.estimate.damage, left.estimate.std);
        // Two answers from almost the same data are closer to each other than either to the truth.
        assert!(apart(&found, left.estimate.damage) < 1.0 && apart(&found, as_f32(&truth)) < OFF);
        for (with, without) in found.estimate.std.iter().zip(&left.estimate.std) {
            assert!((0.8..1.05).contains(&(with / without)), "{with} {without}");
        }
    }
}

#[test]
fn a_search_that_runs_out_of_budget_says_so() {
    // Five minutes of a record: thirty forward solves are all that the budget has.
    const MOST_SOLVES: u32 = 40;
    let scenario = Scenario {
        tail_s: 300.0,
        noise: 0.05,
        ..case(4).scenario(Signal::Recorded)
    };
    let observed = Observed::simulated(&girder50(), &scenario).expect("simulates");
    let found = identify(&observed.problem(), 1);
    println!(
        "{:?} after {} solves: {:?}",
        found.stop, found.forward_solves, found.estimate.damage
    );
    assert_eq!(found.stop, Stop::Budget);
    assert!(found.forward_solves < MOST_SOLVES);
    let enough = Scenario {
        tail_s: 3.0,
        ..scenario
    };
    let observed = Observed::simulated(&girder50(), &enough).expect("simulates");
    assert_eq!(identify(&observed.problem(), 1).stop, Stop::Converged);
}

// ---- what the paper's search can and cannot find --------------------------------------------------------------------

#[test]
fn paper_ga_finds_case_3() {
    // The one case in which the nearest code has the least misfit of all. Seed 1 finds it in generation 20.
    const GENERATIONS: u32 = 60;
    let bridge = girder50();
    let recording = Observed::simulated(&bridge, &case(3).scenario(Signal::Recorded)).expect("simulates");
    let problem = recording.problem();
    let mut search = PaperGa::new(xoshiro(1), 0.0);
    let mut known = HashMap::new();
    while search.generations() <= GENERATIONS {
        let Some(code) = search.ask() else { break };
        search.tell(*known.entry(code).or_insert_with(|| misfit(&problem, code)));
    }
    println!(
        "found in generation {}, {} codes solved",
        search.best_since(),
        known.len()
    );
    assert_eq!(search.best().0, case(3).code());
}

#[test]
fn the_nearest_code_is_not_the_one_with_the_least_misfit() {
    // Why a genetic search over codes ends elsewhere than the paper's tables: one point of damage that no code can express
    // is better made up for by 10 % in an element at a support, which the first mode hardly bends.
    let bridge = girder50();
    for (number, better) in [
        (1, code(&[(5, 1), (10, 1)])),
        (2, code(&[(5, 4), (9, 1)])),
        (4, code(&[(2, 1), (5, 4)])),
        (5, code(&[(5, 1), (10, 2)])),
        (6, code(&[(5, 1), (10, 2)])),
        (8, code(&[(5, 1), (10, 1)])),
    ] {
        let recording = Observed::simulated(&bridge, &case(number).scenario(Signal::Recorded)).expect("simulates");
        let problem = recording.problem();
        let (nearest, other) = (misfit(&problem, case(number).code()), misfit(&problem, better));
        println!("case {number}: nearest {nearest:.3e}, {:?} {other:.3e}", better.genes());
        assert!(other < nearest, "case {number}");
        let truth = case(number).loss();
        assert!(
            problem.misfit(&truth).expect("a solve") < 1e-4 * other,
            "the damage itself explains it all"
        );
    }
}

#[test]
fn no_limit_of_the_misfit_serves_all_eight_cases() {
    // A limit that ends the search at the nearest code in case 8 must be above 8.7e-5 (m/s²)²; one that does not end it at
    // the undamaged bridge in case 3, below 9.4e-8. No unit of 1e-6 and no other mass of the girder mends that: both
    // misfits grow alike with the square of the unit and of the girder's lightness.
    let bridge = girder50();
    let of = |number: u32, code: DamageCode| {
        misfit(
            &Observed::simulated(&bridge, &case(number).scenario(Signal::Recorded))
                .expect("simulates")
                .problem(),
            code,
        )
    };
    let undamaged = of(3, DamageCode::default());
    let nearest = of(8, case(8).code());
    println!("case 3, undamaged: {undamaged:.1e}; case 8, nearest: {nearest:.1e}");
    assert!(undamaged < paper_ga::LIMIT && paper_ga::LIMIT < nearest && nearest > 500.0 * undamaged);
    const IN_GAL: f32 = 1e-4 * paper_ga::LIMIT;
    assert!(
        of(3, case(3).code()) > IN_GAL,
        "in gal no code is below it, so that no search would converge"
    );
}

// ---- the genetic searches, on landscapes made for them --------------------------------------------------------------

/// A smooth landscape with its least misfit at one code.
fn hill(code: DamageCode) -> f32 {
    const TOP: [u8; ELEMENTS] = [2, 0, 7, 1, 4, 0, 3, 0, 5, 6];
    code.genes()
        .iter()
        .zip(TOP)
        .map(|(&g, t)| (f32::from(g) - f32::from(t)).powi(2))
        .sum::<f32>()
        + 0.5
}

/// Runs a search for so many solves; gives the codes that it asked for.
fn asked(search: &mut impl CodeSearch, landscape: impl Fn(DamageCode) -> f32, solves: usize) -> Vec<DamageCode> {
    let mut codes = vec![];
    while codes.len() < solves {
        let Some(code) = search.ask() else { break };
        assert_eq!(search.ask(), Some(code), "asked twice, the same answer");
        codes.push(code);
        search.tell(landscape(code));
    }
    codes
}

#[test]
fn two_point_crossover_exchanges_the_middle_and_nothing_else() {
    let mut rng = xoshiro(3);
    for _ in 0..20_000 {
        let pair = [0, 1].map(|_| DamageCode::from_bits(rng.next_u32()));
        let cuts = [0, 1].map(|_| rng.next_u32() % (CODE_BITS + 1));
        let children = paper_ga::swap_between(pair, cuts);
        let (from, to) = (cuts[0].min(cuts[1]), cuts[0].max(cuts[1]));
        for bit in 0..CODE_BITS {
            let of = |code: DamageCode| code.bits() >> bit & 1;
            let [a, b] = if (from..to).contains(&bit) { [1, 0] } else { [0, 1] };
            assert_eq!(
                [of(children[0]), of(children[1])],
                [of(pair[a]), of(pair[b])],
                "bit {bit}, cuts {cuts:?}"
            );
        }
    }
    let pair = [code(&[(1, 7)]), code(&[(10, 7)])];
    assert_eq!(paper_ga::swap_between(pair, [13, 13]), pair);
    assert_eq!(paper_ga::swap_between(pair, [CODE_BITS, 0]), [pair[1], pair[0]]);
}

#[test]
fn mutation_replaces_one_gene_in_ten_evenly() {
    // A replaced gene is the old one again once in eight. Five standard deviations: a right rate fails once in two
    // million runs, and the seed is fixed.
    const CODES: u32 = 100_000;
    const DEVIATIONS: f64 = 5.0;
    let mut rng = xoshiro(5);
    let before = code(&[(2, 3), (5, 7)]);
    let (mut changed, mut landed) = ([0_u32; ELEMENTS], [0_u32; 8]);
    for _ in 0..CODES {
        let after = paper_ga::mutate(before, &mut rng);
        for e in (0..ELEMENTS).filter(|&e| after.gene(e) != before.gene(e)) {
            changed[e] += 1;
            if before.gene(e) == 0 {
                landed[usize::from(after.gene(e))] += 1;
            }
        }
    }
    let within =
        |count: u32, n: f64, p: f64| (f64::from(count) - n * p).abs() < DEVIATIONS * (n * p * (1.0 - p)).sqrt();
    let rate = f64::from(paper_ga::MUTATION) * 7.0 / 8.0;
    println!(
        "changed {changed:?} of {CODES}, expected {:.0}; landed {landed:?}",
        f64::from(CODES) * rate
    );
    assert!(changed.iter().all(|&count| within(count, f64::from(CODES), rate)));
    let total = f64::from(landed.iter().sum::<u32>());
    assert!(landed[0] == 0 && landed[1..].iter().all(|&count| within(count, total, 1.0 / 7.0)));
}

#[test]
fn paper_ga_keeps_its_best_and_its_sizes() {
    let mut search = PaperGa::new(xoshiro(9), 0.0);
    let mut best = f32::INFINITY;
    let mut solves = 0_u32;
    while let Some(code) = search.ask() {
        if solves > 0 && (solves as usize).is_multiple_of(paper_ga::POPULATION) {
            assert_eq!(code, search.best().0, "the best is the first of each new generation");
        }
        search.tell(hill(code));
        solves += 1;
        assert_eq!(search.generations(), (solves - 1) / paper_ga::POPULATION as u32 + 1);
        assert!(search.best().1 <= best && search.best_since() <= search.generations());
        best = search.best().1;
    }
    // No misfit is below zero: 1000 generations of 50.
    assert_eq!((solves, search.generations()), (50_000, paper_ga::MAX_GENERATIONS));
    assert!(!search.converged() && (best - 0.5).abs() < f32::EPSILON, "{best}");
    // And it ends at once when a misfit is below the limit.
    let mut search = PaperGa::new(xoshiro(9), 0.6);
    asked(&mut search, hill, usize::MAX);
    assert!(search.converged() && search.generations() < paper_ga::MAX_GENERATIONS);
}

#[test]
fn micro_ga_keeps_its_best_its_budget_and_brings_strangers() {
    const _: () = assert!(micro_ga::POPULATION <= 10);
    const BUDGET: u32 = 3000;
    let mut search = MicroGa::new(xoshiro(2), BUDGET);
    let first = asked(&mut search, hill, 1);
    assert_eq!(first, [DamageCode::default()], "the undamaged bridge comes first");
    let mut best = search.best().1;
    for _ in 1..BUDGET {
        assert_eq!(asked(&mut search, hill, 1).len(), 1);
        assert!(search.best().1 <= best, "{best}");
        best = search.best().1;
    }
    assert_eq!(search.ask(), None, "the budget is used up");
    assert!(
        search.restarts() > 0 && (best - 0.5).abs() < f32::EPSILON,
        "{} {best}",
        search.restarts()
    );
    // The elite is not judged again: seven solves a generation after the first eight.
    assert_eq!(search.generations(), (BUDGET - 8).div_ceil(7) + 1);

    search.begin_again(100);
    assert_eq!(asked(&mut search, hill, usize::MAX).len(), 100);
}

#[test]
fn searches_are_the_same_for_the_same_seed_and_not_for_another() {
    let paper = |seed| asked(&mut PaperGa::new(xoshiro(seed), 0.0), hill, 2000);
    let micro = |seed| asked(&mut MicroGa::new(xoshiro(seed), 500), hill, 2000);
    assert!(paper(1) == paper(1) && micro(1) == micro(1));
    assert!(paper(1) != paper(2) && micro(1) != micro(2));
}

/// A generator of another kind (a Weyl sequence, mixed), which counts its draws.
struct Counting {
    state: u32,
    draws: u32,
}

impl TryRng for Counting {
    type Error = Infallible;

    fn try_next_u32(&mut self) -> Result<u32, Infallible> {
        self.draws += 1;
        self.state = self.state.wrapping_add(0x9E37_79B9);
        let mixed = (self.state ^ (self.state >> 16)).wrapping_mul(0x85EB_CA6B);
        Ok(mixed ^ (mixed >> 13))
    }

    fn try_next_u64(&mut self) -> Result<u64, Infallible> {
        let halves = [self.try_next_u32()?, self.try_next_u32()?];
        Ok(u64::from(halves[0]) << 32 | u64::from(halves[1]))
    }

    fn try_fill_bytes(&mut self, bytes: &mut [u8]) -> Result<(), Infallible> {
        for chunk in bytes.chunks_mut(4) {
            let word = self.try_next_u32()?.to_le_bytes();
            chunk.copy_from_slice(&word[..chunk.len()]);
        }
        Ok(())
    }
}

#[test]
fn searches_run_on_any_generator_and_draw_from_no_other() {
    let mut rng = Counting { state: 1, draws: 0 };
    // A borrowed generator is one too.
    asked(&mut PaperGa::new(&mut rng, 0.0), hill, paper_ga::POPULATION);
    assert_eq!(rng.draws, 50, "one draw for each individual of the first population");
    let mut search = PaperGa::new(&mut rng, 0.6);
    asked(&mut search, hill, usize::MAX);
    assert!(search.converged());
    let before = rng.draws;
    asked(&mut MicroGa::new(&mut rng, 100), hill, usize::MAX);
    assert!(rng.draws > before);
}

// ---- a record that this program did not make ------------------------------------------------------------------------

#[test]
fn damage_is_found_in_the_history_of_an_independent_program() {
    // Reference r2: element 1 has lost 21 %, element 5 41 %; made by other code, to the same step of 1 ms, printed to 8 digits.
    const TENTH_OF_A_POINT: f32 = 1e-3;
    let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/data/reference");
    for (file, truth) in [
        ("r1_2dof_1car_60kmh_healthy.csv", [0.0, 0.0]),
        ("r2_2dof_1car_60kmh_e1_21_e5_41.csv", [0.21, 0.41]),
    ] {
        let mut rows = csv::Reader::from_path(folder.join(file)).expect("a reference history");
        let samples: Vec<f32> = rows
            .deserialize::<Vec<f64>>()
            .flat_map(|row| row.expect("numbers").into_iter().skip(1).take(3))
            .map(|value| value as f32)
            .collect();
        let scenario = Scenario {
            nodes: vec![3, 6, 9],
            lead_s: 0.0,
            tail_s: 0.0,
            ..Scenario::inspection_car()
        };
        let mut observed = Observed::simulated(&girder50(), &scenario).expect("simulates");
        observed.samples = samples;
        let found = search(
            &observed.problem(),
            Method::Hybrid,
            1,
            0.0,
            &Known::default(),
            &mut |_| (),
        )
        .expect("a search");
        for (e, &loss) in found.damage().iter().enumerate() {
            let truth = match e {
                0 => truth[0],
                4 => truth[1],
                _ => 0.0,
            };
            assert!(
                (loss - truth).abs() < TENTH_OF_A_POINT,
                "{file}, element {}: {loss}",
                e + 1
            );
        }
    }
}
