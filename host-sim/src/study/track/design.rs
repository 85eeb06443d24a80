//! The bounds of the design's second table (its section 6): six 16-car trains, four inspection cars, all ten.

use anyhow::Result;
use nalgebra::DMatrix;
use serde_json::{Value, json};
use spanwatch::bridge::Damage;
use spanwatch::capacity::ELEMENTS;
use spanwatch::track::profile::{Knots, Profile};

use super::bound::{Known, Problem, bound, information};
use super::truth::{Change, SENSORS, Setting, Speeds, Stock, Traffic, Viaduct};
use crate::batch;
use crate::evaluate::aligned;
use crate::model::BridgeFrame;
use crate::simulate::Scenario;
use crate::study::noise::campaign::Spread;
use crate::track::Spectrum;
use crate::track::prior::{fit, precision};
use crate::train::TrainName;

/// The design's table: by trains (six, four, all ten) and what is known of the profile, median and worst element, points.
#[rustfmt::skip]
pub const TABLE: [[[f64; 2]; 4]; 3] = [
    [[0.47, 1.14], [1.6, 3.7], [0.62, 1.52], [0.49, 1.19]],
    [[0.45, 1.48], [1.2, 3.2], [0.56, 1.80], [0.46, 1.52]],
    [[0.28, 0.80], [0.7, 2.0], [0.36, 1.01], [0.29, 0.83]],
];
/// Passages of the table: six, then four.
const PASSAGES: [(Stock, usize); 2] = [(Stock::Sixteen, 6), (Stock::Inspection, 4)];
/// Time before the first axle and after the last, s.
const LEAD_TAIL_S: [f64; 2] = [1.0, 2.0];

/// Which passages count, as tables call them, and which of the ten they are.
const GROUPS: [(&str, std::ops::Range<usize>); 3] =
    [("six of 16 cars", 0..6), ("four inspection", 6..10), ("all ten", 0..10)];

/// One row of bounds.
#[derive(Debug, Clone, PartialEq)]
pub struct Row {
    /// The track's class.
    pub class: Spectrum,
    /// Which passages.
    pub passages: &'static str,
    /// Nodes with a sensor.
    pub nodes: Vec<u16>,
    /// How fast the trains are.
    pub speeds: Speeds,
    /// The bound of each element for each of [`Known::ALL`]: root mean square over tracks.
    pub bounds: [Damage<f64>; 4],
    /// Median and worst element of the design's table, points, where it has them.
    pub design: Option<[[f64; 2]; 4]>,
}

/// What is to be bounded.
#[derive(Debug, Clone)]
pub struct Plan {
    /// Classes of track.
    pub classes: Vec<Spectrum>,
    /// Sets of sensors.
    pub sensors: Vec<Vec<u16>>,
    /// How fast the trains are.
    pub speeds: Vec<Speeds>,
    /// Whether each car's load is unknown by itself.
    pub uneven: bool,
    /// Standard deviation of the stiffness of the whole bridge from passage to passage.
    pub temperature: f32,
    /// Tracks of each class.
    pub tracks: u32,
    /// Knots of the profile.
    pub knots: Knots<f64>,
}

impl Plan {
    /// Passages that are linearised.
    pub fn passages(&self) -> u64 {
        (self.classes.len() * self.sensors.len() * self.speeds.len()) as u64 * u64::from(self.tracks) * 10
    }
}

/// The ten passages.
pub fn passages(speeds: Speeds, nodes: &[u16]) -> Vec<Scenario> {
    let passage = |(stock, count): (Stock, usize)| {
        let (kind, cars) = stock.cars();
        let [slow, fast] = stock.speeds_kmh();
        (0..count).map(move |i| {
            let [lead_s, tail_s] = LEAD_TAIL_S;
            Scenario {
                train: TrainName::Known(kind),
                cars: Some(cars),
                speed_kmh: match speeds {
                    Speeds::Spread => slow + (fast - slow) * i as f64 / (count - 1) as f64,
                    Speeds::Equal => stock.equal_kmh(),
                },
                nodes: nodes.to_vec(),
                lead_s,
                tail_s,
                ..Scenario::inspection_car()
            }
            .recorded()
        })
    };
    PASSAGES.into_iter().flat_map(passage).collect()
}

