//! The CSV of a track: `x_m` first, then the irregularity in mm, up and to the left.
//!
//! ```text
//! x_m,z_irregularity_mm                                  both rails alike, straight
//! x_m,z_left_mm,z_right_mm[,y_left_mm,y_right_mm]        each rail, straight without the last two
//! ```
//!
//! Points ascend at any spacing; `x_m` is 0 at node 1 and negative on the approach. What no smooth curve could be laid
//! through in good faith is refused: too few points, a hole in the table, a value in the wrong unit. The spacing decides
//! which waves are told: see [`spline`](super::spline).

use std::fmt::Write as _;
use std::path::Path;

use anyhow::{Context, Result, anyhow, bail};

use super::{Profile, Rails};
use crate::number_table::NumberTable;

/// Name of the first column.
pub const PLACE_COLUMN: &str = "x_m";
/// The column of both rails' heights.
pub const HEIGHT_COLUMN: &str = "z_irregularity_mm";
/// The columns of the left and the right rail's heights.
pub const HEIGHT_COLUMNS: [&str; 2] = ["z_left_mm", "z_right_mm"];
/// The columns of the left and the right rail's lateral places.
pub const LATERAL_COLUMNS: [&str; 2] = ["y_left_mm", "y_right_mm"];
/// Largest irregularity, mm. No train runs on more; a larger one is a slip of the unit.
pub const LIMIT_MM: f64 = 100.0;
/// Farthest place from node 1, m. What is farther is a slip of the unit.
pub const FARTHEST_M: f64 = 1e5;
/// Points closer than this, m, are a slip: a place is written to as much.
pub const CLOSEST_M: f64 = 1e-4;
/// Fewest points.
pub const FEWEST_POINTS: usize = 4;
/// A spacing is a gap if it is more than this many times the usual (median) one.
const GAP_FACTOR: f64 = 5.0;
/// Decimals of a written place, m, and irregularity, mm: curvature from points 0.05 m apart feels 1e-8 mm as 1e-8 /m.
const PLACE_DECIMALS: usize = 4;
const VALUE_DECIMALS: usize = 8;
const MM: f64 = 1e-3;

/// Reads a table and lays the curves through it.
///
/// # Errors
/// One sentence that says file, line and column, and what to mend.
pub fn read(path: &Path) -> Result<Profile> {
    read_table(path, NumberTable::open(path)?)
}

/// The same from a table that is open already; errors name `path`.
///
/// # Errors
/// As [`read`].
pub fn read_table(path: &Path, mut table: NumberTable) -> Result<Profile> {
    let file = path.display();
    let layout = Layout::of(table.header()).with_context(|| format!("{file}: line 1"))?;

    let mut rails = Rails {
        x_m: Vec::new(),
        z_m: Default::default(),
        y_m: Default::default(),
    };
    let mut lines = Vec::new();
    while let Some(row) = table.next_row()? {
        let number = |column: usize, limit: f64, unit: &str| -> Result<f64> {
            let value = row.number(column)?;
            if value.abs() > limit {
                bail!(
                    "{}: {} {unit} is more than {limit} {unit}; check the unit of the column",
                    row.place(column),
                    row.text(column)
                );
            }
            Ok(value)
        };
        let x = number(0, FARTHEST_M, "m")?;
        if let Some(&before) = rails.x_m.last()
            && x <= before
        {
            bail!(
                "{}: {x} m does not come after {before} m; sort the rows by place, one a place",
                row.place(0)
            );
        }
        if let Some(&before) = rails.x_m.last()
            && x - before < 0.99 * CLOSEST_M
        {
            bail!(
                "{}: {x} m lies less than {CLOSEST_M} m behind {before} m; check the unit of the column",
                row.place(0)
            );
        }
        rails.x_m.push(x);
        for (rail, columns) in [(&mut rails.z_m, Some(layout.z)), (&mut rails.y_m, layout.y)] {
            for side in 0..2 {
                let value = columns.map_or(Ok(0.0), |columns| number(columns[side], LIMIT_MM, "mm"))?;
                rail[side].push(value * MM);
            }
        }
        lines.push(row.line);
    }
    if rails.x_m.len() < FEWEST_POINTS {
        bail!(
            "{file}: {} point{} only; a track needs at least {FEWEST_POINTS}",
            rails.x_m.len(),
            if rails.x_m.len() == 1 { "" } else { "s" }
        );
    }
    if let Some((row, usual_m)) = gap(&rails.x_m) {
        bail!(
            "{file}: line {}: the track has a gap from {} m to {} m, where points are usually {} m apart; put in the points \
             that are missing, or take the part on one side of the gap",
            lines[row],
            rails.x_m[row - 1],
            rails.x_m[row],
            (usual_m * 1e6).round() / 1e6
        );
    }
    Ok(Profile::new(rails))
}

