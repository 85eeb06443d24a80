//! What the campaigns are of: a way to learn a track from healthy passages, and to monitor the bridge with what was learnt.

use std::fs;
use std::path::PathBuf;

use anyhow::{Context, Result, anyhow};
use spanwatch::bridge::ReducedBridge;
use spanwatch::capacity::ELEMENTS;
use spanwatch::identify::estimate::Estimate;
use spanwatch::identify::evidence::{EVIDENCE_BYTES, Evidence, Forgetting};
use spanwatch::logger::Logger;
use spanwatch::track::learnt::LearntTrack;
use spanwatch::wire::CRC32C;
use spanwatch::wire::message::{Event, Memory, Reason, TrackState, Verdict};

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

    /// The file of what these passages teach, named by their samples and by all that it depends on.
    fn lesson(&self, passages: &[calibrate::Passage]) -> Option<PathBuf> {
        let mut digest = CRC32C.digest();
        for sample in passages.iter().flat_map(|passage| &passage.observed.samples) {
            digest.update(&sample.to_le_bytes());
        }
        digest.update(&self.blob);
        digest.update(&self.seed.to_le_bytes());
        let name = format!("track-{}-{:08x}.blob", passages.len(), digest.finalize());
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
            model_crc: CRC32C.checksum(&self.blob),
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
    model_crc: u32,
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
        let evidence = Evidence::from_bytes(&self.evidence, self.model_crc, forgetting)?;
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
