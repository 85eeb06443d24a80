//! Runs that must come out alike: at changing speed, backwards, in space and in the plane, together and one by one.

use anyhow::{Context, Result};
use spanwatch::bridge::ModalBridge;
use spanwatch::capacity::{ELEMENTS, MODES};
use spanwatch::interaction::{Direction, PlanarInteraction, Run, Scheme, TrainSteps};
use spanwatch::track::{Irregularity, Smooth, Track};
use spanwatch::train::{Motion, Place, PlanarTrain, Train};
use spanwatch::wire::message::TrainKind;

use super::beam::{self, GIRDER50, alone};
use super::{Row, Topic};
use crate::crossing::Crossing;
use crate::model::eigen::Wanted;
use crate::model::modal::ModalModel;
use crate::model::reduce::reduce;
use crate::model::{self, Structure};
use crate::track::{Profile, Spectrum, Stretch, generate};
use crate::train::{SpatialTrain, TrainName};

/// The topic.
pub const TOPIC: Topic = Topic {
    title: "Runs that must agree",
    about: "girder50. A force that gathers speed or brakes, against the integral of each mode's answer to it (Duhamel, by \
            Simpson's rule at 0.1 ms); three forces together, against their sum; two 15-DOF cars in space on equal rails, \
            against the same cars in the plane, on the modes of the logger's reduced model; a train that comes from the \
            other end over the mirrored track onto the mirrored bridge (element 8 with 40 % less for element 3, FRA class \
            6), against the forward run.",
    rows,
};

/// What rounding leaves of two ways to the same number.
const ROUNDING: f64 = 1e-8;

fn rows() -> Result<Vec<Row>> {
    let mut rows = vec![
        changing_speed("gathering speed: 20 m/s and 1.5 m/s²", 1.5)?,
        changing_speed("braking: 20 m/s and -2 m/s²", -2.0)?,
        together()?,
        in_space()?,
    ];
    rows.push(mirrored()?);
    Ok(rows)
}

/// Mid-span displacement (m) under a force along `run` by Duhamel's integral, `modes` exact sines, a value a step.
///
/// With `J' = l J + f`, `l = -xi w + i w_d`, the mode's answer is `Im J / w_d`.
fn duhamel(load_n: f64, run: &Run<f64>, modes: usize, step_s: f64, steps: usize) -> Vec<f64> {
    let mut deflection = vec![0.0; steps];
    for k in 1..=modes {
        let (w, decay) = (GIRDER50.omega(k), 0.5 * GIRDER50.damping(k));
        let wd = (w * w - decay * decay).sqrt();
        let load = |t: f64| {
            let x = run.speed_mps * t + 0.5 * run.acceleration_mps2 * t * t;
            if x > GIRDER50.length_m {
                0.0
            } else {
                -load_n * GIRDER50.shape(k, x)
            }
        };
        let turned = |t: f64| [(-decay * t).exp() * (wd * t).cos(), (-decay * t).exp() * (wd * t).sin()];
        let ([half, whole], mut j) = ([turned(0.5 * step_s), turned(step_s)], [0.0; 2]);
        for (n, deflection) in deflection.iter_mut().enumerate() {
            let t = n as f64 * step_s;
            let [f0, f1, f2] = [0.0, 0.5, 1.0].map(|part| step_s / 6.0 * load(t + part * step_s));
            let [real, imaginary] = [j[0] + f0, j[1]];
            j = [
                real * whole[0] - imaginary * whole[1] + 4.0 * f1 * half[0] + f2,
                real * whole[1] + imaginary * whole[0] + 4.0 * f1 * half[1],
            ];
            *deflection += GIRDER50.shape(k, 0.5 * GIRDER50.length_m) * j[1] / wd;
        }
    }
    deflection
}

fn changing_speed(what: &'static str, acceleration_mps2: f64) -> Result<Row> {
    const LOAD_N: f64 = 1e5;
    const STEP_S: f64 = 5e-4;
    const FINER: usize = 5;
    let run = Run {
        acceleration_mps2,
        ..Run::at(20.0)
    };
    let found = Crossing {
        model: &GIRDER50.modes(20, 4)?,
        train: &alone(beam::force(LOAD_N))?,
        run,
        track: None,
        scheme: Scheme::Exact,
        step_s: STEP_S,
    }
    .history(11, 4.0)?
    .displacement_m;
    let fine = duhamel(LOAD_N, &run, 4, STEP_S / FINER as f64, found.len() * FINER);
    let expected: Vec<f64> = fine.into_iter().skip(FINER - 1).step_by(FINER).collect();
    Ok(Row::new(what, "Duhamel's integral")
        .everywhere(&expected, &found)
        .times(1e3)
        .shown("mm", 4)
        .within(1e-4, "frequencies of twenty elements, over 4 s"))
}

