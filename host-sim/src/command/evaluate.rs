//! `host-sim evaluate`: the paper's cases, searched again and set beside its tables, and the studies that choices rest on.

use std::path::{Path, PathBuf};

use anyhow::{Result, bail};
use clap::{Args, Subcommand, ValueEnum};
use host_sim::evaluate::{self, Case, Plan, Signal};
use host_sim::identification::Method;
use host_sim::model::Structure;
use host_sim::picture::chart;
use host_sim::study::{accuracy, node_maxima, precision};
use host_sim::{model, output, terminal};
use spanwatch::identify::paper_ga;
use spanwatch::wire::message::TrainKind;

use super::{print, print_json};

/// What to evaluate.
#[derive(Debug, Subcommand)]
pub(super) enum Command {
    /// Search the paper's cases without noise, from mid-span alone (its Tables 6 to 8)
    Paper(Paper),
    /// Compare time integrations by the error of the recorder's signal and their work
    Accuracy {
        /// Existing folder that the picture is written into, too
        #[arg(long, value_name = "DIR")]
        out: Option<PathBuf>,
    },
    /// Compare the logger's simulation in single precision with the same in double precision
    Precision,
    /// Make the paper's Table 4 again: the largest acceleration of each node before and after damage
    Table4,
}

#[derive(Debug, Args)]
pub(super) struct Paper {
    /// Train of the cases
    #[arg(long, value_enum, default_value_t = CaseTrain::Inspection2Dof)]
    train: CaseTrain,
    /// Cases, as 1,4,8; without it all eight
    #[arg(long, value_delimiter = ',', value_name = "NUMBERS")]
    cases: Vec<u32>,
    /// Searches a case and method; their seeds are 1, 2, ..
    #[arg(long, default_value_t = 5)]
    seeds: u32,
    /// How to search; without it all three, one after the other
    #[arg(long, value_enum, value_delimiter = ',', value_name = "METHODS")]
    method: Vec<SearchMethod>,
    /// Search the solution at every step of 1 ms, as the paper, and not what a recorder keeps of it
    #[arg(long)]
    raw: bool,
    /// Misfit that ends paper-ga, (m/s2)2; 0: all 1000 generations
    #[arg(long, default_value_t = paper_ga::LIMIT)]
    limit: f32,
    /// Print one JSON array in place of the tables
    #[arg(long)]
    json: bool,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum CaseTrain {
    /// The two-degree-of-freedom inspection car
    #[value(name = "inspection-2dof", alias = "2dof")]
    Inspection2Dof,
    /// The 15-degree-of-freedom car
    #[value(name = "shinkansen-3d", alias = "3d")]
    Shinkansen3d,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum SearchMethod {
    /// The paper's genetic algorithm
    PaperGa,
    /// The logger's small genetic search alone
    MicroGa,
    /// The logger's identification: small genetic search, then Gauss-Newton
    Hybrid,
}

/// Evaluates and prints.
pub(super) fn run(command: &Command) -> Result<()> {
    match command {
        Command::Paper(arguments) => paper(arguments),
        Command::Accuracy { out } => accuracy(out.as_deref()),
        Command::Precision => print(&precision::table(&precision::rows()?)),
        Command::Table4 => print(&node_maxima::table(&node_maxima::solve()?)),
    }
}

fn accuracy(out: Option<&Path>) -> Result<()> {
    let picture = out.map(|folder| folder.join("accuracy.svg"));
    if let Some(path) = &picture {
        output::check(path)?;
    }
    let bridge = Structure::new(model::shipped("girder50")?)?;
    let bar = terminal::progress(accuracy::CASES.len() as u64, "comparing");
    let comparisons = (accuracy::CASES.iter())
        .map(|case| {
            let comparison = accuracy::compare(&bridge, case, accuracy::CONVERGED_STEPS);
            bar.inc(1);
            comparison
        })
        .collect::<Result<Vec<_>>>();
    bar.finish_and_clear();
    let comparisons = comparisons?;
    let tables = accuracy::tables(&bridge, &comparisons)?;
    if let Some(path) = &picture {
        let svg = chart::svg(
            "Error of the recorder's signal by work",
            "girder50, element 5 with 11 % loss, nodes 3, 6 and 9, below 40 Hz; points: steps of 5 to 0.25 ms",
            &accuracy::plots(&bridge, &comparisons)?,
        )?;
        output::write(&[(path, svg.as_bytes())])?;
    }
    print(&tables)
}

fn paper(arguments: &Paper) -> Result<()> {
    let train = match arguments.train {
        CaseTrain::Inspection2Dof => TrainKind::Inspection2Dof,
        CaseTrain::Shinkansen3d => TrainKind::Shinkansen3d,
    };
    if arguments.seeds == 0 {
        bail!("--seeds must be at least 1");
    }
    if !(arguments.limit.is_finite() && arguments.limit >= 0.0) {
        bail!("--limit must be zero or a positive number, not {}", arguments.limit);
    }
    let cases = if arguments.cases.is_empty() {
        evaluate::cases(train).to_vec()
    } else {
        arguments
            .cases
            .iter()
            .map(|&number| Case::numbered(number, train))
            .collect::<Result<_>>()?
    };
    let methods = if arguments.method.is_empty() {
        vec![Method::PaperGa, Method::MicroGa, Method::Hybrid]
    } else {
        let method = |method: &SearchMethod| match method {
            SearchMethod::PaperGa => Method::PaperGa,
            SearchMethod::MicroGa => Method::MicroGa,
            SearchMethod::Hybrid => Method::Hybrid,
        };
        arguments.method.iter().map(method).collect()
    };
    let plan = Plan {
        cases,
        methods,
        seeds: arguments.seeds,
        signal: if arguments.raw { Signal::Raw } else { Signal::Recorded },
        limit: arguments.limit,
    };
    let bridge = model::shipped("girder50")?;
    let searches = plan.cases.len() * plan.methods.len() * plan.seeds as usize;
    let bar = terminal::progress(searches as u64, "searching");
    let rows = evaluate::paper(&bridge, &plan, &|| bar.inc(1));
    bar.finish_and_clear();
    let rows = rows?;
    if arguments.json {
        print_json(&evaluate::json(&rows))
    } else {
        print(&evaluate::table(&rows))
    }
}
