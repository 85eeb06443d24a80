//! `host-sim track generate` and `track show`.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use anyhow::{Result, bail};
use clap::{Args, Subcommand};
use host_sim::model::reduce::reduce;
use host_sim::track::generate::LONGEST_M;
use host_sim::track::spline::POINTS_A_WAVE;
use host_sim::track::summary::{Extreme, spacing_m, summary};
use host_sim::track::{Profile, Rails, Spectrum, Stretch, generate, table};
use host_sim::train::TrainName;
use host_sim::{calibrate, model, output, picture};
use spanwatch::capacity::ELEMENTS;
use spanwatch::track::learnt::{BANDS_AN_OCTAVE, FIRST_BAND_MPS, LearntTrack};
use spanwatch::track::{Motion, Track};
use spanwatch::wire::message::TrainKind;

/// A learnt profile is drawn by points so far apart, m: a fifth of its spans.
const POINT_M: f64 = 0.08;
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
        /// A track: x_m,z_irregularity_mm or x_m,z_left_mm,z_right_mm[,y_left_mm,y_right_mm]; or one that was learnt (host-sim calibrate)
        #[arg(value_name = "FILE")]
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
    let (facts, track) = match calibrate::read_of_any_bridge(path)? {
        Some((learnt, bridge)) => (describe_learnt(&learnt, bridge)?, rails(&learnt)),
        None => (String::new(), table::read(path)?),
    };
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
    super::print(&(facts + &describe(&track)))
}

/// The rails of a learnt profile, at points.
fn rails(learnt: &LearntTrack) -> Profile {
    let [first, last] = learnt.profile.extent_m().unwrap_or_default().map(f64::from);
    let spans = ((last - first) / POINT_M).ceil();
    let x_m: Vec<f64> = (0..=spans as usize)
        .map(|i| first + (last - first) * i as f64 / spans)
        .collect();
    let z_m = x_m
        .iter()
        .map(|&x| learnt.profile.at(Motion::Vertical, x as f32).value.into());
    Profile::new(Rails::equal(x_m.clone(), z_m.collect()))
}

/// What was learnt beside the profile, by a bridge of this fingerprint.
fn describe_learnt(learnt: &LearntTrack, fingerprint: u32) -> Result<String> {
    let mut text = String::new();
    let mut row = |key: &str, value: String| {
        let _ = writeln!(text, "{key:<20} {value}");
    };
    let mut bridge = format!("one of your own (fingerprint {fingerprint:08x})");
    for name in model::shipped_names() {
        // Those that are too large for a logger have no track.
        if let Ok(reduced) = reduce(&model::shipped(name)?)
            && calibrate::bridge_crc(&reduced).is_ok_and(|of| of == fingerprint)
        {
            name.clone_into(&mut bridge);
        }
    }
    row("bridge", bridge);
    row("learnt from", format!("{} passages", learnt.passages));
    for kind in [TrainKind::Inspection2Dof, TrainKind::Shinkansen3d] {
        let speeds = learnt.speeds[kind as usize];
        if speeds != 0 {
            let from_kmh = |band: u32| 3.6 * FIRST_BAND_MPS * (band as f32 / BANDS_AN_OCTAVE).exp2();
            let [slowest, fastest] = [speeds.trailing_zeros(), u64::BITS - speeds.leading_zeros()].map(from_kmh);
            let name = TrainName::Known(kind);
            row(
                "trains",
                format!("{}, between {slowest:.0} and {fastest:.0} km/h", name.name()),
            );
        }
    }
    row("stiffness", format!("{:.4} of the model's", learnt.stiffness));
    row("damping", format!("{:.3} of the model's", learnt.damping));
    let floor = learnt.spread * learnt.spread.transpose();
    let points = floor
        .diagonal()
        .map(|variance| format!("{:.2}", 100.0 * variance.sqrt()));
    row(
        "known at best to",
        format!("{} points, elements 1 to {ELEMENTS}", points.as_slice().join(" ")),
    );
    Ok(text)
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
