//! `host-sim evaluate`: the paper's cases, searched again and set beside its tables, and the studies that choices rest on.

use std::path::{Path, PathBuf};
use std::str::FromStr;

use anyhow::{Result, bail};
use clap::{Args, Subcommand, ValueEnum};
use host_sim::evaluate::{self, Case, Plan, Signal};
use host_sim::identification::Method;
use host_sim::model::Structure;
use host_sim::picture::{chart, estimates};
use host_sim::study::noise::field::Field;
use host_sim::study::noise::fusion::{self, Traffic};
use host_sim::study::noise::{self, Nuisance};
use host_sim::study::{accuracy, node_maxima, precision, sources};
use host_sim::{model, output, terminal};
use spanwatch::capacity::CHANNELS;
use spanwatch::identify::paper_ga;
use spanwatch::wire::message::TrainKind;

use super::{print, print_json};

/// Most wear: with it the paper's largest loss, 41 %, is still within what an estimate can be.
const MOST_WEAR: f64 = 0.4;
/// Cases that are fused unless others are named: slow and slight, slow and heavy, fast and slight.
const FUSED_CASES: [u32; 3] = [1, 4, 6];

/// What to evaluate.
#[derive(Debug, Subcommand)]
pub(super) enum Command {
    /// Search the paper's cases without noise, from mid-span alone (its Tables 6 to 8)
    Paper(Paper),
    /// Monte Carlo of the paper's cases with noise: how far identifications are off, and how far they must be
    Noise(Noise),
    /// What each kind of measurement adds: samples or natural frequencies after the train, displacements, more sensors
    Sources(Sources),
    /// Unknown tracks: how well damage can be told after learning the track from healthy passages, and how well it is
    Track(super::evaluate_track::Track),
    /// The way from decision to disk under faults: what is lost, given twice, changed or let in
    Link(super::evaluate_link::Link),
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

#[derive(Debug, Args)]
pub(super) struct Noise {
    /// What the recordings have that the model has not
    #[arg(long, value_enum, default_value_t = Campaign::White)]
    campaign: Campaign,
    /// Trains of the cases, as 2dof,3d
    #[arg(
        long,
        value_enum,
        value_delimiter = ',',
        default_value = "inspection-2dof",
        value_name = "TRAINS"
    )]
    train: Vec<CaseTrain>,
    /// Cases, as 1,4,8; without it all eight, or 1,4,6 for fusion
    #[arg(long, value_delimiter = ',', value_name = "NUMBERS")]
    cases: Vec<u32>,
    /// Part of its stiffness that every element has lost besides, so that none lies at a bound of what an estimate can be
    #[arg(long, default_value_t = 0.0, value_name = "PART")]
    wear: f64,
    /// White noise, as parts of each sensor's RMS
    #[arg(long, value_delimiter = ',', default_value = "0.05", value_name = "PARTS")]
    noise: Vec<f64>,
    /// Nodes with a sensor, as 3,6,9; give it again for another set; without it 6, and 3,6,9
    #[arg(long, value_name = "NODES")]
    sensors: Vec<SensorSet>,
    /// Whether speed, entry time, load and stiffness of the whole bridge are known
    #[arg(long, value_enum, default_value_t = Told::Both)]
    nuisance: Told,
    /// Identifications a row (fusion: bridges of thirty passages); their seeds are 1, 2, ..
    #[arg(long, default_value_t = 20)]
    seeds: u32,
    /// Print one JSON array in place of the table
    #[arg(long)]
    json: bool,
    /// Draw estimates and their intervals beside the truth into this file, too (not for fusion)
    #[arg(long, value_name = "FILE.svg")]
    svg: Option<PathBuf>,
}

