//! The campaigns' rows in words: tables, and JSON.

use serde_json::{Value, json};

use super::campaign::{Detected, Errors, Healthy, Key, Row};
use super::design::{class_name, nodes_name};
use crate::evaluate::{aligned, median_and_worst};
use crate::study::noise::campaign::Spread;

/// What is printed under the table of [`errors`].
const ERRORS: &str = "\
RMSE, bound: of the losses, points: root mean square over elements (and viaducts) / median element / worst element. The bound is that of these
passages with the healthy ones before. ratio: of the root mean squares / of the medians / of the worst elements. 95 %: intervals that hold the true
loss. used: monitored passages that were. unlearnt: viaducts whose track could not be.
";
/// What is printed under the table of [`healthy`].
const HEALTHY: &str = "\
alarms: passages with one / viaducts with any; all are false. changed: viaducts whose track is said to have changed, which is false, too. used:
passages that were.
";
/// What is printed under the table of [`changes`].
const CHANGES: &str = "\
reported: viaducts whose change was. after: passages until then, median / most. taken for damage: viaducts with an alarm.
";
/// What is printed under the table of [`detection`].
const DETECTION: &str = "\
after: passages until an alarm names the element: median / 95 % of the viaducts / most. found: viaducts with an
alarm within 6 passages / within all. wrong: viaducts with an alarm of a whole element. changed: viaducts whose track was said to have changed.
";
/// Passages within which a loss should be found.
const SOON: usize = 6;

fn points(spread: Spread) -> String {
    let [rms, median, worst] = [spread.rms, spread.median, spread.worst].map(|part| format!("{:.2}", 100.0 * part));
    format!("{rms} / {median} / {worst}")
}

fn head<const N: usize>(more: [&str; N]) -> Vec<String> {
    ["class", "nodes", "speeds"]
        .into_iter()
        .chain(more)
        .map(str::to_owned)
        .collect()
}

fn key(key: &Key) -> Vec<String> {
    vec![
        class_name(key.class).to_owned(),
        nodes_name(&key.nodes),
        key.speeds.name().to_owned(),
    ]
}

fn key_json(key: &Key) -> Value {
    json!({ "class": class_name(key.class), "nodes": key.nodes, "speeds": key.speeds.name() })
}

/// The lines as a table, each of `N` cells.
fn markdown<const N: usize>(lines: Vec<Vec<String>>, legend: &str) -> String {
    let line = |mut cells: Vec<String>| -> [String; N] {
        std::array::from_fn(|i| cells.get_mut(i).map(std::mem::take).unwrap_or_default())
    };
    format!("{}\n{legend}", aligned(lines.into_iter().map(line).collect()))
}

fn unlearnt<O>(row: &Row<O>) -> String {
    (row.viaducts.len() - row.monitored().count()).to_string()
}

/// Errors of the losses, as a table in Markdown.
pub fn errors(rows: &[Row<Errors>]) -> String {
    let mut lines = vec![head(["viaducts", "RMSE", "bound", "ratio", "95 %", "used", "unlearnt"])];
    for row in rows {
        let (rmse, bound) = (Spread::of(&row.rmse()), Spread::of(&row.bound()));
        let ratio = [
            rmse.rms / bound.rms,
            rmse.median / bound.median,
            rmse.worst / bound.worst,
        ];
        let mut line = key(&row.key);
        line.extend([
            row.viaducts.len().to_string(),
            points(rmse),
            points(bound),
            ratio.map(|ratio| format!("{ratio:.2}")).join(" / "),
            format!("{:.1}", 100.0 * row.coverage()),
            row.monitored().map(|errors| errors.used).sum::<usize>().to_string(),
            unlearnt(row),
        ]);
        lines.push(line);
    }
    markdown::<10>(lines, ERRORS)
}

/// The same as JSON.
pub fn errors_json(rows: &[Row<Errors>]) -> Value {
    let row = |row: &Row<Errors>| {
        json!({
            "row": key_json(&row.key),
            "rmse": row.rmse(),
            "bound": row.bound(),
            "coverage": row.coverage(),
            "viaducts": row.viaducts.iter().map(|of| match of {
                Ok(errors) => json!({
                    "truth": errors.truth,
                    "damage": errors.estimate.damage,
                    "std": errors.estimate.std,
                    "low": errors.estimate.low,
                    "high": errors.estimate.high,
                    "bound": errors.bound,
                    "used": errors.used,
                }),
                Err(error) => json!({ "unlearnt": error }),
            }).collect::<Vec<_>>(),
        })
    };
    rows.iter().map(row).collect()
}

