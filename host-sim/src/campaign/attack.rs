//! An attacker on the line: hears every frame, sends what it likes, and knows everything but the device's key.
//!
//! Two ends talk without faults; the attacker has every frame that was ever sent, also in earlier sessions, and puts in between frames of
//! its own making, each with a right checksum. Whatever an end does because of one is compared with what the same end would have done
//! without it: nothing may be accepted, and never more bytes may come out than went in.

use std::time::Instant;

use spanwatch::session::packet::{Receipt, Vitals, Welcome};
use spanwatch::session::{Channel, Device, End, Hello, Key, LoggerEnd, StationEnd, ToLogger, ToStation};
use spanwatch::wire::message::{Request, VERSION};
use spanwatch::wire::{Decoder, FrameBuffer, Kind};

use super::forgery::{bare, flip, framed, spliced, truncated};
use super::line::Chance;
use super::link::Backlog;

const DEVICE: Device = 7;
/// Frames of the past that the attacker uses.
const REMEMBERED: usize = 4000;
/// Longest time between an attack and the next, ms.
const PAUSE_MS: u64 = 800;

/// What the attacker does.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Attack {
    /// A frame of the past once more, to the end that it was for.
    Replay,
    /// A frame back to the end that it came from.
    Reflect,
    /// A frame with fewer bytes.
    Truncate,
    /// The head of one frame and the rest of another.
    Splice,
    /// A frame with changed bits.
    Change,
    /// A frame that was sealed by a session of another key.
    WrongKey,
    /// A request, receipt, event or answer in the clear, or with another version in its head.
    Downgrade,
    /// Random bytes.
    Junk,
}

impl Attack {
    /// Every one.
    pub const EACH: [Self; 8] = [
        Self::Replay,
        Self::Reflect,
        Self::Truncate,
        Self::Splice,
        Self::Change,
        Self::WrongKey,
        Self::Downgrade,
        Self::Junk,
    ];
}

/// What a kind of attack has come to.
#[derive(Debug, Clone, Copy)]
pub struct Row {
    /// What the attacker did.
    pub attack: Attack,
    /// How often.
    pub frames: u64,
    /// How often an end took something from it: a request, a message, a receipt, a session.
    pub accepted: u64,
    /// Bytes that the attacker sent.
    pub bytes_in: u64,
    /// Bytes that came out because of them.
    pub bytes_out: u64,
    /// Frames to which more bytes came out than went in.
    pub amplified: u64,
    /// Alerts that did not come through all the same.
    pub lost: u64,
    /// Its seed.
    pub seed: u64,
    /// Time that it took, s.
    pub seconds: f64,
}

impl Row {
    /// Nothing was accepted, answered at length, or lost.
    pub fn is_clean(&self) -> bool {
        [self.accepted, self.amplified, self.lost] == [0; 3]
    }
}

/// Every kind of attack, `frames` of each.
pub fn run(frames: u64, seed: u64, mut done: impl FnMut(&Row)) -> Vec<Row> {
    let attack = |attack| {
        let row = Scene::new(seed).attacked(attack, frames, seed);
        done(&row);
        row
    };
    Attack::EACH.map(attack).to_vec()
}

/// What an end has in its memory that an attack could change.
#[derive(Debug, Clone, PartialEq, Eq)]
struct Effects {
    requests: u64,
    messages: u64,
    acknowledged: u32,
    sessions: u64,
}

#[derive(Clone)]
struct Scene {
    chance: Chance,
    now_ms: u64,
    key: Key,
    backlog: Backlog,
    logger: LoggerEnd,
    logger_decoder: Decoder,
    station: StationEnd,
    station_decoder: Decoder,
    stored: u32,
    effects: Effects,
    /// Requests that the base station has sent.
    asked: u32,
    /// Frames to the logger and to the station that were ever sent.
    heard: [Vec<Vec<u8>>; 2],
}

const TO_LOGGER: usize = 0;
const TO_STATION: usize = 1;

impl Scene {
    fn new(seed: u64) -> Self {
        let key = Key::new(*b"a key that no attacker knows ...");
        Self {
            chance: Chance::new(seed),
            now_ms: 1,
            logger: LoggerEnd::new(DEVICE, 1, key.clone(), 1),
            key,
            backlog: Backlog::default(),
            logger_decoder: Decoder::new(),
            station: StationEnd::new(),
            station_decoder: Decoder::new(),
            stored: 0,
            effects: Effects {
                requests: 0,
                messages: 0,
                acknowledged: 0,
                sessions: 0,
            },
            asked: 0,
            heard: [vec![], vec![]],
        }
    }

