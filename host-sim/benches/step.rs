//! Times of the solver on this computer: `cargo bench -p host-sim --bench step`.
//!
//! `planar_step` is the time of one step. The others are times of whole passages; the column below the time gives steps or
//! patterns a second.

mod passage;

use divan::counter::ItemsCount;
use divan::{Bencher, black_box};
use host_sim::batch;
use host_sim::identification::Observed;
use host_sim::model;
use host_sim::simulate::Scenario;
use passage::{BRIDGE, Endless, InSpace, SPEED_MPS, Traffic};
use spanwatch::bridge::Damage;
use spanwatch::capacity::ELEMENTS;
use spanwatch::interaction::Scheme;
use spanwatch::interaction::simulation::LONGEST_STEP_S;
use spanwatch::math::Real;
use spanwatch::wire::message::TrainKind::{Inspection2Dof, Shinkansen3d};

const TRAFFIC: [Traffic; 6] = [
    Traffic {
        kind: Inspection2Dof,
        cars: 1,
    },
    Traffic {
        kind: Inspection2Dof,
        cars: 4,
    },
    Traffic {
        kind: Inspection2Dof,
        cars: 16,
    },
    Traffic {
        kind: Shinkansen3d,
        cars: 1,
    },
    Traffic {
        kind: Shinkansen3d,
        cars: 4,
    },
    Traffic {
        kind: Shinkansen3d,
        cars: 16,
    },
];
/// Damage patterns of a batch: a generation of the paper's search.
const PATTERNS: usize = 50;

fn main() {
    divan::main();
}

/// One step of the logger's solver while the train is on the bridge.
// A sample is several passages, so that each has steps with few and with many cars on the bridge.
#[divan::bench(types = [f32, f64], args = TRAFFIC, sample_size = 7200, sample_count = 50)]
fn planar_step<T: Real>(bencher: Bencher<'_, '_>, traffic: Traffic) {
    let cars = passage::cars::<T>(traffic, Scheme::Exact, LONGEST_STEP_S);
    let mut passage = Endless::new(traffic, &cars);
    bencher.bench_local(|| passage.step());
}

/// A passage of cars in space, 15 degrees of freedom each.
#[divan::bench(args = TRAFFIC)]
fn spatial_passage(bencher: Bencher<'_, '_>, traffic: Traffic) {
    let passage = InSpace::new(traffic, Scheme::Exact, LONGEST_STEP_S);
    bencher.counter(ItemsCount::new(passage.steps)).bench_local(|| {
        passage.solve(&mut |state| {
            black_box(state.position[0]);
        });
    });
}

/// One damage pattern against one recording, as the searches ask it: eigenproblem, passage with lead and free vibration,
/// recorder, misfit.
#[divan::bench(args = TRAFFIC)]
fn forward_solve(bencher: Bencher<'_, '_>, traffic: Traffic) {
    let observed = observed(traffic);
    let problem = observed.problem();
    bencher
        .counter(ItemsCount::new(1_u32))
        .bench_local(|| problem.misfit(black_box(&[0.1; ELEMENTS])).expect("a solve"));
}

/// A batch of [`PATTERNS`] damage patterns of sixteen `shinkansen-3d` cars on so many threads.
#[divan::bench(args = threads(), sample_count = 20)]
fn batch_of_patterns(bencher: Bencher<'_, '_>, threads: usize) {
    let observed = observed(TRAFFIC[5]);
    let problem = observed.problem();
    let patterns: Vec<Damage<f32>> = (0..PATTERNS)
        .map(|p| std::array::from_fn(|e| if e == p % ELEMENTS { 0.01 * p as f32 } else { 0.0 }))
        .collect();
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(threads)
        .build()
        .expect("threads");
    bencher
        .counter(ItemsCount::new(PATTERNS))
        .bench_local(|| pool.install(|| batch::misfits(&problem, &patterns).expect("solves")));
}

/// One thread, and one a processor.
fn threads() -> Vec<usize> {
    let processors = std::thread::available_parallelism().map_or(1, usize::from);
    if processors == 1 { vec![1] } else { vec![1, processors] }
}

/// A recording of the healthy girder through the recorder's chain.
fn observed(traffic: Traffic) -> Observed {
    let scenario = Scenario {
        train: traffic.name(),
        cars: Some(traffic.cars),
        speed_kmh: 3.6 * SPEED_MPS,
        ..Scenario::inspection_car().recorded()
    };
    Observed::simulated(&model::shipped(BRIDGE).expect("ships"), &scenario).expect("a passage")
}
