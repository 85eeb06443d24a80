//! Recorded passages through a logger: each recording's raw counts in blocks, as a sensor's driver would deliver them.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail};
use spanwatch::bridge::ReducedBridge;
use spanwatch::guess;
use spanwatch::interaction::Direction;
use spanwatch::wire::message::{
    Alert, BLOCK_COUNTS, Channel, Configuration, Event, Memory, PassagePiece, PassageReport, Quantity, Ranges, Status,
    TrackReport, Traffic, Trigger, Verdict,
};

use crate::recording::{Recording, Run};
use crate::station::{Heard, Station, words};
use crate::train::TrainName;
use crate::{model, terminal};

/// Seed of the logger's search where nobody gives one.
pub const DEFAULT_SEED: u64 = 1;
/// How far off is what a recording says of its run, where a track is learnt: a timetable's or a trackside unit's values.
const ROUGHLY: Ranges = Ranges {
    speed: 0.02,
    entry_s: 0.1,
    load: 0.05,
    stiffness: 0.005,
};

/// A recording that is ready to be replayed.
pub struct Prepared {
    /// File it came from.
    pub path: PathBuf,
    /// What was read.
    pub recording: Recording,
    /// Its bridge, if it names one.
    pub bridge: Option<ReducedBridge<f64>>,
    /// What the logger is told of it.
    pub configuration: Configuration,
}

/// Something that a logger said of a recording, with times on the recording's clock, s.
pub enum Told {
    /// A passage.
    Passage {
        /// What the logger says.
        report: PassageReport,
        /// Beginning.
        start_s: f64,
        /// End.
        end_s: f64,
    },
    /// An alert.
    Alert {
        /// As it came.
        heard: Box<Heard>,
        /// What the logger says.
        alert: Alert,
        /// Beginning of its passage.
        start_s: f64,
    },
    /// The track has changed.
    Track {
        /// What the logger says.
        report: TrackReport,
        /// Beginning of the passage that has shown it.
        start_s: f64,
    },
}

/// Reads a recording and everything it needs, and checks it, before any logger is asked. `bridge`, the name of a bridge
/// that comes with the program or a bridge file, takes the place of the one that the recording names.
pub fn prepare(path: &Path, bridge: Option<&str>, seed: u64) -> Result<Prepared> {
    let recording = Recording::read(path)?;
    let name = path.display();
    let bridge = match bridge.or(recording.bridge.as_deref()) {
        Some(bridge) => {
            let file = model::find(bridge).with_context(|| name.to_string())?;
            Some(model::reduce::reduce(&file)?)
        }
        None => None,
    };
    if let Some(bridge) = &bridge {
        for channel in &recording.channels {
            let place = channel.node.and_then(|node| bridge.sensor_at(node));
            if place.is_some_and(|place| bridge.sensors.column(place).iter().all(|&moves| moves == 0.0)) {
                bail!(
                    "{name}: channel \"{}\" is at a support of bridge \"{}\", which does not move; check its node",
                    channel.column,
                    bridge.name
                );
            }
            if let Some(node) = channel.node.filter(|&node| bridge.sensor_at(node).is_none()) {
                bail!(
                    "{name}: channel \"{}\" is at node {node}, but bridge \"{}\" has nodes 1 to {}",
                    channel.column,
                    bridge.name,
                    bridge.sensor_count
                );
            }
        }
    }
    let configuration = configuration(&recording, seed);
    configuration.check().with_context(|| name.to_string())?;
    Ok(Prepared {
        path: path.to_owned(),
        recording,
        bridge,
        configuration,
    })
}

fn configuration(recording: &Recording, seed: u64) -> Configuration {
    let traffic = || {
        let Some(TrainName::Known(train)) = recording.train else {
            return None;
        };
        Some(Traffic {
            train,
            cars: recording.cars? as u8,
            speed_mps: recording.speed_kmh.map(|speed| (speed / 3.6) as f32),
            acceleration_mps2: recording.acceleration_mps2 as f32,
            backward: recording.direction == Direction::Backward,
            entry_time_s: recording.entry_in_stream_s(),
            load_factor: recording.load_factor.unwrap_or(1.0) as f32,
            ranges: ranges(recording),
        })
    };
    let channel = |channel: &crate::recording::Channel| Channel {
        node: channel.node.unwrap_or(0),
        quantity: channel.unit.quantity(),
        lsb: channel.lsb,
        full_scale_counts: channel.full_scale_counts,
    };
    Configuration {
        sample_rate_hz: recording.rate_hz() as f32,
        channels: recording.channels.iter().map(channel).collect(),
        trigger: Trigger::default(),
        antialias_hz: recording.antialias_hz.map(|hz| hz as f32),
        traffic: traffic(),
        memory: Memory::default(),
        seed,
    }
}

