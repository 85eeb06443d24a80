//! Both ends of a session that talk over a line which changes, repeats and invents frames, at any time; one of them may be faulty and seal
//! nonsense with the right key.

use std::collections::{BTreeMap, VecDeque};

use spanwatch::session::packet::{Heartbeat, Receipt, Time, Vitals, Welcome};
use spanwatch::session::{Hello, Key, LoggerEnd, StationEnd, ToLogger, ToStation, WINDOW};
use spanwatch::wire::message::Request;
use spanwatch::wire::{Decoder, Frame, FrameBuffer, Kind};

use super::mutation::{Raw, mutate, posted, whole};
use super::{Counts, must};
use crate::campaign::forgery::{bare, flip, framed, spliced, truncated};
use crate::campaign::line::Chance;
use crate::campaign::link::{Backlog, alert};

const DEVICE: u32 = 7;
/// No clock comes farther, ms: half of what its number can hold.
const LAST_MS: u64 = u64::MAX / 2;
/// What happens in a run.
const EVENTS: u64 = 60;
/// Frames that an end may have to say at once: a heartbeat, a hello, a window of parcels; a knock, a receipt, the time.
const LOGGER_SAYS: usize = 2 + WINDOW;
const STATION_SAYS: usize = 3;
/// Frames of the past that may come again.
const REMEMBERED: usize = 40;

/// Which end seals nonsense.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Faulty {
    Neither,
    Logger,
    Station,
}

struct World<'c> {
    chance: &'c mut Chance,
    faulty: Faulty,
    key: Key,
    now_ms: u64,
    starts: u32,
    backlog: Backlog,
    logger: LoggerEnd,
    logger_decoder: Decoder,
    station: StationEnd,
    station_decoder: Decoder,
    disk: u32,
    /// Frames under way to the logger and to the station, and some of the past.
    under_way: [VecDeque<Vec<u8>>; 2],
    past: [Vec<Vec<u8>>; 2],
    /// The logger's nonce of each session: offered last, of the station's session, of the logger's.
    nonces: [[u8; 16]; 4],
    /// Requests that were sealed and not obeyed, by number: in which session.
    asked: BTreeMap<u32, [u8; 16]>,
    requests: u32,
    counts: Counts,
}

const TO_LOGGER: usize = 0;
const TO_STATION: usize = 1;
/// Places in [`World::nonces`].
const SAID: usize = 0;
const OFFERED: usize = 1;
const OF_STATION: usize = 2;
const OF_LOGGER: usize = 3;

/// A conversation.
pub(super) fn run(chance: &mut Chance) -> Result<Counts, String> {
    let key = Key::new(*b"a key of the fuzz campaign only.");
    let mut world = World {
        faulty: chance.pick(&[Faulty::Neither, Faulty::Logger, Faulty::Station]),
        now_ms: if chance.once_in(10) {
            whole(chance).min(LAST_MS)
        } else {
            1
        },
        chance,
        starts: 1,
        backlog: Backlog::default(),
        logger: LoggerEnd::new(DEVICE, 1, key.clone(), 1),
        key,
        logger_decoder: Decoder::new(),
        station: StationEnd::new(),
        station_decoder: Decoder::new(),
        disk: 0,
        under_way: Default::default(),
        past: Default::default(),
        nonces: [[0; 16]; 4],
        asked: BTreeMap::new(),
        requests: 0,
        counts: Counts::default(),
    };
    for _ in 0..world.chance.below(EVENTS) {
        world.event()?;
    }
    Ok(world.counts)
}

