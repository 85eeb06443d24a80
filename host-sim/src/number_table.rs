//! A CSV of numbers under a header, read row by row with errors that say line and column.

use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, anyhow, bail};

/// A CSV that is being read.
pub struct NumberTable {
    path: PathBuf,
    reader: csv::Reader<Box<dyn Read>>,
    header: csv::StringRecord,
    record: csv::StringRecord,
}

/// A row of it.
pub struct Row<'a> {
    table: &'a NumberTable,
    /// Its line in the file, from 1.
    pub line: u64,
}

impl NumberTable {
    /// Opens a CSV and reads its header.
    ///
    /// # Errors
    /// If there is no such file, or it is not text.
    pub fn open(path: &Path) -> Result<Self> {
        let file = File::open(path).with_context(|| format!("cannot read {}", path.display()))?;
        Self::of(path, Box::new(file))
    }

    /// Reads the header of a CSV whose text comes from `source`; its errors name `path`.
    ///
    /// # Errors
    /// As [`Self::open`].
    pub fn of(path: &Path, source: Box<dyn Read>) -> Result<Self> {
        let mut reader = csv::ReaderBuilder::new()
            .flexible(true)
            .trim(csv::Trim::All)
            .from_reader(source);
        let header = reader.headers().map_err(|error| unreadable(path, &error))?.clone();
        if header.iter().any(|name| name.contains(['\n', '\r'])) {
            bail!(
                "{}: line 1: the name of a column goes on in the next line; close its quotation mark",
                path.display()
            );
        }
        Ok(Self {
            path: path.to_owned(),
            reader,
            header,
            record: csv::StringRecord::new(),
        })
    }

    /// The names of the columns.
    pub fn header(&self) -> &csv::StringRecord {
        &self.header
    }

    /// The next row; none at the end.
    ///
    /// # Errors
    /// If it has more or fewer columns than the header, or is not text.
    pub fn next_row(&mut self) -> Result<Option<Row<'_>>> {
        let read = self.reader.read_record(&mut self.record);
        if !read.map_err(|error| unreadable(&self.path, &error))? {
            return Ok(None);
        }
        let line = self.record.position().map_or(0, csv::Position::line);
        if self.record.len() != self.header.len() {
            bail!(
                "{}: line {line}: {} columns, but line 1 names {}",
                self.path.display(),
                self.record.len(),
                self.header.len()
            );
        }
        Ok(Some(Row { table: self, line }))
    }
}

impl Row<'_> {
    /// The number in a column.
    ///
    /// # Errors
    /// If it is not a finite number.
    pub fn number(&self, column: usize) -> Result<f64> {
        let text = self.text(column);
        let value: f64 = text
            .parse()
            .map_err(|_| anyhow!("{}: \"{}\" is not a number", self.place(column), text.escape_debug()))?;
        if !value.is_finite() {
            bail!(
                "{}: {text} is not a finite number; leave the row out instead",
                self.place(column)
            );
        }
        Ok(value)
    }

    /// What stands in a column.
    pub fn text(&self, column: usize) -> &str {
        &self.table.record[column]
    }

    /// File, line and column in words.
    pub fn place(&self, column: usize) -> String {
        let table = self.table;
        format!(
            "{}: line {}, column {}",
            table.path.display(),
            self.line,
            &table.header[column]
        )
    }
}

fn unreadable(path: &Path, error: &csv::Error) -> anyhow::Error {
    let file = path.display();
    let line = match error.kind() {
        csv::ErrorKind::Utf8 { pos: Some(pos), .. } => pos.line(),
        csv::ErrorKind::Io(error) => return anyhow!("cannot read {file}: {error}"),
        _ => return anyhow!("{file}: {error}"),
    };
    anyhow!("{file}: line {line}: it is not text (UTF-8); a table of numbers is a CSV")
}