/// How far off the expected run may be: nothing where a value is given and nobody says that it is not sure. (A speed and an entry
/// time that are not given come with their own ranges, from the passage.)
fn ranges(recording: &Recording) -> Ranges {
    let margins = &recording.margins;
    let load = match recording.load_factor {
        Some(_) => 0.0,
        None => f64::from(guess::LOAD_RANGE),
    };
    Ranges {
        speed: margins.speed.unwrap_or(0.0) as f32,
        entry_s: margins.entry_s.unwrap_or(0.0) as f32,
        load: margins.load.unwrap_or(load) as f32,
        stiffness: margins.stiffness.unwrap_or(0.0) as f32,
    }
}

impl Prepared {
    /// Refuses a recording of a track that is said to be irregular, where none was learnt.
    ///
    /// # Errors
    /// It is one.
    pub fn refuse_irregular(&self) -> Result<()> {
        if self.recording.track.is_some() {
            bail!(
                "{}: its track is irregular; learn it from healthy passages (host-sim calibrate) and give --track. Without the key \
                 track in the TOML the track is taken for smooth, and what is found then is not to be relied on",
                self.path.display()
            );
        }
        Ok(())
    }

    /// What a recording says of its run is only roughly right, or as far off as its `[range]` says: so it is where a track is learnt, and
    /// where one that was learnt is monitored with. What it does not say keeps the range that it has for that.
    pub fn loosen(&mut self) {
        let recording = &self.recording;
        let margins = recording.margins;
        let Some(traffic) = &mut self.configuration.traffic else {
            return;
        };
        let ranges = &mut traffic.ranges;
        let told = [
            (
                &mut ranges.speed,
                margins.speed,
                recording.speed_kmh.is_some(),
                ROUGHLY.speed,
            ),
            (
                &mut ranges.entry_s,
                margins.entry_s,
                recording.entry_time_s.is_some(),
                ROUGHLY.entry_s,
            ),
            (
                &mut ranges.load,
                margins.load,
                recording.load_factor.is_some(),
                ROUGHLY.load,
            ),
            (&mut ranges.stiffness, margins.stiffness, true, ROUGHLY.stiffness),
        ];
        for (range, margin, given, roughly) in told {
            if margin.is_none() && given {
                *range = roughly;
            }
        }
    }

    /// The configuration for every train of this kind: without the speed and the entry time of this one.
    pub fn watching(&self) -> Configuration {
        let mut configuration = self.configuration.clone();
        if let Some(traffic) = &mut configuration.traffic {
            traffic.speed_mps = None;
            traffic.entry_time_s = None;
        }
        configuration
    }

    /// What each channel measures.
    pub fn quantities(&self) -> Vec<Quantity> {
        self.configuration
            .channels
            .iter()
            .map(|channel| channel.quantity)
            .collect()
    }

