//! A line to one logger: frames, and the base station's end of the session on it.

use std::time::{Duration, SystemTime, UNIX_EPOCH};

use anyhow::{Context, Result};
use spanwatch::session::packet::{Heartbeat, Hello, Welcome};
use spanwatch::session::{Device, Key, StationEnd, ToStation};
use spanwatch::wire::frame::Refusal;
use spanwatch::wire::message::{Answer, Request};
use spanwatch::wire::{Decoder, FrameBuffer, Kind};

use super::store::Origin;
use crate::channel::Channel;

/// What the session asks whoever has the line.
pub trait Desk {
    /// A logger says that it is this one: its key, and how far its messages are stored; none: it is not known here.
    fn welcome(&mut self, hello: &Hello) -> Option<(Key, Welcome)>;
    /// The next message.
    fn message(&mut self, origin: Origin, message: &[u8]) -> Kept;
    /// Messages behind number `after`, up to `upto`, have not come yet.
    fn gap(&mut self, _logger: Device, _series: u32, _after: u32, _upto: u32) {}
    /// The logger believes to be stored here what is not, up to `upto`: whether that is written down now.
    fn lost(&mut self, logger: Device, series: u32, after: u32, upto: u32) -> bool;
    /// The logger lives.
    fn heartbeat(&mut self, _logger: Device, _series: u32, _heartbeat: &Heartbeat) {}
    /// An answer to the request of that number.
    fn answer(&mut self, number: u32, answer: Answer);
}

/// What became of a message.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kept {
    /// It is on disk.
    OnDisk,
    /// [`Line::confirm`] will say when it is.
    Later,
    /// It could not be stored.
    No,
}

/// The base station's end of a line.
pub struct Line {
    channel: Box<dyn Channel>,
    decoder: Decoder,
    out: FrameBuffer,
    session: StationEnd,
    frames: u64,
}

impl Line {
    /// The end of `channel`; nobody has said anything yet.
    pub fn new(channel: Box<dyn Channel>) -> Self {
        Self {
            channel,
            decoder: Decoder::new(),
            out: FrameBuffer::new(),
            session: StationEnd::new(),
            frames: 0,
        }
    }

    /// Frames that were accepted.
    pub fn frames(&self) -> u64 {
        self.frames
    }

    /// Frames that were refused.
    pub fn rejected(&self) -> u32 {
        let refusals = self.session.refusals();
        let refused = (refusals.forged.saturating_add(refusals.replayed)).saturating_add(refusals.unsealed);
        self.decoder.rejections().total().saturating_add(refused)
    }

    /// The logger that has proven who it is, and the series of its numbers.
    pub fn logger(&self) -> Option<(Device, u32)> {
        self.session.logger()
    }

    /// Sessions that have come up so far.
    pub fn sessions(&self) -> u32 {
        self.session.sessions()
    }

    /// Everything up to this number is on disk.
    pub fn confirm(&mut self, number: u32) -> Result<()> {
        self.session.stored(number);
        self.send_what_is_due()
    }

    /// Sends a request; nothing without a session.
    pub fn request(&mut self, number: u32, request: &Request) -> Result<()> {
        if !self.session.is_up() {
            return Ok(());
        }
        let frame = (self.session)
            .seal(Kind::Request, number, request, &mut self.out)
            .ok()
            .context("the request does not fit into a frame")?;
        self.channel.send(frame).context("cannot send to the logger")
    }

    fn send_what_is_due(&mut self) -> Result<()> {
        while let Some(frame) = self.session.poll(now_ms(), &mut self.out) {
            self.channel.send(frame).context("cannot send to the logger")?;
        }
        Ok(())
    }

    /// Takes what the line gives within `timeout`.
    pub fn turn(&mut self, timeout: Duration, desk: &mut dyn Desk) -> Result<()> {
        self.send_what_is_due()?;
        let mut buffer = [0; 1024];
        let count = self
            .channel
            .receive(&mut buffer, timeout)
            .context("cannot hear the logger")?;
        for &byte in &buffer[..count] {
            let Some(frame) = self.decoder.push(byte) else { continue };
            self.frames += 1;
            let heard = self.session.on_frame(frame, now_ms());
            let (logger, series) = self.session.logger().unwrap_or_default();
            match heard {
                ToStation::Hello(hello) => {
                    let Some((key, welcome)) = desk.welcome(&hello) else {
                        continue;
                    };
                    let welcome = (self.session).welcome(&hello, &key, chance(), welcome, now_ms(), &mut self.out);
                    if let Some(frame) = welcome {
                        self.channel.send(frame).context("cannot send to the logger")?;
                    }
                }
                ToStation::Parcel {
                    sequence,
                    previous,
                    message,
                } => {
                    let origin = Origin {
                        logger,
                        series,
                        number: sequence,
                        previous,
                    };
                    match desk.message(origin, message) {
                        Kept::OnDisk => self.session.stored(sequence),
                        Kept::No => self.session.not_stored(),
                        Kept::Later => {}
                    }
                }
                ToStation::Gap { stored, previous } => desk.gap(logger, series, stored, previous),
                ToStation::Lost {
                    stored,
                    acknowledged,
                    heartbeat,
                } => {
                    if desk.lost(logger, series, stored, acknowledged) {
                        self.session.stored(acknowledged);
                    }
                    desk.heartbeat(logger, series, &heartbeat);
                }
                ToStation::Heartbeat(heartbeat) => desk.heartbeat(logger, series, &heartbeat),
                ToStation::Answer(frame) => match frame.message() {
                    Some(answer) => desk.answer(frame.sequence, answer),
                    None => self.decoder.refuse(Refusal::Payload),
                },
                ToStation::Duplicate | ToStation::Nothing => {}
            }
        }
        self.send_what_is_due()
    }
}

/// Random bytes.
pub(super) fn chance<const N: usize>() -> [u8; N] {
    let mut bytes = [0; N];
    getrandom::fill(&mut bytes).expect("the system has random numbers");
    bytes
}

/// A name for a series of numbers that has none; never 0.
pub(super) fn new_series() -> u32 {
    u32::from_le_bytes(chance()) | 1
}

/// The clock, ms since 1970.
pub(super) fn now_ms() -> u64 {
    let since = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
    since.as_millis() as u64
}
