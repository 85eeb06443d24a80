//! The paper's cases: each simulated without noise, identified from mid-span alone, and set beside the paper's result.

use std::collections::HashMap;
use std::fmt::Write;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Mutex, PoisonError};
use std::time::Instant;

use anyhow::{Context, Result, anyhow, bail};
use rand_core::SeedableRng;
use rand_xoshiro::Xoshiro128PlusPlus;
use spanwatch::bridge::ReducedBridge;
use spanwatch::identify::{CodeSearch, DamageCode, Hybrid, MicroGa, PaperGa, Problem};
use spanwatch::interaction::{Observation, Run};
use spanwatch::train::Train;

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
    /// The case of that number in the paper's Tables 6 and 7.
    pub fn numbered(number: u32) -> Result<Self> {
        (CASES_2DOF.into_iter().find(|case| case.number == number)).with_context(|| {
            format!(
                "there is no case {number}; the paper's cases are 1 to {}",
                CASES_2DOF.len()
            )
        })
    }

    /// The passage of this case.
    pub fn scenario(&self, signal: Signal) -> Scenario {
        let mut scenario = Scenario {
            speed_kmh: self.speed_kmh,
            cars: self.cars,
            ..Scenario::inspection_car()
        };
        for &(element, loss) in self.damage {
            scenario.damage[element - 1] = loss;
        }
        match signal {
            Signal::Recorded => scenario.recorded(),
            Signal::Raw => scenario,
        }
    }

    /// The code that should be found: the nearest tenth of each element.
    pub fn code(&self) -> DamageCode {
        DamageCode::nearest(&self.scenario(Signal::Raw).damage.map(|loss| loss as f32))
    }
}

/// What of the simulated acceleration is searched.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Signal {
    /// What the design's recorder keeps of it: below 40 Hz, 200 samples a second.
    Recorded,
    /// The solution at every step of 1 ms, all eight modes, as the paper has it.
    Raw,
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

impl Method {
    /// As it is called on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::PaperGa => "paper-ga",
            Self::MicroGa => "micro-ga",
            Self::Hybrid => "hybrid",
        }
    }
}

/// A recorded passage of a case, ready to be searched.
#[derive(Debug, Clone)]
pub struct Recording<'a> {
    bridge: &'a ReducedBridge<f32>,
    observation: Observation<f32>,
    samples: Vec<f32>,
}

impl<'a> Recording<'a> {
    /// Simulates a case on `bridge`, in `f64`.
    pub fn of(bridge: &'a ReducedBridge<f32>, case: &Case, signal: Signal) -> Result<Self> {
        Self::of_scenario(bridge, &case.scenario(signal))
    }

    /// Simulates any scenario on `bridge`, in `f64`.
    pub fn of_scenario(bridge: &'a ReducedBridge<f32>, scenario: &Scenario) -> Result<Self> {
        let passage = simulate(&bridge.cast(), scenario)?;
        let train = Train::of_kind(scenario.train, scenario.cars)
            .with_context(|| format!("there is no train of {} cars", scenario.cars))?;
        let interval_s = scenario.sample_interval_s();
        let places = (scenario.nodes.iter())
            .map(|&node| {
                bridge
                    .sensor_at(node)
                    .with_context(|| format!("the bridge has no node {node}"))
            })
            .collect::<Result<_>>()?;
        Ok(Self {
            bridge,
            observation: Observation {
                train,
                run: Run {
                    speed_mps: (scenario.speed_kmh / 3.6) as f32,
                    entry_time_s: scenario.lead_s as f32,
                    load_factor: scenario.load_factor as f32,
                    kinematics: scenario.kinematics,
                },
                places,
                sample_rate_hz: interval_s.recip() as f32,
                steps_per_sample: (interval_s / scenario.step_s).round() as u32,
                antialias_hz: scenario.antialias_hz.map(|hz| hz as f32),
            },
            samples: (0..passage.channels[0].len())
                .flat_map(|i| passage.channels.iter().map(move |channel| channel[i] as f32))
                .collect(),
        })
    }

    /// The problem to be searched.
    pub fn problem(&self) -> Problem<'_> {
        Problem {
            bridge: self.bridge,
            observation: &self.observation,
            samples: &self.samples,
        }
    }
}

/// What one search found.
#[derive(Debug, Clone, Copy)]
pub struct Found {
    /// The code.
    pub code: DamageCode,
    /// Its misfit (of the damage itself for [`Method::Hybrid`]), (m/s²)².
    pub objective: f32,
    /// Generations until the search ended.
    pub generations: u32,
    /// Generation in which the code appeared.
    pub best_since: u32,
    /// Forward solves that the search asked for.
    pub forward_solves: u32,
    /// Time, s; a code that was solved before, for another seed too, is looked up.
    pub seconds: f64,
}

/// Misfits of the codes of one case that are known already.
pub type Known = Mutex<HashMap<DamageCode, f32>>;

/// Forward solves that the small genetic search may take when it is alone.
const MICRO_BUDGET: u32 = 4000;

