//! The base station's end of a session with one logger.

use serde::Serialize;

use super::KNOCK_MS;
use super::logger_end::{Refusals, read_parcel, seal};
use super::packet::{BRING_UP_BYTES, Device, Heartbeat, Hello, NONCE_BYTES, Receipt, Time, Welcome};
use super::seal::{Channel, End, Key, Refused};
use crate::wire::frame::{FrameBuffer, TooLong};
use crate::wire::{Frame, Kind};

/// Time for a logger to take up a session that it was offered, ms.
const OFFER_MS: u64 = 5000;

/// What a frame means to the base station.
#[derive(Debug, PartialEq)]
pub enum ToStation<'a> {
    /// A logger says who it is. Nothing is proven: give its key to [`StationEnd::welcome`] if there is one.
    Hello(Hello),
    /// The next message of the logger's series: store it, then say so ([`StationEnd::stored`], or [`StationEnd::not_stored`]).
    Parcel {
        /// Its number.
        sequence: u32,
        /// The number before it.
        previous: u32,
        /// The message.
        message: &'a [u8],
    },
    /// A message that is stored already; its receipt goes again.
    Duplicate,
    /// Messages between `stored` and `previous` have not come yet. The logger sends them again.
    Gap {
        /// The last that has come.
        stored: u32,
        /// The one before that which has come.
        previous: u32,
    },
    /// The logger believes to be on disk here what is not, up to this number: it is lost.
    Lost {
        /// What is stored.
        stored: u32,
        /// What the logger believes.
        acknowledged: u32,
        /// The heartbeat that says so.
        heartbeat: Heartbeat,
    },
    /// The logger lives.
    Heartbeat(Heartbeat),
    /// An answer to a request, with its number.
    Answer(Frame<'a>),
    /// Nothing to be done by others.
    Nothing,
}

/// The base station's end. See the [module](super).
#[derive(Debug, Clone)]
pub struct StationEnd {
    channel: Option<Channel>,
    /// The session that was offered last, until the logger has sealed something by it.
    offered: Option<Offer>,
    /// Who has proven that it is at the other end.
    device: Device,
    /// The name of the logger's series of numbers.
    stream: u32,
    /// Everything of it up to here is on disk.
    stored: u32,
    /// Everything of it up to here was handed on to be stored.
    taken: u32,
    sessions: u32,
    knock_at_ms: Option<u64>,
    last_knock_ms: Option<u64>,
    receipt_due: bool,
    time: Option<Time>,
    refusals: Refusals,
}

#[derive(Debug, Clone)]
struct Offer {
    channel: Channel,
    device: Device,
    stream: u32,
    stored: u32,
}

impl Default for StationEnd {
    fn default() -> Self {
        Self::new()
    }
}

impl StationEnd {
    /// An end that knows of no session, and knocks.
    pub const fn new() -> Self {
        Self {
            channel: None,
            offered: None,
            device: 0,
            stream: 0,
            stored: 0,
            taken: 0,
            sessions: 0,
            knock_at_ms: Some(0),
            last_knock_ms: None,
            receipt_due: false,
            time: None,
            refusals: Refusals::NONE,
        }
    }

    /// The logger has proven who it is.
    pub fn is_up(&self) -> bool {
        self.channel.is_some()
    }

    /// The logger that has proven who it is, and the name of its series of numbers.
    pub fn logger(&self) -> Option<(Device, u32)> {
        self.is_up().then_some((self.device, self.stream))
    }

    /// What was refused so far.
    pub fn refusals(&self) -> Refusals {
        self.refusals
    }