    fn attacked(mut self, attack: Attack, frames: u64, seed: u64) -> Row {
        let start = Instant::now();
        let mut row = Row {
            attack,
            frames: 0,
            accepted: 0,
            bytes_in: 0,
            bytes_out: 0,
            amplified: 0,
            lost: 0,
            seed,
            seconds: 0.0,
        };
        let mut starts = 1;
        while row.frames < frames {
            self.now_ms += 1 + self.chance.below(PAUSE_MS);
            if self.chance.below(500) == 0 {
                // Ends restart, so that there are sessions of the past.
                starts += 1;
                self.logger = LoggerEnd::new(DEVICE, 1, self.key.clone(), starts);
            }
            if self.chance.below(3) == 0 {
                self.backlog.make(1);
            }
            self.talk(true);
            let Some((to, frame)) = self.forge(attack) else {
                continue;
            };
            row.frames += 1;
            row.bytes_in += frame.len() as u64;
            // What would have come without it is what comes with the same chances.
            let heard = std::mem::take(&mut self.heard);
            let mut without = self.clone();
            self.heard = heard;
            without.deliver(to, &[0]);
            let expected = without.answer(to);
            self.deliver(to, &frame);
            let answered = self.answer(to);
            row.accepted += u64::from(without.effects != self.effects);
            let more = answered.saturating_sub(expected);
            row.bytes_out += more;
            row.amplified += u64::from(more > frame.len() as u64);
        }
        // Afterwards all is as if nothing had been.
        self.backlog.make(10);
        for _ in 0..200 {
            self.now_ms += 1000;
            self.talk(false);
        }
        row.lost = u64::from(self.backlog.made() - self.stored);
        row.seconds = start.elapsed().as_secs_f64();
        row
    }

    /// Everything that the ends have to say to each other now, over a line without faults.
    fn talk(&mut self, ask: bool) {
        if ask && self.chance.below(4) == 0 {
            self.asked += 1;
            let mut out = FrameBuffer::new();
            if let Ok(frame) = self.station.seal(Kind::Request, self.asked, &Request::Status, &mut out) {
                let frame = frame.to_vec();
                self.remember(TO_LOGGER, &frame);
                self.deliver(TO_LOGGER, &frame);
            }
        }
        loop {
            let said = [self.say(TO_LOGGER), self.say(TO_STATION)];
            if said.iter().all(Vec::is_empty) {
                return;
            }
            for (to, frames) in [(TO_LOGGER, &said[0]), (TO_STATION, &said[1])] {
                for frame in frames {
                    self.remember(to, frame);
                    self.deliver(to, frame);
                }
            }
        }
    }

    fn remember(&mut self, to: usize, frame: &[u8]) {
        let heard = &mut self.heard[to];
        if heard.len() < REMEMBERED {
            heard.push(frame.to_vec());
        } else {
            let place = self.chance.below(REMEMBERED as u64) as usize;
            heard[place] = frame.to_vec();
        }
    }

    /// The frames that an end sends now to the end `to`.
    fn say(&mut self, to: usize) -> Vec<Vec<u8>> {
        let mut out = FrameBuffer::new();
        let mut frames = vec![];
        if to == TO_LOGGER {
            while let Some(frame) = self.station.poll(self.now_ms, &mut out) {
                frames.push(frame.to_vec());
            }
            return frames;
        }
        while let Ok(Some(frame)) = self
            .logger
            .poll(self.now_ms, 0, &mut self.backlog, |_| Vitals::default(), &mut out)
        {
            frames.push(frame.to_vec());
        }
        frames
    }

    /// Bytes that the end `from` sends now.
    fn answer(&mut self, from: usize) -> u64 {
        let frames = self.say(1 - from);
        frames.iter().map(|frame| frame.len() as u64).sum()
    }

    fn deliver(&mut self, to: usize, bytes: &[u8]) {
        for &byte in bytes {
            if to == TO_LOGGER {
                let Some(frame) = self.logger_decoder.push(byte) else {
                    continue;
                };
                let was_up = self.logger.is_up();
                match self.logger.on_frame(frame, self.now_ms, &mut self.backlog) {
                    Ok(ToLogger::Request(_)) => self.effects.requests += 1,
                    _ => self.effects.sessions += u64::from(was_up != self.logger.is_up()),
                }
                self.effects.acknowledged = self.backlog.confirmed();
                continue;
            }
            let Some(frame) = self.station_decoder.push(byte) else {
                continue;
            };
            match self.station.on_frame(frame, self.now_ms) {
                ToStation::Hello(hello) if hello.device == DEVICE => self.welcome(&hello),
                ToStation::Parcel { sequence, .. } => {
                    self.effects.messages += 1;
                    self.stored = sequence;
                    self.station.stored(sequence);
                }
                ToStation::Heartbeat(_) | ToStation::Answer(_) | ToStation::Lost { .. } => self.effects.messages += 1,
                _ => {}
            }
        }
    }