/// Which columns hold the left and the right rail.
struct Layout {
    z: [usize; 2],
    y: Option<[usize; 2]>,
}

impl Layout {
    fn of(header: &csv::StringRecord) -> Result<Self> {
        if header.get(0) != Some(PLACE_COLUMN) {
            bail!(
                "the first column must be \"{PLACE_COLUMN}\", not \"{}\"; the first line names the columns, with commas \
                 between them",
                header.get(0).unwrap_or("")
            );
        }
        let mut names = header.iter().enumerate();
        if let Some((_, name)) = names.find(|&(i, name)| header.iter().take(i).any(|other| other == name)) {
            bail!("column \"{name}\" is there twice");
        }
        let known = |name: &&str| {
            [PLACE_COLUMN, HEIGHT_COLUMN].contains(name)
                || HEIGHT_COLUMNS.contains(name)
                || LATERAL_COLUMNS.contains(name)
        };
        if let Some(name) = header.iter().find(|name| !known(name)) {
            bail!(
                "column \"{name}\" is none of a track; its columns are {PLACE_COLUMN}, then {HEIGHT_COLUMN} or {}, and {} \
                 where the rails are not straight",
                HEIGHT_COLUMNS.join(" and "),
                LATERAL_COLUMNS.join(" and ")
            );
        }
        let place = |name: &str| header.iter().position(|other| other == name);
        let both = |names: [&str; 2]| match names.map(place) {
            [Some(left), Some(right)] => Ok(Some([left, right])),
            [None, None] => Ok(None),
            [left, _] => {
                let (there, missing) = if left.is_some() {
                    (names[0], names[1])
                } else {
                    (names[1], names[0])
                };
                Err(anyhow!(
                    "there is a column \"{there}\" but no \"{missing}\"; name both rails"
                ))
            }
        };
        let z = match (place(HEIGHT_COLUMN), both(HEIGHT_COLUMNS)?) {
            (Some(shared), None) => [shared; 2],
            (None, Some(each)) => each,
            (None, None) => bail!(
                "there is no column \"{HEIGHT_COLUMN}\", nor {} for each rail",
                HEIGHT_COLUMNS.join(" and ")
            ),
            (Some(_), Some(_)) => bail!(
                "there are {HEIGHT_COLUMN} and {} at once; give both rails one height, or each its own",
                HEIGHT_COLUMNS.join(", ")
            ),
        };
        Ok(Self {
            z,
            y: both(LATERAL_COLUMNS)?,
        })
    }
}

/// The row after the first gap and the usual spacing.
fn gap(x_m: &[f64]) -> Option<(usize, f64)> {
    let usual = median_spacing_m(x_m);
    let row = (1..x_m.len()).find(|&i| {
        let spacing = x_m[i] - x_m[i - 1];
        spacing > GAP_FACTOR * usual
    })?;
    Some((row, usual))
}

/// The spacing that half of the points do not exceed, m.
pub fn median_spacing_m(x_m: &[f64]) -> f64 {
    let mut spacings: Vec<f64> = x_m.windows(2).map(|pair| pair[1] - pair[0]).collect();
    spacings.sort_by(f64::total_cmp);
    spacings[(spacings.len() - 1) / 2]
}

/// The text of a track's CSV: in the short form where rails are alike and straight, else each rail.
pub fn text(rails: &Rails) -> String {
    let alike = rails.z_m[0] == rails.z_m[1];
    let straight = rails.y_m.iter().flatten().all(|&y| y == 0.0);
    let (names, columns): (Vec<&str>, Vec<&[f64]>) = if alike && straight {
        (vec![HEIGHT_COLUMN], vec![&rails.z_m[0]])
    } else {
        let lateral = if straight { 0 } else { 2 };
        (
            HEIGHT_COLUMNS
                .into_iter()
                .chain(LATERAL_COLUMNS.into_iter().take(lateral))
                .collect(),
            (rails.z_m.iter().chain(rails.y_m.iter().take(lateral)))
                .map(Vec::as_slice)
                .collect(),
        )
    };
    let mut text = format!("{PLACE_COLUMN},{}\n", names.join(","));
    for (i, x) in rails.x_m.iter().enumerate() {
        let _ = write!(text, "{x:.PLACE_DECIMALS$}");
        for column in &columns {
            let _ = write!(text, ",{:.VALUE_DECIMALS$}", column[i] / MM);
        }
        text.push('\n');
    }
    text
}
