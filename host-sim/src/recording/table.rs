//! The CSV of a recording: `time_s` first, then a column a channel; columns that no channel names are passed over.

use std::fmt::Write as _;
use std::path::Path;

use anyhow::{Result, anyhow, bail};

use super::clock::{self, ClockError};
use super::{Recording, description_path};
use crate::number_table::NumberTable;

/// Name of the first column.
pub const TIME_COLUMN: &str = "time_s";
/// Decimals of a written time where fewer do not tell it exactly.
const MAX_TIME_DECIMALS: usize = 9;

/// Reads the samples of the channels that `recording` names.
pub fn read(path: &Path, recording: Recording) -> Result<Recording> {
    read_table(path, NumberTable::open(path)?, recording)
}

/// The same from a table that is open already; errors name `path`.
pub fn read_table(path: &Path, mut table: NumberTable, mut recording: Recording) -> Result<Recording> {
    let file = path.display();
    let header = table.header().clone();
    if header.get(0) != Some(TIME_COLUMN) {
        bail!(
            "{file}: line 1: the first column must be \"{TIME_COLUMN}\", not \"{}\"; the first line names the columns, \
             with commas between them",
            header.get(0).unwrap_or("")
        );
    }
    let columns = recording
        .channels
        .iter()
        .map(|channel| {
            let mut places = (1..header.len()).filter(|&i| header[i] == channel.column);
            match (places.next(), places.next()) {
                (Some(place), None) => Ok(place),
                (Some(_), Some(_)) => Err(anyhow!("{file}: line 1: column \"{}\" is there twice", channel.column)),
                (None, _) => Err(anyhow!(
                    "{file}: line 1: there is no column \"{}\", which {} names; the columns are: {}",
                    channel.column,
                    description_path(path)?.file_name().unwrap_or_default().display(),
                    header.iter().collect::<Vec<_>>().join(", ")
                )),
            }
        })
        .collect::<Result<Vec<usize>>>()?;

    let (mut times, mut lines) = (Vec::new(), Vec::new());
    while let Some(row) = table.next_row()? {
        times.push(row.number(0)?);
        for (channel, &column) in recording.channels.iter_mut().zip(&columns) {
            channel.values.push(row.number(column)? * channel.unit.factor());
        }
        lines.push(row.line);
    }
    if times.is_empty() {
        bail!("{file}: it has a header but no samples");
    }
    let (interval_s, runs) = clock::runs(&times).map_err(|error| match error {
        ClockError::OneRow => anyhow!("{file}: one sample only; the sampling rate needs at least two"),
        ClockError::NotIncreasing { row } => anyhow!(
            "{file}: line {}, column {TIME_COLUMN}: {} s does not come after {} s",
            lines[row],
            times[row],
            times[row - 1]
        ),
        ClockError::Uneven { row, interval_s } => anyhow!(
            "{file}: line {}, column {TIME_COLUMN}: {} s is not a whole number of intervals of {interval_s:.6} s after \
             {} s; rows may be missing, but the sampling rate must be constant",
            lines[row],
            times[row],
            times[row - 1]
        ),
    })?;
    recording.start_s = times[0];
    recording.interval_s = interval_s;
    recording.runs = runs;
    Ok(recording)
}

/// The text of a recording's CSV: times in as many decimals as they need, values with nine digits.
pub fn text(recording: &Recording) -> String {
    let decimals = time_decimals(recording.interval_s).max(time_decimals(recording.start_s));
    let mut text = String::from(TIME_COLUMN);
    for channel in &recording.channels {
        let _ = write!(text, ",{}", quoted(&channel.column));
    }
    text.push('\n');
    for run in &recording.runs {
        for row in 0..run.rows {
            let time = recording.start_s + (run.first_sample + row as u64) as f64 * recording.interval_s;
            let _ = write!(text, "{time:.decimals$}");
            for channel in &recording.channels {
                let _ = write!(
                    text,
                    ",{:.8e}",
                    channel.values[run.first_row + row] / channel.unit.factor()
                );
            }
            text.push('\n');
        }
    }
    text
}

/// Decimals that tell `value` exactly, at least 3, at most [`MAX_TIME_DECIMALS`].
fn time_decimals(value: f64) -> usize {
    (3..MAX_TIME_DECIMALS)
        .find(|&decimals| {
            let scaled = value * 10_f64.powi(decimals as i32);
            (scaled - scaled.round()).abs() < 1e-6
        })
        .unwrap_or(MAX_TIME_DECIMALS)
}

fn quoted(name: &str) -> String {
    if name.contains([',', '"', '\n']) {
        format!("\"{}\"", name.replace('"', "\"\""))
    } else {
        name.to_owned()
    }
}
