//! The campaign's rows in words: a table, and JSON.

use serde_json::{Value, json};

use super::campaign::{End, Row, Spread};
use super::fusion;
use super::truth::Setting;
use crate::evaluate::aligned;
use crate::train::TrainName;

/// What is printed under the table of [`campaign`].
const LEGEND: &str = "\
RMSE, bound: of the damage, points: root mean square over elements (and seeds) / median element / worst element.
ratio: RMSE to bound over the elements whose bound is below 10 points / the worst of them.
95 %: intervals that hold the true damage, of all elements / of damaged ones.
ends: searches that ended wrongly (worse than the truth by 5 standard deviations): in another basin + short of the bottom; and
rivals, as far off but as good an explanation as the truth. false: identifications with a false alarm. missed: damaged elements
without an alarm. unexplained: identifications that say so. solves: median / worst. s: seconds an identification, median.
";

/// What is printed under the table of [`fused`].
const FUSED_LEGEND: &str = "\
RMSE, bound: of the damage from thirty passages, points: root mean square over elements (and seeds) / median / worst element; the
bound is that of all thirty together. ratio: RMSE to bound over all elements / of the worst. 95 %: intervals that hold the true damage.
wrong: passages whose answer explains them worse than the truth by 5 standard deviations. left out: passages that the evidence
has refused because they contradict the others.
";

fn points(spread: Spread) -> String {
    let [rms, median, worst] = [spread.rms, spread.median, spread.worst].map(|part| format!("{:.2}", 100.0 * part));
    format!("{rms} / {median} / {worst}")
}

fn per_cent(part: f64) -> String {
    if part.is_nan() {
        "none".to_owned()
    } else {
        format!("{:.1}", 100.0 * part)
    }
}

/// `3, 6, 9`
fn nodes(setting: &Setting) -> String {
    let nodes: Vec<String> = setting.nodes.iter().map(u16::to_string).collect();
    nodes.join(", ")
}

fn train(setting: &Setting) -> &'static str {
    match setting.case.train {
        spanwatch::wire::message::TrainKind::Inspection2Dof => "2dof",
        spanwatch::wire::message::TrainKind::Shinkansen3d => "3d",
    }
}

/// The rows of a campaign as a table in Markdown; what the model does not know is named if anything is unknown in any.
pub fn campaign(rows: &[Row]) -> String {
    let heads = [
        "case",
        "train",
        "noise",
        "nodes",
        "run",
        "error",
        "RMSE",
        "bound",
        "ratio",
        "95 %",
        "ends",
        "rivals",
        "false",
        "missed",
        "unexplained",
        "solves",
        "s",
    ];
    let mut lines = vec![heads.map(String::from)];
    for row in rows {
        let setting = &row.setting;
        let (all, damaged) = row.coverage();
        let (missed, present) = row.missed();
        let (median, worst) = row.solves();
        lines.push([
            setting.case.number.to_string(),
            train(setting).to_owned(),
            format!("{:.0} %", 100.0 * setting.noise),
            nodes(setting),
            setting.nuisance.name().to_owned(),
            setting.field.name().to_owned(),
            points(row.error()),
            points(row.limit()),
            row.ratio()
                .map_or_else(|| "none".to_owned(), |(all, worst)| format!("{all:.2} / {worst:.2}")),
            format!("{} / {}", per_cent(all), per_cent(damaged)),
            format!("{} + {}", row.ended(End::WrongBasin), row.ended(End::Short)),
            row.ended(End::Rival).to_string(),
            format!("{} of {}", row.false_alarms(), row.outcomes.len()),
            format!("{missed} of {present}"),
            row.unexplained().to_string(),
            format!("{median} / {worst}"),
            format!("{:.2}", row.seconds().0),
        ]);
    }
    format!("{}\n{LEGEND}", aligned(lines))
}

