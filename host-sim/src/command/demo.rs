//! `host-sim demo`: the whole way once, with nothing to prepare. Three recorded passages go through a logger; what it says
//! is printed, its alerts are stored, and each passage gets a picture.

use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use clap::Args;
use host_sim::channel::InProcess;
use host_sim::identification::{Known, Method, Observed, search};
use host_sim::picture;
use host_sim::replay::{self, Prepared, Told};
use host_sim::station::{Station, store::Store, words};
use spanwatch::wire::message::Alert;

#[derive(Debug, Args)]
pub(super) struct Arguments {
    /// Folder for recordings, pictures and the alert file; it is made if need be
    #[arg(long, default_value = "demo-out", value_name = "DIR")]
    out: PathBuf,
    /// Another one: a viaduct with unknown, rough rails, which are learnt from its trains
    #[arg(long)]
    unknown_track: bool,
}

/// A recording that comes with the program.
struct Shipped {
    stem: &'static str,
    csv: &'static str,
    toml: &'static str,
    what: &'static str,
    /// Damaged elements, from 1, and what they have truly lost.
    truth: &'static [(usize, f64)],
}

macro_rules! shipped {
    ($stem:literal, $what:literal, $truth:expr) => {
        Shipped {
            stem: $stem,
            csv: include_str!(concat!("../../recordings/", $stem, ".csv")),
            toml: include_str!(concat!("../../recordings/", $stem, ".toml")),
            what: $what,
            truth: $truth,
        }
    };
}

const SHIPPED: [Shipped; 3] = [
    shipped!(
        "healthy-60kmh-noise5-3nodes",
        "one inspection car at 60 km/h over the healthy girder, three sensors, 5 % noise",
        &[]
    ),
    shipped!(
        "case4-60kmh-noise5-3nodes",
        "the same car, after element 1 has lost 21 % and element 5 41 % of their bending stiffness (the paper's case 4)",
        &[(1, 0.21), (5, 0.41)]
    ),
    shipped!(
        "case8-3d-270kmh-noise2-3nodes",
        "the paper's 16-car train at 270 km/h, after element 5 has lost 11 % (its case 8, which it could not solve), 2 % noise",
        &[(5, 0.11)]
    ),
];

pub(super) fn run(arguments: &Arguments) -> Result<()> {
    let out = &arguments.out;
    if arguments.unknown_track {
        return super::demo_track::run(out);
    }
    fs::create_dir_all(out).with_context(|| format!("cannot make the folder {}", out.display()))?;
    let mut store = Store::open(&out.join("alerts.sqlite"))?;
    let mut station = Station::new(Box::new(InProcess::new()));
    super::print("A logger runs in this program; recorded passages reach it as raw counts in frames.\n")?;
    for shipped in SHIPPED {
        let prepared = unpack(out, &shipped)?;
        super::print(&format!("\n{}: {}\n", prepared.path.display(), shipped.what))?;
        let mut raised = None;
        prepared.replay(&mut station, None, None, |told| match told {
            Told::Passage { report, start_s, end_s } => super::print(&format!(
                "  {}\n",
                words::passage(report, &prepared.quantities(), *start_s, *end_s)
            )),
            Told::Alert { heard, alert, start_s } => {
                let text = words::alert(alert);
                store.keep_heard(heard, shipped.stem, *start_s)?;
                raised = Some(alert.clone());
                super::print(&format!("  {text}\n"))
            }
            Told::Track { report, start_s } => super::print(&format!("  {}\n", words::track_changed(report, *start_s))),
        })?;
        let path = out.join(shipped.stem).with_extension("svg");
        draw(&path, &shipped, &prepared, raised.as_ref())?;
        super::print(&format!("  Picture: {}\n", path.display()))?;
    }
    super::print(&format!(
        "\n{} frames came from the logger, {} refused; alerts in {}: {}.\n",
        station.frames(),
        station.rejected(),
        out.join("alerts.sqlite").display(),
        store.alerts()?
    ))
}

/// Writes a recording that comes with the program where the user can look at it, and reads it as any other.
fn unpack(out: &Path, shipped: &Shipped) -> Result<Prepared> {
    let path = out.join(shipped.stem).with_extension("csv");
    for (path, text) in [(&path, shipped.csv), (&path.with_extension("toml"), shipped.toml)] {
        fs::write(path, text).with_context(|| format!("cannot write {}", path.display()))?;
    }
    replay::prepare(&path, None, replay::DEFAULT_SEED)
}

/// The passage measured and fitted, and the damage by element as the logger's search finds it. An alert tells no intervals,
/// so the search is run again here.
fn draw(path: &Path, shipped: &Shipped, prepared: &Prepared, alert: Option<&Alert>) -> Result<()> {
    let observed = Observed::recorded(prepared)?;
    let (problem, known) = (observed.problem(), Known::default());
    let found = search(&problem, Method::Hybrid, replay::DEFAULT_SEED, 0.0, &known, &mut |_| ())?;
    let mut truth = vec![0.0; observed.bridge.elements];
    for &(element, loss) in shipped.truth {
        truth[element - 1] = loss;
    }
    let title = match alert {
        Some(_) => "Damage, beyond doubt",
        None => "Healthy",
    };
    picture::passage(
        path,
        &format!("{title}: {}", shipped.stem),
        shipped.what,
        prepared,
        &observed,
        &found,
        Some(&truth),
    )
}
