//! The paper's cases: each simulated without noise, identified from mid-span alone, and set beside the paper's result.

use std::collections::HashMap;
use std::time::Instant;

use anyhow::Result;
use rand_core::SeedableRng;
use rand_xoshiro::Xoshiro128PlusPlus;
use spanwatch::bridge::ReducedBridge;
use spanwatch::capacity::ELEMENTS;
use spanwatch::identify::{CodeSearch, DamageCode, Hybrid, MicroGa, PaperGa, Problem, paper_ga};
use spanwatch::interaction::{Kinematics, Observation, Run};
use spanwatch::train::Train;
use spanwatch::wire::message::TrainKind;

use crate::simulate::{Scenario, simulate};

/// A case of the paper's Tables 6 and 7.
#[derive(Debug, Clone, Copy)]
pub struct Case {
    /// Its number.
    pub number: u32,
    /// Damaged elements (from 1) and their true damage.
    pub damage: &'static [(usize, f64)],
    /// Speed, km/h.
    pub speed_kmh: f64,
    /// Cars.
    pub cars: usize,
    /// Generations that the paper needed.
    pub paper_generations: u32,
}

/// Tables 6 and 7: the inspection car.
pub const CASES_2DOF: [Case; 8] = [
    Case {
        number: 1,
        damage: &[(5, 0.11)],
        speed_kmh: 60.0,
        cars: 1,
        paper_generations: 12,
    },
    Case {
        number: 2,
        damage: &[(5, 0.41)],
        speed_kmh: 60.0,
        cars: 1,
        paper_generations: 40,
    },
    Case {
        number: 3,
        damage: &[(1, 0.11)],
        speed_kmh: 60.0,
        cars: 1,
        paper_generations: 2,
    },
    Case {
        number: 4,
        damage: &[(1, 0.21), (5, 0.41)],
        speed_kmh: 60.0,
        cars: 1,
        paper_generations: 265,
    },
    Case {
        number: 5,
        damage: &[(5, 0.11)],
        speed_kmh: 120.0,
        cars: 1,
        paper_generations: 8,
    },
    Case {
        number: 6,
        damage: &[(5, 0.11)],
        speed_kmh: 270.0,
        cars: 1,
        paper_generations: 9,
    },
    Case {
        number: 7,
        damage: &[(5, 0.11)],
        speed_kmh: 120.0,
        cars: 16,
        paper_generations: 15,
    },
    Case {
        number: 8,
        damage: &[(5, 0.11)],
        speed_kmh: 270.0,
        cars: 16,
        paper_generations: 169,
    },
];

impl Case {
    /// The passage of this case.
    pub fn scenario(&self) -> Scenario {
        let mut scenario = Scenario {
            speed_kmh: self.speed_kmh,
            cars: self.cars,
            ..Scenario::inspection_car()
        };
        for &(element, loss) in self.damage {
            scenario.damage[element - 1] = loss;
        }
        scenario.recorded()
    }

    /// The code that should be found: the nearest tenth of each element.
    pub fn code(&self) -> DamageCode {
        DamageCode::nearest(&self.scenario().damage.map(|loss| loss as f32))
    }
}

/// How to search.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Method {
    /// The paper's genetic algorithm.
    PaperGa,
    /// The logger's small genetic search alone.
    MicroGa,
    /// The logger's whole identification.
    Hybrid,
}

/// What one search found.
#[derive(Debug, Clone, Copy)]
pub struct Found {
    /// The code.
    pub code: DamageCode,
    /// Its misfit (of the damage itself for [`Method::Hybrid`]), (m/s²)².
    pub objective: f32,
    /// Generations.
    pub generations: u32,
    /// Forward solves.
    pub forward_solves: u32,
    /// Time, s.
    pub seconds: f64,
}

/// Forward solves that the small genetic search may take when it is alone.
const MICRO_BUDGET: u32 = 4000;

/// Runs one search on one case.
pub fn run(bridge: &ReducedBridge<f32>, case: &Case, method: Method, seed: u64) -> Result<Found> {
    let scenario = case.scenario();
    let passage = simulate(&bridge.cast(), &scenario)?;
    let samples: Vec<f32> = passage.channels[0].iter().map(|&v| v as f32).collect();
    let observation = observation(bridge, &scenario)?;
    let problem = Problem {
        bridge,
        observation: &observation,
        samples: &samples,
    };
    let start = Instant::now();
    let rng = Xoshiro128PlusPlus::seed_from_u64(seed);
    Ok(match method {
        Method::PaperGa => search(&problem, PaperGa::new(rng), start)?,
        Method::MicroGa => search(&problem, MicroGa::new(rng, paper_ga::LIMIT, MICRO_BUDGET), start)?,
        Method::Hybrid => {
            let mut hybrid = Hybrid::new(seed);
            let found = loop {
                if let Some(found) = hybrid.advance(&problem)? {
                    break found;
                }
            };
            Found {
                code: found.code,
                objective: found.objective,
                generations: found.generations,
                forward_solves: found.forward_solves,
                seconds: start.elapsed().as_secs_f64(),
            }
        }
    })
}

fn search(problem: &Problem<'_>, mut search: impl CodeSearch, start: Instant) -> Result<Found> {
    // A code that comes again is not solved again, but counts: the search on its own would have to.
    let mut known: HashMap<DamageCode, f32> = HashMap::new();
    let mut forward_solves = 0;
    while let Some(code) = search.ask() {
        let misfit = match known.get(&code) {
            Some(&misfit) => misfit,
            None => problem.misfit(&code.damage())?,
        };
        known.insert(code, misfit);
        forward_solves += 1;
        search.tell(misfit);
    }
    let (code, objective) = search.best();
    let seconds = start.elapsed().as_secs_f64();
    Ok(Found {
        code,
        objective,
        generations: search.generations(),
        forward_solves,
        seconds,
    })
}

fn observation(bridge: &ReducedBridge<f32>, scenario: &Scenario) -> Result<Observation<f32>> {
    let rate = scenario.sample_interval_s().recip();
    Ok(Observation {
        train: Train::of_kind(TrainKind::Inspection2Dof, scenario.cars).expect("the cases have 1 to 16 cars"),
        run: Run {
            speed_mps: (scenario.speed_kmh / 3.6) as f32,
            entry_time_s: scenario.lead_s as f32,
            load_factor: scenario.load_factor as f32,
            kinematics: Kinematics::Paper,
        },
        places: scenario
            .nodes
            .iter()
            .filter_map(|&node| bridge.sensor_at(node))
            .collect(),
        sample_rate_hz: rate as f32,
        steps_per_sample: (rate.recip() / scenario.step_s).round() as u32,
        antialias_hz: scenario.antialias_hz.map(|hz| hz as f32),
    })
}

/// Elements of a bridge model, as a check that a case fits it.
pub const CASE_ELEMENTS: usize = ELEMENTS;
