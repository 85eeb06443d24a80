//! From a bridge file to the reduced model that the logger holds.
//!
//! [`mod@file`] reads what an engineer wrote, a girder or a [`frame`], and makes a [`BridgeFrame`] of it; [`structure`] is
//! that in finite elements, with the [`path`] of the wheels. [`eigen`] finds its natural modes, [`modal`] makes of them
//! what the time solution wants, [`influence`] says what standing loads do, [`reduce`] the [`ReducedBridge`] of a logger; [`shapes`] takes the mode shapes back out
//! of it, for the eye.
//!
//! [`ReducedBridge`]: spanwatch::bridge::ReducedBridge

pub mod condensation;
pub mod eigen;
pub mod file;
pub mod frame;
pub mod girder;
pub mod influence;
pub mod modal;
pub mod participation;
pub mod path;
pub mod reduce;
pub mod shapes;
pub mod structure;

use std::fs::File;
use std::io::Read;
use std::path::Path;

use anyhow::{Context, Result, anyhow, bail};
use spanwatch::bridge::{ReducedBridge, blob};
use spanwatch::capacity::MODEL_BLOB_BYTES;

pub use file::BridgeFile;
pub use structure::{BridgeFrame, Structure};

/// No bridge model's file is nearly as large, bytes.
const MAX_FILE_BYTES: u64 = 1 << 20;

/// The bridges that come with the program, by name.
const SHIPPED: &[(&str, &str)] = &[
    ("girder50", include_str!("../../bridges/girder50.toml")),
    ("twospan", include_str!("../../bridges/twospan.toml")),
    ("viaduct24", include_str!("../../bridges/viaduct24.toml")),
    ("rdso45m", include_str!("../../bridges/rdso45m.toml")),
];

/// Their names.
pub fn shipped_names() -> impl Iterator<Item = &'static str> {
    SHIPPED.iter().map(|(name, _)| *name)
}

/// The bridge of that name among those that come with the program.
pub fn shipped(name: &str) -> Result<BridgeFrame> {
    let Some((_, text)) = SHIPPED.iter().find(|(known, _)| *known == name) else {
        let known: Vec<&str> = shipped_names().collect();
        bail!(
            "there is no bridge named \"{name}\"; the bridges known here are: {}",
            known.join(", ")
        );
    };
    file::read(text).with_context(|| format!("bridge \"{name}\""))
}

/// The bridge of a name or of a file: what ends in `.toml` is a file, all else a name.
pub fn find(name_or_file: &str) -> Result<BridgeFrame> {
    if Path::new(name_or_file)
        .extension()
        .is_some_and(|extension| extension.eq_ignore_ascii_case("toml"))
    {
        return from_file(Path::new(name_or_file));
    }
    shipped(name_or_file)
        .map_err(|error| anyhow!("{error}; a bridge of your own is a file NAME.toml, named with --bridge"))
}

/// The bridge in a file.
pub fn from_file(path: &Path) -> Result<BridgeFrame> {
    let text = std::fs::read_to_string(path).with_context(|| format!("cannot read {}", path.display()))?;
    file::read(&text).with_context(|| path.display().to_string())
}

/// The bytes of a model, as the logger reads them.
pub fn to_blob(bridge: &ReducedBridge<f64>) -> Result<Vec<u8>> {
    let mut buffer = vec![0; MODEL_BLOB_BYTES];
    Ok(blob::write(&bridge.cast(), &mut buffer)?.to_vec())
}

/// The model in the bytes of a file that `model build` has written.
pub fn from_blob(bytes: &[u8]) -> Result<ReducedBridge<f32>> {
    Ok(blob::read(bytes)?)
}

/// The bytes of a file that may be a model.
///
/// # Errors
/// If the file cannot be read or is far larger than any model.
pub fn read_bytes(path: &Path) -> Result<Vec<u8>> {
    let cannot = || format!("cannot read {}", path.display());
    let file = File::open(path).with_context(cannot)?;
    let mut bytes = Vec::new();
    file.take(MAX_FILE_BYTES + 1)
        .read_to_end(&mut bytes)
        .with_context(cannot)?;
    if bytes.len() as u64 > MAX_FILE_BYTES {
        bail!("{}: this is not a bridge model; it is larger than any", path.display());
    }
    Ok(bytes)
}