    /// Takes a frame that the decoder has found, at the base station's time `now_ms`.
    pub fn on_frame<'a>(&mut self, frame: Frame<'a>, now_ms: u64) -> ToStation<'a> {
        match frame.kind {
            Kind::Hello => Hello::from_bytes(frame.payload()).map_or(ToStation::Nothing, ToStation::Hello),
            Kind::Sealed => self.on_sealed(frame, now_ms),
            _ => {
                self.refusals.unsealed();
                ToStation::Nothing
            }
        }
    }

    fn on_sealed<'a>(&mut self, frame: Frame<'a>, now_ms: u64) -> ToStation<'a> {
        let (offered, channel) = (&mut self.offered, &mut self.channel);
        let (kind, counter) = (frame.kind as u8, frame.sequence);
        let long = frame.payload().len() >= BRING_UP_BYTES;
        let mut result = Err(Refused::Forged);
        let mut by_offer = false;
        // A key that does not fit leaves the bytes as they were.
        let inner = frame.open(|bytes, tag| {
            if let Some(offer) = offered {
                by_offer = offer.channel.open(kind, counter, bytes, tag).is_ok();
            }
            if by_offer {
                result = Ok(());
            } else if let Some(channel) = channel {
                result = channel.open(kind, counter, bytes, tag);
            }
            result.is_ok()
        });
        if by_offer && let Some(offer) = self.offered.take() {
            self.channel = Some(offer.channel);
            // The old session may have gone on meanwhile.
            let same = (offer.device, offer.stream) == (self.device, self.stream);
            self.stored = match same {
                true => offer.stored.max(self.stored),
                false => offer.stored,
            };
            self.taken = match same {
                true => self.taken.max(self.stored),
                false => self.stored,
            };
            self.stream = offer.stream;
            self.device = offer.device;
            self.sessions = self.sessions.saturating_add(1);
            self.knock_at_ms = None;
        }
        let opened = result.and_then(|()| inner.ok_or(Refused::Forged));
        match opened {
            Ok(frame) => self.on_opened(frame, now_ms),
            Err(refused) => {
                self.refusals.count(refused);
                if refused == Refused::Forged && long {
                    // Perhaps somebody believes in a session that was before a restart. A knock is no longer than this.
                    self.knock_at_ms.get_or_insert(now_ms);
                }
                ToStation::Nothing
            }
        }
    }

    fn on_opened<'a>(&mut self, frame: Frame<'a>, now_ms: u64) -> ToStation<'a> {
        match frame.kind {
            Kind::Answer => ToStation::Answer(frame),
            Kind::Heartbeat => {
                let Some(heartbeat) = frame.message::<Heartbeat>() else {
                    return ToStation::Nothing;
                };
                self.time = Some(Time {
                    uptime_ms: heartbeat.uptime_ms,
                    time_ms: now_ms,
                });
                self.receipt_due = true;
                let (stored, acknowledged) = (self.stored, heartbeat.acknowledged);
                if acknowledged > stored {
                    return ToStation::Lost {
                        stored,
                        acknowledged,
                        heartbeat,
                    };
                }
                ToStation::Heartbeat(heartbeat)
            }
            Kind::Parcel => self.on_parcel(frame),
            _ => ToStation::Nothing,
        }
    }

    fn on_parcel<'a>(&mut self, frame: Frame<'a>) -> ToStation<'a> {
        let Some((sequence, previous, message)) = read_parcel(frame) else {
            return ToStation::Nothing;
        };
        if sequence <= self.taken {
            self.receipt_due = true;
            return ToStation::Duplicate;
        }
        if previous > self.taken {
            let stored = self.taken;
            return ToStation::Gap { stored, previous };
        }
        self.taken = sequence;
        ToStation::Parcel {
            sequence,
            previous,
            message,
        }
    }

    /// Answers a hello, whose key is `key`, with a session of the fresh `nonce`. What exists stays until the logger has used the new one.
    pub fn welcome<'b>(
        &mut self,
        hello: &Hello,
        key: &Key,
        nonce: [u8; NONCE_BYTES],
        welcome: Welcome,
        now_ms: u64,
        out: &'b mut FrameBuffer,
    ) -> Option<&'b [u8]> {
        // A knock now would make the logger begin once more.
        if self.channel.is_none() {
            self.knock_at_ms = Some(now_ms.saturating_add(OFFER_MS));
        }
        let mut channel = Channel::new(End::Station, key, hello, &nonce);
        let counter = channel.next_counter()?;
        let written = out.write_with(Kind::Welcome, counter, |room| {
            let (place, rest) = room.split_first_chunk_mut::<NONCE_BYTES>()?;
            *place = nonce;
            let (bytes, rest) = rest.split_at_mut_checked(BRING_UP_BYTES - NONCE_BYTES - 16)?;
            bytes.fill(0);
            postcard::to_slice(&welcome, bytes).ok()?;
            let tag = channel.seal(Kind::Welcome as u8, counter, bytes)?;
            *rest.first_chunk_mut::<16>()? = tag;
            Some(BRING_UP_BYTES)
        });
        self.offered = Some(Offer {
            channel,
            device: hello.device,
            stream: welcome.stream,
            stored: welcome.stored,
        });
        written.ok()
    }

    /// Everything up to this number is on disk, or declared lost: a receipt goes out.
    pub fn stored(&mut self, sequence: u32) {
        self.stored = self.stored.max(sequence);
        self.taken = self.taken.max(sequence);
        self.receipt_due = true;
    }

    /// What was handed on and is not on disk cannot be stored now: the logger sends it again.
    pub fn not_stored(&mut self) {
        self.taken = self.stored;
    }

    /// Sessions that have come up so far.
    pub fn sessions(&self) -> u32 {
        self.sessions
    }

    /// The next frame that is to be sent now; call it again until there is none.
    pub fn poll<'b>(&mut self, now_ms: u64, out: &'b mut FrameBuffer) -> Option<&'b [u8]> {
        let rested = |last: u64| now_ms >= last.saturating_add(KNOCK_MS);
        if self.knock_at_ms.is_some_and(|at| now_ms >= at) && self.last_knock_ms.is_none_or(rested) {
            self.last_knock_ms = Some(now_ms);
            // Until someone has answered, again and again.
            self.knock_at_ms = match self.channel {
                Some(_) => None,
                None => Some(now_ms.saturating_add(super::FIRST_HELLO_MS)),
            };
            let knock = out.write_with(Kind::Knock, 0, |room| {
                room.get_mut(..BRING_UP_BYTES)?.fill(0);
                Some(BRING_UP_BYTES)
            });
            return knock.ok();
        }
        if core::mem::take(&mut self.receipt_due) {
            let receipt = Receipt { stored: self.stored };
            return self.seal(Kind::Receipt, 0, &receipt, out).ok();
        }
        let time = self.time.take()?;
        self.seal(Kind::Time, 0, &time, out).ok()
    }

    /// Seals a request.
    pub fn seal<'b>(
        &mut self,
        kind: Kind,
        sequence: u32,
        message: &impl Serialize,
        out: &'b mut FrameBuffer,
    ) -> Result<&'b [u8], TooLong> {
        seal(self.channel.as_mut(), kind, sequence, message, out)
    }
}
