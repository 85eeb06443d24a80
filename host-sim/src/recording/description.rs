//! The TOML of a recording: what is known of the passage and of each channel.

use std::fmt::Write as _;

use anyhow::{Result, anyhow, bail};
use serde::Deserialize;
use spanwatch::capacity::{CARS, CHANNELS};
use spanwatch::interaction::Direction;
use spanwatch::wire::message::{Quantity, Ranges};
use toml::Spanned;

use super::{Channel, DEFAULT_FULL_SCALE_COUNTS, Margins, Recording, Unit};
use crate::toml_text;
use crate::train::TrainName;

/// Faster than any train; a speed beyond it is a slip of the unit.
pub const MAX_SPEED_KMH: f64 = 1000.0;
/// Brakes harder than any train's.
pub const MAX_ACCELERATION_MPS2: f64 = 5.0;

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    bridge: Option<String>,
    train: Option<Spanned<String>>,
    cars: Option<Spanned<i64>>,
    speed_kmh: Option<Spanned<f64>>,
    entry_time_s: Option<Spanned<f64>>,
    load_factor: Option<Spanned<f64>>,
    antialias_hz: Option<Spanned<f64>>,
    track: Option<String>,
    acceleration_mps2: Option<Spanned<f64>>,
    #[serde(default)]
    direction: Way,
    #[serde(default)]
    range: RangeTable,
    #[serde(default)]
    channel: Vec<Spanned<ChannelEntry>>,
}

#[derive(Debug, Clone, Copy, Default, Deserialize)]
#[serde(rename_all = "kebab-case")]
enum Way {
    #[default]
    Forward,
    Backward,
}

