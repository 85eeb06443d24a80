//! Bridge models, learnt tracks and evidence as bytes: changed, their checksum mostly made right, so that it is the contents that are
//! tested. What is accepted must be of use.

use std::sync::OnceLock;

use spanwatch::bridge::{ModalBridge, ReducedBridge, blob};
use spanwatch::capacity::{CHANNELS, ELEMENTS, MODEL_BLOB_BYTES, MODES};
use spanwatch::identify::estimate::Information;
use spanwatch::identify::evidence::{Basis, EVIDENCE_BYTES, Evidence, Forgetting};
use spanwatch::interaction::simulation::{Recorder, Sensor, Simulation};
use spanwatch::interaction::{Observation, Run, Scheme};
use spanwatch::track::blob::{self as track_blob, TRACK_BLOB_BYTES};
use spanwatch::track::learnt::{LearntTrack, Spread, UNLEARNT, Unexplained};
use spanwatch::track::profile::{Knots, Profile, Stretch};
use spanwatch::track::watch::Watch;
use spanwatch::track::{Motion, Track};
use spanwatch::train::PlanarTrain;
use spanwatch::wire::message::{Quantity, TrainKind};
use spanwatch::wire::{CRC32C, fingerprint};

use super::mutation::{mutate, near, number, whole};
use super::{Counts, must};
use crate::campaign::line::Chance;
use crate::model;

/// Samples of a simulation that must be numbers.
const SAMPLES: usize = 12;

/// The bridges that fit a logger.
fn bridges() -> &'static [ReducedBridge<f32>] {
    static BRIDGES: OnceLock<Vec<ReducedBridge<f32>>> = OnceLock::new();
    BRIDGES.get_or_init(|| {
        let reduced = |name: &str| Some(model::reduce::reduce(&model::shipped(name).ok()?).ok()?.cast());
        ["girder50", "twospan"].into_iter().filter_map(reduced).collect()
    })
}

fn written(bridge: &ReducedBridge<f32>) -> Vec<u8> {
    let mut buffer = [0; 2 * MODEL_BLOB_BYTES];
    blob::write(bridge, &mut buffer).map(<[u8]>::to_vec).unwrap_or_default()
}

/// A model as it should be.
pub(super) fn model(_: &mut Chance) -> Vec<u8> {
    static MODEL: OnceLock<Vec<u8>> = OnceLock::new();
    MODEL
        .get_or_init(|| bridges().first().map(written).unwrap_or_default())
        .clone()
}

/// One that is changed, mostly with its checksum right.
pub(super) fn broken_model(chance: &mut Chance) -> Vec<u8> {
    let place = chance.below(bridges().len() as u64) as usize;
    if chance.once_in(3) {
        let mut bytes = model(chance);
        mutate(&mut bytes, &written(&bridges()[place]), chance);
        return checked(bytes, chance);
    }
    let mut bridge = bridges()[place].clone();
    for _ in 0..=chance.below(3) {
        change(&mut bridge, chance);
    }
    written(&bridge)
}

/// Other numbers in a model.
fn change(bridge: &mut ReducedBridge<f32>, chance: &mut Chance) {
    let basis = bridge.basis as u64;
    let k = chance.below(basis) as usize;
    match chance.below(10) {
        0 => bridge.lambda[k] = near(bridge.lambda[k], chance),
        1 => {
            let factor = chance.pick(&[1e-4, 1e-2, 0.5, 2.0, 1e2, 1e4, 1e6]);
            bridge.lambda *= factor;
        }
        2 => {
            let which = chance.below(2) as usize;
            bridge.rayleigh[which] = near(bridge.rayleigh[which], chance);
        }
        3 | 4 => {
            let i = chance.below(bridge.path.nodes as u64) as usize;
            bridge.path.position_m[i] = near(bridge.path.position_m[i], chance);
        }
        5 => {
            let factor = number(chance);
            bridge.path.position_m.iter_mut().for_each(|x| *x *= factor);
        }
        6 => {
            let i = chance.below(bridge.path.nodes as u64) as usize;
            let path = &mut bridge.path;
            let matrix = if chance.once_in(2) {
                &mut path.displacement
            } else {
                &mut path.slope
            };
            matrix[(k, i)] = near(matrix[(k, i)], chance);
        }
        7 => {
            let i = chance.below(bridge.sensor_count as u64) as usize;
            bridge.sensors[(k, i)] = near(bridge.sensors[(k, i)], chance);
            bridge.sensor_node[i] = whole(chance) as u16;
        }
        8 => {
            let f = chance.below(bridge.factor_count as u64) as usize;
            if chance.once_in(2) {
                bridge.factors[(k, f)] = near(bridge.factors[(k, f)], chance);
            } else {
                bridge.factor_element[f] = whole(chance) as u8;
            }
        }
        _ => bridge.elements = whole(chance) as usize & 0xFF,
    }
}