/// Bounds of a plan; `done` is called after every passage.
///
/// # Errors
/// If a passage cannot be simulated.
pub fn run(bridge: &BridgeFrame, plan: &Plan, done: &(dyn Fn() + Sync)) -> Result<Vec<Row>> {
    let mut rows = vec![];
    for &class in &plan.classes {
        let precision = precision(class, &plan.knots)?;
        let setting = Setting {
            class,
            traffic: Traffic::Both,
            speeds: Speeds::Spread,
            uneven: plan.uneven,
            temperature: plan.temperature,
            change: Change::HALF_A_MILLIMETRE,
        };
        let viaducts = (1..=u64::from(plan.tracks))
            .map(|seed| {
                let viaduct = Viaduct::new(bridge, &setting, seed)?;
                let track = Profile::new(plan.knots.clone(), &fit(viaduct.track(false), &plan.knots));
                Ok((viaduct.model, track))
            })
            .collect::<Result<Vec<_>>>()?;
        for nodes in &plan.sensors {
            for &speeds in &plan.speeds {
                let scenarios = passages(speeds, nodes);
                let jobs: Vec<(usize, usize)> = (0..viaducts.len())
                    .flat_map(|v| (0..scenarios.len()).map(move |p| (v, p)))
                    .collect();
                let found = batch::each(&jobs, |&(v, p)| {
                    let (model, track) = &viaducts[v];
                    let problem = Problem {
                        bridge: model,
                        track,
                        damage: [0.0; ELEMENTS],
                        ranges: setting.ranges(),
                        uneven: plan.uneven,
                    };
                    let found = information(&problem, &scenarios[p]);
                    done();
                    found
                })
                .into_iter()
                .collect::<Result<Vec<_>>>()?;
                for (group, (name, which)) in GROUPS.into_iter().enumerate() {
                    let mut squares = [[0.0; ELEMENTS]; 4];
                    for of_track in found.chunks(scenarios.len()) {
                        let sum: DMatrix<f64> = of_track[which.clone()].iter().sum();
                        for (squares, known) in squares.iter_mut().zip(Known::ALL) {
                            for (square, bound) in squares.iter_mut().zip(bound(&sum, &precision, known)?) {
                                *square += bound * bound / f64::from(plan.tracks);
                            }
                        }
                    }
                    let as_designed = class == Spectrum::Fra6 && *nodes == SENSORS && speeds == Speeds::Spread;
                    rows.push(Row {
                        class,
                        passages: name,
                        nodes: nodes.clone(),
                        speeds,
                        bounds: squares.map(|squares| squares.map(f64::sqrt)),
                        design: as_designed.then_some(TABLE[group]),
                    });
                }
            }
        }
    }
    Ok(rows)
}

/// What is printed under the table.
const LEGEND: &str = "\
Standard deviation of the losses, points, median / worst element, that no unbiased estimate from these passages can be below; in brackets the
design's. 5 % noise; speed, entry and load of each passage unknown. Healthy passages are as many as those monitored (or ten times), at their speeds.
";

/// As tables call a class.
pub fn class_name(class: Spectrum) -> &'static str {
    match class {
        Spectrum::Fra1 => "1",
        Spectrum::Fra2 => "2",
        Spectrum::Fra3 => "3",
        Spectrum::Fra4 => "4",
        Spectrum::Fra5 => "5",
        Spectrum::Fra6 => "6",
        Spectrum::ErriLow => "ERRI",
    }
}

/// `3, 6, 9`
pub fn nodes_name(nodes: &[u16]) -> String {
    nodes.iter().map(u16::to_string).collect::<Vec<_>>().join(", ")
}