#[derive(Debug, Args)]
pub(super) struct Sources {
    /// Trains of the cases, as 2dof,3d
    #[arg(
        long,
        value_enum,
        value_delimiter = ',',
        default_value = "inspection-2dof,shinkansen-3d",
        value_name = "TRAINS"
    )]
    train: Vec<CaseTrain>,
    /// Cases, as 1,7
    #[arg(long, value_delimiter = ',', default_value = "1", value_name = "NUMBERS")]
    cases: Vec<u32>,
    /// Part of its stiffness that every element has lost besides, so that none lies at a bound of what an estimate can be
    #[arg(long, default_value_t = 0.0, value_name = "PART")]
    wear: f64,
    /// Identifications of each source; their seeds are 1, 2, ..; 0: the bounds alone
    #[arg(long, default_value_t = 10)]
    seeds: u32,
    /// Print one JSON array in place of the tables
    #[arg(long)]
    json: bool,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Campaign {
    /// White noise and rounding only
    White,
    /// What a model does not know of a real bridge, too: irregularity, errors of stiffness and masses, alone and together
    Field,
    /// White noise; thirty passages of one bridge put together
    Fusion,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Told {
    /// They are told, and true
    Known,
    /// A first guess is told, and how far off it may be
    Unknown,
    /// Both, one after the other
    Both,
}

/// Nodes that have a sensor.
#[derive(Debug, Clone)]
pub(super) struct SensorSet(pub(super) Vec<u16>);

impl FromStr for SensorSet {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let node = |part: &str| (part.trim().parse()).map_err(|_| format!("\"{part}\" is no node"));
        let nodes = text.split(',').map(node).collect::<Result<Vec<u16>, _>>()?;
        if nodes.len() > CHANNELS || (1..nodes.len()).any(|i| nodes[..i].contains(&nodes[i])) {
            return Err(format!("a set of sensors is 1 to {CHANNELS} different nodes"));
        }
        Ok(Self(nodes))
    }
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
        Command::Noise(arguments) => noise(arguments),
        Command::Sources(arguments) => compare_sources(arguments),
        Command::Track(arguments) => super::evaluate_track::run(arguments),
        Command::Link(arguments) => super::evaluate_link::run(arguments),
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

impl From<CaseTrain> for TrainKind {
    fn from(train: CaseTrain) -> Self {
        match train {
            CaseTrain::Inspection2Dof => Self::Inspection2Dof,
            CaseTrain::Shinkansen3d => Self::Shinkansen3d,
        }
    }
}

/// The cases of those numbers; all of the train's if there are none.
fn numbered(numbers: &[u32], train: TrainKind) -> Result<Vec<Case>> {
    if numbers.is_empty() {
        return Ok(evaluate::cases(train).to_vec());
    }
    numbers.iter().map(|&number| Case::numbered(number, train)).collect()
}

pub(super) fn check_wear(wear: f64) -> Result<()> {
    if !(0.0..=MOST_WEAR).contains(&wear) {
        bail!("--wear must be 0 to {MOST_WEAR}, not {wear}");
    }
    Ok(())
}

fn compare_sources(arguments: &Sources) -> Result<()> {
    check_wear(arguments.wear)?;
    let plan = sources::Plan {
        cases: (arguments.train.iter())
            .map(|&train| numbered(&arguments.cases, train.into()))
            .collect::<Result<Vec<_>>>()?
            .concat(),
        wear: arguments.wear,
        seeds: arguments.seeds,
    };
    let passages = 2 * plan.cases.len() as u64 * u64::from(plan.seeds);
    let bar = terminal::progress(passages, "identifying");
    let rows = sources::run(&model::shipped("girder50")?, &plan, &|| bar.inc(1));
    bar.finish_and_clear();
    let rows = rows?;
    if arguments.json {
        print_json(&sources::json(&rows))
    } else {
        print(&sources::table(&rows))
    }
}

fn noise(arguments: &Noise) -> Result<()> {
    if arguments.seeds == 0 {
        bail!("--seeds must be at least 1");
    }
    if let Some(part) = (arguments.noise.iter()).find(|part| !(part.is_finite() && **part > 0.0)) {
        bail!("--noise must be positive numbers, not {part}");
    }
    check_wear(arguments.wear)?;
    let fusion = arguments.campaign == Campaign::Fusion;
    if let Some(path) = &arguments.svg {
        if fusion {
            bail!("--svg goes with the campaigns white and field only");
        }
        output::check(path)?;
    }
    let numbers = if fusion && arguments.cases.is_empty() {
        &FUSED_CASES
    } else {
        arguments.cases.as_slice()
    };
    let cases = (arguments.train.iter())
        .map(|&train| numbered(numbers, train.into()))
        .collect::<Result<Vec<_>>>()?
        .concat();
    let bridge = model::shipped("girder50")?;
    let sensors: Vec<Vec<u16>> = match arguments.sensors.as_slice() {
        [] => vec![vec![6], vec![3, 6, 9]],
        sets => sets.iter().map(|set| set.0.clone()).collect(),
    };
    let plan = noise::campaign::Plan {
        cases,
        wear: arguments.wear,
        noise: arguments.noise.clone(),
        sensors,
        nuisance: match arguments.nuisance {
            Told::Known => vec![Nuisance::Known],
            Told::Unknown => vec![Nuisance::Unknown],
            Told::Both => vec![Nuisance::Known, Nuisance::Unknown],
        },
        fields: match arguments.campaign {
            Campaign::Field => Field::ALL.to_vec(),
            Campaign::White | Campaign::Fusion => vec![Field::NONE],
        },
        seeds: arguments.seeds,
    };
    if fusion {
        let traffics = [Traffic::Same, Traffic::Mixed];
        let passages = plan.identifications() * (traffics.len() * fusion::PASSAGES) as u64;
        let bar = terminal::progress(passages, "identifying");
        let rows = fusion::run(&bridge, &plan.settings(), &traffics, plan.seeds, &|| bar.inc(1));
        bar.finish_and_clear();
        let rows = rows?;
        return if arguments.json {
            print_json(&noise::table::fused_json(&rows))
        } else {
            print(&noise::table::fused(&rows))
        };
    }
    let bar = terminal::progress(plan.identifications(), "identifying");
    let rows = noise::campaign::run(&bridge, &plan, &|| bar.inc(1));
    bar.finish_and_clear();
    let rows = rows?;
    if let Some(path) = &arguments.svg {
        output::write(&[(path, estimates::svg(&rows)?.as_bytes())])?;
    }
    if arguments.json {
        print_json(&noise::table::campaign_json(&rows))
    } else {
        print(&noise::table::campaign(&rows))
    }
}

fn paper(arguments: &Paper) -> Result<()> {
    if arguments.seeds == 0 {
        bail!("--seeds must be at least 1");
    }
    if !(arguments.limit.is_finite() && arguments.limit >= 0.0) {
        bail!("--limit must be zero or a positive number, not {}", arguments.limit);
    }
    let cases = numbered(&arguments.cases, arguments.train.into())?;
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
