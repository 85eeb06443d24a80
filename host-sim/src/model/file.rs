//! The bridge file, as an engineer writes it (TOML): a girder, or with `kind = "frame"` a [`frame`](super::frame::file).

use anyhow::{Result, bail};
use serde::Deserialize;
use spanwatch::capacity::ELEMENTS;

use super::frame::reading;
use super::structure::BridgeFrame;
use crate::toml_text;

/// Reads and checks the text of a bridge file of either kind.
pub fn read(text: &str) -> Result<BridgeFrame> {
    /// All that is looked at first.
    #[derive(Deserialize)]
    struct Kind {
        kind: Option<toml::Spanned<String>>,
    }
    let Kind { kind } = toml_text::parse(text)?;
    match kind {
        None => Ok(BridgeFrame::from(&parse(text)?)),
        Some(kind) if kind.get_ref() == "frame" => reading::read(text),
        Some(kind) => bail!(
            "{}: kind is \"{}\"; it must be \"frame\", and for a girder it is left out",
            toml_text::place(text, &kind.span()),
            kind.get_ref()
        ),
    }
}

/// A girder of equal beam elements.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BridgeFile {
    /// Name of the bridge, at most 24 bytes.
    pub name: String,
    /// Length of the girder, m.
    pub length_m: f64,
    /// Number of equal elements.
    pub elements: usize,
    /// Mass of a metre, kg/m.
    pub mass_per_length_kgpm: f64,
    /// E I of the undamaged girder, N m².
    pub bending_stiffness_nm2: f64,
    /// Nodes, from 1, whose vertical displacement is held.
    pub supports: Vec<usize>,
    /// Damping ratio at the first two modes.
    pub damping_ratio: f64,
    /// Modes in the reduced basis.
    pub basis_modes: usize,
}

/// Reads and checks the text of a girder's file.
pub fn parse(text: &str) -> Result<BridgeFile> {
    let bridge: BridgeFile = toml_text::parse(text)?;
    let BridgeFile {
        length_m,
        mass_per_length_kgpm,
        bending_stiffness_nm2,
        damping_ratio,
        ..
    } = bridge;
    if bridge.name.is_empty() || bridge.name.len() > 24 {
        bail!("name must have 1 to 24 letters, not {}", bridge.name.len());
    }
    for (key, value) in [
        ("length_m", length_m),
        ("mass_per_length_kgpm", mass_per_length_kgpm),
        ("bending_stiffness_nm2", bending_stiffness_nm2),
    ] {
        if !(value.is_finite() && value > 0.0) {
            bail!("{key} must be a positive number, not {value}");
        }
    }
    if !(0.0..0.5).contains(&damping_ratio) {
        bail!("damping_ratio must lie between 0 and 0.5, not {damping_ratio}");
    }
    if !(2..=ELEMENTS).contains(&bridge.elements) {
        bail!(
            "elements must be 2 to {ELEMENTS}, not {}: that is what a logger has memory for",
            bridge.elements
        );
    }
    let nodes = bridge.elements + 1;
    if let Some(node) = bridge.supports.iter().find(|&&node| !(1..=nodes).contains(&node)) {
        bail!("supports names node {node}, but the nodes are 1 to {nodes}");
    }
    let mut supports = bridge.supports.clone();
    supports.sort_unstable();
    supports.dedup();
    if supports.len() < 2 {
        bail!("the girder can fall: supports must name at least two different nodes");
    }
    if bridge.basis_modes == 0 || bridge.basis_modes > 2 * nodes - supports.len() {
        bail!(
            "basis_modes must be 1 to {} for {} elements on {} supports, not {}",
            2 * nodes - supports.len(),
            bridge.elements,
            supports.len(),
            bridge.basis_modes
        );
    }
    Ok(bridge)
}
