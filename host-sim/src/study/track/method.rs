//! What the campaigns are of: a way to learn a track from healthy passages, and to monitor the bridge with what was learnt.

use std::fs;
use std::path::PathBuf;

use anyhow::{Context, Result, anyhow};
use spanwatch::bridge::ReducedBridge;
use spanwatch::capacity::ELEMENTS;
use spanwatch::identify::estimate::Estimate;
use spanwatch::identify::evidence::{Basis, EVIDENCE_BYTES, Evidence, Forgetting};
use spanwatch::logger::Logger;
use spanwatch::track::learnt::LearntTrack;
use spanwatch::wire::message::{Event, Memory, Reason, TrackState, Verdict};
use spanwatch::wire::{CRC32C, fingerprint};

use super::truth::Passage;
use crate::calibrate::{self, DRIFT_M, Options, calibrate};
use crate::model::to_blob;
use crate::output;

/// A way to learn and to monitor.
pub trait Method: Sync {
    /// What is learnt.
    type Learnt: Send + Sync;

    /// Learns from healthy passages, seen by the sensors at `nodes`.
    ///
    /// # Errors
    /// If they teach nothing.
    fn learn(&self, healthy: &[&Passage], nodes: &[u16]) -> Result<Self::Learnt>;

    /// Begins to monitor, nothing being known of the bridge yet.
    ///
    /// # Errors
    /// If what was learnt cannot be used.
    fn monitor<'a>(&'a self, learnt: &'a Self::Learnt, nodes: &'a [u16]) -> Result<Box<dyn Monitor + 'a>>;
}

/// Something that watches a bridge, passage after passage.
pub trait Monitor {
    /// The next passage.
    ///
    /// # Errors
    /// If it refuses the passage, which is an error of the campaign.
    fn pass(&mut self, passage: &Passage) -> Result<Said>;
}

/// What is said after a passage.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Said {
    /// The losses by all passages so far.
    pub estimate: Estimate,
    /// Elements that an alarm names, bit `e` for element `e` from 0; 0: no alarm.
    pub alarm: u16,
    /// Whether the track is said to have changed, with this passage or before.
    pub changed: bool,
    /// Why the passage was of no use; none if it was.
    pub unused: Option<Reason>,
}

/// Version of what is learnt, in the names of kept lessons: to be raised with any change of what the same passages teach.
const LESSONS: u32 = 1;

/// Learnt on the base station, monitored by the logger itself, which is told each train and goes on from the evidence of those before.
#[derive(Debug, Clone)]
pub struct Logged {
    bridge: ReducedBridge<f64>,
    blob: Vec<u8>,
    seed: u64,
    /// Where learnt tracks are kept, so that another campaign over the same viaducts need not learn them again.
    lessons: Option<PathBuf>,
}

impl Logged {
    /// For a bridge; `seed` is that of all searches, and learnt tracks are kept in the folder `lessons`, if there is one.
    ///
    /// # Errors
    /// If its model has no room on a logger.
    pub fn new(bridge: &ReducedBridge<f64>, seed: u64, lessons: Option<PathBuf>) -> Result<Self> {
        Ok(Self {
            bridge: bridge.clone(),
            blob: to_blob(bridge)?,
            seed,
            lessons,
        })
    }

    /// The file of what these passages teach, named by their samples, the bridge's model, the seed and [`LESSONS`].
    fn lesson(&self, passages: &[calibrate::Passage]) -> Option<PathBuf> {
        let mut digest = CRC32C.digest();
        for sample in passages.iter().flat_map(|passage| &passage.observed.samples) {
            digest.update(&sample.to_le_bytes());
        }
        digest.update(&fingerprint(&self.blob).to_le_bytes());
        digest.update(&self.seed.to_le_bytes());
        let name = format!("track-v{LESSONS}-{}-{:08x}.blob", passages.len(), digest.finalize());
        Some(self.lessons.as_ref()?.join(name))
    }
}

/// A track as it was learnt, and as the logger takes it.
#[derive(Debug, Clone)]
pub struct Lesson {
    learnt: LearntTrack,
    blob: Vec<u8>,
}

impl Method for Logged {
    type Learnt = Lesson;

