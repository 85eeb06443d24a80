//! Passages to learn from, from recordings.

use anyhow::{Result, bail};

use super::Passage;
use crate::identification::Observed;
use crate::replay::Prepared;
use crate::train::TrainName;

impl Passage {
    /// The passage of a recording. What this says of the run is taken for [roughly](Prepared::loosen) right.
    ///
    /// # Errors
    /// As [`Observed::recorded`].
    pub fn recorded(prepared: &mut Prepared) -> Result<Self> {
        prepared.loosen();
        let name = prepared.path.display().to_string();
        let observed = Observed::recorded(prepared)?;
        let Some(TrainName::Known(train)) = prepared.recording.train else {
            bail!("{name}: its train is none that a logger knows");
        };
        Ok(Self { name, train, observed })
    }
}
