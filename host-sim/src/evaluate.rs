//! The paper's cases: each simulated without noise, identified from mid-span alone, and set beside the paper's result.

use std::fmt::Write;
use std::time::Instant;

use anyhow::{Context, Result, bail};
use spanwatch::bridge::Damage;
use spanwatch::capacity::ELEMENTS;
use spanwatch::identify::DamageCode;
use spanwatch::identify::refine::Stop;
use spanwatch::interaction::simulation::LONGEST_STEP_S;
use spanwatch::wire::message::TrainKind;

use crate::batch;
use crate::identification::{Found, Known, Method, Observed, search};
use crate::model::BridgeFrame;
use crate::simulate::Scenario;
use crate::station::words::identification as words;
use crate::train::TrainName;

/// A case of the paper's Tables 6 to 8.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Case {
    /// Its number.
    pub number: u32,
    /// The car.
    pub train: TrainKind,
    /// Damaged elements (from 1) and their true damage.
    pub damage: &'static [(usize, f64)],
    /// Speed, km/h.
    pub speed_kmh: f64,
    /// Cars.
    pub cars: usize,
    /// Generations that the paper needed; none where it found nothing in 1000.
    pub paper_generations: Option<u32>,
}

/// Loss of element 5 in cases 1 and 5 to 8.
const SLIGHT: &[(usize, f64)] = &[(5, 0.11)];
/// Losses of cases 1 to 4.
const LOSSES: [&[(usize, f64)]; 4] = [SLIGHT, &[(5, 0.41)], &[(1, 0.11)], &[(1, 0.21), (5, 0.41)]];

/// The eight cases of a car: Tables 6 and 7 for the inspection car, Table 8 and section 4.4 for the 15-DOF car, which
/// runs in trains of sixteen but in cases 5 and 6.
pub fn cases(train: TrainKind) -> [Case; 8] {
    let (slow_cars, generations) = match train {
        TrainKind::Inspection2Dof => (1, [12, 40, 2, 265, 8, 9, 15, 169].map(Some)),
        TrainKind::Shinkansen3d => (16, [Some(57), Some(43), Some(187), Some(381), None, None, None, None]),
    };
    let runs = [
        (60.0, slow_cars),
        (60.0, slow_cars),
        (60.0, slow_cars),
        (60.0, slow_cars),
        (120.0, 1),
        (270.0, 1),
        (120.0, 16),
        (270.0, 16),
    ];
    std::array::from_fn(|i| Case {
        number: i as u32 + 1,
        train,
        damage: LOSSES.get(i).copied().unwrap_or(SLIGHT),
        speed_kmh: runs[i].0,
        cars: runs[i].1,
        paper_generations: generations[i],
    })
}

impl Case {
    /// The case of that number and car.
    ///
    /// # Errors
    /// If there is none.
    pub fn numbered(number: u32, train: TrainKind) -> Result<Self> {
        let cases = cases(train);
        (cases.into_iter().find(|case| case.number == number))
            .with_context(|| format!("there is no case {number}; the paper's cases are 1 to {}", cases.len()))
    }

    /// The passage of this case.
    pub fn scenario(&self, signal: Signal) -> Scenario {
        let mut scenario = Scenario {
            train: TrainName::Known(self.train),
            speed_kmh: self.speed_kmh,
            cars: Some(self.cars),
            ..Scenario::inspection_car()
        };
        for &(element, loss) in self.damage {
            scenario.damage[element - 1] = loss;
        }
        match signal {
            // As the paper does: the same program, with the same step, makes and explains the passage.
            Signal::Recorded => Scenario {
                step_s: LONGEST_STEP_S,
                ..scenario.recorded()
            },
            Signal::Raw => scenario,
        }
    }

    /// The true loss of each element.
    pub fn loss(&self) -> Damage<f32> {
        let mut loss = [0.0; ELEMENTS];
        for &(element, true_loss) in self.damage {
            loss[element - 1] = true_loss as f32;
        }
        loss
    }

