//! `host-sim track generate` and `track show`.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use anyhow::{Result, bail};
use clap::{Args, Subcommand};
use host_sim::track::generate::LONGEST_M;
use host_sim::track::spline::POINTS_A_WAVE;
use host_sim::track::summary::{Extreme, spacing_m, summary};
use host_sim::track::{Profile, Spectrum, Stretch, generate, table};
use host_sim::{output, picture};
use spanwatch::track::Motion;

/// The motions of a track and what they are called.
const MOTIONS: [(&str, Motion); 3] = [
    ("vertical", Motion::Vertical),
    ("lateral", Motion::Lateral),
    ("cross-level", Motion::Roll),
];

#[derive(Debug, Subcommand)]
pub(super) enum Command {
    /// Make a track by chance from a standard spectrum
    Generate(Generate),
    /// Show what a track is like
    Show {
        /// A track: x_m,z_irregularity_mm or x_m,z_left_mm,z_right_mm[,y_left_mm,y_right_mm]
        #[arg(value_name = "FILE.csv")]
        track: PathBuf,
        /// Draw it into this file, too
        #[arg(long, value_name = "FILE.svg")]
        picture: Option<PathBuf>,
    },
}

#[derive(Debug, Args)]
pub(super) struct Generate {
    /// The standard spectrum
    #[arg(long, value_enum)]
    spectrum: Spectrum,
    /// Seed of the chance
    #[arg(long)]
    seed: u64,
    /// Where the track begins, from node 1
    #[arg(long, default_value_t = -140.0, allow_negative_numbers = true)]
    from_m: f64,
    /// Where it ends, from node 1
    #[arg(long, default_value_t = 60.0, allow_negative_numbers = true)]
    to_m: f64,
    /// Distance of points
    #[arg(long, default_value_t = 0.05, allow_negative_numbers = true)]
    spacing_m: f64,
    /// Longest wave
    #[arg(long, default_value_t = LONGEST_M, allow_negative_numbers = true)]
    longest_m: f64,
    /// Both rails alike and straight
    #[arg(long)]
    vertical_only: bool,
    /// Where to write the track
    #[arg(short, long, value_name = "FILE.csv")]
    output: PathBuf,
}

pub(super) fn run(command: &Command) -> Result<()> {
    match command {
        Command::Generate(arguments) => write(arguments),
        Command::Show { track, picture } => show(track, picture.as_deref()),
    }
}

fn write(arguments: &Generate) -> Result<()> {
    let stretch = Stretch {
        from_m: arguments.from_m,
        to_m: arguments.to_m,
        spacing_m: arguments.spacing_m,
        longest_m: arguments.longest_m,
        vertical_only: arguments.vertical_only,
    };
    let track = generate(arguments.spectrum, arguments.seed, &stretch)?;
    let path = arguments.output.as_path();
    output::write(&[(path, table::text(track.rails()).as_bytes())])?;
    super::print(&format!(
        "wrote {}: {} points, vertical {:.3} mm rms\n",
        path.display(),
        track.rails().x_m.len(),
        1e3 * summary(&track, Motion::Vertical).rms_m
    ))
}

fn show(path: &Path, svg: Option<&Path>) -> Result<()> {
    let track = table::read(path)?;
    if let Some(svg) = svg {
        if let (Ok(from), Ok(to)) = (path.canonicalize(), svg.canonicalize())
            && from == to
        {
            bail!(
                "--picture {} would overwrite the track; choose another name",
                svg.display()
            );
        }
        let name = path.file_name().unwrap_or_default().display();
        picture::track::irregularity(svg, &format!("Irregularity of {name}"), &track)?;
    }
    super::print(&describe(&track))
}

fn describe(track: &Profile) -> String {
    let mut text = String::new();
    let mut row = |key: &str, value: String| {
        let _ = writeln!(text, "{key:<20} {value}");
    };
    let x = &track.rails().x_m;
    let [finest, usual, coarsest] = spacing_m(track);
    row(
        "track",
        format!("{} m to {} m from node 1", rounded(x[0]), rounded(x[x.len() - 1])),
    );
    row(
        "points",
        format!(
            "{}, {} m apart ({} to {} m)",
            x.len(),
            rounded(usual),
            rounded(finest),
            rounded(coarsest)
        ),
    );
    row(
        "shortest wave",
        format!("{} m, by curvature within 5 %", rounded(POINTS_A_WAVE * usual)),
    );
    for (name, motion) in MOTIONS {
        let of = summary(track, motion);
        let at = |extreme: Extreme, factor: f64, decimals: usize, unit: &str| {
            // Added zero, so that no minus stands before it.
            let value = (factor * extreme.value * 1e6).round() / 1e6 + 0.0;
            format!("{value:.decimals$}{unit} at {:.2} m", extreme.x_m)
        };
        if of.extremes.iter().all(|extreme| extreme.value == 0.0) {
            row(name, "none".to_owned());
            continue;
        }
        row(name, format!("{:.3} mm rms", 1e3 * of.rms_m));
        row("  lowest", at(of.extremes[0], 1e3, 3, " mm"));
        row("  highest", at(of.extremes[1], 1e3, 3, " mm"));
        row("  largest slope", at(of.slope, 1e3, 3, " mm/m"));
        row("  largest curvature", at(of.curvature, 1e3, 4, " 1/km"));
    }
    text
}

/// A number for the eye, without the dust of binary fractions.
fn rounded(value: f64) -> f64 {
    (value * 1e6).round() / 1e6
}
