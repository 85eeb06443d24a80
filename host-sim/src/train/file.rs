//! The train file, as an engineer writes it (TOML): kinds of car, and the cars from front to end.
//!
//! ```toml
//! name = "a coach behind a locomotive"
//!
//! [kinds.locomotive]                 # axles without suspension: constant forces
//! axles_m = [0.0, 2.0, 9.0, 11.0]    # behind its first
//! axle_load_kn = 200.0               # each, or a list of as many
//!
//! [kinds.coach]                      # a body on two bogies; what is left out is the paper's car (its Tables 2 and 3)
//! body_weight_kn = 350.0
//! upper_spring_kn_per_m = [5000.0, 176.4, 500.0]       # x, y, z
//!
//! [[cars]]
//! kind = "locomotive"
//! [[cars]]
//! kind = "coach"
//! behind_m = 17.0                    # its first axle behind the train's first
//! ```

use std::collections::BTreeMap;
use std::path::Path;

use anyhow::{Context, Result, bail};
use serde::Deserialize;
use spanwatch::capacity::CARS;
use spanwatch::train::stock::{BogieCar, SHINKANSEN, SPATIAL_CONTACTS, SPATIAL_DOFS};
use spanwatch::train::{Car, Contact, Motion, Place, Spring};

use super::SpatialTrain;
use crate::toml_text;

/// The trains that come with the program as files, by name.
pub const SHIPPED: [(&str, &str); 1] = [("rdso-test", include_str!("../../trains/rdso-test.toml"))];

/// The text of a train that comes with the program as a file.
pub fn shipped(name: &str) -> Option<&'static str> {
    SHIPPED.iter().find(|(known, _)| *known == name).map(|(_, text)| *text)
}

/// Heaviest axle and car that make sense, kN: a slip of the unit shows.
const MAX_WEIGHT_KN: f64 = 3000.0;
/// Longest train that makes sense, m.
const MAX_LENGTH_M: f64 = 2000.0;

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    #[allow(dead_code, reason = "for whoever reads the file")]
    name: String,
    kinds: BTreeMap<String, Kind>,
    cars: Vec<Coupled>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Coupled {
    kind: String,
    #[serde(default)]
    behind_m: f64,
}

#[derive(Debug, Deserialize)]
#[serde(untagged)]
enum Loads {
    Each(f64),
    List(Vec<f64>),
}

/// A kind of car: with axles it is a row of forces, otherwise a body on two bogies.
#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
struct Kind {
    axles_m: Option<Vec<f64>>,
    axle_load_kn: Option<Loads>,
    body_weight_kn: Option<f64>,
    bogie_weight_kn: Option<f64>,
    wheelset_weight_kn: Option<f64>,
    body_inertia_t_m2: Option<[f64; 3]>,
    bogie_inertia_t_m2: Option<[f64; 3]>,
    upper_spring_kn_per_m: Option<[f64; 3]>,
    upper_damper_kns_per_m: Option<[f64; 3]>,
    lower_spring_kn_per_m: Option<[f64; 3]>,
    lower_damper_kns_per_m: Option<[f64; 3]>,
    bogie_distance_m: Option<f64>,
    axle_distance_m: Option<f64>,
}

/// The train in a file.
///
/// # Errors
/// One sentence that names the file and what is wrong in it.
pub fn read(path: &Path) -> Result<SpatialTrain> {
    let text = std::fs::read_to_string(path).with_context(|| format!("cannot read {}", path.display()))?;
    parse(&text).with_context(|| path.display().to_string())
}

/// The train in the text of a train file.
///
/// # Errors
/// As [`read`], without the file's name.
pub fn parse(text: &str) -> Result<SpatialTrain> {
    let file: File = toml_text::parse(text)?;
    if file.cars.is_empty() || file.cars.len() > CARS {
        bail!(
            "a train has 1 to {CARS} [[cars]], not {}: that is what a logger has memory for",
            file.cars.len()
        );
    }
    let mut train = SpatialTrain {
        kinds: Default::default(),
        cars: Default::default(),
    };
    let mut names = Vec::new();
    for (name, kind) in &file.kinds {
        let car = car(kind).with_context(|| format!("kind \"{name}\""))?;
        if train.kinds.push(car).is_err() {
            bail!("more than {CARS} kinds of car");
        }
        names.push(name.as_str());
    }
    let mut end_m = f64::NEG_INFINITY;
    for (i, coupled) in file.cars.iter().enumerate() {
        let number = i + 1;
        let Some(kind) = names.iter().position(|name| *name == coupled.kind) else {
            bail!(
                "car {number} is of kind \"{}\"; the kinds are: {}",
                coupled.kind,
                names.join(", ")
            );
        };
        let behind_m = coupled.behind_m;
        if i == 0 && behind_m != 0.0 {
            bail!("car 1 is the first: its behind_m must be 0, not {behind_m}");
        }
        if !behind_m.is_finite() || behind_m > MAX_LENGTH_M {
            bail!("behind_m of car {number} must be at most {MAX_LENGTH_M} m, not {behind_m}");
        }
        if behind_m <= end_m {
            bail!(
                "car {number} begins {behind_m} m behind the train's first axle, but the car before it ends at {end_m} m"
            );
        }
        end_m = behind_m + train.kinds[kind].length_m();
        // There is room: CARS were counted.
        let _ = train.cars.push(Place { kind, behind_m });
    }
    Ok(train)
}