    /// The code that should be found: the nearest tenth of each element.
    pub fn code(&self) -> DamageCode {
        DamageCode::nearest(&self.loss())
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
    /// Limit of the misfit that ends the paper's search, (m/s²)².
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
    /// How long each took, s; a code that was solved before, for another seed too, is looked up.
    pub seconds: Vec<f64>,
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

    /// Searches of the logger's kind that ended for that reason.
    fn stopped(&self, stop: Stop) -> usize {
        let identifications = self.found.iter().filter_map(|found| found.identification);
        identifications.filter(|found| found.stop == stop).count()
    }

    /// Why they ended: `converged`, or `18 converged, 2 budget`.
    fn ended(&self) -> String {
        let parts: Vec<(usize, &str)> = [Stop::Converged, Stop::NoProgress, Stop::Budget]
            .map(|stop| (self.stopped(stop), words::stop(stop)))
            .into_iter()
            .filter(|&(count, _)| count > 0)
            .collect();
        match parts.as_slice() {
            [(_, word)] => (*word).to_owned(),
            parts => {
                let told: Vec<String> = parts.iter().map(|(count, word)| format!("{count} {word}")).collect();
                told.join(", ")
            }
        }
    }

    /// Median and worst of a number over the seeds.
    fn spread<N: Copy + PartialOrd>(&self, of: impl Fn(&Found) -> N) -> Option<(N, N)> {
        median_and_worst(self.found.iter().map(of).collect())
    }
}

/// Median (of an even number the upper of the middle two) and largest; none of nothing.
pub fn median_and_worst<N: Copy + PartialOrd>(mut values: Vec<N>) -> Option<(N, N)> {
    values.sort_by(|a, b| a.partial_cmp(b).unwrap_or(std::cmp::Ordering::Equal));
    Some((*values.get(values.len() / 2)?, *values.last()?))
}

/// Runs a plan on all processors, rows in the order of methods and cases. `done` is called after every search.
pub fn paper(bridge: &BridgeFrame, plan: &Plan, done: &(dyn Fn() + Sync)) -> Result<Vec<Row>> {
    if plan.cases.is_empty() || plan.methods.is_empty() || plan.seeds == 0 {
        bail!("nothing to evaluate: give at least one case, one method and one seed");
    }
    let recordings = (plan.cases.iter())
        .map(|case| {
            Ok((
                Observed::simulated(bridge, &case.scenario(plan.signal))?,
                Known::default(),
            ))
        })
        .collect::<Result<Vec<_>>>()?;
    let jobs: Vec<(usize, Method, u64)> = (plan.methods.iter())
        .flat_map(|&method| (0..plan.cases.len()).map(move |case| (case, method)))
        .flat_map(|(case, method)| (1..=u64::from(plan.seeds)).map(move |seed| (case, method, seed)))
        .collect();
    let results = batch::each(&jobs, |&(case, method, seed)| -> Result<(Found, f64)> {
        let (recording, known) = &recordings[case];
        let start = Instant::now();
        let found = search(&recording.problem(), method, seed, plan.limit, known, &mut |_| ())?;
        let seconds = start.elapsed().as_secs_f64();
        done();
        Ok((found, seconds))
    })
    .into_iter()
    .collect::<Result<Vec<_>>>()?;

    let mut rows = vec![];
    for (found, (index, method)) in (results.chunks(plan.seeds as usize))
        .zip((plan.methods.iter()).flat_map(|&method| (0..plan.cases.len()).map(move |case| (case, method))))
    {
        let case = plan.cases[index];
        rows.push(Row {
            case,
            method,
            nearest_objective: recordings[index].0.problem().misfit(&case.code().damage())?,
            found: found.iter().map(|(found, _)| *found).collect(),
            seconds: found.iter().map(|(_, seconds)| *seconds).collect(),
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
    let heads = |method| {
        [
            "case",
            "km/h",
            "cars",
            "true, %",
            "found, %",
            "right",
            "generations",
            if method == Method::Hybrid {
                "ended"
            } else {
                "code since"
            },
            "paper's",
            "forward solves",
            "misfit",
            "of nearest",
            "seconds",
        ]
    };
    let mut text = String::new();
    for group in rows.chunk_by(|a, b| a.method == b.method) {
        let method = group.first().map_or(Method::Hybrid, |row| row.method);
        let mut lines = vec![heads(method).map(String::from)];
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
                if method == Method::Hybrid {
                    row.ended()
                } else {
                    pair(row.spread(|found| found.best_since))
                },
                (case.paper_generations).map_or_else(|| "none".to_owned(), |generations| generations.to_string()),
                pair(row.spread(|found| found.forward_solves)),
                objective.map_or_else(String::new, |(m, _)| format!("{m:.1e}")),
                format!("{:.1e}", row.nearest_objective),
                median_and_worst(row.seconds.clone()).map_or_else(String::new, |(m, _)| format!("{m:.1}")),
            ]);
        }
        // Writing to a String does not fail.
        let _ = writeln!(text, "{}\n\n{}", method.name(), aligned(lines));
    }
    text.push_str(
        "true, found: elements and their loss in per cent, found: the code most often found. right: searches that ended at \
         the nearest code.\ngenerations (until the end), code since (generation in which it appeared), forward solves (a \
         derivative at its true cost): median / worst;\nended: why hybrid's descent did; paper's: its converged generation.\nmisfit: median, (m/s2)2; for hybrid that of the damage \
         itself. seconds: median; a code solved before is looked up.\n",
    );
    text
}

/// A table in Markdown, its columns aligned; the first line are its heads.
pub fn aligned<const N: usize>(mut lines: Vec<[String; N]>) -> String {
    let widths: [usize; N] =
        std::array::from_fn(|c| lines.iter().map(|line| line[c].chars().count()).max().unwrap_or(0));
    lines.insert(1.min(lines.len()), widths.map(|width| "-".repeat(width)));
    let mut text = String::new();
    for line in &lines {
        let cells: Vec<String> = (line.iter().zip(widths))
            .map(|(cell, width)| format!("{cell:<width$}"))
            .collect();
        // Writing to a String does not fail.
        let _ = writeln!(text, "| {} |", cells.join(" | "));
    }
    text
}

/// The rows as JSON: one object a row.
pub fn json(rows: &[Row]) -> serde_json::Value {
    let row = |row: &Row| {
        let spread = |of: fn(&Found) -> u32| row.spread(of).map_or([0, 0], |(median, worst)| [median, worst]);
        serde_json::json!({
            "method": row.method.name(),
            "case": row.case.number,
            "train": TrainName::Known(row.case.train).name(),
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
            "stopped": (row.method == Method::Hybrid).then(|| serde_json::json!({
                "converged": row.stopped(Stop::Converged),
                "no progress": row.stopped(Stop::NoProgress),
                "budget": row.stopped(Stop::Budget),
            })),
            "paper_generations": row.case.paper_generations,
            "forward_solves": spread(|found| found.forward_solves),
            "objective": row.spread(|found| found.objective).map(|(median, _)| median),
            "seconds": median_and_worst(row.seconds.clone()).map(|(median, _)| median),
        })
    };
    rows.iter().map(row).collect()
}
