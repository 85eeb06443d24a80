//! Estimates of many identifications beside the truth: a panel a case, a strip an element, a whisker an identification.

use anyhow::Result;
use plotters::style::text_anchor::HPos;
use plotters::style::{Color, RGBColor};
use spanwatch::capacity::ELEMENTS;

use super::canvas::{
    BLUE, BODY, Canvas, GREEN, GRID, INK, LEFT, Panel, SMALL, SOFT, Svg, TITLE, Ticks, VERMILION, ticks,
};
use crate::study::noise::campaign::Row;
use crate::study::noise::truth::Setting;
use crate::train::TrainName;

/// Identifications of a row that are drawn; more would be a blur.
const DRAWN: usize = 10;
/// Sizes, px.
const HEAD: f64 = 104.0;
const CAPTION: f64 = 34.0;
const PANEL: f64 = 150.0;
const GAP: f64 = 10.0;
const AXIS: f64 = 58.0;
/// The part of an element's strip that estimates fill.
const FILLED: f64 = 0.86;
/// Standard deviations of the bound's band.
const BAND: f64 = 1.96;
/// Ticks of a panel, and what each stands for, %.
const TICK: f64 = 10.0;
/// Colours of the sets of sensors, in their order.
const COLOURS: [RGBColor; 3] = [VERMILION, BLUE, GREEN];

/// The picture of a campaign's rows: rows of the same case, noise and knowledge share a panel, their sensors side by side.
///
/// # Errors
/// If it cannot be drawn.
pub fn svg(rows: &[Row]) -> Result<String> {
    let mut panels: Vec<Vec<&Row>> = vec![];
    for row in rows {
        match panels.iter_mut().find(|panel| alike(&panel[0].setting, &row.setting)) {
            Some(panel) => panel.push(row),
            None => panels.push(vec![row]),
        }
    }
    let mut sets: Vec<&[u16]> = vec![];
    for row in rows {
        if !sets.contains(&row.setting.nodes.as_slice()) {
            sets.push(&row.setting.nodes);
        }
    }
    // One scale for all, a whole number of ticks, that holds all that is drawn.
    let ends = rows.iter().flat_map(|row| {
        let drawn = row.outcomes.iter().take(DRAWN);
        drawn.flat_map(|outcome| outcome.answer.high.into_iter().chain(outcome.truth.damage))
    });
    let scale = (100.0 * ends.fold(0.0, f64::max) / TICK).ceil().max(1.0) * TICK;
    let height = HEAD + panels.len() as f64 * (CAPTION + PANEL + GAP) + AXIS;
    Svg::draw(height, |canvas| {
        head(canvas, rows, &sets)?;
        for (k, panel) in panels.iter().enumerate() {
            let top = HEAD + k as f64 * (CAPTION + PANEL + GAP) + CAPTION;
            draw(canvas, panel, &sets, scale, top, k + 1 == panels.len())?;
        }
        Ok(())
    })
}

/// Whether two settings differ in their sensors at most.
fn alike(a: &Setting, b: &Setting) -> bool {
    Setting {
        nodes: b.nodes.clone(),
        ..a.clone()
    } == *b
}

fn head(canvas: &Canvas<'_>, rows: &[Row], sets: &[&[u16]]) -> Result<()> {
    canvas.text(
        "Estimated damage beside the true one",
        LEFT,
        30.0,
        TITLE,
        INK,
        HPos::Left,
    )?;
    let seeds = rows.first().map_or(0, |row| row.outcomes.len());
    let shown = seeds.min(DRAWN);
    let which = match shown {
        _ if shown < seeds => format!("the first {shown} of {seeds} identifications"),
        1 => "one identification".to_owned(),
        _ => format!("{shown} identifications"),
    };
    let words = format!("In each element, side by side: {which}, each a dot with its 95 % interval.");
    canvas.text(&words, LEFT, 56.0, BODY, SOFT, HPos::Left)?;
    let mut x = LEFT;
    for (colour, nodes) in COLOURS.iter().zip(sets) {
        let numbers: Vec<String> = nodes.iter().map(u16::to_string).collect();
        let label = format!(
            "sensor at node{} {}",
            if nodes.len() > 1 { "s" } else { "" },
            numbers.join(", ")
        );
        canvas.stroke(&[(x + 8.0, 74.0), (x + 8.0, 92.0)], *colour, 1.4)?;
        canvas.spot(x + 8.0, 83.0, 2.6, *colour)?;
        canvas.text(&label, x + 20.0, 83.0, SMALL, INK, HPos::Left)?;
        x += 34.0 + 7.2 * label.chars().count() as f64;
    }
    canvas.stroke(&[(x, 83.0), (x + 26.0, 83.0)], INK, 2.4)?;
    canvas.text("true", x + 34.0, 83.0, SMALL, INK, HPos::Left)?;
    x += 84.0;
    canvas.fill(x, 75.0, x + 26.0, 91.0, BOUND)?;
    let label = "where 95 % of the best unbiased estimates would lie (± 1.96 Cramer-Rao bounds)";
    canvas.text(label, x + 34.0, 83.0, SMALL, INK, HPos::Left)
}

