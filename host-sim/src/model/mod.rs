//! From a bridge file to the reduced model that the logger holds.
//!
//! [`file`] reads what an engineer wrote, [`beam`] makes finite elements of it, [`reduce`] a [`ReducedBridge`].
//!
//! [`ReducedBridge`]: spanwatch::bridge::ReducedBridge

pub mod beam;
pub mod file;
pub mod reduce;

use std::path::Path;

use anyhow::{Context, Result, anyhow, bail};
use spanwatch::bridge::{ReducedBridge, blob};
use spanwatch::capacity::MODEL_BLOB_BYTES;

pub use file::BridgeFile;

/// The bridges that come with the program, by name.
const SHIPPED: &[(&str, &str)] = &[("girder50", include_str!("../../bridges/girder50.toml"))];

/// The bridge of that name among those that come with the program.
pub fn shipped(name: &str) -> Result<BridgeFile> {
    let Some((_, text)) = SHIPPED.iter().find(|(known, _)| *known == name) else {
        let known: Vec<&str> = SHIPPED.iter().map(|(known, _)| *known).collect();
        bail!(
            "there is no bridge named \"{name}\"; the bridges known here are: {}",
            known.join(", ")
        );
    };
    file::parse(text).with_context(|| format!("bridge \"{name}\""))
}

/// The bridge in a file.
pub fn from_file(path: &Path) -> Result<BridgeFile> {
    let text = std::fs::read_to_string(path).with_context(|| format!("cannot read {}", path.display()))?;
    file::parse(&text).with_context(|| path.display().to_string())
}

/// The bytes of a model, as the logger reads them.
pub fn to_blob(bridge: &ReducedBridge<f64>) -> Result<Vec<u8>> {
    let mut buffer = vec![0; MODEL_BLOB_BYTES];
    Ok(blob::write(&bridge.cast(), &mut buffer)?.to_vec())
}

/// The model in a file that `model build` has written.
pub fn read_blob(path: &Path) -> Result<ReducedBridge<f32>> {
    let bytes = std::fs::read(path).with_context(|| format!("cannot read {}", path.display()))?;
    blob::read(&bytes).map_err(|error| anyhow!("{}: {error}", path.display()))
}
