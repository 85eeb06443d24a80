//! The validation chapter: what the solver and the finite elements find, beside closed forms, others' numbers and what
//! mechanics demands.
//!
//! A [`Topic`] is a module with a few [`Row`]s. Every row is computed when it is asked for, by the very code that simulates
//! passages; nothing that is found here is written down but on the [`page`] that shows it.

pub mod beam;
pub mod compare;
pub mod energy;
pub mod frames;
pub mod histories;
pub mod moving_force;
pub mod order;
pub mod page;
pub mod runs;
pub mod specimen;
pub mod sprung_mass;
pub mod step_response;

use anyhow::{Context, Result};
use serde::Serialize;

/// One comparison.
#[derive(Debug, Clone, Serialize)]
pub struct Row {
    /// What is compared.
    pub what: String,
    /// Where the expected value comes from.
    pub source: &'static str,
    /// What it should be.
    pub expected: f64,
    /// What it is.
    pub found: f64,
    /// Unit of both.
    pub unit: &'static str,
    /// Decimals worth showing of both.
    #[serde(skip)]
    pub decimals: usize,
    /// By how much they differ, as a part of what the row is measured by; of the expected value unless the row says
    /// otherwise.
    pub difference: f64,
    /// Largest difference with which the row holds.
    pub tolerance: f64,
    /// Why that tolerance.
    pub reason: &'static str,
}

impl Row {
    /// A row that compares nothing yet.
    pub fn new(what: impl Into<String>, source: &'static str) -> Self {
        Self {
            what: what.into(),
            source,
            expected: f64::NAN,
            found: f64::NAN,
            unit: "",
            decimals: 0,
            difference: f64::NAN,
            tolerance: 0.0,
            reason: "",
        }
    }

    /// How the values are shown.
    pub fn shown(self, unit: &'static str, decimals: usize) -> Self {
        Self { unit, decimals, ..self }
    }

    /// Both values so many times as large: in another unit.
    pub fn times(self, factor: f64) -> Self {
        Self {
            expected: factor * self.expected,
            found: factor * self.found,
            ..self
        }
    }

    /// Two numbers; their difference is a part of the expected one.
    pub fn numbers(self, expected: f64, found: f64) -> Self {
        self.measured_by(expected, found, expected)
    }

    /// Two numbers; their difference is a part of `measure`.
    pub fn measured_by(self, expected: f64, found: f64, measure: f64) -> Self {
        Self {
            expected,
            found,
            difference: ((found - expected) / measure).abs(),
            ..self
        }
    }

    /// Two histories, by their RMS: the difference is the RMS of theirs.
    pub fn histories(self, expected: &[f64], found: &[f64]) -> Self {
        Self {
            expected: compare::rms(expected),
            found: compare::rms(found),
            difference: compare::relative_rms(found, expected),
            ..self
        }
    }

    /// Two histories, by their largest values: the difference is the largest of theirs at any time.
    pub fn everywhere(self, expected: &[f64], found: &[f64]) -> Self {
        let apart: Vec<f64> = expected.iter().zip(found).map(|(e, f)| f - e).collect();
        let largest = compare::largest(expected);
        let alike = expected.len() == found.len();
        Self {
            expected: largest,
            found: compare::largest(found),
            difference: if alike {
                compare::largest(&apart) / largest
            } else {
                f64::NAN
            },
            ..self
        }
    }

    /// The tolerance, and why it is that.
    pub fn within(self, tolerance: f64, reason: &'static str) -> Self {
        Self {
            tolerance,
            reason,
            ..self
        }
    }

    /// Whether the difference is within the tolerance; what is no number is not.
    pub fn holds(&self) -> bool {
        self.difference <= self.tolerance
    }
}

/// Rows that belong together.
#[derive(Debug, Clone, Copy)]
pub struct Topic {
    /// Its title.
    pub title: &'static str,
    /// What is looked at, with its data.
    pub about: &'static str,
    /// Computes the rows.
    pub rows: fn() -> Result<Vec<Row>>,
}

/// A topic whose rows have been computed.
#[derive(Debug, Clone)]
pub struct Chapter {
    /// The topic.
    pub topic: Topic,
    /// Its rows.
    pub rows: Vec<Row>,
}

/// All topics.
pub const TOPICS: [Topic; 8] = [
    moving_force::TOPIC,
    sprung_mass::TOPIC,
    step_response::TOPIC,
    histories::TOPIC,
    energy::TOPIC,
    order::TOPIC,
    runs::TOPIC,
    frames::TOPIC,
];

/// Computes everything; `done` hears how many topics are.
///
/// # Errors
/// If a row cannot be computed at all.
pub fn run(done: &mut dyn FnMut(usize)) -> Result<Vec<Chapter>> {
    let mut chapters = Vec::new();
    for topic in TOPICS {
        let rows = (topic.rows)().with_context(|| format!("cannot compute \"{}\"", topic.title))?;
        chapters.push(Chapter { topic, rows });
        done(chapters.len());
    }
    Ok(chapters)
}

/// The rows that do not hold, each as a sentence.
pub fn failures(chapters: &[Chapter]) -> Vec<String> {
    let rows = (chapters.iter()).flat_map(|chapter| chapter.rows.iter().map(|row| (chapter.topic.title, row)));
    rows.filter(|(_, row)| !row.holds())
        .map(|(title, row)| {
            format!(
                "{title}: {}: found {:.*} {unit}, expected {:.*} {unit}; they differ by {:.1e}, more than {:.0e}",
                row.what,
                row.decimals,
                row.found,
                row.decimals,
                row.expected,
                row.difference,
                row.tolerance,
                unit = row.unit
            )
        })
        .collect()
}
