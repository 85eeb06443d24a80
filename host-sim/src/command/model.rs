//! `host-sim model build` and `model show`.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail};
use clap::Subcommand;
use host_sim::model::Structure;
use host_sim::model::shapes::{self, Mode};
use host_sim::{model, output, picture};
use spanwatch::bridge::{ReducedBridge, blob};

use super::show_frame;

/// Mode shapes that are drawn.
const DRAWN: usize = 3;
/// Size of the sketch of a mode shape in the terminal, characters.
const SKETCH: [usize; 2] = [61, 4];
/// The Braille character without dots.
const NO_DOTS: char = '\u{2800}';
/// Points of a mode shape.
const POINTS: usize = 201;

#[derive(Debug, Subcommand)]
pub(super) enum Command {
    /// Reduce a bridge to the model that the logger holds
    Build {
        /// A bridge file, or the name of a bridge that comes with the program
        #[arg(value_name = "BRIDGE.toml")]
        bridge: String,
        /// Where to write the model
        #[arg(short, long, value_name = "FILE")]
        output: PathBuf,
    },
    /// Show what a model holds
    Show {
        /// A model that `model build` wrote, a bridge file .toml, or the name of a bridge that comes with the program
        #[arg(value_name = "FILE")]
        model: String,
        /// Draw the first mode shapes into this file, too
        #[arg(long, value_name = "FILE.svg")]
        svg: Option<PathBuf>,
    },
}

pub(super) fn run(command: &Command) -> Result<()> {
    match command {
        Command::Build { bridge, output } => build(bridge, output),
        Command::Show { model, svg } => show(model, svg.as_deref()),
    }
}

fn build(bridge: &str, path: &Path) -> Result<()> {
    let file = model::find(bridge)?;
    if let (Ok(from), Ok(to)) = (Path::new(bridge).canonicalize(), path.canonicalize())
        && from == to
    {
        bail!(
            "-o {} would overwrite the bridge file; choose another name",
            path.display()
        );
    }
    output::check(path)?;
    let bytes = model::to_blob(&model::reduce::reduce(&file)?)?;
    output::write(&[(path, &bytes)])?;
    super::print(&format!(
        "wrote {}: bridge \"{}\", {} bytes, format version {}, CRC-32C {:#010x}\n",
        path.display(),
        file.name,
        bytes.len(),
        blob::FORMAT_VERSION,
        crc(&bytes)
    ))
}

fn show(name: &str, svg: Option<&Path>) -> Result<()> {
    if let Some(svg) = svg.filter(|svg| svg.extension().is_none_or(|extension| extension != "svg")) {
        bail!("{}: a picture is named by its file .svg", svg.display());
    }
    let path = Path::new(name);
    let is_bridge_file = path.extension().is_some_and(|e| e.eq_ignore_ascii_case("toml"));
    let bytes = if path.is_file() && !is_bridge_file {
        model::read_bytes(path)?
    } else {
        let file = if is_bridge_file {
            model::find(name)?
        } else {
            model::find(name).with_context(|| format!("there is no model file {name}"))?
        };
        match model::reduce::reduce(&file) {
            Ok(reduced) => model::to_blob(&reduced)?,
            // A frame stands on its own, even if no logger can hold it.
            Err(reason) => {
                let structure = Structure::new(file)?;
                return super::print(&show_frame::show(&structure, &reason.to_string(), svg)?);
            }
        }
    };
    // What is shown has been through the same door as on the logger.
    let bridge = model::from_blob(&bytes).with_context(|| name.to_owned())?;
    let wide = bridge.cast::<f64>();
    let modes = shapes::modes(&wide, POINTS);
    if let Some(svg) = svg {
        output::check(svg)?;
        draw(svg, &wide, &modes)?;
    }
    super::print(&describe(&wide, &bytes, &modes))
}