fn together() -> Result<Row> {
    const SPEED_MPS: f64 = 25.0;
    let forces = [(1e5, 0.0), (7e4, 9.0), (1.2e5, 20.0)];
    let model = GIRDER50.modes(10, 8)?;
    let history = |train: &SpatialTrain, entry_time_s: f64| {
        Crossing {
            model: &model,
            train,
            run: Run {
                entry_time_s,
                ..Run::at(SPEED_MPS)
            },
            track: None,
            scheme: Scheme::Exact,
            step_s: 1e-3,
        }
        .history(6, 4.0)
        .map(|history| history.acceleration_mps2)
    };
    let mut train: SpatialTrain = Train {
        kinds: heapless::Vec::new(),
        cars: heapless::Vec::new(),
    };
    let mut sum = vec![0.0; 4000];
    for (kind, (load_n, behind_m)) in forces.into_iter().enumerate() {
        train.kinds.push(beam::force(load_n)).ok().context("a kind")?;
        train.cars.push(Place { kind, behind_m }).ok().context("a car")?;
        let one = history(&alone(beam::force(load_n))?, behind_m / SPEED_MPS)?;
        sum.iter_mut().zip(one).for_each(|(sum, one)| *sum += one);
    }
    Ok(Row::new("three forces of two kinds, acceleration", "sum of three runs")
        .histories(&sum, &history(&train, 0.0)?)
        .shown("m/s²", 7)
        .within(ROUNDING, "linear: rounding"))
}

fn in_space() -> Result<Row> {
    const SPEED_MPS: f64 = 40.0;
    const STEP_S: f64 = 1e-3;
    const STEPS: usize = 3000;
    let mut damage = [0.0; ELEMENTS];
    damage[4] = 0.3;
    let girder = model::shipped("girder50")?;
    let reduced = reduce(&girder)?;
    let modal = ModalBridge::<f64, MODES>::new(&reduced, &damage, &[5]);
    let planar = PlanarTrain::of_kind(TrainKind::Shinkansen3d, 2).context("two cars")?;
    let cars = TrainSteps::new(planar, Scheme::Exact, STEP_S)?;
    let mut interaction = PlanarInteraction::new(modal, &Smooth, &cars, Run::at(SPEED_MPS))?;
    let expected: Vec<f64> = (0..STEPS)
        .map(|_| {
            interaction.step(&cars, &Smooth);
            interaction.acceleration_mps2(0)
        })
        .collect();
    let found = Crossing {
        model: &ModalModel::new(&Structure::new(girder)?, &damage, Wanted::Count(MODES))?,
        train: &TrainName::Known(TrainKind::Shinkansen3d).train(Some(2))?,
        run: Run::at(SPEED_MPS),
        track: None,
        scheme: Scheme::Exact,
        step_s: STEP_S,
    }
    .history(6, STEPS as f64 * STEP_S)?;
    Ok(Row::new(
        "15 degrees of freedom on equal rails, acceleration",
        "6 degrees of freedom",
    )
    .histories(&expected, &found.acceleration_mps2)
    .shown("m/s²", 7)
    .within(1e-6, "two solvers of the eigenproblem"))
}

/// A track read from its other end.
struct Mirrored<'a> {
    track: &'a Profile,
    length_m: f64,
}

impl Track<f64> for Mirrored<'_> {
    fn extent_m(&self) -> Option<[f64; 2]> {
        let [begin, end] = Track::<f64>::extent_m(self.track)?;
        Some([self.length_m - end, self.length_m - begin])
    }

    fn at(&self, motion: Motion, x_m: f64) -> Irregularity<f64> {
        let there = Track::<f64>::at(self.track, motion, self.length_m - x_m);
        Irregularity {
            slope: -there.slope,
            ..there
        }
    }
}

fn mirrored() -> Result<Row> {
    let structure = Structure::new(model::shipped("girder50")?)?;
    let train = TrainName::Known(TrainKind::Shinkansen3d).train(Some(2))?;
    let track = generate(
        Spectrum::Fra6,
        1,
        &Stretch {
            vertical_only: true,
            ..Stretch::default()
        },
    )?;
    let mirror = Mirrored {
        track: &track,
        length_m: 50.0,
    };
    let run = |element: usize, track: &dyn Track<f64>, direction, sensor| -> Result<Vec<f64>> {
        let mut damage = [0.0; ELEMENTS];
        damage[element - 1] = 0.4;
        let found = Crossing {
            model: &ModalModel::new(&structure, &damage, Wanted::Count(MODES))?,
            train: &train,
            run: Run {
                direction,
                ..Run::at(60.0)
            },
            track: Some(track),
            scheme: Scheme::Exact,
            step_s: 1e-3,
        }
        .history(sensor, 2.5)?;
        Ok(found.acceleration_mps2)
    };
    let forward = run(3, &track, Direction::Forward, 4)?;
    let backward = run(8, &mirror, Direction::Backward, 8)?;
    Ok(
        Row::new("backwards over the mirror image, acceleration", "the forward run")
            .histories(&forward, &backward)
            .shown("m/s²", 7)
            .within(1e-6, "rounding, in wheel places and modes"),
    )
}