    fn learn(&self, healthy: &[&Passage], nodes: &[u16]) -> Result<Lesson> {
        let passages = (healthy.iter())
            .map(|passage| {
                Ok(calibrate::Passage {
                    name: format!("passage {}", passage.index),
                    train: passage.train(),
                    observed: passage.observed(nodes)?,
                })
            })
            .collect::<Result<Vec<_>>>()?;
        let kept = self.lesson(&passages);
        if let Some(path) = kept.as_ref().filter(|path| path.exists()) {
            return Ok(Lesson {
                learnt: calibrate::read(path, &self.bridge)?,
                blob: fs::read(path)?,
            });
        }
        let options = Options {
            drift_m: DRIFT_M,
            before: None,
            healthy: true,
            seed: self.seed,
        };
        let calibration = calibrate(&passages, &options, &|_, _| ())?;
        let blob = calibration.to_blob(&self.bridge)?;
        if let Some(path) = &kept {
            output::write(&[(path, &blob)])?;
        }
        Ok(Lesson {
            blob,
            learnt: calibration.learnt,
        })
    }

    fn monitor<'a>(&'a self, learnt: &'a Lesson, nodes: &'a [u16]) -> Result<Box<dyn Monitor + 'a>> {
        let mut logger = Box::new(Logger::new());
        logger.load(&self.blob)?;
        logger.load_track(&learnt.blob)?;
        Ok(Box::new(Watching {
            logger,
            learnt: &learnt.learnt,
            basis: Basis {
                bridge: fingerprint(&self.blob),
                track: fingerprint(&learnt.blob),
                spread: &learnt.learnt.spread,
            },
            nodes,
            seed: self.seed,
            evidence: vec![],
        }))
    }
}

/// A logger at work.
struct Watching<'a> {
    logger: Box<Logger>,
    learnt: &'a LearntTrack,
    basis: Basis<'a>,
    nodes: &'a [u16],
    seed: u64,
    /// What it knows of the bridge, as it keeps it.
    evidence: Vec<u8>,
}

impl Monitor for Watching<'_> {
    fn pass(&mut self, passage: &Passage) -> Result<Said> {
        let logger = &mut self.logger;
        logger.configure(passage.configuration(self.nodes, 0, self.seed))?;
        if !self.evidence.is_empty() {
            logger.restore(&self.evidence)?;
        }
        let mut events = vec![];
        let mut work = |logger: &mut Logger| {
            loop {
                let more = logger.poll();
                events.extend(std::iter::from_fn(|| logger.next_event()));
                if !more {
                    break;
                }
            }
        };
        (logger.push(0, &passage.stream(self.nodes)))
            .map_err(|error| anyhow!("the logger takes no samples: {error:?}"))?;
        work(logger);
        logger.finish();
        work(logger);

        let mut buffer = [0; EVIDENCE_BYTES];
        self.evidence = logger.evidence(&mut buffer).to_vec();
        let Memory {
            long_passages,
            recent_passages,
        } = Memory::default();
        let forgetting = Forgetting::new(long_passages, recent_passages)?;
        let (evidence, _) = Evidence::from_bytes(&self.evidence, &self.basis, forgetting)?;
        let mut said = Said {
            estimate: evidence.against(self.learnt).estimate(ELEMENTS),
            alarm: 0,
            changed: logger.track_state() == TrackState::Changed,
            unused: None,
        };
        let mut reports = 0;
        for event in events {
            match event {
                Event::Alert(alert) => said.alarm |= alert.certain,
                Event::Passage(report) => {
                    reports += 1;
                    if let Verdict::NotIdentified(reason) = report.verdict {
                        said.unused = Some(reason);
                    }
                }
                Event::Track(_) => {}
            }
        }
        (reports == 1).then_some(said).with_context(|| {
            format!(
                "passage {} is {reports} passages for the logger; lead or tail are too short",
                passage.index
            )
        })
    }
}

#[cfg(test)]
mod tests {
    use super::super::campaign::{Plan, changes, detection, errors, healthy};
    use super::super::truth::{Change, NOISE, SENSORS, Setting, Speeds, State, Traffic, Viaduct};
    use super::*;
    use crate::calibrate::knots;
    use crate::model;
    use crate::study::noise::campaign::Spread;
    use crate::track::Spectrum;
    use crate::track::prior::fit;
    use spanwatch::capacity::CHANNELS;
    use spanwatch::track::blob;
    use spanwatch::track::learnt::{UNLEARNT, Unexplained};
    use spanwatch::track::profile::Profile;