/// Runs one search. `limit`, (m/s²)², ends the genetic searches.
pub fn run(problem: &Problem<'_>, method: Method, seed: u64, limit: f32, known: &Known) -> Result<Found> {
    let start = Instant::now();
    let rng = Xoshiro128PlusPlus::seed_from_u64(seed);
    let mut found = match method {
        Method::PaperGa => search(problem, PaperGa::new(rng, limit), known)?,
        Method::MicroGa => search(problem, MicroGa::new(rng, limit, MICRO_BUDGET), known)?,
        Method::Hybrid => {
            let mut hybrid = Hybrid::new(seed);
            let found = loop {
                if let Some(found) = hybrid.advance(problem)? {
                    break found;
                }
            };
            Found {
                code: found.code,
                objective: found.objective,
                generations: found.generations,
                best_since: found.generations,
                forward_solves: found.forward_solves,
                seconds: 0.0,
            }
        }
    };
    found.seconds = start.elapsed().as_secs_f64();
    Ok(found)
}

fn search(problem: &Problem<'_>, mut search: impl CodeSearch, known: &Known) -> Result<Found> {
    // A code that comes again is not solved again, but counts: the search on its own would have to.
    let mut forward_solves = 0;
    while let Some(code) = search.ask() {
        let before = known.lock().unwrap_or_else(PoisonError::into_inner).get(&code).copied();
        let misfit = match before {
            Some(misfit) => misfit,
            None => problem.misfit(&code.damage())?,
        };
        if before.is_none() {
            known
                .lock()
                .unwrap_or_else(PoisonError::into_inner)
                .insert(code, misfit);
        }
        forward_solves += 1;
        search.tell(misfit);
    }
    let (code, objective) = search.best();
    Ok(Found {
        code,
        objective,
        generations: search.generations(),
        best_since: search.best_since(),
        forward_solves,
        seconds: 0.0,
    })
}

/// What is to be evaluated.
#[derive(Debug, Clone)]
pub struct Plan {
    /// Cases, by number.
    pub cases: Vec<Case>,
    /// Searches.
    pub methods: Vec<Method>,
    /// Searches a case and method; their seeds are 1, 2, ..
    pub seeds: u32,
    /// What is searched.
    pub signal: Signal,
    /// Limit of the misfit that ends the genetic searches, (m/s²)².
    pub limit: f32,
}

/// What one method found in one case.
#[derive(Debug, Clone)]
pub struct Row {
    /// The case.
    pub case: Case,
    /// The method.
    pub method: Method,
    /// Misfit of the code nearest to the damage, (m/s²)².
    pub nearest_objective: f32,
    /// One search a seed.
    pub found: Vec<Found>,
}

impl Row {
    /// Searches that ended at the code nearest to the damage.
    pub fn right(&self) -> usize {
        self.found.iter().filter(|found| found.code == self.case.code()).count()
    }

    /// The code found most often; of equals the one with the smaller misfit.
    pub fn code(&self) -> DamageCode {
        let times = |code| self.found.iter().filter(|found| found.code == code).count();
        (self.found.iter())
            .max_by(|a, b| {
                times(a.code)
                    .cmp(&times(b.code))
                    .then(b.objective.total_cmp(&a.objective))
            })
            .map_or(DamageCode::default(), |found| found.code)
    }

    /// Median and worst of a number over the seeds.
    fn spread<N: Copy + PartialOrd>(&self, of: impl Fn(&Found) -> N) -> Option<(N, N)> {
        let mut values: Vec<N> = self.found.iter().map(of).collect();
        values.sort_by(|a, b| a.partial_cmp(b).unwrap_or(std::cmp::Ordering::Equal));
        Some((*values.get(values.len() / 2)?, *values.last()?))
    }
}

/// Runs a plan on all processors, rows in the order of methods and cases. `done` is called after every search.
pub fn paper(bridge: &ReducedBridge<f32>, plan: &Plan, done: &(dyn Fn() + Sync)) -> Result<Vec<Row>> {
    if plan.cases.is_empty() || plan.methods.is_empty() || plan.seeds == 0 {
        bail!("nothing to evaluate: give at least one case, one method and one seed");
    }
    let recordings = (plan.cases.iter())
        .map(|case| Ok((Recording::of(bridge, case, plan.signal)?, Known::default())))
        .collect::<Result<Vec<_>>>()?;
    let jobs: Vec<(usize, Method, u64)> = (plan.methods.iter())
        .flat_map(|&method| (0..plan.cases.len()).map(move |case| (case, method)))
        .flat_map(|(case, method)| (1..=u64::from(plan.seeds)).map(move |seed| (case, method, seed)))
        .collect();
    let next = AtomicUsize::new(0);
    let work = || -> Result<Vec<(usize, Found)>> {
        let mut results = vec![];
        loop {
            let job = next.fetch_add(1, Ordering::Relaxed);
            let Some(&(case, method, seed)) = jobs.get(job) else {
                return Ok(results);
            };
            let (recording, known) = &recordings[case];
            let found = run(&recording.problem(), method, seed, plan.limit, known)?;
            results.push((job, found));
            done();
        }
    };
    let workers = std::thread::available_parallelism().map_or(1, usize::from);
    let mut results = std::thread::scope(|scope| {
        let threads: Vec<_> = (0..workers).map(|_| scope.spawn(work)).collect();
        let joined = threads
            .into_iter()
            .map(|thread| thread.join().map_err(|_| anyhow!("a search panicked"))?);
        joined.collect::<Result<Vec<_>>>()
    })?
    .concat();
    results.sort_by_key(|(job, _)| *job);

    let mut rows = vec![];
    for (found, (index, method)) in (results.chunks(plan.seeds as usize))
        .zip((plan.methods.iter()).flat_map(|&method| (0..plan.cases.len()).map(move |case| (case, method))))
    {
        let case = plan.cases[index];
        rows.push(Row {
            case,
            method,
            nearest_objective: recordings[index].0.problem().misfit(&case.code().damage())?,
            found: found.iter().map(|(_, found)| *found).collect(),
        });
    }
    Ok(rows)
}