/// The rows of thirty passages put together, as a table in Markdown.
pub fn fused(rows: &[fusion::Row]) -> String {
    let heads = [
        "case", "trains", "noise", "nodes", "run", "bridges", "RMSE", "bound", "ratio", "95 %", "wrong", "left out",
    ];
    let mut lines = vec![heads.map(String::from)];
    for row in rows {
        let (all, worst) = row.ratio();
        lines.push([
            row.setting.case.number.to_string(),
            match row.traffic {
                fusion::Traffic::Same => train(&row.setting).to_owned(),
                fusion::Traffic::Mixed => row.traffic.name().to_owned(),
            },
            format!("{:.0} %", 100.0 * row.setting.noise),
            nodes(&row.setting),
            row.setting.nuisance.name().to_owned(),
            row.fused.len().to_string(),
            points(Spread::of(&row.rmse())),
            points(Spread::of(&row.bound)),
            format!("{all:.2} / {worst:.2}"),
            per_cent(row.coverage()),
            row.wrong.to_string(),
            row.left_out().to_string(),
        ]);
    }
    format!("{}\n{FUSED_LEGEND}", aligned(lines))
}

fn setting_json(setting: &Setting) -> Value {
    json!({
        "case": setting.case.number,
        "train": TrainName::Known(setting.case.train).name(),
        "cars": setting.case.cars,
        "speed_kmh": setting.case.speed_kmh,
        "wear": setting.wear,
        "noise": setting.noise,
        "nodes": setting.nodes,
        "nuisance": setting.nuisance.name(),
        "error": setting.field.name(),
        "damage": setting.draw(0).truth.damage,
    })
}

/// The rows of a campaign as JSON, one object a row; each identification's damage and interval are in it.
pub fn campaign_json(rows: &[Row]) -> Value {
    let row = |row: &Row| {
        let ratio = row.ratio();
        let (coverage, coverage_damaged) = row.coverage();
        let (missed, present) = row.missed();
        let (solves, solves_worst) = row.solves();
        let (seconds, seconds_worst) = row.seconds();
        let found = row.outcomes.iter().map(|outcome| {
            json!({
                "damage": outcome.answer.found.damage,
                "low": outcome.answer.low,
                "high": outcome.answer.high,
                "excess": outcome.excess,
                "speed_mps": outcome.answer.found.run.speed_mps,
                "true_speed_mps": outcome.truth.run.speed_mps,
                "entry_time_s": outcome.answer.found.run.entry_time_s,
                "true_entry_time_s": outcome.truth.run.entry_time_s,
                "load_factor": outcome.answer.found.run.load_factor,
                "true_load_factor": outcome.truth.run.load_factor,
                "stiffness": outcome.answer.found.stiffness,
                "true_stiffness": outcome.truth.stiffness,
                "forward_solves": outcome.answer.forward_solves,
                "seconds": outcome.seconds,
            })
        });
        let mut object = setting_json(&row.setting);
        let figures = json!({
            "seeds": row.outcomes.len(),
            "rmse": row.rmse(),
            "bias": row.bias(),
            "bound": row.bound,
            "ratio": ratio.map(|(all, _)| all),
            "ratio_worst": ratio.map(|(_, worst)| worst),
            "coverage": coverage,
            "coverage_damaged": (!coverage_damaged.is_nan()).then_some(coverage_damaged),
            "wrong_basin": row.ended(End::WrongBasin),
            "short": row.ended(End::Short),
            "rivals": row.ended(End::Rival),
            "false_alarms": row.false_alarms(),
            "missed": missed,
            "damaged": present,
            "unexplained": row.unexplained(),
            "forward_solves": [solves, solves_worst],
            "seconds": [seconds, seconds_worst],
            "found": found.collect::<Vec<_>>(),
        });
        merge(&mut object, figures);
        object
    };
    rows.iter().map(row).collect()
}

/// The rows of thirty passages put together as JSON, one object a row.
pub fn fused_json(rows: &[fusion::Row]) -> Value {
    let row = |row: &fusion::Row| {
        let (all, worst) = row.ratio();
        let mut object = setting_json(&row.setting);
        let figures = json!({
            "traffic": row.traffic.name(),
            "passages": fusion::PASSAGES,
            "seeds": row.fused.len(),
            "rmse": row.rmse(),
            "bound": row.bound,
            "ratio": all,
            "ratio_worst": worst,
            "coverage": row.coverage(),
            "wrong": row.wrong,
            "found": row.fused.iter().map(|fused| json!({
                "damage": fused.estimate.damage, "std": fused.estimate.std, "low": fused.estimate.low, "high": fused.estimate.high,
            })).collect::<Vec<_>>(),
        });
        merge(&mut object, figures);
        object
    };
    rows.iter().map(row).collect()
}

fn merge(object: &mut Value, more: Value) {
    if let (Value::Object(object), Value::Object(more)) = (object, more) {
        object.extend(more);
    }
}
