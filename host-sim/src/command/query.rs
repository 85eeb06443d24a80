//! `host-sim query`: what the base station has stored.

use std::path::PathBuf;

use anyhow::{Result, bail};
use clap::Args;
use host_sim::station::store::{Cell, Store, Table, Topic};
use serde_json::{Map, Value};

#[derive(Debug, Args)]
pub(super) struct Arguments {
    /// What is asked for
    #[arg(value_enum)]
    topic: Topic,
    /// SQLite file of the base station
    #[arg(long, default_value = "spanwatch.sqlite", value_name = "FILE")]
    database: PathBuf,
    /// Of this logger only
    #[arg(long)]
    logger: Option<u32>,
    /// From then on: a date (2026-11-23, 2026-11-23T14:00; UTC), a weekday (the last one, today included), or how long ago (36h, 7d)
    #[arg(long, value_name = "WHEN")]
    since: Option<String>,
    /// One JSON object a line
    #[arg(long, conflicts_with = "csv")]
    json: bool,
    /// CSV
    #[arg(long)]
    csv: bool,
}

pub(super) fn run(arguments: &Arguments) -> Result<()> {
    if !arguments.database.exists() {
        bail!("there is no database {}", arguments.database.display());
    }
    let table =
        Store::open(&arguments.database)?.query(arguments.topic, arguments.logger, arguments.since.as_deref())?;
    if arguments.json {
        return table.rows.iter().try_for_each(|row| {
            let cells = table.columns.iter().zip(row);
            let object: Map<String, Value> = cells.map(|(name, cell)| (name.clone(), as_json(cell))).collect();
            super::print_json(&object.into())
        });
    }
    if arguments.csv {
        let mut out = csv::Writer::from_writer(vec![]);
        out.write_record(&table.columns)?;
        for row in &table.rows {
            out.write_record(row.iter().map(as_text))?;
        }
        return super::print(&String::from_utf8_lossy(&out.into_inner()?));
    }
    super::print(&as_lines(&table))
}

/// Columns under each other; those in which no row has anything are left out.
fn as_lines(table: &Table) -> String {
    let rows: Vec<Vec<String>> = table.rows.iter().map(|row| row.iter().map(as_text).collect()).collect();
    if rows.is_empty() {
        return "nothing\n".to_owned();
    }
    let width = |column: usize| rows.iter().map(|row| row[column].chars().count()).max().unwrap_or(0);
    let shown: Vec<(usize, usize)> = (0..table.columns.len())
        .map(|column| (column, width(column)))
        .filter(|(_, width)| *width > 0)
        .map(|(column, width)| (column, width.max(table.columns[column].chars().count())))
        .collect();
    let line = |cells: &[String]| {
        let cells = shown.iter().map(|&(column, width)| format!("{:width$}", cells[column]));
        let line = cells.collect::<Vec<_>>().join("  ");
        format!("{}\n", line.trim_end())
    };
    line(&table.columns) + &rows.iter().map(|row| line(row)).collect::<String>()
}

fn as_text(cell: &Cell) -> String {
    match cell {
        Cell::Null | Cell::Blob(_) => String::new(),
        Cell::Integer(value) => value.to_string(),
        Cell::Real(value) => format!("{:.4}", value),
        Cell::Text(text) => text.clone(),
    }
}

fn as_json(cell: &Cell) -> Value {
    match cell {
        Cell::Null | Cell::Blob(_) => Value::Null,
        Cell::Integer(value) => (*value).into(),
        Cell::Real(value) => (*value).into(),
        Cell::Text(text) => text.clone().into(),
    }
}