    /// What the TOML leaves open that nothing can be identified without.
    pub fn missing_keys(&self) -> Vec<&'static str> {
        let recording = &self.recording;
        [("bridge", self.bridge.is_none()), ("train", recording.train.is_none())]
            .into_iter()
            .filter_map(|(key, missing)| missing.then_some(key))
            .collect()
    }

    /// Replays the recording; `tell` hears of everything that the logger says, as it comes. The logger monitors with the learnt
    /// `track`, and goes on from `evidence`, if there are any.
    pub fn replay(
        &self,
        station: &mut Station,
        track: Option<&[u8]>,
        evidence: Option<&[u8]>,
        tell: impl FnMut(&Told) -> Result<()>,
    ) -> Result<Status> {
        self.replay_keeping(station, track, evidence, tell, None)
    }

    /// As [`Self::replay`]; `keep` is given every passage that the learnt track did not explain, with its number.
    pub fn replay_keeping(
        &self,
        station: &mut Station,
        track: Option<&[u8]>,
        evidence: Option<&[u8]>,
        mut tell: impl FnMut(&Told) -> Result<()>,
        mut keep: Option<&mut Keep<'_>>,
    ) -> Result<Status> {
        if let Some(bridge) = &self.bridge {
            station.load(bridge)?;
        }
        if let Some(track) = track {
            station.keep_track(track)?;
        }
        station.configure(&self.configuration)?;
        if let Some(evidence) = evidence {
            station.restore(evidence)?;
        }
        let channels = self.recording.channels.len();
        let rows = BLOCK_COUNTS / channels;
        let counts = self.recording.to_counts();
        let bar = terminal::progress(self.recording.rows() as u64, "replaying");
        for run in &self.recording.runs {
            let first = run.first_row * channels;
            let of_run = &counts[first..first + run.rows * channels];
            for (block, counts) in of_run.chunks(rows * channels).enumerate() {
                station.samples(run.first_sample + (block * rows) as u64, counts)?;
                bar.inc((counts.len() / channels) as u64);
                self.hear(station, &mut tell, keep.as_deref_mut())?;
            }
        }
        let status = station.finish()?;
        if status.samples != self.recording.rows() as u64 {
            bail!(
                "the logger has taken {} of {} samples: it has restarted {} while it was working",
                status.samples,
                self.recording.rows(),
                words::restart(status.health.restart)
            );
        }
        self.hear(station, &mut tell, keep)?;
        bar.finish_and_clear();
        Ok(status)
    }

    fn hear(
        &self,
        station: &mut Station,
        tell: &mut impl FnMut(&Told) -> Result<()>,
        keep: Option<&mut Keep<'_>>,
    ) -> Result<()> {
        let mut strange = None;
        let time_s = |sample: u64| self.recording.start_s + sample as f64 * self.recording.interval_s;
        while let Some(heard) = station.next_heard() {
            let event = heard.notice.event.clone();
            if let Event::Passage(report) = &event
                && let Verdict::NotIdentified(reason) = report.verdict
                && reason.may_be_the_track()
            {
                strange = Some(report.passage);
            }
            tell(&match event {
                Event::Passage(report) => Told::Passage {
                    start_s: time_s(report.start_sample),
                    end_s: time_s(report.end_sample),
                    report,
                },
                Event::Alert(alert) => Told::Alert {
                    start_s: time_s(alert.start_sample),
                    heard: Box::new(heard),
                    alert,
                },
                Event::Track(report) => Told::Track {
                    start_s: time_s(report.start_sample),
                    report,
                },
            })?;
            station.confirm()?;
        }
        if let (Some(keep), Some(number)) = (keep, strange)
            && let Some((first, values)) = station.strange_passage()?
            && first.passage == number
        {
            keep(&self.kept(&first, &values), number)?;
        }
        Ok(())
    }

    /// A passage as a recording of its own, on the clock of this one.
    fn kept(&self, first: &PassagePiece, values: &[f32]) -> Recording {
        let mut kept = self.recording.clone();
        let channels = usize::from(first.channels).max(1);
        kept.start_s += first.first_sample as f64 * kept.interval_s;
        // It names a file beside the recording, and what was learnt of the track takes its place.
        kept.track = None;
        kept.runs.clear();
        kept.channels.iter_mut().for_each(|channel| channel.values.clear());
        for (sample, row) in (0..).zip(values.chunks_exact(channels)) {
            // A row that lacks a value is left out, as in any recording.
            if row.iter().any(|value| value.is_nan()) {
                continue;
            }
            let first_row = kept.rows();
            match kept.runs.last_mut() {
                Some(run) if run.first_sample + run.rows as u64 == sample => run.rows += 1,
                _ => kept.runs.push(Run {
                    first_row,
                    first_sample: sample,
                    rows: 1,
                }),
            }
            for (channel, &value) in kept.channels.iter_mut().zip(row) {
                channel.values.push(value.into());
            }
        }
        kept
    }
}

/// Hears of a passage and its number.
pub type Keep<'a> = dyn FnMut(&Recording, u32) -> Result<()> + 'a;