    fn welcome(&mut self, hello: &Hello) {
        let nonce = self.chance.bytes(16).try_into().unwrap_or_default();
        let mut out = FrameBuffer::new();
        let welcome = Welcome {
            stream: 1,
            stored: self.stored,
            time_ms: self.now_ms,
        };
        if let Some(frame) = self
            .station
            .welcome(hello, &self.key, nonce, welcome, self.now_ms, &mut out)
        {
            let frame = frame.to_vec();
            self.remember(TO_LOGGER, &frame);
            self.deliver(TO_LOGGER, &frame);
        }
    }

    fn some(&mut self, to: usize) -> Option<Vec<u8>> {
        let frames = self.heard[to].len() as u64;
        let place = self.chance.below(frames) as usize;
        self.heard[to].get(place).cloned()
    }

    /// A frame of the attacker's, and the end that it is for.
    fn forge(&mut self, attack: Attack) -> Option<(usize, Vec<u8>)> {
        let to = self.chance.below(2) as usize;
        let frame = match attack {
            Attack::Replay => self.some(to)?,
            Attack::Reflect => self.some(1 - to)?,
            Attack::Truncate => framed(truncated(bare(&self.some(to)?), &mut self.chance)),
            Attack::Splice => {
                let (head, rest) = (bare(&self.some(to)?), bare(&self.some(to)?));
                framed(spliced(&head, &rest, &mut self.chance))
            }
            Attack::Change => {
                let mut bare = bare(&self.some(to)?);
                flip(&mut bare, 3, &mut self.chance);
                framed(bare)
            }
            Attack::WrongKey => self.sealed_by_another(to),
            Attack::Downgrade => self.downgraded(to)?,
            Attack::Junk => {
                let length = 1 + self.chance.below(700) as usize;
                let mut bytes = self.chance.bytes(length);
                bytes.push(0);
                bytes
            }
        };
        Some((to, frame))
    }

    fn sealed_by_another(&mut self, to: usize) -> Vec<u8> {
        let key = match self.chance.below(2) {
            0 => Key::DEMO,
            _ => Key::new(self.chance.bytes(32).try_into().unwrap_or_default()),
        };
        let [logger, station] = [0, 1].map(|_| self.chance.bytes(16).try_into().unwrap_or_default());
        let hello = Hello {
            device: DEVICE,
            key: 0,
            stream: 1,
            nonce: logger,
        };
        let end = [End::Station, End::Logger][to];
        let channel = Channel::new(end, &key, &hello, &station);
        let kinds = [
            [Kind::Request, Kind::Receipt, Kind::Time],
            [Kind::Parcel, Kind::Heartbeat, Kind::Answer],
        ];
        let kind = kinds[to][self.chance.below(3) as usize];
        let counter = self.chance.below(200) as u32;
        let mut out = FrameBuffer::new();
        let receipt = Receipt { stored: u32::MAX / 2 };
        let frame = out.write_sealed(
            counter,
            kind,
            1,
            |room| postcard::to_slice(&receipt, room).ok().map(|written| written.len()),
            |bytes| channel.seal(Kind::Sealed as u8, counter, bytes),
        );
        frame.map(<[u8]>::to_vec).unwrap_or_default()
    }

    fn downgraded(&mut self, to: usize) -> Option<Vec<u8>> {
        if self.chance.below(2) == 0 {
            let mut bare = bare(&self.some(to)?);
            bare[0] = (VERSION + self.chance.below(256) as u8) % VERSION.max(1);
            return Some(framed(bare));
        }
        let mut out = FrameBuffer::new();
        let number = self.chance.below(100) as u32;
        let frame = match self.chance.below(4) {
            0 => out.write(Kind::Request, number, &Request::Finish),
            1 => out.write(Kind::Receipt, number, &Receipt { stored: u32::MAX / 2 }),
            2 => out.write(Kind::Parcel, number, &(1_u32, 0_u32)),
            _ => out.write(Kind::Time, number, &(self.now_ms, self.now_ms)),
        };
        frame.ok().map(<[u8]>::to_vec)
    }
}

/// The rows as text.
pub fn table(rows: &[Row]) -> String {
    use std::fmt::Write as _;
    let mut text = String::from(
        "| attack | frames | accepted | bytes in | bytes out | more out than in | alerts lost | s |\n|---|---|---|---|---|---|---|---|\n",
    );
    for row in rows {
        // Writing to a string cannot fail.
        let _ = writeln!(
            text,
            "| {} | {} | {} | {} | {} | {} | {} | {:.1} |",
            format!("{:?}", row.attack).to_lowercase(),
            row.frames,
            row.accepted,
            row.bytes_in,
            row.bytes_out,
            row.amplified,
            row.lost,
            row.seconds
        );
    }
    text
}
