//! Many viaducts: each learns its track from healthy passages, and is monitored with what it has learnt.
//!
//! | campaign | monitored | counted |
//! |---|---|---|
//! | [`errors`] | a few passages, put together | errors of the losses, beside the bound of these very passages |
//! | [`healthy`] | many passages of a healthy bridge | alarms, all of them false, and changes of the track that are none |
//! | [`detection`] | a bridge that has lost stiffness in one element | passages until an alarm names it |
//! | [`changes`] | a healthy bridge whose track has changed | passages until that is reported, and alarms |
//!
//! A passage follows from viaduct and number ([`truth`](super::truth)), so all sets of sensors and all losses see the same trains, and each
//! is solved once.

use std::collections::HashMap;
use std::sync::{Arc, Mutex, PoisonError};

use anyhow::{Result, bail};
use spanwatch::bridge::Damage;
use spanwatch::capacity::ELEMENTS;
use spanwatch::identify::estimate::Estimate;
use spanwatch::track::profile::Profile;

use super::bound::{Known, Problem, bound};
use super::method::{Method, Said};
use super::truth::{Change, Passage, Setting, Speeds, State, Traffic, Viaduct};
use crate::batch;
use crate::calibrate::knots;
use crate::model::BridgeFrame;
use crate::study::noise::campaign::mean;
use crate::track::Spectrum;
use crate::track::prior::{fit, precision};

/// What is to be run.
#[derive(Debug, Clone)]
pub struct Plan {
    /// Classes of track.
    pub classes: Vec<Spectrum>,
    /// Sets of sensors, of [`SENSORS`](super::truth::SENSORS).
    pub sensors: Vec<Vec<u16>>,
    /// How fast the trains are.
    pub speeds: Vec<Speeds>,
    /// Which trains pass.
    pub traffic: Traffic,
    /// Whether each car's masses are off.
    pub uneven: bool,
    /// Standard deviation of the stiffness of the whole bridge from passage to passage.
    pub temperature: f32,
    /// How the track changes.
    pub change: Change,
    /// Healthy passages that the track is learnt from.
    pub healthy: usize,
    /// Passages that are monitored, at most.
    pub passages: usize,
    /// Viaducts of each row, ...
    pub viaducts: u32,
    /// ... of this seed and those that follow.
    pub first_seed: u64,
}

impl Plan {
    /// Rows of the table.
    pub fn keys(&self) -> Vec<Key> {
        let mut keys = vec![];
        for &class in &self.classes {
            for &speeds in &self.speeds {
                for nodes in &self.sensors {
                    let nodes = nodes.clone();
                    keys.push(Key { class, speeds, nodes });
                }
            }
        }
        keys
    }

    /// Passages that are learnt from or monitored, if each viaduct is monitored `times` times.
    pub fn work(&self, times: usize) -> u64 {
        (self.keys().len() * (self.healthy + times * self.passages)) as u64 * u64::from(self.viaducts)
    }
}

/// What tells the rows of a table apart.
#[derive(Debug, Clone, PartialEq)]
pub struct Key {
    /// Class of the track.
    pub class: Spectrum,
    /// How fast the trains are.
    pub speeds: Speeds,
    /// Nodes with a sensor.
    pub nodes: Vec<u16>,
}

/// A row: what became of each viaduct, or why its track could not be learnt.
#[derive(Debug, Clone)]
pub struct Row<O> {
    /// What it is a row of.
    pub key: Key,
    /// By viaduct.
    pub viaducts: Vec<Result<O, String>>,
}

impl<O> Row<O> {
    /// Those that were monitored.
    pub fn monitored(&self) -> impl Iterator<Item = &O> {
        self.viaducts.iter().flatten()
    }
}

/// Tells of so many passages that are done.
type Done<'a> = &'a (dyn Fn(u64) + Sync);

/// A passage's number, the bits of the losses, and whether the track has changed.
type Number = (usize, [u64; ELEMENTS], bool);

/// The passages of a viaduct, each solved when it is first asked for.
struct Timetable {
    viaduct: Viaduct,
    solved: Mutex<HashMap<Number, Arc<Passage>>>,
}

impl Timetable {
    fn passage(&self, index: usize, state: &State) -> Result<Arc<Passage>> {
        let key = (index, state.damage.map(f64::to_bits), state.changed);
        let known = |solved: &Mutex<HashMap<_, Arc<Passage>>>| {
            let solved = solved.lock().unwrap_or_else(PoisonError::into_inner);
            solved.get(&key).cloned()
        };
        if let Some(passage) = known(&self.solved) {
            return Ok(passage);
        }
        let passage = Arc::new(self.viaduct.passage(index, state)?);
        let mut solved = self.solved.lock().unwrap_or_else(PoisonError::into_inner);
        solved.insert(key, passage.clone());
        Ok(passage)
    }
}

/// A viaduct whose track has been learnt.
struct Learnt<'a, M: Method> {
    timetable: &'a Timetable,
    method: &'a M,
    learnt: &'a M::Learnt,
    nodes: &'a [u16],
    plan: &'a Plan,
    done: Done<'a>,
}