/// Colour of the bound's band.
const BOUND: RGBColor = RGBColor(0xD8, 0xD8, 0xD8);

fn draw(canvas: &Canvas<'_>, rows: &[&Row], sets: &[&[u16]], scale: f64, top: f64, last: bool) -> Result<()> {
    let Some(first) = rows.first() else { return Ok(()) };
    let setting = &first.setting;
    let case = &setting.case;
    let field = match setting.field.name() {
        "none" => String::new(),
        name => format!("; unknown to the model: {name}"),
    };
    let cars = if case.cars == 1 {
        "1 car".to_owned()
    } else {
        format!("{} cars", case.cars)
    };
    let lost: Vec<String> = (case.damage.iter())
        .map(|(element, loss)| format!("element {element}: {:.0} %", 100.0 * loss))
        .collect();
    let wear = match setting.wear {
        0.0 => String::new(),
        wear => format!("; all worn by {:.0} %", 100.0 * wear),
    };
    let words = format!(
        "Case {} ({}{wear}): {}, {cars}, {:.0} km/h; {:.0} % noise; run and stiffness {}{field}",
        case.number,
        lost.join(", "),
        TrainName::Known(case.train).name(),
        case.speed_kmh,
        100.0 * setting.noise,
        setting.nuisance.name()
    );
    canvas.text(&words, LEFT, top - 13.0, BODY, INK, HPos::Left)?;
    let panel = canvas.panel(top, PANEL, (0.5, ELEMENTS as f64 + 0.5), (0.0, scale));
    panel.grid(&Ticks::none(), &ticks(0.0, scale, (scale / TICK) as usize))?;
    panel.y_label("loss, %")?;
    let width = FILLED / sets.len() as f64;
    for row in rows {
        let Some(set) = sets.iter().position(|nodes| *nodes == row.setting.nodes) else {
            continue;
        };
        for e in 0..ELEMENTS {
            let left = (e + 1) as f64 - FILLED / 2.0 + width * set as f64;
            strip(canvas, &panel, row, e, (left, width), COLOURS[set % COLOURS.len()])?;
        }
    }
    for e in 1..ELEMENTS {
        let x = panel.px(e as f64 + 0.5);
        canvas.stroke(&[(x, top), (x, top + PANEL)], GRID, 1.0)?;
    }
    if last {
        let labels = Ticks {
            values: (1..=ELEMENTS).map(|e| e as f64).collect(),
            decimals: 0,
            logarithmic: false,
        };
        panel.x_axis(&labels, "element, from the end by which the train enters")?;
    }
    Ok(())
}

/// The estimates of one element by one set of sensors, from `left`, `width` wide.
fn strip(
    canvas: &Canvas<'_>,
    panel: &Panel<'_, '_>,
    row: &Row,
    e: usize,
    (left, width): (f64, f64),
    colour: RGBColor,
) -> Result<()> {
    let truth = row.setting.draw(0).truth.damage[e];
    let y = |part: f64| panel.py(100.0 * part);
    let (from, to) = (panel.px(left), panel.px(left + width) - 2.0);
    canvas.fill(
        from,
        y(truth + BAND * row.bound[e]),
        to,
        y(truth - BAND * row.bound[e]),
        BOUND,
    )?;
    canvas.stroke(&[(from, y(truth)), (to, y(truth))], INK, 2.4)?;
    let outcomes = &row.outcomes[..row.outcomes.len().min(DRAWN)];
    for (k, outcome) in outcomes.iter().enumerate() {
        let x = from + (to - from) * (k as f64 + 0.5) / outcomes.len() as f64;
        let answer = &outcome.answer;
        canvas.stroke(&[(x, y(answer.low[e])), (x, y(answer.high[e]))], colour.mix(0.75), 1.0)?;
        canvas.spot(x, y(answer.found.damage[e]), 1.9, colour)?;
    }
    Ok(())
}