/// False alarms, as a table in Markdown.
pub fn healthy(rows: &[Row<Healthy>]) -> String {
    let mut lines = vec![head(["viaducts", "passages", "used", "alarms", "changed", "unlearnt"])];
    for row in rows {
        let sum = |of: fn(&Healthy) -> usize| row.monitored().map(of).sum::<usize>();
        let mut line = key(&row.key);
        line.extend([
            row.viaducts.len().to_string(),
            sum(|of| of.passages).to_string(),
            sum(|of| of.used).to_string(),
            format!("{} / {}", sum(|of| of.alarms), sum(|of| usize::from(of.alarms > 0))),
            sum(|of| usize::from(of.changed.is_some())).to_string(),
            unlearnt(row),
        ]);
        lines.push(line);
    }
    markdown::<9>(lines, HEALTHY)
}

/// What became of changed tracks, as a table in Markdown.
pub fn changes(rows: &[Row<Healthy>]) -> String {
    let mut lines = vec![head([
        "viaducts",
        "passages",
        "reported",
        "after",
        "taken for damage",
        "unlearnt",
    ])];
    for row in rows {
        let after: Vec<usize> = row.monitored().filter_map(|of| of.changed).collect();
        let mut line = key(&row.key);
        line.extend([
            row.viaducts.len().to_string(),
            row.monitored().map(|of| of.passages).sum::<usize>().to_string(),
            after.len().to_string(),
            median_and_worst(after).map_or_else(|| "never".to_owned(), |(median, most)| format!("{median} / {most}")),
            row.monitored().filter(|of| of.alarms > 0).count().to_string(),
            unlearnt(row),
        ]);
        lines.push(line);
    }
    markdown::<9>(lines, CHANGES)
}

/// What was said of healthy bridges, whether their tracks have changed or not, as JSON.
pub fn healthy_json(rows: &[Row<Healthy>]) -> Value {
    let row = |row: &Row<Healthy>| {
        json!({
            "row": key_json(&row.key),
            "viaducts": row.viaducts.iter().map(|of| match of {
                Ok(of) => json!({
                    "passages": of.passages, "used": of.used, "alarms": of.alarms, "changed_after": of.changed,
                }),
                Err(error) => json!({ "unlearnt": error }),
            }).collect::<Vec<_>>(),
        })
    };
    rows.iter().map(row).collect()
}

/// Passages until an alarm, as a table in Markdown: a line a loss.
pub fn detection(rows: &[Row<Vec<Detected>>]) -> String {
    let mut lines = vec![head([
        "element", "loss", "viaducts", "after", "found", "wrong", "changed",
    ])];
    for row in rows {
        let states = row.monitored().map(Vec::len).max().unwrap_or(0);
        for s in 0..states {
            let of: Vec<Detected> = row.monitored().filter_map(|found| found.get(s)).copied().collect();
            let (element, loss) = (of[0].element + 1, of[0].loss);
            // Never is after all others.
            let mut after: Vec<usize> = of.iter().map(|found| found.after.unwrap_or(usize::MAX)).collect();
            after.sort_unstable();
            let at = |part: f64| {
                let place = ((after.len() as f64 * part).ceil() as usize).clamp(1, after.len());
                match after[place - 1] {
                    usize::MAX => "never".to_owned(),
                    passages => passages.to_string(),
                }
            };
            let within = |most: usize| after.iter().filter(|&&passages| passages <= most).count();
            let mut line = key(&row.key);
            line.extend([
                element.to_string(),
                format!("{:.0} %", 100.0 * loss),
                of.len().to_string(),
                format!("{} / {} / {}", at(0.5), at(0.95), at(1.0)),
                format!("{} / {}", within(SOON), within(usize::MAX - 1)),
                of.iter().filter(|found| found.wrong).count().to_string(),
                of.iter().filter(|found| found.changed.is_some()).count().to_string(),
            ]);
            lines.push(line);
        }
    }
    markdown::<10>(lines, DETECTION)
}

/// The same as JSON.
pub fn detection_json(rows: &[Row<Vec<Detected>>]) -> Value {
    let row = |row: &Row<Vec<Detected>>| {
        let detected = |found: &Detected| {
            json!({
                "element": found.element + 1,
                "loss": found.loss,
                "after": found.after,
                "wrong": found.wrong,
                "changed_after": found.changed,
            })
        };
        json!({
            "row": key_json(&row.key),
            "viaducts": row.viaducts.iter().map(|of| match of {
                Ok(found) => found.iter().map(detected).collect(),
                Err(error) => json!({ "unlearnt": error }),
            }).collect::<Vec<_>>(),
        })
    };
    rows.iter().map(row).collect()
}