/// The last four bytes are made those of the others, but for one time in eight.
fn checked(mut bytes: Vec<u8>, chance: &mut Chance) -> Vec<u8> {
    if !chance.once_in(8)
        && let Some((body, crc)) = bytes.split_last_chunk_mut::<4>()
    {
        *crc = CRC32C.checksum(body).to_le_bytes();
    }
    bytes
}

/// A model is read.
pub(super) fn run_model(chance: &mut Chance) -> Result<Counts, String> {
    let bytes = broken_model(chance);
    let Ok(bridge) = blob::read(&bytes) else {
        return Ok(Counts::of(false));
    };
    let again = written(&bridge);
    must!(
        blob::read(&again).is_ok_and(|other| written(&other) == again),
        "it is another once written"
    );
    use_model(&bridge, &UNLEARNT, chance)?;
    Ok(Counts::of(true))
}

/// Simulates a passage over it, damaged or not.
fn use_model(bridge: &ReducedBridge<f32>, track: &LearntTrack, chance: &mut Chance) -> Result<(), String> {
    let mut damage = [0.0; ELEMENTS];
    if chance.once_in(2) {
        damage.iter_mut().for_each(|loss| *loss = chance.below(8) as f32 * 0.1);
    }
    let place = chance.below(bridge.sensor_count as u64) as usize;
    let modal = ModalBridge::<f32, MODES>::new(bridge, &damage, &[place]);
    let numbers = (modal.omega_squared.iter())
        .chain(modal.damping.iter())
        .chain(modal.path.iter().flatten().flat_map(|shape| shape.iter()))
        .chain(modal.sensors.iter().flat_map(|shape| shape.iter()));
    must!(
        numbers.into_iter().all(|value| value.is_finite()),
        "its modes are no numbers: {damage:?}"
    );
    let sensor = |quantity| Sensor { place, quantity };
    let sensors = [sensor(Quantity::Acceleration), sensor(Quantity::Displacement)];
    let recorder = Recorder::new(sensors.into_iter().collect(), 200.0, Some(40.0));
    let train = PlanarTrain::of_kind(TrainKind::Inspection2Dof, 1).ok_or("no train")?;
    let run = Run {
        entry_time_s: 0.02,
        ..Run::at(chance.pick(&[5.0, 20.0, 75.0]))
    };
    let Ok(mut observation) = Observation::new(train, run, recorder, Scheme::Exact) else {
        return Err("no observation".to_owned());
    };
    observation.stiffness = track.stiffness;
    let mut hypothesis = observation.expected();
    hypothesis.damage = damage;
    let Ok(mut simulation) = Simulation::<f32, MODES>::new(bridge, &hypothesis, &observation, &track.profile) else {
        return Ok(());
    };
    for n in 0..SAMPLES {
        let sample = simulation.sample(&observation, &track.profile);
        must!(
            sample.iter().all(|value| value.is_finite()),
            "sample {n} is no number: {sample:?}"
        );
    }
    Ok(())
}

/// The fingerprint of the model that tracks and evidence belong to.
fn of_bridge(chance: &mut Chance) -> u32 {
    fingerprint(&model(chance))
}

/// A track as it should be.
pub(super) fn track(chance: &mut Chance) -> Vec<u8> {
    let (track, coefficients) = learnt(false, chance);
    let mut buffer = [0; 2 * TRACK_BLOB_BYTES];
    let bridge = of_bridge(chance);
    track_blob::write(&track, &coefficients, bridge, &mut buffer)
        .map(<[u8]>::to_vec)
        .unwrap_or_default()
}

/// One that is changed, mostly with its checksum right.
pub(super) fn broken_track(chance: &mut Chance) -> Vec<u8> {
    let (track, coefficients) = learnt(true, chance);
    let mut buffer = [0; 2 * TRACK_BLOB_BYTES];
    let bridge = of_bridge(chance);
    let written = track_blob::write(&track, &coefficients, bridge, &mut buffer);
    let mut bytes = written.map(<[u8]>::to_vec).unwrap_or_default();
    if chance.once_in(3) {
        mutate(&mut bytes, &[], chance);
        bytes = checked(bytes, chance);
    }
    bytes
}

