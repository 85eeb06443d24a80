//! The trains by the names they have in recordings and on the command line.

use anyhow::{Result, bail};
use spanwatch::wire::message::TrainKind;

/// The name of a train.
pub fn name(kind: TrainKind) -> &'static str {
    match kind {
        TrainKind::Inspection2Dof => "inspection-2dof",
    }
}

/// The train of that name.
pub fn parse(name: &str) -> Result<TrainKind> {
    match name {
        "inspection-2dof" => Ok(TrainKind::Inspection2Dof),
        "shinkansen-3d" => bail!("train \"shinkansen-3d\" comes with a later version; this one knows inspection-2dof"),
        _ => bail!("there is no train \"{name}\"; the train known here is inspection-2dof"),
    }
}
