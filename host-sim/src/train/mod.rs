//! Trains: by the names that the program knows, or from a [`file`].

pub mod file;

use std::path::Path;

use anyhow::{Context, Result, bail};
use spanwatch::capacity::CARS;
use spanwatch::train::Train;
use spanwatch::train::stock::{self, SPATIAL_CONTACTS, SPATIAL_DOFS};
use spanwatch::wire::message::TrainKind;

/// A train in space, every car of it of its own kind if need be.
pub type SpatialTrain = Train<f64, SPATIAL_DOFS, SPATIAL_CONTACTS, CARS>;

/// What a recording or the command line calls a train.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum TrainName {
    /// One that the logger knows too.
    Known(TrainKind),
    /// The file of one.
    File(String),
}

impl TrainName {
    /// The train of that name: what ends in `.toml` is a file.
    ///
    /// # Errors
    /// If no train has that name.
    pub fn parse(name: &str) -> Result<Self> {
        let is_file = Path::new(name)
            .extension()
            .is_some_and(|extension| extension.eq_ignore_ascii_case("toml"));
        Ok(match name {
            "inspection-2dof" => Self::Known(TrainKind::Inspection2Dof),
            "shinkansen-3d" => Self::Known(TrainKind::Shinkansen3d),
            _ if is_file || file::shipped(name).is_some() => Self::File(name.to_owned()),
            _ => bail!(
                "there is no train \"{name}\"; the trains known here are inspection-2dof, shinkansen-3d and {}; one of your \
                 own is a file NAME.toml",
                file::SHIPPED.map(|(name, _)| name).join(", ")
            ),
        })
    }

    /// The name.
    pub fn name(&self) -> &str {
        match self {
            Self::Known(TrainKind::Inspection2Dof) => "inspection-2dof",
            Self::Known(TrainKind::Shinkansen3d) => "shinkansen-3d",
            Self::File(name) => name,
        }
    }

    /// The train: of `cars` cars, if it is one that is known; a file says its own number.
    ///
    /// # Errors
    /// If the number of cars is missing, wrong or out of place, or the file cannot be used.
    pub fn train(&self, cars: Option<usize>) -> Result<SpatialTrain> {
        match (self, cars) {
            (Self::Known(kind), Some(cars)) => {
                let car = match kind {
                    TrainKind::Inspection2Dof => stock::inspection(),
                    TrainKind::Shinkansen3d => stock::shinkansen(),
                };
                Train::uniform(car, cars, stock::PITCH_M)
                    .with_context(|| format!("--cars must be 1 to {CARS}, not {cars}"))
            }
            (Self::Known(_), None) => bail!("train \"{}\" needs its number of cars: give --cars", self.name()),
            (Self::File(name), None) => match file::shipped(name) {
                Some(text) => file::parse(text).with_context(|| format!("train \"{name}\"")),
                None => file::read(Path::new(name)),
            },
            (Self::File(name), Some(_)) => bail!("train \"{name}\" has the cars that its file names: leave --cars out"),
        }
    }
}
