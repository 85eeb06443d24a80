//! A whole logger, behind its line, that is asked all sorts of things by a base station which has the right key.

use std::sync::OnceLock;

use spanwatch::link::{Board, Health, RemoteLogger};
use spanwatch::passage::Stream;
use spanwatch::session::packet::Welcome;
use spanwatch::session::{Key, StationEnd, ToStation, WINDOW};
use spanwatch::settings::Part;
use spanwatch::wire::message::{
    Answer, BLOCK_COUNTS, CHUNK_BYTES, Channel, Chunk, Configuration, Memory, Outcome, Quantity, Ranges, Request,
    SampleBlock, SetupRequest, Traffic, TrainKind, Trigger,
};
use spanwatch::wire::{Decoder, FrameBuffer, Kind};

use super::blobs;
use super::mutation::{Raw, mutate, number, posted, whole};
use super::{Counts, must};
use crate::campaign::line::Chance;
use crate::campaign::power::TEARS;
use crate::flash::SimulatedFlash;

/// Pages of the flash: few, so that they are used over and over.
const PAGES: usize = 5;
/// Pages of the settings: room for a model in each setup.
const SETTINGS_PAGES: usize = 26;
/// Things that happen in a run.
const EVENTS: u64 = 14;
/// Slices of work between two requests, and once in a while until the end: a search ends within so many.
const SLICES: u64 = 2;
const LAST_SLICES: u64 = 200_000;
/// Runs of which one works until the end.
const PATIENT: u64 = 20_000;
/// Frames that a logger sends in return for one: its answer, and whatever is due.
const SAYS: usize = 4 + 2 * WINDOW;

type Flash = SimulatedFlash<4, 512>;

/// A logger and a base station that have just met.
#[derive(Clone)]
struct Pair {
    logger: Box<RemoteLogger<Flash>>,
    station: StationEnd,
    /// Of what comes from the logger.
    decoder: Decoder,
    line: Line,
    requests: u32,
    disk: u32,
    counts: Counts,
}

/// The board under the logger.
#[derive(Clone, Default)]
struct Line {
    said: Vec<u8>,
    now_ms: u64,
}

impl Board for Line {
    fn send(&mut self, bytes: &[u8]) {
        self.said.extend_from_slice(bytes);
    }

    fn ticks(&mut self) -> u64 {
        0
    }

    fn now_ms(&mut self) -> u64 {
        self.now_ms
    }

    fn health(&mut self) -> Health {
        Health::default()
    }

    /// Restarts have their own target.
    fn restart(&mut self) {}
}

/// What a request may have for an answer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Expected {
    /// One, whatever it says.
    One,
    /// None: it is no request.
    None,
}

/// A logger is asked several things.
pub(super) fn run(chance: &mut Chance) -> Result<Counts, String> {
    if chance.once_in(20) {
        return blocks(chance);
    }
    let mut pair = met()?;
    let (mut rate_hz, mut channels, mut next) = (200.0, 1, 0);
    if chance.once_in(2) {
        pair.deliver(Request::Model, blobs::model(chance), chance)?;
        if chance.once_in(2) {
            pair.deliver(Request::Track, blobs::track(chance), chance)?;
        }
    }
    for _ in 0..=chance.below(EVENTS) {
        pair.line.now_ms = pair.line.now_ms.saturating_add(chance.below(2000));
        match chance.below(16) {
            0..3 => {
                let configuration = configuration(chance);
                (rate_hz, channels) = (configuration.sample_rate_hz, configuration.channels.len().max(1));
                next = 0;
                pair.ask(&posted(&Request::Configure(configuration)), Expected::One)?;
            }
            3 => {
                let blob = blobs::broken_model(chance);
                pair.deliver(Request::Model, blob, chance)?;
            }
            4 => {
                let blob = blobs::broken_track(chance);
                pair.deliver(Request::Track, blob, chance)?;
            }
            5 => {
                let blob = blobs::broken_evidence(chance);
                pair.deliver(Request::Restore, blob, chance)?;
            }
            6..9 => {
                let blocks = 1 + chance.below(12);
                let shape = chance.below(4);
                for _ in 0..blocks {
                    let counts = counts(channels, shape, chance);
                    let rows = (counts.len() / channels) as u64;
                    let block = SampleBlock {
                        first_sample: next,
                        counts: counts.into_iter().collect(),
                    };
                    next += rows;
                    pair.ask(&posted(&Request::Samples(block)), Expected::One)?;
                }
                let _ = rate_hz;
            }
            9 => pair.ask(&posted(&Request::Finish), Expected::One)?,
            10 => pair.go_on()?,
            11..14 => {
                let request = posted(&request(chance));
                pair.ask(&request, Expected::One)?;
            }
            _ => {
                let mut bytes = posted(&request(chance));
                mutate(&mut bytes, &[], chance);
                bytes.truncate(500);
                let read = postcard::take_from_bytes::<Request>(&bytes);
                if matches!(read, Ok((Request::Key(_), _))) {
                    // The session would be over.
                    continue;
                }
                let whole = matches!(read, Ok((_, [])));
                pair.ask(&bytes, if whole { Expected::One } else { Expected::None })?;
            }
        }
        for _ in 0..chance.below(SLICES + 1) {
            pair.logger.poll(&mut pair.line);
        }
        pair.hear(None)?;
    }
    if chance.once_in(PATIENT) {
        let mut left = LAST_SLICES;
        while pair.logger.poll(&mut pair.line) {
            left -= 1;
            must!(left > 0, "it still works after {LAST_SLICES} slices");
        }
        pair.hear(None)?;
    }
    pair.ask(&posted(&Request::Status), Expected::One)?;
    must!(
        !pair.logger.has_failed(),
        "its flash works and it says that it has failed"
    );
    Ok(pair.counts)
}