impl<M: Method> Learnt<'_, M> {
    /// Monitors until `enough`, which hears how many passages there were and what was said.
    fn monitor(&self, state: &State, mut enough: impl FnMut(usize, &Said) -> bool) -> Result<()> {
        let mut monitor = self.method.monitor(self.learnt, self.nodes)?;
        for count in 1..=self.plan.passages {
            let passage = self.timetable.passage(self.plan.healthy + count - 1, state)?;
            let said = monitor.pass(&passage)?;
            (self.done)(1);
            if enough(count, &said) {
                (self.done)((self.plan.passages - count) as u64);
                break;
            }
        }
        Ok(())
    }
}

/// Learns the track of every viaduct of a plan, and does `work` with each. `done` hears of passages.
fn each_viaduct<M: Method, O: Send>(
    bridge: &BridgeFrame,
    plan: &Plan,
    method: &M,
    done: Done<'_>,
    work: impl Fn(&Learnt<'_, M>) -> Result<O> + Sync + Send,
) -> Result<Vec<Row<O>>> {
    let keys = plan.keys();
    if keys.is_empty() || plan.viaducts == 0 || plan.passages == 0 {
        bail!("nothing to evaluate: give at least one class, speed, set of sensors, viaduct and passage");
    }
    let jobs: Vec<(Spectrum, Speeds, u64)> = (plan.classes.iter())
        .flat_map(|&class| plan.speeds.iter().map(move |&speeds| (class, speeds)))
        .flat_map(|(class, speeds)| (0..u64::from(plan.viaducts)).map(move |i| (class, speeds, plan.first_seed + i)))
        .collect();
    let of_job = |&(class, speeds, seed): &(Spectrum, Speeds, u64)| -> Result<Vec<Result<O, String>>> {
        let setting = Setting {
            class,
            traffic: plan.traffic,
            speeds,
            uneven: plan.uneven,
            temperature: plan.temperature,
            change: plan.change,
        };
        let timetable = Timetable {
            viaduct: Viaduct::new(bridge, &setting, seed)?,
            solved: Mutex::default(),
        };
        let numbers: Vec<usize> = (0..plan.healthy).collect();
        let healthy = batch::each(&numbers, |&index| timetable.viaduct.passage(index, &State::HEALTHY))
            .into_iter()
            .collect::<Result<Vec<_>>>()?;
        let healthy: Vec<&Passage> = healthy.iter().collect();
        (plan.sensors.iter())
            .map(|nodes| {
                let learnt = method.learn(&healthy, nodes);
                done(plan.healthy as u64);
                match learnt {
                    Ok(learnt) => work(&Learnt {
                        timetable: &timetable,
                        method,
                        learnt: &learnt,
                        nodes,
                        plan,
                        done,
                    })
                    .map(Ok),
                    Err(error) => Ok(Err(format!("{error:#}"))),
                }
            })
            .collect()
    };
    let found = batch::each(&jobs, of_job).into_iter().collect::<Result<Vec<_>>>()?;
    // By job, then sensors; a row is of all seeds.
    let mut rows: Vec<Row<O>> = (keys.into_iter()).map(|key| Row { key, viaducts: vec![] }).collect();
    let sets = plan.sensors.len();
    for (j, of_sets) in found.into_iter().enumerate() {
        let first = j / plan.viaducts as usize * sets;
        for (row, of_set) in rows[first..].iter_mut().zip(of_sets) {
            row.viaducts.push(of_set);
        }
    }
    Ok(rows)
}

/// What a few passages put together say of the losses.
#[derive(Debug, Clone, PartialEq)]
pub struct Errors {
    /// The true losses.
    pub truth: Damage<f64>,
    /// What is found.
    pub estimate: Estimate,
    /// The bound of these passages after the healthy ones.
    pub bound: Damage<f64>,
    /// Passages that were used.
    pub used: usize,
}

/// Errors of the losses after [`Plan::passages`] monitored passages of a bridge in that state.
///
/// # Errors
/// If there is nothing to do, or a passage cannot be solved.
pub fn errors<M: Method>(
    bridge: &BridgeFrame,
    plan: &Plan,
    state: &State,
    method: &M,
    done: Done<'_>,
) -> Result<Vec<Row<Errors>>> {
    each_viaduct(bridge, plan, method, done, |learnt| {
        let (mut last, mut used) = (None, 0);
        learnt.monitor(state, |_, said| {
            used += usize::from(said.unused.is_none());
            last = Some(*said);
            false
        })?;
        let viaduct = &learnt.timetable.viaduct;
        let Some(knots) = knots(viaduct.model.path.length_m()) else {
            bail!("a bridge of this length has no place in a profile");
        };
        let track = Profile::new(knots.clone(), &fit(viaduct.track(state.changed), &knots));
        let problem = Problem {
            bridge: &viaduct.model,
            track: &track,
            damage: state.damage,
            ranges: viaduct.setting.ranges(),
            uneven: plan.uneven,
        };
        let numbers: Vec<usize> = (plan.healthy..plan.healthy + plan.passages).collect();
        let told = batch::each(&numbers, |&index| {
            problem.of(&*learnt.timetable.passage(index, state)?, learnt.nodes)
        })
        .into_iter()
        .collect::<Result<Vec<_>>>()?;
        let many = plan.healthy as f64 / plan.passages as f64;
        let precision = precision(viaduct.setting.class, &knots)?;
        let Some(said) = last else {
            bail!("no passage was monitored");
        };
        Ok(Errors {
            truth: state.damage,
            estimate: said.estimate,
            bound: bound(&told.iter().sum(), &precision, Known::Healthy(many))?,
            used,
        })
    })
}

impl Row<Errors> {
    /// RMSE of each element.
    pub fn rmse(&self) -> Damage<f64> {
        let error = |errors: &Errors, e: usize| f64::from(errors.estimate.damage[e]) - errors.truth[e];
        std::array::from_fn(|e| mean(self.monitored().map(|errors| error(errors, e).powi(2))).sqrt())
    }

    /// The bound of each element, root mean square over the viaducts.
    pub fn bound(&self) -> Damage<f64> {
        std::array::from_fn(|e| mean(self.monitored().map(|errors| errors.bound[e].powi(2))).sqrt())
    }

    /// Part of the 95 % intervals that hold the true loss.
    pub fn coverage(&self) -> f64 {
        let holds = |errors: &Errors, e: usize| {
            let truth = errors.truth[e] as f32;
            (errors.estimate.low[e]..=errors.estimate.high[e]).contains(&truth)
        };
        mean(
            self.monitored()
                .flat_map(|errors| (0..ELEMENTS).map(move |e| f64::from(holds(errors, e)))),
        )
    }
}

/// What was said of a healthy bridge.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Healthy {
    /// Passages monitored.
    pub passages: usize,
    /// Those that were used.
    pub used: usize,
    /// Those with an alarm.
    pub alarms: usize,
    /// The passage, from 1, with which the track was said to have changed.
    pub changed: Option<usize>,
}