/// A track and the coefficients of its profile; `odd` ones have numbers that no track has.
fn learnt(odd: bool, chance: &mut Chance) -> (LearntTrack, Vec<f32>) {
    let value = |usual: f32, chance: &mut Chance| match odd && chance.once_in(12) {
        true => near(usual, chance),
        false => usual,
    };
    let stretches = |chance: &mut Chance| {
        let spacing = if odd && chance.once_in(3) {
            chance.pick(&[1e-45, 1e-38, 1e-20, 1e-6, 1e-3, 1e3, 1e30])
        } else {
            1.0
        };
        let spans = 5 + chance.below(60) as u16;
        let approach = Stretch {
            from_m: value(-30.0, chance),
            spacing_m: value(3.0, chance),
            spans: 10,
        };
        let bridge = Stretch {
            from_m: value(0.0, chance),
            spacing_m: value(spacing, chance),
            spans,
        };
        let all = [approach, bridge];
        Knots::new(&all[chance.below(2) as usize..])
    };
    // Some are no knots.
    let knots = (0..20).find_map(|_| stretches(chance)).unwrap_or(Knots::NONE);
    let coefficients: Vec<f32> = (0..knots.coefficients())
        .map(|_| value((chance.below(2001) as f32 - 1000.0) * 1e-6, chance))
        .collect();
    let mut track = UNLEARNT.clone();
    track.profile = Profile::new(knots, &coefficients);
    track.stiffness = value(0.98, chance);
    track.damping = value(1.1, chance);
    if !chance.once_in(4) {
        let scale = value(chance.pick(&[1e-3, 0.1]), chance);
        track.spread = Spread::from_fn(|i, j| match i.cmp(&j) {
            std::cmp::Ordering::Equal => value(scale, chance),
            std::cmp::Ordering::Greater => value(0.2 * scale * (chance.below(200) as f32 * 0.01 - 1.0), chance),
            std::cmp::Ordering::Less => 0.0,
        });
    }
    track.unexplained = [(); CHANNELS].map(|()| Unexplained {
        floor: value(1e-6, chance),
        part: value(0.01, chance),
    });
    track.scatter = value(0.5, chance);
    track.passages = if odd && chance.once_in(8) {
        whole(chance) as u16
    } else {
        26
    };
    track.speeds = if odd && chance.once_in(8) {
        [whole(chance), whole(chance)]
    } else {
        [u64::MAX, 1]
    };
    (track, coefficients)
}

/// A track is read.
pub(super) fn run_track(chance: &mut Chance) -> Result<Counts, String> {
    let bytes = broken_track(chance);
    let bridge = of_bridge(chance);
    let mut read = UNLEARNT.clone();
    if track_blob::read_into(&bytes, bridge, &mut read).is_err() {
        must!(read == UNLEARNT, "a track that was refused has changed what is known");
        return Ok(Counts::of(false));
    }
    let mut again = track_blob_of(chance)?;
    must!(
        track_blob::read_into(&bytes, bridge, &mut again).is_ok(),
        "it is refused behind another"
    );
    must!(again == read, "it is another behind another");
    // Everywhere a number.
    let [first, last] = read.profile.extent_m().ok_or("it has no extent")?;
    for n in 0..40 {
        let part = n as f32 / 39.0;
        let x_m = match n % 4 {
            3 => number(chance),
            _ => first + part * (last - first),
        };
        let at = read.profile.at(Motion::Vertical, x_m);
        let numbers = [at.value, at.slope, at.curvature, at.curvature_rate];
        must!(
            numbers.iter().all(|value| value.is_finite()),
            "at {x_m} m it is {numbers:?}"
        );
    }
    // A reference that is nearly a contradiction leaves nothing known, but numbers.
    let known = read.relative(&information(chance.pick(&[1.0, 1e3, 1e6]), chance));
    let numbers = known.matrix.iter().chain(known.vector.iter());
    must!(
        numbers.into_iter().all(|value| value.is_finite()),
        "what passages say by it is no numbers"
    );
    if let Some(bridge) = bridges().first() {
        use_model(&bridge.clone().damped(read.damping), &read, chance)?;
    }
    Ok(Counts::of(true))
}

