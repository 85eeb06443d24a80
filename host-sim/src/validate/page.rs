//! The chapter as a page: Markdown, columns aligned.

use std::fmt::Write as _;

use super::{Chapter, Row};

/// Differences below this are what rounding leaves, and change from one computer to another.
const ROUNDING: f64 = 1e-8;

const INTRODUCTION: &str = "\
# Validation
`host-sim validate` computes every row of these tables when it runs, by the same code that simulates passages, and ends with exit
code 0 if all of them hold, with 2 if one does not. `host-sim validate > docs/validation.md` makes this page; a test holds the two
together.

*Expected* is a closed form, evaluated, or a number that others have published, with its source; *found* is what this program
makes of the same question. *Difference* is a part of the expected value, of the largest value where all times are compared, of the
RMS where histories are (then both columns show RMS values). *Tolerance* is the largest difference with which the row holds.

Displacements are positive up. Modes are stepped exactly (the default scheme) unless a chapter says otherwise.
";

const HEAD: [&str; 7] = [
    "what",
    "source",
    "expected",
    "found",
    "difference",
    "tolerance",
    "why that tolerance",
];
/// The columns of numbers.
const RIGHT: [bool; 7] = [false, false, true, true, true, true, false];

/// The whole page.
pub fn page(chapters: &[Chapter]) -> String {
    let mut text = INTRODUCTION.to_owned();
    let rows = chapters.iter().flat_map(|chapter| &chapter.rows);
    let (all, holding) = rows.fold((0, 0), |(all, holding), row| {
        (all + 1, holding + usize::from(row.holds()))
    });
    let _ = writeln!(text, "\n{holding} of {all} rows hold.");
    for chapter in chapters {
        let _ = writeln!(text, "\n## {}\n{}\n", chapter.topic.title, wrapped(chapter.topic.about));
        text += &table(&chapter.rows);
    }
    text
}

fn table(rows: &[Row]) -> String {
    let cells: Vec<[String; 7]> = std::iter::once(HEAD.map(str::to_owned))
        .chain(rows.iter().map(cells))
        .collect();
    let width: [usize; 7] =
        std::array::from_fn(|column| cells.iter().map(|row| row[column].chars().count()).max().unwrap_or(0));
    let mut text = String::new();
    for (i, row) in cells.iter().enumerate() {
        for ((cell, &width), right) in row.iter().zip(&width).zip(RIGHT) {
            let _ = if right {
                write!(text, "| {cell:>width$} ")
            } else {
                write!(text, "| {cell:<width$} ")
            };
        }
        text += "|\n";
        if i == 0 {
            for (&width, right) in width.iter().zip(RIGHT) {
                let line = "-".repeat(width);
                let _ = if right {
                    write!(text, "|-{line}:")
                } else {
                    write!(text, "|-{line}-")
                };
            }
            text += "|\n";
        }
    }
    text
}

fn cells(row: &Row) -> [String; 7] {
    let value = |value: f64| {
        // No minus before a value that is shown as zero.
        let text = format!("{:.*}", row.decimals, value);
        let text = if text
            .trim_start_matches('-')
            .bytes()
            .all(|digit| matches!(digit, b'0' | b'.'))
        {
            text.trim_start_matches('-').to_owned()
        } else {
            text
        };
        if row.unit.is_empty() {
            text
        } else {
            format!("{text} {}", row.unit)
        }
    };
    let mark = if row.holds() { "" } else { " **fails**" };
    let difference = if row.difference < ROUNDING && row.difference > 0.0 {
        format!("< {ROUNDING:e}")
    } else if row.difference == 0.0 {
        "0".to_owned()
    } else {
        format!("{:.1e}{mark}", row.difference)
    };
    [
        row.what.clone(),
        row.source.to_owned(),
        value(row.expected),
        value(row.found),
        difference,
        if row.tolerance == 0.0 {
            "0".to_owned()
        } else {
            format!("{:e}", row.tolerance)
        },
        row.reason.to_owned(),
    ]
}

/// Lines of at most 130 characters.
fn wrapped(text: &str) -> String {
    const WIDTH: usize = 130;
    let mut lines = String::new();
    let mut length = 0;
    for word in text.split_whitespace() {
        let letters = word.chars().count();
        if length > 0 && length + 1 + letters > WIDTH {
            lines.push('\n');
            length = 0;
        } else if length > 0 {
            lines.push(' ');
            length += 1;
        }
        lines += word;
        length += letters;
    }
    lines
}