    const SETTING: Setting = Setting {
        class: Spectrum::Fra6,
        traffic: Traffic::Inspection,
        speeds: Speeds::Spread,
        uneven: false,
        temperature: 0.0,
        change: Change::HALF_A_MILLIMETRE,
    };

    /// Stands in for a calibration: it is shown the true track of the viaduct of seed 1.
    struct Shown {
        logged: Logged,
        coefficients: Vec<f64>,
    }

    impl Shown {
        fn new() -> Self {
            let viaduct = Viaduct::new(&girder50(), &SETTING, 1).expect("a viaduct");
            Self {
                coefficients: fit(viaduct.track(false), &knots(50.0).expect("knots")),
                logged: Logged::new(&viaduct.model, 1, None).expect("a model"),
            }
        }
    }

    impl Method for Shown {
        type Learnt = Lesson;

        fn learn(&self, _: &[&Passage], _: &[u16]) -> Result<Lesson> {
            let coefficients: Vec<f32> = self.coefficients.iter().map(|&c| c as f32).collect();
            let learnt = LearntTrack {
                profile: Profile::new(
                    knots(50.0).and_then(|knots| knots.cast()).expect("knots"),
                    &coefficients,
                ),
                unexplained: [Unexplained {
                    floor: 0.0,
                    part: (NOISE * NOISE) as f32,
                }; CHANNELS],
                // Two in the root of the number of samples of a passage, and what the two models differ by.
                scatter: 0.1,
                passages: 60,
                speeds: [u64::MAX; 2],
                ..UNLEARNT.clone()
            };
            let mut buffer = [0; blob::TRACK_BLOB_BYTES];
            let crc = fingerprint(&self.logged.blob);
            Ok(Lesson {
                blob: blob::write(&learnt, &coefficients, crc, &mut buffer)?.to_vec(),
                learnt,
            })
        }

        fn monitor<'a>(&'a self, learnt: &'a Lesson, nodes: &'a [u16]) -> Result<Box<dyn Monitor + 'a>> {
            self.logged.monitor(learnt, nodes)
        }
    }

    fn girder50() -> model::BridgeFrame {
        model::shipped("girder50").expect("ships")
    }

    fn plan(passages: usize) -> Plan {
        Plan {
            classes: vec![SETTING.class],
            sensors: vec![SENSORS.to_vec()],
            speeds: vec![SETTING.speeds],
            traffic: SETTING.traffic,
            uneven: SETTING.uneven,
            temperature: SETTING.temperature,
            change: SETTING.change,
            // Nothing is learnt from them; but the bound counts them.
            healthy: 40,
            passages,
            viaducts: 1,
            first_seed: 1,
        }
    }

    #[test]
    fn a_track_that_is_known_hides_no_damage_and_is_none() {
        let shown = Shown::new();
        let quiet = healthy(&girder50(), &plan(4), &shown, &|_| ()).expect("monitors");
        let of = quiet[0].monitored().next().expect("a viaduct");
        assert_eq!((of.passages, of.used, of.alarms, of.changed), (4, 4, 0, None));

        let found = detection(&girder50(), &plan(4), &[4], &[0.2], &shown, &|_| ()).expect("monitors");
        let found = found[0].monitored().next().expect("a viaduct")[0];
        assert!(found.after.is_some() && !found.wrong, "{found:?}");
    }

    #[test]
    fn a_change_of_the_track_is_reported() {
        let rows = changes(&girder50(), &plan(6), &Shown::new(), &|_| ()).expect("monitors");
        let of = rows[0].monitored().next().expect("a viaduct");
        assert!(of.changed.is_some() && of.alarms == 0, "{of:?}");
    }

    #[test]
    fn losses_everywhere_are_found_as_well_as_can_be() {
        let worn = State {
            damage: [0.1; ELEMENTS],
            ..State::HEALTHY
        };
        let rows = errors(&girder50(), &plan(4), &worn, &Shown::new(), &|_| ()).expect("monitors");
        let (rmse, bound) = (Spread::of(&rows[0].rmse()), Spread::of(&rows[0].bound()));
        println!("rmse {rmse:?} bound {bound:?}");
        // Ten losses of one viaduct: their root mean square is within a factor of two of its expectation.
        assert!(rmse.rms < 2.0 * bound.rms, "{rmse:?} {bound:?}");
    }
}