/// False alarms on healthy bridges.
///
/// # Errors
/// As [`errors`].
pub fn healthy<M: Method>(bridge: &BridgeFrame, plan: &Plan, method: &M, done: Done<'_>) -> Result<Vec<Row<Healthy>>> {
    each_viaduct(bridge, plan, method, done, |learnt| watch(learnt, &State::HEALTHY))
}

/// Monitors to the end and counts.
fn watch<M: Method>(learnt: &Learnt<'_, M>, state: &State) -> Result<Healthy> {
    let mut found = Healthy::default();
    learnt.monitor(state, |count, said| {
        found.passages = count;
        found.used += usize::from(said.unused.is_none());
        found.alarms += usize::from(said.alarm != 0);
        if said.changed && found.changed.is_none() {
            found.changed = Some(count);
        }
        false
    })?;
    Ok(found)
}

/// A healthy bridge whose track has changed: how soon that is said, and whether it is taken for damage.
///
/// # Errors
/// As [`errors`].
pub fn changes<M: Method>(bridge: &BridgeFrame, plan: &Plan, method: &M, done: Done<'_>) -> Result<Vec<Row<Healthy>>> {
    let state = State {
        changed: true,
        ..State::HEALTHY
    };
    each_viaduct(bridge, plan, method, done, |learnt| watch(learnt, &state))
}

/// What was said of a bridge with a loss in one element.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Detected {
    /// The element, from 0.
    pub element: usize,
    /// Its loss.
    pub loss: f64,
    /// Passages until an alarm named it; none: none did.
    pub after: Option<usize>,
    /// Whether an alarm named a whole element before.
    pub wrong: bool,
    /// The passage with which the track was said to have changed before that.
    pub changed: Option<usize>,
}

/// Passages until an alarm, for each loss in each element (from 0) alone.
///
/// # Errors
/// As [`errors`].
pub fn detection<M: Method>(
    bridge: &BridgeFrame,
    plan: &Plan,
    elements: &[usize],
    losses: &[f64],
    method: &M,
    done: Done<'_>,
) -> Result<Vec<Row<Vec<Detected>>>> {
    let states: Vec<(usize, f64)> = (elements.iter())
        .flat_map(|&element| losses.iter().map(move |&loss| (element, loss)))
        .collect();
    each_viaduct(bridge, plan, method, done, |learnt| {
        batch::each(&states, |&(element, loss)| -> Result<Detected> {
            let mut found = Detected {
                element,
                loss,
                after: None,
                wrong: false,
                changed: None,
            };
            learnt.monitor(&State::damaged(element, loss), |count, said| {
                found.wrong |= said.alarm & !(1 << element) != 0;
                if said.changed && found.changed.is_none() {
                    found.changed = Some(count);
                }
                if said.alarm >> element & 1 == 1 {
                    found.after = Some(count);
                }
                found.after.is_some()
            })?;
            Ok(found)
        })
        .into_iter()
        .collect()
    })
}
