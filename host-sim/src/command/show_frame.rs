//! `host-sim model show` of a bridge that is too large for a logger: its frame, its modes and what moves in each.

use std::fmt::Write as _;
use std::path::Path;

use anyhow::Result;
use host_sim::model::condensation::Condensed;
use host_sim::model::eigen::{NaturalModes, frequency_hz, natural_modes};
use host_sim::model::{Structure, participation};
use host_sim::{output, picture};

/// Modes in the table.
const LISTED: usize = 24;
/// Modes that are drawn.
const DRAWN: usize = 4;
/// A mode with a larger share of turning members moves nothing else; it is not drawn.
const TURNING: f64 = 0.5;

/// What is printed of a bridge; `reason` says why a logger cannot hold it. Draws its first modes into `svg`.
pub(super) fn show(structure: &Structure, reason: &str, svg: Option<&Path>) -> Result<String> {
    let modes = natural_modes(&structure.stiffness(&[]), structure.mass())?;
    if let Some(path) = svg {
        output::check(path)?;
        draw(structure, &modes, path)?;
    }
    let mut text = head(structure, reason);
    table(&mut text, structure, &modes)?;
    Ok(text)
}

fn head(structure: &Structure, reason: &str) -> String {
    let bridge = &structure.bridge;
    let frame = &bridge.frame;
    let mut text = String::new();
    let mut row = |key: &str, value: String| {
        let _ = writeln!(text, "{key:<18} {value}");
    };
    row("bridge", bridge.name.clone());
    row(
        "frame",
        format!(
            "{} nodes, {} beam elements, {} springs, {} degrees of freedom",
            frame.nodes.len(),
            frame.beams.len(),
            frame.springs.len(),
            structure.matrices.freedoms()
        ),
    );
    row(
        "mass",
        format!("{:.1} t", structure.matrices.node_kg.iter().sum::<f64>() / 1e3),
    );
    row(
        "path",
        format!(
            "{:.2} m over {} points",
            structure.path.last().map_or(0.0, |point| point.x_m),
            structure.path.len()
        ),
    );
    row(
        "damage groups",
        format!("{}: {}", frame.groups.len(), frame.groups.join(" ")),
    );
    for sensor in &structure.sensors {
        row("sensor", format!("{}: {}", sensor.number, sensor.name));
    }
    row("in a logger", reason.to_owned());
    text
}

fn table(text: &mut String, structure: &Structure, modes: &NaturalModes) -> Result<()> {
    let condensed = if structure.bridge.masters.is_empty() {
        None
    } else {
        let condensed = Condensed::new(structure)?;
        Some((condensed.kept.len(), condensed.errors(modes)?))
    };
    let [p1, p2] = structure.bridge.damping.rayleigh(&modes.omega_squared);
    let _ = write!(
        text,
        "\n{:>4}  {:>12}  {:>13}  {:>15}  {:>7}  {:<20}",
        "mode", "frequency Hz", "damping ratio", "moves x  y  z %", "turns %", "most"
    );
    let _ = writeln!(text, "{}", if condensed.is_some() { "  condensed" } else { "" });
    for (k, &w2) in modes.omega_squared.iter().take(LISTED).enumerate() {
        let shape = modes.shapes.column(k);
        let [x, y, z, turning] = participation::shares(structure, shape).map(|share| 100.0 * share);
        let (node, direction) = participation::largest(structure, shape);
        let most = format!(
            "{} {}",
            structure.bridge.frame.nodes[node].name,
            ["x", "y", "z"][direction]
        );
        let _ = write!(
            text,
            "{:>4}  {:>12.4}  {:>13.4}  {x:>7.0} {y:>3.0} {z:>3.0}  {turning:>7.0}  {most:<20}",
            k + 1,
            frequency_hz(w2),
            (p1 + p2 * w2) / (2.0 * w2.sqrt()),
        );
        let error = match &condensed {
            None => String::new(),
            Some((_, errors)) => errors[k].map_or("          -".into(), |error| format!("  {:>+8.2} %", 100.0 * error)),
        };
        let _ = writeln!(text, "{error}");
    }
    if let Some((kept, _)) = condensed {
        let _ = writeln!(
            text,
            "\ncondensed: by how much its frequency is higher if only the {kept} degrees of freedom of [condensation] are kept; - if \
             that model has no such mode"
        );
    }
    Ok(())
}

fn draw(structure: &Structure, modes: &NaturalModes, path: &Path) -> Result<()> {
    let drawn: Vec<(String, usize)> = (0..modes.omega_squared.len())
        .filter(|&k| participation::shares(structure, modes.shapes.column(k))[3] < TURNING)
        .take(DRAWN)
        .map(|k| {
            let label = format!("mode {}: {:.3} Hz", k + 1, frequency_hz(modes.omega_squared[k]));
            (label, k)
        })
        .collect();
    let rows: Vec<_> = drawn
        .iter()
        .map(|(label, k)| (label.as_str(), modes.shapes.column(*k).into_owned()))
        .collect();
    picture::frame_modes(path, structure, &rows)
}