/// Damaged elements (from 1) with their per cent: `5: 10, 10: 10`.
fn damaged(of: impl Iterator<Item = (usize, f64)>) -> String {
    let parts: Vec<String> = of
        .filter(|&(_, loss)| loss > 0.0)
        .map(|(e, loss)| format!("{e}: {:.0}", 100.0 * loss))
        .collect();
    if parts.is_empty() {
        "none".into()
    } else {
        parts.join(", ")
    }
}

fn damaged_by_code(code: DamageCode) -> String {
    damaged((1..).zip(code.damage::<f64>()))
}

/// The rows as a table, a method after the other, in Markdown.
pub fn table(rows: &[Row]) -> String {
    let heads = [
        "case",
        "km/h",
        "cars",
        "true, %",
        "found, %",
        "right",
        "generations",
        "code since",
        "paper's",
        "forward solves",
        "misfit",
        "of nearest",
        "seconds",
    ];
    let mut text = String::new();
    for group in rows.chunk_by(|a, b| a.method == b.method) {
        let mut lines = vec![heads.map(String::from)];
        for row in group {
            let case = &row.case;
            let pair = |spread: Option<(u32, u32)>| spread.map_or_else(String::new, |(m, w)| format!("{m} / {w}"));
            let objective = row.spread(|found| found.objective);
            lines.push([
                case.number.to_string(),
                format!("{:.0}", case.speed_kmh),
                case.cars.to_string(),
                damaged(case.damage.iter().copied()),
                damaged_by_code(row.code()),
                format!("{} of {}", row.right(), row.found.len()),
                pair(row.spread(|found| found.generations)),
                pair(row.spread(|found| found.best_since)),
                case.paper_generations.to_string(),
                pair(row.spread(|found| found.forward_solves)),
                objective.map_or_else(String::new, |(m, _)| format!("{m:.1e}")),
                format!("{:.1e}", row.nearest_objective),
                row.spread(|found| found.seconds)
                    .map_or_else(String::new, |(m, _)| format!("{m:.1}")),
            ]);
        }
        let widths: Vec<usize> = (0..heads.len())
            .map(|c| lines.iter().map(|line| line[c].chars().count()).max().unwrap_or(0))
            .collect();
        lines.insert(1, std::array::from_fn(|c| "-".repeat(widths[c])));
        let method = group.first().map_or("", |row| row.method.name());
        // Writing to a String does not fail.
        let _ = writeln!(text, "{method}\n");
        for line in &lines {
            let cells: Vec<String> = line
                .iter()
                .zip(&widths)
                .map(|(cell, &width)| format!("{cell:<width$}"))
                .collect();
            let _ = writeln!(text, "| {} |", cells.join(" | "));
        }
        text.push('\n');
    }
    text.push_str(
        "true, found: elements and their loss in per cent, found: the code most often found. right: searches that ended at \
         the nearest code.\ngenerations (until the end), code since (generation in which it appeared), forward solves: \
         median / worst; paper's: its converged generation.\nmisfit: median, (m/s2)2; for hybrid that of the damage \
         itself. seconds: median; a code solved before is looked up.\n",
    );
    text
}

/// The rows as JSON: one object a row.
pub fn json(rows: &[Row]) -> serde_json::Value {
    let row = |row: &Row| {
        let spread = |of: fn(&Found) -> u32| row.spread(of).map_or([0, 0], |(median, worst)| [median, worst]);
        serde_json::json!({
            "method": row.method.name(),
            "case": row.case.number,
            "speed_kmh": row.case.speed_kmh,
            "cars": row.case.cars,
            "damage": row.case.scenario(Signal::Raw).damage,
            "nearest_code": row.case.code().genes(),
            "nearest_objective": row.nearest_objective,
            "code": row.code().genes(),
            "right": row.right(),
            "seeds": row.found.len(),
            "generations": spread(|found| found.generations),
            "code_since": spread(|found| found.best_since),
            "paper_generations": row.case.paper_generations,
            "forward_solves": spread(|found| found.forward_solves),
            "objective": row.spread(|found| found.objective).map(|(median, _)| median),
            "seconds": row.spread(|found| found.seconds).map(|(median, _)| median),
        })
    };
    rows.iter().map(row).collect()
}
