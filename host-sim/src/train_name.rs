//! The trains by the names they have in recordings and on the command line.

use anyhow::{Result, bail};
use spanwatch::capacity::CARS;
use spanwatch::train::Train;
use spanwatch::train::stock::{self, SPATIAL_CONTACTS, SPATIAL_DOFS};
use spanwatch::wire::message::TrainKind;

/// A train in space, every car of it of its own kind if need be.
pub type SpatialTrain = Train<f64, SPATIAL_DOFS, SPATIAL_CONTACTS, CARS>;

/// The train of `cars` cars of a kind; none if the number is not 1 to [`CARS`].
pub fn spatial(kind: TrainKind, cars: usize) -> Option<SpatialTrain> {
    let car = match kind {
        TrainKind::Inspection2Dof => stock::inspection(),
        TrainKind::Shinkansen3d => stock::shinkansen(),
    };
    Train::uniform(car, cars, stock::PITCH_M)
}

/// The name of a train.
pub fn name(kind: TrainKind) -> &'static str {
    match kind {
        TrainKind::Inspection2Dof => "inspection-2dof",
        TrainKind::Shinkansen3d => "shinkansen-3d",
    }
}

/// The train of that name.
pub fn parse(name: &str) -> Result<TrainKind> {
    match name {
        "inspection-2dof" => Ok(TrainKind::Inspection2Dof),
        "shinkansen-3d" => Ok(TrainKind::Shinkansen3d),
        _ => bail!("there is no train \"{name}\"; the trains known here are inspection-2dof and shinkansen-3d"),
    }
}