/// A logger and a station with a session; the same for all runs.
fn met() -> Result<Pair, String> {
    static MET: OnceLock<Result<Pair, String>> = OnceLock::new();
    MET.get_or_init(|| {
        let mut pair = Pair {
            logger: Box::new(RemoteLogger::new()),
            station: StationEnd::new(),
            decoder: Decoder::new(),
            line: Line {
                said: vec![],
                now_ms: 1,
            },
            requests: 0,
            disk: 0,
            counts: Counts::default(),
        };
        pair.logger
            .open(Flash::new(PAGES, TEARS[0], 0), Flash::new(SETTINGS_PAGES, TEARS[0], 0))
            .map_err(|error| error.to_string())?;
        pair.logger.poll(&mut pair.line);
        pair.hear(None)?;
        must!(pair.station.is_up(), "no session");
        pair.counts = Counts::default();
        Ok(pair)
    })
    .clone()
}

impl Pair {
    /// Takes what the logger has said; answers to `request` are counted.
    fn hear(&mut self, request: Option<u32>) -> Result<Vec<Answer>, String> {
        let mut answers = vec![];
        let mut frames = 0;
        while !self.line.said.is_empty() {
            let mut welcome = None;
            for byte in std::mem::take(&mut self.line.said) {
                let Some(frame) = self.decoder.push(byte) else { continue };
                frames += 1;
                match self.station.on_frame(frame, self.line.now_ms) {
                    ToStation::Answer(frame) => {
                        must!(
                            request == Some(frame.sequence),
                            "an answer to {} that nobody waits for",
                            frame.sequence
                        );
                        let answer = frame.message().ok_or("an answer that does not decode")?;
                        answers.push(answer);
                    }
                    ToStation::Parcel { sequence, .. } => {
                        self.disk = sequence;
                        self.station.stored(sequence);
                    }
                    ToStation::Hello(hello) => welcome = Some(hello),
                    ToStation::Lost { .. } | ToStation::Gap { .. } => return Err("messages are missing".to_owned()),
                    _ => {}
                }
            }
            must!(self.decoder.rejections().total() == 0, "a frame that is none");
            let mut out = FrameBuffer::new();
            let mut replies = vec![];
            if let Some(hello) = welcome {
                let welcome = Welcome {
                    stream: 1,
                    stored: self.disk,
                    time_ms: self.line.now_ms,
                };
                let nonce = [9; 16];
                let frame = (self.station).welcome(&hello, &Key::DEMO, nonce, welcome, self.line.now_ms, &mut out);
                replies.extend(frame.map(<[u8]>::to_vec));
            }
            while let Some(frame) = self.station.poll(self.line.now_ms, &mut out) {
                replies.push(frame.to_vec());
            }
            for reply in replies {
                self.logger.receive(&reply, &mut self.line);
            }
            must!(frames < 64 * SAYS, "they do not stop talking");
        }
        Ok(answers)
    }

    /// Seals these bytes as a request, and hears its answer.
    fn ask(&mut self, bytes: &[u8], expected: Expected) -> Result<(), String> {
        self.asked(bytes, expected).map(|_| ())
    }

    fn asked(&mut self, bytes: &[u8], expected: Expected) -> Result<Option<Answer>, String> {
        self.hear(None)?;
        self.requests += 1;
        let mut out = FrameBuffer::new();
        let sealed = self.station.seal(Kind::Request, self.requests, &Raw(bytes), &mut out);
        let Ok(frame) = sealed.map(<[u8]>::to_vec) else {
            return Err("the session is over".to_owned());
        };
        self.logger.receive(&frame, &mut self.line);
        let answers = self.hear(Some(self.requests))?;
        let number = usize::from(expected == Expected::One);
        must!(
            answers.len() == number,
            "{} answers in place of {number}",
            answers.len()
        );
        let refused = match answers.first() {
            Some(Answer::Acknowledgement(of)) => of.outcome != Outcome::Done,
            Some(_) => false,
            None => true,
        };
        self.counts.accepted += u64::from(!refused);
        self.counts.refused += u64::from(refused);
        Ok(answers.into_iter().next())
    }

