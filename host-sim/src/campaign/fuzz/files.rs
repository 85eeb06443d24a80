//! Files as people write them, changed: recordings, bridges, trains, tables of a track. An error is a sentence; what is read can be used.

use std::io::Cursor;
use std::path::Path;

use spanwatch::track::{Motion, Track};

use super::mutation::mutate_text;
use super::{Counts, must};
use crate::campaign::line::Chance;
use crate::model::{self, Structure};
use crate::number_table::NumberTable;
use crate::recording::{Recording, description, table};
use crate::track::table as track_table;
use crate::train::file as train_file;

/// Longest sentence.
const LONGEST: usize = 2000;
/// Nodes of a frame whose matrices are made, which takes time with the cube of them.
const FEW_NODES: usize = 12;
/// Bytes of a recording's samples for each byte of its text.
const SAMPLES_A_BYTE: usize = 8;

const RECORDING: &str = "bridge = \"girder50\"\ntrain = \"inspection-2dof\"\ncars = 1\nspeed_kmh = 60.0\nentry_time_s = 1.0\n\
                         load_factor = 1.0\nantialias_hz = 40.0\nacceleration_mps2 = 0.1\ndirection = \"forward\"\n[range]\n\
                         speed = 0.1\nentry_s = 0.5\nload = 0.3\nstiffness = 0.01\n[[channel]]\ncolumn = \"a\"\nnode = 6\n\
                         unit = \"m/s2\"\nlsb_mps2 = 1e-6\nfull_scale_counts = 8388607\n[[channel]]\ncolumn = \"b\"\nnode = 3\n\
                         unit = \"mm\"\nlsb_mm = 1e-5\n";
const SAMPLES: &str = "time_s,a,b\n0.000,1.0e-3,0.01\n0.005,-2.5e-3,0.02\n0.010,3.1e-3,-0.01\n0.015,0,0\n0.020,1.5,2\n0.040,0.1,0.2\n\
                       0.045,0.1,0.3\n1.000,0.2,0.1\n";
const TRACK: &str = "x_m,z_left_mm,z_right_mm,y_left_mm,y_right_mm\n-1.0,0,0,0,0\n-0.5,0.1,0.2,0,0.1\n0.0,0.3,0.1,0,0\n0.5,-0.2,0.1,0.1,0\n\
                     1.0,0,0,0,0\n1.5,0.1,0,0,0\n";
const HEIGHTS: &str = "x_m,z_irregularity_mm\n0,0\n0.25,1.5\n0.5,-1\n0.75,0.3\n1,0\n";
const PORTAL: &str = "kind = \"frame\"\nname = \"portal\"\ndamping_ratio = 0.02\nbasis_modes = 4\n[materials]\n\
    steel = { E_npm2 = 2.0e11, nu = 0.3, density_kgpm3 = 7850.0 }\n[sections]\n\
    column = { material = \"steel\", A_m2 = 0.02, J_m4 = 1.0e-5, Iy_m4 = 3.0e-4, Iz_m4 = 3.0e-4 }\n[nodes]\nA1 = [0.0, 0.0, 0.0]\n\
    A2 = [6.0, 0.0, 0.0]\n[supports]\nA1 = [\"all\"]\nA2 = [\"x\", \"y\", \"z\"]\nB1 = [\"y\"]\n[[row]]\nname = \"B\"\nfirst = 1\nlast = 3\n\
    at_m = [0.0, 0.0, 5.0]\nstep_m = [3.0, 0.0, 0.0]\n[[beam]]\nnodes = [\"A1\", \"B1..B3\", \"A2\"]\nsection = \"column\"\n\
    groups = [\"left\", \"mid\", \"mid\", \"right\"]\ndivide = 2\nrigid_m = [0.1, 0.1]\nup = [0.0, 1.0, 0.0]\n[[spring]]\nnodes = [\"B2\"]\n\
    z_npm = 1.0e6\n[[mass]]\nnodes = [\"B2\"]\nkg = 100.0\ninertia_kgm2 = [1.0, 2.0, 3.0]\n[path]\nline = [\"A1\", \"A2\"]\nrail_height_m = 0.2\n\
    [[sensor]]\nnumber = 1\nnode = \"B2\"\ndirection = [0.0, 0.6, 0.8]\n[condensation]\nnodes = [\"B1..B3\"]\ndirections = [\"z\"]\n";
const GIRDER: &str = include_str!("../../../bridges/girder50.toml");
const TWO_SPANS: &str = include_str!("../../../bridges/twospan.toml");
const VIADUCT: &str = include_str!("../../../bridges/viaduct24.toml");
const TRAIN: &str = include_str!("../../../trains/rdso-test.toml");
const COACHES: &str = "name = \"c\"\n[kinds.l]\naxles_m = [0.0, 2.0, 9.0, 11.0]\naxle_load_kn = [200.0, 200.0, 190.0, 190.0]\n[kinds.c]\n\
    body_weight_kn = 350.0\nbogie_weight_kn = 50.0\nwheelset_weight_kn = 17.0\nbody_inertia_t_m2 = [50.0, 2000.0, 2000.0]\n\
    upper_spring_kn_per_m = [5000.0, 176.4, 500.0]\nupper_damper_kns_per_m = [1.0, 2.0, 3.0]\nbogie_distance_m = 17.5\n\
    axle_distance_m = 2.5\n[[cars]]\nkind = \"l\"\n[[cars]]\nkind = \"c\"\nbehind_m = 17.0\n";

