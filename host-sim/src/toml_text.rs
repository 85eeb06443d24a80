//! TOML read with errors of one line that say where.

use std::ops::Range;

use anyhow::{Result, anyhow};
use serde::de::DeserializeOwned;

/// Reads `text`; an error says line and column, not the file.
pub fn parse<T: DeserializeOwned>(text: &str) -> Result<T> {
    toml::from_str(text).map_err(|error: toml::de::Error| {
        let message = error.message().trim().replace('\n', ", ");
        match error.span() {
            Some(span) => anyhow!("{}: {message}", place(text, &span)),
            None => anyhow!("{message}"),
        }
    })
}

/// Line and column of the beginning of `span`, both from 1.
pub fn place(text: &str, span: &Range<usize>) -> String {
    let before = text.get(..span.start).unwrap_or(text);
    let line = before.matches('\n').count() + 1;
    let column = before.chars().rev().take_while(|&c| c != '\n').count() + 1;
    format!("line {line}, column {column}")
}