#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
struct RangeTable {
    speed: Option<Spanned<f64>>,
    entry_s: Option<Spanned<f64>>,
    load: Option<Spanned<f64>>,
    stiffness: Option<Spanned<f64>>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct ChannelEntry {
    column: Spanned<String>,
    node: Option<Spanned<i64>>,
    unit: Spanned<String>,
    lsb_mps2: Option<Spanned<f64>>,
    lsb_mm: Option<Spanned<f64>>,
    full_scale_counts: Option<Spanned<i64>>,
}

/// Reads and checks the text: a [`Recording`] without samples. An error says line and column, not the file.
pub fn parse(text: &str) -> Result<Recording> {
    let file: File = toml_text::parse(text)?;
    let at = |span: std::ops::Range<usize>| toml_text::place(text, &span);

    let train = match &file.train {
        Some(name) => Some(TrainName::parse(name.get_ref()).map_err(|error| anyhow!("{}: {error}", at(name.span())))?),
        None => None,
    };
    let cars = match &file.cars {
        Some(cars) => match usize::try_from(*cars.get_ref()) {
            Ok(number) if (1..=CARS).contains(&number) => Some(number),
            _ => bail!("{}: cars must be 1 to {CARS}, not {}", at(cars.span()), cars.get_ref()),
        },
        None => None,
    };
    if let (Some(name), Some(TrainName::Known(_)), None) = (&file.train, &train, cars) {
        bail!(
            "{}: a train needs its number of cars; add the line cars = 1, or however many",
            at(name.span())
        );
    }
    let number =
        |key: &str, value: &Option<Spanned<f64>>, range: std::ops::RangeInclusive<f64>, words: &str| match value {
            Some(value) if !range.contains(value.get_ref()) => Err(anyhow!(
                "{}: {key} must be {words}, not {}",
                at(value.span()),
                value.get_ref()
            )),
            value => Ok(value.as_ref().map(|value| *value.get_ref())),
        };
    let positive = f64::MIN_POSITIVE..=f64::MAX;
    let speed_words = format!("positive and at most {MAX_SPEED_KMH} km/h");
    let speed_kmh = number(
        "speed_kmh",
        &file.speed_kmh,
        f64::MIN_POSITIVE..=MAX_SPEED_KMH,
        &speed_words,
    )?;
    let entry_time_s = number("entry_time_s", &file.entry_time_s, f64::MIN..=f64::MAX, "a finite time")?;
    let load_factor = number("load_factor", &file.load_factor, positive.clone(), "a positive number")?;
    let acceleration_mps2 = number(
        "acceleration_mps2",
        &file.acceleration_mps2,
        -MAX_ACCELERATION_MPS2..=MAX_ACCELERATION_MPS2,
        "between -5 and 5 m/s2",
    )?;
    let antialias_hz = number(
        "antialias_hz",
        &file.antialias_hz,
        positive.clone(),
        "a positive frequency",
    )?;
    let margin = |key: &str, value: &Option<Spanned<f64>>, widest: f32| {
        // The widest is what the logger takes, an f32 that may lie just above the decimal fraction.
        let words = format!("0 (held) or positive, and at most {widest}");
        number(
            key,
            value,
            0.0..=f64::from(widest).max(widest.to_string().parse()?),
            &words,
        )
    };
    let range = &file.range;
    for (key, value, of, given) in [
        ("speed", &range.speed, "speed_kmh", speed_kmh.is_some()),
        ("entry_s", &range.entry_s, "entry_time_s", entry_time_s.is_some()),
    ] {
        if let (Some(value), false) = (value, given) {
            bail!(
                "{}: {key} in [range] says how far off {of} may be, but there is no {of}; give it, or leave {key} out and it is \
                 estimated",
                at(value.span())
            );
        }
    }
    let margins = Margins {
        speed: margin("speed in [range]", &range.speed, Ranges::WIDEST.speed)?,
        entry_s: margin("entry_s in [range]", &range.entry_s, Ranges::WIDEST.entry_s)?,
        load: margin("load in [range]", &range.load, Ranges::WIDEST.load)?,
        stiffness: margin("stiffness in [range]", &range.stiffness, Ranges::WIDEST.stiffness)?,
    };

    if file.channel.is_empty() {
        bail!("it names no channel; add a [[channel]] with column, node and unit for each column that holds one");
    }
    if let Some(extra) = file.channel.get(CHANNELS) {
        bail!(
            "{}: {} channels, but a logger has at most {CHANNELS}",
            at(extra.span()),
            file.channel.len()
        );
    }
    let mut channels: Vec<Channel> = Vec::new();
    for entry in &file.channel {
        let place = at(entry.span());
        let entry = entry.get_ref();
        let column = entry.column.get_ref();
        if column == super::table::TIME_COLUMN || channels.iter().any(|channel| channel.column == *column) {
            bail!(
                "{}: column \"{column}\" is taken already; each channel needs its own",
                at(entry.column.span())
            );
        }
        let node = match &entry.node {
            Some(node) => Some(u16::try_from(*node.get_ref()).ok().filter(|&n| n > 0).ok_or_else(|| {
                anyhow!(
                    "{}: node must be 1 or more (they count from the end the train enters by), not {}",
                    at(node.span()),
                    node.get_ref()
                )
            })?),
            None if file.bridge.is_some() => {
                bail!("{place}: channel \"{column}\" needs its node, since a bridge is named")
            }
            None => None,
        };
        let unit = match Unit::named(entry.unit.get_ref()) {
            Some(unit) => unit,
            None => bail!(
                "{}: unit of channel \"{column}\" must be \"m/s2\", \"g\" or \"gal\" of an acceleration, or \"mm\" of a displacement, not \"{}\"",
                at(entry.unit.span()),
                entry.unit.get_ref()
            ),
        };
        let (key, own, factor, (other_key, other)) = match unit.quantity() {
            Quantity::Acceleration => ("lsb_mps2", &entry.lsb_mps2, 1.0, ("lsb_mm", &entry.lsb_mm)),
            Quantity::Displacement => ("lsb_mm", &entry.lsb_mm, 1e-3, ("lsb_mps2", &entry.lsb_mps2)),
        };
        if let Some(value) = other {
            let (is, other_is) = match unit.quantity() {
                Quantity::Acceleration => ("an acceleration", "a displacement"),
                Quantity::Displacement => ("a displacement", "an acceleration"),
            };
            bail!(
                "{}: {other_key} is of {other_is}, but channel \"{column}\" is {is} (unit \"{}\"); give {key}, or leave it out",
                at(value.span()),
                unit.name()
            );
        }
        let lsb = number(key, own, f64::from(f32::MIN_POSITIVE)..=f64::from(f32::MAX), "positive")?;
        let full_scale_counts = match &entry.full_scale_counts {
            Some(counts) => i32::try_from(*counts.get_ref())
                .ok()
                .filter(|&counts| counts > 0)
                .ok_or_else(|| {
                    anyhow!(
                        "{}: full_scale_counts must be 1 to {}, not {}",
                        at(counts.span()),
                        i32::MAX,
                        counts.get_ref()
                    )
                })?,
            None => DEFAULT_FULL_SCALE_COUNTS,
        };
        channels.push(Channel {
            column: column.clone(),
            node,
            unit,
            lsb: lsb.map_or(unit.default_lsb(), |lsb| (lsb * factor) as f32),
            full_scale_counts,
            values: Vec::new(),
        });
    }
    Ok(Recording {
        start_s: 0.0,
        interval_s: 0.0,
        runs: Vec::new(),
        channels,
        bridge: file.bridge,
        train,
        cars,
        speed_kmh,
        entry_time_s,
        load_factor,
        margins,
        antialias_hz,
        track: file.track,
        acceleration_mps2: acceleration_mps2.unwrap_or(0.0),
        direction: match file.direction {
            Way::Forward => Direction::Forward,
            Way::Backward => Direction::Backward,
        },
    })
}

/// The text of a recording's TOML, with a comment line for each remark.
pub fn text(recording: &Recording, remarks: &[String]) -> String {
    let mut text = String::new();
    for line in remarks.iter().flat_map(|remark| remark.lines()) {
        let _ = writeln!(text, "# {line}");
    }
    let mut key = |name: &str, value: Option<toml::Value>| {
        if let Some(value) = value {
            let _ = writeln!(text, "{name} = {value}");
        }
    };
    let train = recording.train.as_ref().map(|train| train.name().into());
    key("bridge", recording.bridge.clone().map(Into::into));
    key("train", train);
    key("cars", recording.cars.map(|cars| (cars as i64).into()));
    key("speed_kmh", recording.speed_kmh.map(Into::into));
    key("entry_time_s", recording.entry_time_s.map(Into::into));
    key("load_factor", recording.load_factor.map(Into::into));
    key("antialias_hz", recording.antialias_hz.map(Into::into));
    key("track", recording.track.clone().map(Into::into));
    let changes = Some(recording.acceleration_mps2).filter(|&change| change != 0.0);
    key("acceleration_mps2", changes.map(Into::into));
    let backward = (recording.direction == Direction::Backward).then(|| "backward".into());
    key("direction", backward);
    let margins = &recording.margins;
    if *margins != Margins::default() {
        text.push_str("\n[range]\n");
        for (name, value) in [
            ("speed", margins.speed),
            ("entry_s", margins.entry_s),
            ("load", margins.load),
            ("stiffness", margins.stiffness),
        ] {
            if let Some(value) = value {
                let _ = writeln!(text, "{name} = {}", toml::Value::from(value));
            }
        }
    }
    for channel in &recording.channels {
        let _ = writeln!(text, "\n[[channel]]");
        let _ = writeln!(text, "column = {}", toml::Value::from(channel.column.as_str()));
        if let Some(node) = channel.node {
            let _ = writeln!(text, "node = {node}");
        }
        let _ = writeln!(text, "unit = \"{}\"", channel.unit.name());
        if channel.lsb != channel.unit.default_lsb() {
            let _ = match channel.unit.quantity() {
                Quantity::Acceleration => writeln!(text, "lsb_mps2 = {:?}", channel.lsb),
                // In f64, so that it is the same f32 again when it has been read.
                Quantity::Displacement => writeln!(text, "lsb_mm = {:?}", f64::from(channel.lsb) * 1e3),
            };
        }
        if channel.full_scale_counts != DEFAULT_FULL_SCALE_COUNTS {
            let _ = writeln!(text, "full_scale_counts = {}", channel.full_scale_counts);
        }
    }
    text
}