    /// A blob in pieces, now and then with one of them missing, twice or somewhere else.
    fn deliver(&mut self, item: fn(Chunk) -> Request, blob: Vec<u8>, chance: &mut Chance) -> Result<(), String> {
        let piece = if chance.once_in(4) {
            1 + chance.below(CHUNK_BYTES as u64) as usize
        } else {
            CHUNK_BYTES
        };
        let odd = chance.once_in(4);
        let pieces = blob.chunks(piece.max(blob.len() / 40).clamp(1, CHUNK_BYTES));
        let mut offset = 0;
        for part in pieces {
            let chunk = Chunk {
                offset,
                total: blob.len() as u32,
                bytes: part.iter().copied().collect(),
            };
            offset += part.len() as u32;
            if odd && chance.once_in(10) {
                let request = match chance.below(3) {
                    0 => continue,
                    1 => item(chunk.clone()),
                    _ => request(chance),
                };
                self.ask(&posted(&request), Expected::One)?;
            }
            self.ask(&posted(&item(chunk)), Expected::One)?;
        }
        Ok(())
    }

    /// What a logger has gathered is what it can go on from.
    fn go_on(&mut self) -> Result<(), String> {
        let mut bytes: Vec<u8> = vec![];
        loop {
            let request = posted(&Request::Evidence {
                offset: bytes.len() as u32,
            });
            let Some(Answer::Piece(chunk)) = self.asked(&request, Expected::One)? else {
                return Err("no evidence".to_owned());
            };
            bytes.extend_from_slice(&chunk.bytes);
            if bytes.len() >= chunk.total as usize {
                break;
            }
            must!(!chunk.bytes.is_empty(), "an evidence that does not end");
        }
        for (n, part) in bytes.chunks(CHUNK_BYTES).enumerate() {
            let chunk = Chunk {
                offset: (n * CHUNK_BYTES) as u32,
                total: bytes.len() as u32,
                bytes: part.iter().copied().collect(),
            };
            let answer = self.asked(&posted(&Request::Restore(chunk)), Expected::One)?;
            let Some(Answer::Acknowledgement(of)) = answer else {
                return Err("no acknowledgement".to_owned());
            };
            must!(
                of.outcome == Outcome::Done,
                "its own evidence is refused: {:?}",
                of.outcome
            );
        }
        Ok(())
    }
}

/// The same samples in blocks and one by one: as many passages.
fn blocks(chance: &mut Chance) -> Result<Counts, String> {
    let mut sharp = configuration(chance);
    if sharp.check().is_err() {
        return Ok(Counts::of(false));
    }
    sharp.trigger.lead_s = sharp.trigger.lead_s.min(1.0);
    let channels = sharp.channels.len();
    let mut streams: [Box<Stream>; 2] = [Box::default(), Box::default()];
    let mut passages = [0, 0];
    streams.iter_mut().for_each(|stream| stream.configure(&sharp));
    let mut next = 0;
    for _ in 0..20 {
        let counts = counts(channels, chance.below(4), chance);
        let counts = &counts[..counts.len() / channels * channels];
        let _ = streams[0].push(next, counts);
        while streams[0].next_passage().is_some() {
            passages[0] += 1;
            streams[0].release();
        }
        for row in counts.chunks(channels) {
            let _ = streams[1].push(next, row);
            next += 1;
            while streams[1].next_passage().is_some() {
                passages[1] += 1;
                streams[1].release();
            }
        }
    }
    must!(
        passages[0] == passages[1],
        "{} passages in blocks, {} in single samples: {sharp:?}",
        passages[0],
        passages[1]
    );
    Ok(Counts::of(true))
}

/// Counts for a block.
fn counts(channels: usize, shape: u64, chance: &mut Chance) -> Vec<i32> {
    let rows = 1 + chance.below((BLOCK_COUNTS / channels) as u64) as usize;
    (0..rows * channels)
        .map(|_| match shape {
            0 => chance.below(200) as i32 - 100,
            1 => chance.any() as i32 >> 8,
            2 => chance.pick(&[0, 1, -1, i32::MAX, i32::MIN]),
            _ => match chance.below(6) {
                0 => chance.any() as i32 >> 10,
                _ => chance.below(20) as i32,
            },
        })
        .collect()
}