/// A sound track, as read.
fn track_blob_of(chance: &mut Chance) -> Result<LearntTrack, String> {
    let (bytes, bridge) = (track(chance), of_bridge(chance));
    let mut read = UNLEARNT.clone();
    track_blob::read_into(&bytes, bridge, &mut read).map_err(|error| format!("a sound track is refused: {error}"))?;
    Ok(read)
}

/// What a passage may say.
fn information(scale: f32, chance: &mut Chance) -> Information {
    let mut information = Information::ZERO;
    for _ in 0..ELEMENTS + 4 {
        let row: [f32; ELEMENTS] = std::array::from_fn(|_| chance.below(2001) as f32 * 1e-3 - 1.0);
        for i in 0..ELEMENTS {
            for j in 0..ELEMENTS {
                information.matrix[(i, j)] += scale * row[i] * row[j];
            }
            information.vector[i] += scale * row[i] * 0.1;
        }
    }
    information
}

/// An evidence that is changed, mostly with its checksum right.
pub(super) fn broken_evidence(chance: &mut Chance) -> Vec<u8> {
    let bridge = of_bridge(chance);
    let mut evidence = Evidence::new(Forgetting::NEVER);
    for _ in 0..chance.below(5) {
        let scale = chance.pick(&[1.0, 1e3, 1e6, 1e-6, 1e-20, 1e20, 1e30, 1e36]);
        let _ = evidence.add(&information(scale, chance));
    }
    let (track, _) = learnt(false, chance);
    let basis = Basis {
        bridge,
        track: chance.pick(&[0, 1, 2]),
        spread: &track.spread,
    };
    let mut watch = Watch::NEW;
    for passage in 0..chance.below(5) as u32 {
        let z = chance.pick(&[0.0, 1.0, -3.0, 1e3, 1e38, f32::NAN, f32::INFINITY]);
        watch.judge(&track, passage, Some(z));
    }
    let mut buffer = [0; EVIDENCE_BYTES];
    let mut bytes = evidence
        .to_bytes(&basis, watch, &mut buffer)
        .map(<[u8]>::to_vec)
        .unwrap_or_default();
    if chance.once_in(2) {
        mutate(&mut bytes, &[], chance);
        bytes = checked(bytes, chance);
    }
    bytes
}

/// An evidence is read, and gone on from.
pub(super) fn run_evidence(chance: &mut Chance) -> Result<Counts, String> {
    let bytes = broken_evidence(chance);
    let bridge = of_bridge(chance);
    let known = chance.pick(&[0, 1]);
    let basis = Basis {
        bridge,
        track: known,
        spread: &UNLEARNT.spread,
    };
    let forgetting = Forgetting::new(1000.0, 20.0).map_err(|error| error.to_string())?;
    let Ok((mut evidence, watch)) = Evidence::from_bytes(&bytes, &basis, forgetting) else {
        return Ok(Counts::of(false));
    };
    let watch = watch.unwrap_or_default();
    let reads = |evidence: &Evidence, when: &str| -> Result<(), String> {
        let mut buffer = [0; EVIDENCE_BYTES];
        let written = evidence
            .to_bytes(&basis, watch, &mut buffer)
            .ok_or("it cannot be written")?;
        let again = Evidence::from_bytes(written, &basis, forgetting);
        let again = again.map_err(|error| format!("{when}, it is refused once written: {error}"))?;
        must!(
            again == (evidence.clone(), Some(watch)),
            "{when}, it is another once written"
        );
        let estimate = evidence.estimate(ELEMENTS);
        let numbers = (estimate.damage.iter())
            .chain(&estimate.std)
            .chain(&estimate.low)
            .chain(&estimate.high);
        must!(
            numbers.into_iter().all(|value| value.is_finite()),
            "{when}, its estimate is no numbers"
        );
        Ok(())
    };
    reads(&evidence, "as it was read")?;
    for n in 0..chance.below(4) {
        let scale = chance.pick(&[1.0, 1e3, 1e6, 1e-6]);
        let _ = evidence.add(&information(scale, chance));
        reads(&evidence, if n == 0 { "after a passage" } else { "after passages" })?;
    }
    let (track, _) = learnt(false, chance);
    let _ = evidence.outlive(&track);
    reads(&evidence, "after another look at the earlier one")?;
    evidence.retire(&track);
    reads(&evidence, "after another track")?;
    Ok(Counts::of(true))
}