fn car(kind: &Kind) -> Result<Car<f64, SPATIAL_DOFS, SPATIAL_CONTACTS>> {
    let has_suspension = kind.body_weight_kn.is_some()
        || kind.bogie_weight_kn.is_some()
        || kind.wheelset_weight_kn.is_some()
        || kind.body_inertia_t_m2.is_some()
        || kind.bogie_inertia_t_m2.is_some()
        || kind.upper_spring_kn_per_m.is_some()
        || kind.upper_damper_kns_per_m.is_some()
        || kind.lower_spring_kn_per_m.is_some()
        || kind.lower_damper_kns_per_m.is_some()
        || kind.bogie_distance_m.is_some()
        || kind.axle_distance_m.is_some();
    match (&kind.axles_m, &kind.axle_load_kn) {
        (Some(axles_m), Some(loads)) if !has_suspension => forces(axles_m, loads),
        (None, None) => bogie_car(kind),
        (Some(_), Some(_)) => {
            bail!("it has axles_m, so it is a row of forces: leave weights, springs and distances out")
        }
        _ => bail!("axles_m and axle_load_kn go together"),
    }
}

/// Axles without suspension.
fn forces(axles_m: &[f64], loads: &Loads) -> Result<Car<f64, SPATIAL_DOFS, SPATIAL_CONTACTS>> {
    let loads_kn = match loads {
        Loads::Each(load) => vec![*load; axles_m.len()],
        Loads::List(loads) => loads.clone(),
    };
    if axles_m.is_empty() || axles_m.len() > SPATIAL_CONTACTS || loads_kn.len() != axles_m.len() {
        bail!(
            "it needs 1 to {SPATIAL_CONTACTS} axles_m and a load for each, not {} and {}",
            axles_m.len(),
            loads_kn.len()
        );
    }
    if axles_m[0] != 0.0 || !axles_m.is_sorted_by(|a, b| a < b) || axles_m.iter().any(|x| !x.is_finite()) {
        bail!("axles_m must begin with 0 and ascend");
    }
    let mut contacts = heapless::Vec::new();
    for (&behind_m, &load_kn) in axles_m.iter().zip(&loads_kn) {
        within("axle_load_kn", load_kn, MAX_WEIGHT_KN)?;
        // There is room: the axles were counted.
        let _ = contacts.push(Contact {
            behind_m,
            motion: Motion::Vertical,
            load_n: 1e3 * load_kn,
            unsprung: 0.0,
            spring: Spring {
                stiffness: 0.0,
                damping: 0.0,
                lever: [0.0; SPATIAL_DOFS],
            },
        });
    }
    Ok(Car {
        inertia: [1.0; SPATIAL_DOFS],
        springs: heapless::Vec::new(),
        contacts,
    })
}

fn bogie_car(kind: &Kind) -> Result<Car<f64, SPATIAL_DOFS, SPATIAL_CONTACTS>> {
    let mut car: BogieCar = SHINKANSEN;
    for (slot, key, value) in [
        (0, "body_weight_kn", kind.body_weight_kn),
        (1, "bogie_weight_kn", kind.bogie_weight_kn),
        (2, "wheelset_weight_kn", kind.wheelset_weight_kn),
    ] {
        if let Some(value) = value {
            within(key, value, MAX_WEIGHT_KN)?;
            car.weight_n[slot] = 1e3 * value;
        }
    }
    for (slot, key, value) in [
        (0, "bogie_distance_m", kind.bogie_distance_m),
        (1, "axle_distance_m", kind.axle_distance_m),
    ] {
        if let Some(value) = value {
            within(key, value, 100.0)?;
            car.half_base_m[slot] = 0.5 * value;
        }
    }
    if car.half_base_m[1] >= car.half_base_m[0] {
        bail!("axle_distance_m must be less than bogie_distance_m");
    }
    for (slot, key, values, may_be_zero) in [
        (
            &mut car.body_inertia_kgm2,
            "body_inertia_t_m2",
            kind.body_inertia_t_m2,
            false,
        ),
        (
            &mut car.bogie_inertia_kgm2,
            "bogie_inertia_t_m2",
            kind.bogie_inertia_t_m2,
            false,
        ),
        (
            &mut car.upper_npm,
            "upper_spring_kn_per_m",
            kind.upper_spring_kn_per_m,
            false,
        ),
        (
            &mut car.upper_nspm,
            "upper_damper_kns_per_m",
            kind.upper_damper_kns_per_m,
            true,
        ),
        (
            &mut car.lower_npm,
            "lower_spring_kn_per_m",
            kind.lower_spring_kn_per_m,
            false,
        ),
        (
            &mut car.lower_nspm,
            "lower_damper_kns_per_m",
            kind.lower_damper_kns_per_m,
            true,
        ),
    ] {
        for (slot, value) in slot.iter_mut().zip(values.into_iter().flatten()) {
            if !(value.is_finite() && value >= 0.0 && (value > 0.0 || may_be_zero)) {
                bail!("{key} must be three positive numbers, not {value}");
            }
            *slot = 1e3 * value;
        }
    }
    Ok(car.spatial())
}

fn within(key: &str, value: f64, limit: f64) -> Result<()> {
    if value > 0.0 && value <= limit {
        return Ok(());
    }
    bail!("{key} must be positive and at most {limit}, not {value}")
}