/// The rows as a table in Markdown.
pub fn table(rows: &[Row]) -> String {
    let heads = ["class", "nodes", "speeds", "passages"].map(str::to_owned);
    let names = Known::ALL.map(Known::name);
    let head = |i: usize| heads.get(i).or(names.get(i.wrapping_sub(heads.len()))).cloned();
    let mut lines: Vec<[String; 8]> = vec![std::array::from_fn(|i| head(i).unwrap_or_default())];
    for row in rows {
        let cells: [String; 4] = std::array::from_fn(|k| {
            let Spread { median, worst, .. } = Spread::of(&row.bounds[k]);
            let design = row.design.map(|design| design[k]);
            let design = design.map_or_else(String::new, |[median, worst]| format!(" ({median} / {worst})"));
            format!("{:.2} / {:.2}{design}", 100.0 * median, 100.0 * worst)
        });
        let [known, only, as_many, ten] = cells;
        lines.push([
            class_name(row.class).to_owned(),
            nodes_name(&row.nodes),
            row.speeds.name().to_owned(),
            row.passages.to_owned(),
            known,
            only,
            as_many,
            ten,
        ]);
    }
    format!("{}\n{LEGEND}", aligned(lines))
}

/// The rows as JSON, one object a row.
pub fn json(rows: &[Row]) -> Value {
    let row = |row: &Row| {
        json!({
            "class": class_name(row.class),
            "nodes": row.nodes,
            "speeds": row.speeds.name(),
            "passages": row.passages,
            "known": Known::ALL.map(Known::name),
            "bounds": row.bounds,
            "design_points": row.design,
        })
    };
    rows.iter().map(row).collect()
}

#[cfg(test)]
mod tests {
    use super::super::bound::design_knots;
    use super::*;
    use crate::calibrate;
    use crate::model;

    fn rows(knots: Option<Knots<f64>>) -> Vec<Row> {
        let plan = Plan {
            classes: vec![Spectrum::Fra6],
            sensors: vec![SENSORS.to_vec()],
            speeds: vec![Speeds::Spread],
            uneven: false,
            temperature: 0.0,
            tracks: 3,
            knots: knots.expect("knots"),
        };
        run(&model::shipped("girder50").expect("ships"), &plan, &|| ()).expect("solves")
    }

    /// Part by which the largest of a row's differences from the design's table exceeds what its digits leave open.
    fn farthest(row: &Row, columns: [usize; 3]) -> f64 {
        let design = row.design.expect("a row of the design");
        let differs = |k: usize| {
            let Spread { median, worst, .. } = Spread::of(&row.bounds[k]);
            [[100.0 * median, design[k][0]], [100.0 * worst, design[k][1]]]
                .map(|[is, should]| (is / should - 1.0).abs())
        };
        columns.into_iter().flat_map(differs).fold(0.0, f64::max)
    }

    #[test]
    fn the_bounds_are_those_of_the_design() {
        /// The design's are of one track by chance, these of three others; bounds of single tracks of one class differ by a tenth to a
        /// fifth. Of ten passages the differences are averaged out.
        const OF_ALL_TEN: f64 = 0.15;
        const OF_FEWER: f64 = 0.3;
        let rows = rows(calibrate::knots(50.0));
        println!("{}", table(&rows));
        for (row, tolerance) in rows.iter().zip([OF_FEWER, OF_FEWER, OF_ALL_TEN]) {
            for columns in [[0, 2, 3], [1, 1, 1]] {
                let farthest = farthest(row, columns);
                assert!(
                    farthest < tolerance,
                    "{}, columns {columns:?}: {farthest:.2}",
                    row.passages
                );
            }
        }
    }

    #[test]
    fn knots_that_miss_the_shortest_waves_promise_too_much() {
        // The design's knots are half of the shortest wave apart: what B-splines cannot be is taken for known, which matters where nothing
        // but the passages themselves tells of the profile.
        let all = rows(design_knots().ok());
        for row in &all {
            assert!(farthest(row, [0, 2, 3]) < 0.3, "{}", row.passages);
        }
        let without_others = |row: &Row| Spread::of(&row.bounds[1]).median;
        for (coarse, fine) in all.iter().zip(rows(calibrate::knots(50.0))) {
            let (coarse, fine) = (without_others(coarse), without_others(&fine));
            assert!(coarse < fine, "{coarse} {fine}");
        }
    }
}
