//! `host-sim predict`: what a real bridge would do, written down before anyone compares.

use std::path::{Path, PathBuf};

use anyhow::Result;
use clap::{Args, Subcommand};
use host_sim::output;
use host_sim::picture::chart;
use host_sim::prediction::{rdso45m, viaduct24};

/// What to predict.
#[derive(Debug, Subcommand)]
pub(super) enum Command {
    /// The truss rdso45m under its test train: deflections, accelerations and frequencies
    Rdso45m(Place),
    /// The viaduct viaduct24 under a Shinkansen train: accelerations at the paper's points
    Viaduct24(Place),
}

#[derive(Debug, Args)]
pub(super) struct Place {
    /// Existing folder that picture and tables of values are written into; without it only the summary is printed
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
}

pub(super) fn run(command: &Command) -> Result<()> {
    match command {
        Command::Rdso45m(place) => truss(place.out.as_deref()),
        Command::Viaduct24(place) => viaduct(place.out.as_deref()),
    }
}

fn truss(out: Option<&Path>) -> Result<()> {
    let files = out.map(|folder| {
        let csv = rdso45m::SPEEDS_KMH.map(|speed| folder.join(format!("rdso45m-{speed}kmh.csv")));
        (csv, folder.join("rdso45m.svg"))
    });
    if let Some((csv, svg)) = &files {
        csv.iter().chain([svg]).try_for_each(|path| output::check(path))?;
    }
    let prediction = rdso45m::predict()?;
    if let Some((csv, svg)) = &files {
        let picture = chart::svg(
            "The truss rdso45m under its test train: predictions",
            "joints L4 of both trusses, positive up; written without knowledge of the measurement",
            &rdso45m::plots(&prediction),
        )?;
        let tables: Vec<String> = prediction.passages.iter().map(rdso45m::csv).collect();
        let mut all: Vec<(&Path, &[u8])> = vec![(svg, picture.as_bytes())];
        all.extend(
            csv.iter()
                .zip(&tables)
                .map(|(path, text)| (path.as_path(), text.as_bytes())),
        );
        output::write(&all)?;
    }
    super::print(&prediction.tables)
}

fn viaduct(out: Option<&Path>) -> Result<()> {
    let svg = out.map(|folder| folder.join("viaduct24.svg"));
    if let Some(svg) = &svg {
        output::check(svg)?;
    }
    let prediction = viaduct24::predict()?;
    if let Some(svg) = &svg {
        let picture = chart::svg(
            "The viaduct viaduct24 under 16 cars of shinkansen-3d at 270 km/h: not validated",
            "accelerations below 100 Hz, and their spectra, at the points of the paper's Figs 4 and 5",
            &viaduct24::plots(&prediction),
        )?;
        output::write(&[(svg, picture.as_bytes())])?;
    }
    super::print(&prediction.tables)
}