/// A file is read.
pub(super) fn run(chance: &mut Chance) -> Result<Counts, String> {
    let read = match chance.below(8) {
        0 | 1 => recording(chance)?,
        2 => track(chance)?,
        3 => train(chance)?,
        4..6 => {
            let girder = chance.pick(&[GIRDER, TWO_SPANS]);
            bridge(girder, chance)?
        }
        6 => bridge(PORTAL, chance)?,
        _ => {
            // Long, and so seldom.
            let long = if chance.once_in(20) { VIADUCT } else { PORTAL };
            bridge(long, chance)?
        }
    };
    Ok(Counts::of(read))
}

/// Whether it was read; if not, the error must be a sentence.
fn sentence<T>(read: anyhow::Result<T>) -> Result<Option<T>, String> {
    match read {
        Ok(read) => Ok(Some(read)),
        Err(error) => {
            let words = format!("{error:#}");
            must!(
                words.lines().count() == 1,
                "an error of {} lines: {words:?}",
                words.lines().count()
            );
            must!(
                words.len() > 8 && words.len() < LONGEST,
                "an error of {} letters: {words}",
                words.len()
            );
            Ok(None)
        }
    }
}

/// Text, changed; none if it is no text any more, which is refused before it is looked at.
fn changed(text: &str, chance: &mut Chance) -> Option<String> {
    String::from_utf8(mutate_text(text, chance)).ok()
}

fn table_of(name: &Path, bytes: Vec<u8>) -> anyhow::Result<NumberTable> {
    NumberTable::of(name, Box::new(Cursor::new(bytes)))
}

fn recording(chance: &mut Chance) -> Result<bool, String> {
    let text = if chance.once_in(2) {
        changed(RECORDING, chance)
    } else {
        Some(RECORDING.to_owned())
    };
    let Some(described) = text.map_or(Ok(None), |text| sentence(description::parse(&text)))? else {
        return Ok(false);
    };
    let samples = if chance.once_in(4) {
        SAMPLES.as_bytes().to_vec()
    } else {
        mutate_text(SAMPLES, chance)
    };
    let (name, bytes) = (Path::new("r.csv"), samples.len());
    let Some(read) = sentence(table_of(name, samples).and_then(|table| table::read_table(name, table, described)))?
    else {
        return Ok(false);
    };
    let counts = read.to_counts();
    must!(
        counts.len() <= SAMPLES_A_BYTE * bytes,
        "{} counts of {bytes} bytes",
        counts.len()
    );
    must!(
        read.interval_s > 0.0 && read.interval_s.is_finite(),
        "an interval of {} s",
        read.interval_s
    );
    must!(read.duration_s().is_finite(), "a duration of {} s", read.duration_s());
    let samples = read.missing().checked_add(read.rows() as u64);
    must!(samples.is_some(), "more samples than can be counted");
    written_again(&read, chance)?;
    Ok(true)
}

/// A description that was read comes back from its own text.
fn written_again(read: &Recording, chance: &mut Chance) -> Result<(), String> {
    if !chance.once_in(4) {
        return Ok(());
    }
    let text = description::text(read, &[]);
    let again = description::parse(&text).map_err(|error| format!("its own text is refused: {error:#}"))?;
    must!(
        again.channels.len() == read.channels.len(),
        "its own text has other channels"
    );
    must!(
        again.speed_kmh == read.speed_kmh && again.train == read.train,
        "its own text says another run"
    );
    Ok(())
}

fn track(chance: &mut Chance) -> Result<bool, String> {
    let text = chance.pick(&[TRACK, HEIGHTS]);
    let name = Path::new("t.csv");
    let bytes = mutate_text(text, chance);
    let Some(read) = sentence(table_of(name, bytes).and_then(|table| track_table::read_table(name, table)))? else {
        return Ok(false);
    };
    for n in 0..40 {
        let x_m = f64::from(n) * 0.1 - 1.5;
        for motion in [Motion::Vertical, Motion::Lateral, Motion::Roll] {
            let at = read.at(motion, x_m);
            let numbers = [at.value, at.slope, at.curvature, at.curvature_rate];
            must!(
                numbers.iter().all(|value| value.is_finite()),
                "at {x_m} m it is {numbers:?}"
            );
        }
    }
    Ok(true)
}

fn train(chance: &mut Chance) -> Result<bool, String> {
    let text = chance.pick(&[TRAIN, COACHES]);
    let Some(text) = changed(text, chance) else {
        return Ok(false);
    };
    let Some(train) = sentence(train_file::parse(&text))? else {
        return Ok(false);
    };
    for car in &train.kinds {
        let numbers = car
            .inertia
            .iter()
            .copied()
            .chain(car.contacts.iter().map(|contact| contact.load_n));
        must!(numbers.into_iter().all(f64::is_finite), "a car's numbers are none");
    }
    Ok(true)
}

fn bridge(text: &str, chance: &mut Chance) -> Result<bool, String> {
    let Some(text) = changed(text, chance) else {
        return Ok(false);
    };
    let Some(frame) = sentence(model::file::read(&text))? else {
        return Ok(false);
    };
    must!(frame.frame.nodes.len() <= 2_000, "{} nodes", frame.frame.nodes.len());
    // Some are followed to the logger.
    if frame.frame.nodes.len() > FEW_NODES || !chance.once_in(10) {
        return Ok(true);
    }
    if sentence(Structure::new(frame.clone()))?.is_none() {
        return Ok(false);
    }
    let Some(reduced) = sentence(model::reduce::reduce(&frame))? else {
        return Ok(false);
    };
    let Some(blob) = sentence(model::to_blob(&reduced))? else {
        return Ok(false);
    };
    Ok(sentence(model::from_blob(&blob))?.is_some())
}