fn draw(path: &Path, bridge: &ReducedBridge<f64>, modes: &[Mode]) -> Result<()> {
    let labels: Vec<String> = (modes.iter().take(DRAWN).enumerate())
        .map(|(k, mode)| {
            format!(
                "mode {}: {:.3} Hz, damping ratio {:.2} %",
                k + 1,
                mode.frequency_hz,
                100.0 * mode.damping_ratio
            )
        })
        .collect();
    let shapes: Vec<(&str, &[f64])> = (labels.iter().zip(modes))
        .map(|(label, mode)| (label.as_str(), mode.shape.as_slice()))
        .collect();
    let nodes: Vec<f64> = bridge.path.position_m[..bridge.path.nodes].to_vec();
    picture::mode_shapes(
        path,
        &format!("Mode shapes of {}", bridge.name),
        &nodes,
        &shapes::held_nodes(bridge),
        &shapes,
    )
}

fn describe(bridge: &ReducedBridge<f64>, bytes: &[u8], modes: &[Mode]) -> String {
    let mut text = String::new();
    let nodes: Vec<String> = bridge.sensor_node[..bridge.sensor_count]
        .iter()
        .map(u16::to_string)
        .collect();
    let mut row = |key: &str, value: String| {
        let _ = writeln!(text, "{key:<18} {value}");
    };
    row("bridge", bridge.name.to_string());
    row("length", format!("{} m", bridge.path.length_m()));
    row("elements", bridge.elements.to_string());
    row("sensor nodes", nodes.join(" "));
    row(
        "supports",
        format!(
            "node {}",
            shapes::held_nodes(bridge)
                .iter()
                .map(u16::to_string)
                .collect::<Vec<_>>()
                .join(", ")
        ),
    );
    row(
        "basis",
        format!(
            "{} vectors (modes, and what bends where an element goes soft)",
            bridge.basis
        ),
    );
    row(
        "blob",
        format!(
            "{} bytes, format version {}, CRC-32C {:#010x}",
            bytes.len(),
            blob::FORMAT_VERSION,
            crc(bytes)
        ),
    );
    row(
        "in the logger",
        format!("{} bytes of RAM", size_of::<ReducedBridge<f32>>()),
    );
    let _ = writeln!(text, "\n{:>4}  {:>12}  {:>13}", "mode", "frequency Hz", "damping ratio");
    for (k, mode) in modes.iter().enumerate() {
        let _ = writeln!(
            text,
            "{:>4}  {:>12.4}  {:>13.4}",
            k + 1,
            mode.frequency_hz,
            mode.damping_ratio
        );
    }
    let [columns, rows] = SKETCH;
    for (k, mode) in modes.iter().take(DRAWN).enumerate() {
        let _ = writeln!(text, "\nmode {}, {:.3} Hz", k + 1, mode.frequency_hz);
        let lines = shapes::sketch(&mode.shape, columns, rows);
        for line in lines.iter().map(|line| line.trim_end_matches(NO_DOTS)) {
            if !line.is_empty() {
                let _ = writeln!(text, "  {line}");
            }
        }
    }
    text.push_str(&node_line(bridge, columns));
    text
}

/// A line of nodes under the sketches: ▲ at supports, | elsewhere, and the numbers below.
fn node_line(bridge: &ReducedBridge<f64>, columns: usize) -> String {
    let held = shapes::held_nodes(bridge);
    let length = bridge.path.length_m();
    let (mut marks, mut numbers) = (vec![' '; columns + 2], vec![' '; columns + 2]);
    for (i, x) in bridge.path.position_m[..bridge.path.nodes].iter().enumerate() {
        let place = (x / length * (columns - 1) as f64).round() as usize;
        let number = (i + 1).to_string();
        marks[place] = if held.contains(&(i as u16 + 1)) { '▲' } else { '╵' };
        for (offset, digit) in number.chars().enumerate() {
            if let Some(slot) = numbers.get_mut(place + offset) {
                *slot = digit;
            }
        }
    }
    [marks, numbers]
        .iter()
        .map(|line| format!("  {}\n", line.iter().collect::<String>().trim_end()))
        .collect()
}

/// The checksum at the end of a blob.
fn crc(bytes: &[u8]) -> u32 {
    bytes.last_chunk().map_or(0, |&end| u32::from_le_bytes(end))
}