/// A configuration, mostly one that makes sense.
fn configuration(chance: &mut Chance) -> Configuration {
    let odd = chance.once_in(3);
    let value = |usual: f32, chance: &mut Chance| match odd && chance.once_in(6) {
        true => number(chance),
        false => usual,
    };
    let sharp = chance.once_in(2);
    let count = 1 + chance.below(3);
    let channels = (0..count)
        .map(|c| Channel {
            node: if chance.once_in(8) {
                whole(chance) as u16
            } else {
                2 + chance.below(9) as u16
            },
            quantity: if c > 0 && chance.once_in(3) {
                Quantity::Displacement
            } else {
                Quantity::Acceleration
            },
            lsb: value(1e-5, chance),
            full_scale_counts: if odd && chance.once_in(6) {
                whole(chance) as i32
            } else {
                1 << 23
            },
        })
        .collect();
    let trigger = match sharp {
        // Begins and ends within a few samples.
        true => Trigger {
            window_s: value(0.04, chance),
            on_ratio: value(chance.pick(&[1.0001, 1.5, 3.0]), chance),
            on_duration_s: value(0.005, chance),
            off_ratio: value(1.0, chance),
            off_duration_s: value(chance.pick(&[0.005, 0.13, 0.131, 0.2]), chance),
            floor_mps2: value(1e-4, chance),
            lead_s: value(0.1, chance),
        },
        false => Trigger {
            lead_s: value(1.5, chance),
            off_duration_s: value(0.1, chance),
            ..Trigger::default()
        },
    };
    let traffic = chance.once_in(3).then(|| Traffic {
        train: chance.pick(&[TrainKind::Inspection2Dof, TrainKind::Shinkansen3d]),
        cars: if odd { chance.below(20) as u8 } else { 1 },
        speed_mps: (!chance.once_in(3)).then(|| value(20.0, chance)),
        acceleration_mps2: value(0.0, chance),
        backward: chance.once_in(4),
        entry_time_s: match chance.below(3) {
            0 => None,
            1 => Some(f64::from(value(0.2, chance))),
            _ => Some(f64::from_bits(chance.any())),
        },
        load_factor: value(1.0, chance),
        ranges: match chance.below(3) {
            0 => Ranges::HELD,
            1 => Ranges::WIDEST,
            _ => Ranges {
                speed: value(0.1, chance),
                entry_s: value(0.1, chance),
                load: value(0.1, chance),
                stiffness: value(0.01, chance),
            },
        },
    });
    Configuration {
        sample_rate_hz: if odd && chance.once_in(4) {
            chance.pick(&[1.0, 8.0, 100_000.0, 99_999.0, 1.5, 0.0, f32::NAN])
        } else {
            200.0
        },
        channels,
        trigger,
        antialias_hz: chance.once_in(3).then(|| value(40.0, chance)),
        traffic,
        memory: Memory {
            long_passages: value(1000.0, chance),
            recent_passages: value(20.0, chance),
        },
        seed: chance.any(),
    }
}

/// Any request.
fn request(chance: &mut Chance) -> Request {
    let chunk = |chance: &mut Chance| {
        let length = chance.below(CHUNK_BYTES as u64 + 1) as usize;
        Chunk {
            offset: if chance.once_in(3) { 0 } else { whole(chance) as u32 },
            total: if chance.once_in(3) {
                length as u32
            } else {
                whole(chance) as u32
            },
            bytes: chance.bytes(length).into_iter().collect(),
        }
    };
    match chance.below(15) {
        0 => Request::Configure(configuration(chance)),
        1 => Request::Model(chunk(chance)),
        2 => Request::Track(chunk(chance)),
        3 => Request::Restore(chunk(chance)),
        4 => {
            let length = chance.below(BLOCK_COUNTS as u64 + 1) as usize;
            Request::Samples(SampleBlock {
                first_sample: match chance.below(3) {
                    0 => u64::MAX - chance.below(200),
                    _ => whole(chance),
                },
                counts: (0..length).map(|_| chance.any() as i32).collect(),
            })
        }
        5 => Request::Finish,
        6 => Request::Evidence {
            offset: whole(chance) as u32,
        },
        7 => Request::Passage {
            offset: whole(chance) as u32,
        },
        8 => Request::Setup(SetupRequest::Begin),
        9 => Request::Setup(SetupRequest::Keep),
        10 => Request::Setup(SetupRequest::Reload),
        11 => Request::Setup(SetupRequest::Read {
            part: chance.pick(&[Part::Model, Part::Track, Part::Configuration]),
            offset: whole(chance) as u32,
        }),
        12 => Request::Clear,
        13 => Request::Restart,
        _ => Request::Status,
    }
}