impl World<'_> {
    fn event(&mut self) -> Result<(), String> {
        match self.chance.below(24) {
            0 => self.now_ms = self.now_ms.saturating_add(1 + self.chance.below(40_000)),
            1 if self.chance.once_in(8) => self.now_ms = whole(self.chance).min(LAST_MS),
            2 | 3 => self.backlog.make(1 + self.chance.below(12) as u32),
            4 => self.ask(),
            5 if self.chance.once_in(3) => {
                self.starts += 1;
                self.logger = LoggerEnd::new(DEVICE, 1, self.key.clone(), self.starts);
                self.nonces[OF_LOGGER] = [0; 16];
            }
            6 if self.chance.once_in(3) => {
                self.station = StationEnd::new();
                self.nonces[OF_STATION] = [0; 16];
            }
            7 => self.nonsense(),
            8 => {
                let to = self.chance.below(2) as usize;
                let frame = self.forged(to);
                self.deliver(to, &frame)?;
            }
            9 => {
                // Out of order, again, or never.
                let to = self.chance.below(2) as usize;
                let line = &mut self.under_way[to];
                match (self.chance.below(3), line.len()) {
                    (_, 0) => {}
                    (0, _) => drop(line.pop_front()),
                    (1, count) => line.swap(0, self.chance.below(count as u64) as usize),
                    _ => line.extend(line.front().cloned()),
                }
            }
            10..14 => {
                self.now_ms = self.now_ms.saturating_add(self.chance.below(1500));
                self.say()?;
            }
            _ => {
                self.now_ms = self.now_ms.saturating_add(self.chance.below(20));
                self.say()?;
                for to in [TO_LOGGER, TO_STATION] {
                    while let Some(frame) = self.under_way[to].pop_front() {
                        self.deliver(to, &frame)?;
                    }
                }
            }
        }
        Ok(())
    }

    fn send(&mut self, to: usize, frame: Vec<u8>) {
        let past = &mut self.past[to];
        if past.len() < REMEMBERED {
            past.push(frame.clone());
        } else {
            past[self.chance.below(REMEMBERED as u64) as usize] = frame.clone();
        }
        self.under_way[to].push_back(frame);
    }

    /// Everything that the ends have to say now.
    fn say(&mut self) -> Result<(), String> {
        let mut out = FrameBuffer::new();
        for spoken in 0.. {
            let said = self
                .logger
                .poll(
                    self.now_ms,
                    self.chance.any(),
                    &mut self.backlog,
                    |_| Vitals::default(),
                    &mut out,
                )
                .map_err(|error| format!("the logger's end failed: {error}"))?;
            let Some(frame) = said.map(<[u8]>::to_vec) else { break };
            must!(
                spoken < LOGGER_SAYS,
                "the logger says more than {LOGGER_SAYS} frames at once at {} ms",
                self.now_ms
            );
            if let Some(hello) = hello_of(&frame) {
                self.nonces[SAID] = hello.nonce;
            }
            self.send(TO_STATION, frame);
        }
        for spoken in 0.. {
            let Some(frame) = self.station.poll(self.now_ms, &mut out).map(<[u8]>::to_vec) else {
                break;
            };
            must!(
                spoken < STATION_SAYS,
                "the station says more than {STATION_SAYS} frames at once"
            );
            self.send(TO_LOGGER, frame);
        }
        Ok(())
    }

    fn ask(&mut self) {
        self.requests += 1;
        let mut out = FrameBuffer::new();
        if let Ok(frame) = self
            .station
            .seal(Kind::Request, self.requests, &Request::Status, &mut out)
        {
            let frame = frame.to_vec();
            self.asked.insert(self.requests, self.nonces[OF_STATION]);
            self.send(TO_LOGGER, frame);
        }
    }

    /// Something that a faulty end has sealed.
    fn nonsense(&mut self) {
        let mut out = FrameBuffer::new();
        let number = whole(self.chance) as u32;
        let mut bytes = match self.chance.below(5) {
            0 => posted(&Receipt {
                stored: whole(self.chance) as u32,
            }),
            1 => posted(&Time {
                uptime_ms: whole(self.chance),
                time_ms: whole(self.chance),
            }),
            2 => posted(&Heartbeat {
                uptime_ms: whole(self.chance),
                starts: number,
                acknowledged: whole(self.chance) as u32,
                vitals: Vitals::default(),
            }),
            3 => {
                let head = [whole(self.chance) as u32, whole(self.chance) as u32];
                let length = self.chance.below(200) as usize;
                [head.map(u32::to_le_bytes).as_flattened(), &self.chance.bytes(length)].concat()
            }
            _ => {
                let length = self.chance.below(500) as usize;
                self.chance.bytes(length)
            }
        };
        if self.chance.once_in(3) {
            mutate(&mut bytes, &[], self.chance);
        }
        let to_logger = [
            Kind::Receipt,
            Kind::Time,
            Kind::Receipt,
            Kind::Welcome,
            Kind::Sealed,
            Kind::Parcel,
        ];
        let to_station = [
            Kind::Heartbeat,
            Kind::Parcel,
            Kind::Answer,
            Kind::Hello,
            Kind::Event,
            Kind::Sealed,
        ];
        let (to, sealed) = match self.faulty {
            Faulty::Neither => return,
            Faulty::Station => {
                let kind = self.chance.pick(&to_logger);
                (TO_LOGGER, self.station.seal(kind, number, &Raw(&bytes), &mut out))
            }
            Faulty::Logger => {
                let kind = self.chance.pick(&to_station);
                (TO_STATION, self.logger.seal(kind, number, &Raw(&bytes), &mut out))
            }
        };
        if let Ok(frame) = sealed {
            let frame = frame.to_vec();
            self.send(to, frame);
        }
    }

    /// A frame of the past, changed, or one of nothing.
    fn forged(&mut self, to: usize) -> Vec<u8> {
        let some = |world: &mut Self| {
            let all = &world.past[to];
            let place = world.chance.below(all.len() as u64) as usize;
            all.get(place).cloned().unwrap_or_else(|| vec![0, 1, 0])
        };
        let frame = some(self);
        let plain = bare(&frame);
        match self.chance.below(6) {
            0 => frame,
            1 if plain.len() > 8 => framed(truncated(plain, self.chance)),
            2 => {
                let other = bare(&some(self));
                framed(spliced(&plain, &other, self.chance))
            }
            3 => {
                let mut plain = plain;
                flip(&mut plain, 3, self.chance);
                framed(plain)
            }
            4 => {
                let mut plain = plain;
                mutate(&mut plain, &[], self.chance);
                framed(plain)
            }
            _ => {
                let length = self.chance.below(300) as usize;
                self.chance.bytes(length)
            }
        }
    }

    fn deliver(&mut self, to: usize, bytes: &[u8]) -> Result<(), String> {
        for &byte in bytes {
            if to == TO_STATION {
                self.station_hears(byte)?;
                continue;
            }
            let Some(frame) = self.logger_decoder.push(byte) else {
                continue;
            };
            let (before, refused) = (self.backlog.confirmed(), self.logger.refusals());
            let welcome = frame.kind == Kind::Welcome;
            let heard = self
                .logger
                .on_frame(frame, self.now_ms, &mut self.backlog)
                .map_err(|error| format!("the logger's end failed: {error}"))?;
            if let ToLogger::Request(Frame { sequence, .. }) = heard {
                let session = self.asked.remove(&sequence);
                must!(
                    session == Some(self.nonces[OF_LOGGER]),
                    "request {sequence} was obeyed, which nobody has made in this session"
                );
            }
            let taken = self.logger.refusals() == refused;
            self.counts.accepted += u64::from(taken);
            self.counts.refused += u64::from(!taken);
            if welcome && taken {
                self.nonces[OF_LOGGER] = self.nonces[SAID];
            }
            let now = self.backlog.confirmed();
            must!(now >= before, "confirmed was {before} and is {now}");
            must!(
                now <= self.backlog.made(),
                "{now} is confirmed, of {} that were made",
                self.backlog.made()
            );
        }
        Ok(())
    }

    fn station_hears(&mut self, byte: u8) -> Result<(), String> {
        let Some(frame) = self.station_decoder.push(byte) else {
            return Ok(());
        };
        let (refused, sessions) = (self.station.refusals(), self.station.sessions());
        let mut hello = None;
        match self.station.on_frame(frame, self.now_ms) {
            ToStation::Hello(said) => hello = Some(said),
            ToStation::Parcel {
                sequence,
                previous,
                message,
            } => {
                if self.faulty == Faulty::Neither {
                    must!(message == alert(sequence), "message {sequence} is another");
                    must!(sequence == self.disk + 1, "{sequence} came behind {}", self.disk);
                }
                if self.faulty != Faulty::Station {
                    must!(previous <= self.disk, "{previous} is missing before {sequence}");
                    must!(sequence > self.disk, "{sequence} came again, {} is stored", self.disk);
                }
                if self.chance.once_in(10) {
                    self.station.not_stored();
                } else {
                    self.disk = sequence;
                    self.station.stored(sequence);
                }
            }
            ToStation::Lost {
                stored, acknowledged, ..
            } => must!(
                self.faulty != Faulty::Neither,
                "{acknowledged} is believed to be stored, {stored} is"
            ),
            _ => {}
        }
        let taken = self.station.refusals() == refused;
        self.counts.accepted += u64::from(taken);
        self.counts.refused += u64::from(!taken);
        if self.station.sessions() != sessions {
            self.nonces[OF_STATION] = self.nonces[OFFERED];
        }
        if let Some(hello) = hello {
            self.welcome(&hello);
        }
        Ok(())
    }

    fn welcome(&mut self, hello: &Hello) {
        let nonce = self.chance.bytes(16).try_into().unwrap_or_default();
        let mut out = FrameBuffer::new();
        let mut welcome = Welcome {
            stream: 1,
            stored: self.disk,
            time_ms: self.now_ms,
        };
        if self.faulty == Faulty::Station && self.chance.once_in(2) {
            welcome = Welcome {
                stream: whole(self.chance) as u32,
                stored: whole(self.chance) as u32,
                time_ms: whole(self.chance),
            };
        }
        let frame = self
            .station
            .welcome(hello, &self.key, nonce, welcome, self.now_ms, &mut out);
        self.nonces[OFFERED] = hello.nonce;
        if let Some(frame) = frame.map(<[u8]>::to_vec) {
            self.send(TO_LOGGER, frame);
        }
    }
}

/// The hello that a frame is, if it is one.
fn hello_of(line: &[u8]) -> Option<Hello> {
    let mut decoder = Decoder::new();
    let mut hello = None;
    for &byte in line {
        if let Some(frame) = decoder.push(byte)
            && frame.kind == Kind::Hello
        {
            hello = Hello::from_bytes(frame.payload());
        }
    }
    hello
}
