//! The logger's end of a session.

use serde::Serialize;

use super::packet::{BRING_UP_BYTES, Device, Heartbeat, Hello, NONCE_BYTES, Receipt, Time, Vitals, Welcome};
use super::seal::{Channel, End, Key, Refused};
use super::{BackOff, HEARTBEAT_MS, KNOCK_MS, LOST_HEARTBEATS, WINDOW};
use crate::capacity::PAYLOAD_BYTES;
use crate::outbox::{Outbox, OutboxError};
use crate::settings::Identity;
use crate::wire::frame::{FrameBuffer, TooLong};
use crate::wire::{Frame, Kind};

/// Where the parcels come from: an [`Outbox`], but for tests.
pub trait Parcels {
    /// The name of their series of numbers; 0: none yet.
    fn stream(&self) -> u32;
    /// Names it.
    fn name_stream(&mut self, stream: u32) -> Result<(), OutboxError>;
    /// Everything up to here is confirmed.
    fn acknowledged(&self) -> u32;
    /// See [`Outbox::next_after`]: number, number before, bytes.
    fn next_after(&mut self, sequence: u32, buffer: &mut [u8]) -> Result<Option<(u32, u32, usize)>, OutboxError>;
    /// See [`Outbox::acknowledge`].
    fn acknowledge(&mut self, sequence: u32) -> Result<(), OutboxError>;
}

impl<F: embedded_storage::nor_flash::NorFlash> Parcels for Outbox<F> {
    fn stream(&self) -> u32 {
        self.stream()
    }

    fn name_stream(&mut self, stream: u32) -> Result<(), OutboxError> {
        self.name_stream(stream)
    }

    fn acknowledged(&self) -> u32 {
        self.acknowledged()
    }

    fn next_after(&mut self, sequence: u32, buffer: &mut [u8]) -> Result<Option<(u32, u32, usize)>, OutboxError> {
        let parcel = self.next_after(sequence, buffer)?;
        Ok(parcel.map(|parcel| (parcel.sequence, parcel.previous, parcel.length)))
    }

    fn acknowledge(&mut self, sequence: u32) -> Result<(), OutboxError> {
        self.acknowledge(sequence)
    }
}

/// What a frame means to the logger.
#[derive(Debug, PartialEq, Eq)]
pub enum ToLogger<'a> {
    /// A request that is fresh and from the base station.
    Request(Frame<'a>),
    /// Nothing to be done by others.
    Nothing,
}

/// What was refused.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Refusals {
    /// Made by another key, or changed.
    pub forged: u32,
    /// Came again, or too late.
    pub replayed: u32,
    /// In the clear, though it only counts sealed.
    pub unsealed: u32,
}

impl Refusals {
    /// Nothing was refused.
    pub const NONE: Self = Self {
        forged: 0,
        replayed: 0,
        unsealed: 0,
    };

    pub(super) fn count(&mut self, refused: Refused) {
        let count = match refused {
            Refused::Forged => &mut self.forged,
            Refused::Replayed => &mut self.replayed,
        };
        *count = count.saturating_add(1);
    }

    pub(super) fn unsealed(&mut self) {
        self.unsealed = self.unsealed.saturating_add(1);
    }
}

/// The logger's end. See the [module](super).
#[derive(Debug, Clone)]
pub struct LoggerEnd {
    device: Device,
    key_number: u8,
    key: Key,
    /// Starts of the device: with `sessions` the part of the nonce that never returns.
    starts: u32,
    sessions: u32,
    channel: Option<Channel>,
    /// The last hello, until it is welcomed.
    hello: Option<Hello>,
    next_hello: BackOff,
    last_hello_ms: Option<u64>,
    heard_ms: u64,
    next_heartbeat_ms: u64,
    /// Numbers that were sent and not confirmed, in order.
    flying: heapless::Vec<u32, WINDOW>,
    resend: BackOff,
    /// Round trip by which the offset is known, and when that was.
    round_trip_ms: u64,
    clock_offset_ms: Option<i64>,
    refusals: Refusals,
}

impl LoggerEnd {
    /// The end of a device that has started for the `starts`-th time, which no two of its starts have in common.
    pub const fn new(device: Device, key_number: u8, key: Key, starts: u32) -> Self {
        Self {
            device,
            key_number,
            key,
            starts,
            sessions: 0,
            channel: None,
            hello: None,
            next_hello: BackOff::HELLO,
            last_hello_ms: None,
            heard_ms: 0,
            next_heartbeat_ms: 0,
            flying: heapless::Vec::new(),
            resend: BackOff::RESEND,
            round_trip_ms: u64::MAX,
            clock_offset_ms: None,
            refusals: Refusals::NONE,
        }
    }

    /// Both ends are sure of each other, as far as this one knows.
    pub fn is_up(&self) -> bool {
        self.channel.is_some()
    }

    /// What was refused so far.
    pub fn refusals(&self) -> Refusals {
        self.refusals
    }

    /// The base station's clock less `now_ms`, ms since 1970; none if it was never told.
    pub fn clock_offset_ms(&self) -> Option<i64> {
        self.clock_offset_ms
    }

    /// The number of its key.
    pub fn key_number(&self) -> u8 {
        self.key_number
    }

    /// Whether this end may get a key of `device`: of its own number, or of any while it has the key that everybody knows.
    pub fn may_become(&self, device: Device) -> bool {
        device == self.device || self.key.is_demo()
    }

    /// Another name and key. The session is over; the next is by these.
    pub fn replace_identity(&mut self, identity: Identity) {
        self.device = identity.device;
        self.key_number = identity.key_number;
        self.key = identity.key;
        self.channel = None;
        self.hello = None;
        self.next_hello = BackOff::HELLO;
    }

    /// Takes a frame that the decoder has found.
    ///
    /// # Errors
    /// Those of the outbox.
    pub fn on_frame<'a>(
        &mut self,
        frame: Frame<'a>,
        now_ms: u64,
        parcels: &mut impl Parcels,
    ) -> Result<ToLogger<'a>, OutboxError> {
        match frame.kind {
            Kind::Knock => self.on_knock(&frame, now_ms),
            Kind::Welcome => self.on_welcome(frame, now_ms, parcels)?,
            Kind::Sealed => return self.on_sealed(frame, now_ms, parcels),
            _ => self.refusals.unsealed(),
        }
        Ok(ToLogger::Nothing)
    }

    fn on_knock(&mut self, frame: &Frame<'_>, now_ms: u64) {
        let rested = self
            .last_hello_ms
            .is_none_or(|last| now_ms >= last.saturating_add(KNOCK_MS));
        // A hello is no longer than this.
        if rested && frame.payload().len() >= BRING_UP_BYTES {
            self.next_hello = BackOff::HELLO;
            self.last_hello_ms = None;
        }
    }

    fn on_welcome(&mut self, frame: Frame<'_>, now_ms: u64, parcels: &mut impl Parcels) -> Result<(), OutboxError> {
        let Some(hello) = self.hello else {
            self.refusals.count(Refused::Replayed);
            return Ok(());
        };
        let Some((channel, welcome)) = read_welcome(frame, &self.key, &hello) else {
            self.refusals.count(Refused::Forged);
            return Ok(());
        };
        self.hello = None;
        self.channel = Some(channel);
        self.heard(now_ms);
        self.next_heartbeat_ms = now_ms;
        self.flying.clear();
        self.resend = BackOff::RESEND;
        if parcels.stream() == 0 {
            parcels.name_stream(welcome.stream)?;
        }
        if parcels.stream() == welcome.stream {
            self.confirmed(welcome.stored, now_ms, parcels)?;
        }
        Ok(())
    }

    fn on_sealed<'a>(
        &mut self,
        frame: Frame<'a>,
        now_ms: u64,
        parcels: &mut impl Parcels,
    ) -> Result<ToLogger<'a>, OutboxError> {
        let Some(channel) = &mut self.channel else {
            self.refusals.count(Refused::Forged);
            return Ok(ToLogger::Nothing);
        };
        let (kind, counter) = (frame.kind as u8, frame.sequence);
        let mut result = Err(Refused::Forged);
        let inner = frame.open(|bytes, tag| {
            result = channel.open(kind, counter, bytes, tag);
            result.is_ok()
        });
        let frame = match result.and_then(|()| inner.ok_or(Refused::Forged)) {
            Ok(frame) => frame,
            Err(refused) => {
                self.refusals.count(refused);
                return Ok(ToLogger::Nothing);
            }
        };
        self.heard(now_ms);
        match frame.kind {
            Kind::Request => return Ok(ToLogger::Request(frame)),
            Kind::Receipt => {
                if let Some(Receipt { stored }) = frame.message() {
                    self.confirmed(stored, now_ms, parcels)?;
                }
            }
            Kind::Time => {
                if let Some(time) = frame.message() {
                    self.on_time(time, now_ms);
                }
            }
            _ => {}
        }
        Ok(ToLogger::Nothing)
    }

    fn on_time(&mut self, Time { uptime_ms, time_ms }: Time, now_ms: u64) {
        let Some(round_trip_ms) = now_ms.checked_sub(uptime_ms) else {
            return;
        };
        // The shortest way there and back says most; it ages, since clocks drift by some 100 ppm.
        self.round_trip_ms = self.round_trip_ms.saturating_add(1);
        if round_trip_ms <= self.round_trip_ms {
            self.round_trip_ms = round_trip_ms;
            let at = uptime_ms.saturating_add(round_trip_ms / 2);
            self.clock_offset_ms = Some(time_ms.cast_signed().wrapping_sub(at.cast_signed()));
        }
    }

    fn heard(&mut self, now_ms: u64) {
        self.heard_ms = now_ms;
        self.next_hello.reset(now_ms);
    }

    fn confirmed(&mut self, stored: u32, now_ms: u64, parcels: &mut impl Parcels) -> Result<(), OutboxError> {
        if stored <= parcels.acknowledged() {
            return Ok(());
        }
        match parcels.acknowledge(stored) {
            // A base station that speaks of what was never sent has another logger's numbers.
            Err(OutboxError::NotSent) => return Ok(()),
            other => other?,
        }
        self.flying.retain(|&number| number > stored);
        self.resend.reset(now_ms);
        Ok(())
    }

    /// The next frame that is to be sent now; call it again until there is none. `vitals` is asked for a heartbeat.
    ///
    /// # Errors
    /// Those of the outbox.
    pub fn poll<'b, P: Parcels>(
        &mut self,
        now_ms: u64,
        entropy: u64,
        parcels: &mut P,
        vitals: impl FnOnce(&mut P) -> Vitals,
        out: &'b mut FrameBuffer,
    ) -> Result<Option<&'b [u8]>, OutboxError> {
        let deaf_ms = now_ms.saturating_sub(self.heard_ms);
        if self.channel.is_some() && deaf_ms > LOST_HEARTBEATS * HEARTBEAT_MS {
            self.channel = None;
            self.next_hello = BackOff::HELLO;
        }
        if self.channel.is_some() && now_ms >= self.next_heartbeat_ms {
            self.next_heartbeat_ms = now_ms.saturating_add(HEARTBEAT_MS);
            let heartbeat = Heartbeat {
                uptime_ms: now_ms,
                starts: self.starts,
                acknowledged: parcels.acknowledged(),
                vitals: vitals(parcels),
            };
            return Ok(self.seal(Kind::Heartbeat, self.starts, &heartbeat, out).ok());
        }
        // A knock asks for a hello although there may be a session.
        let asked = self.last_hello_ms.is_none();
        if (self.channel.is_none() || asked) && self.next_hello.is_due(now_ms) {
            return Ok(self.say_hello(now_ms, entropy, parcels.stream(), out));
        }
        self.send_parcel(now_ms, parcels, out)
    }

    fn send_parcel<'b>(
        &mut self,
        now_ms: u64,
        parcels: &mut impl Parcels,
        out: &'b mut FrameBuffer,
    ) -> Result<Option<&'b [u8]>, OutboxError> {
        if !self.flying.is_empty() && self.resend.is_due(now_ms) {
            self.flying.clear();
            self.resend.tried(now_ms);
        }
        if self.flying.is_full() {
            return Ok(None);
        }
        let last = self.flying.last().copied().unwrap_or(parcels.acknowledged());
        let mut found = Ok(None);
        let Some(channel) = &mut self.channel else {
            return Ok(None);
        };
        let Some(counter) = channel.next_counter() else {
            self.channel = None;
            return Ok(None);
        };
        let mut number = 0;
        // The number stands before the message inside the frame, and is known only once the message was read: it is in the head.
        let written = out.write_sealed(
            counter,
            Kind::Parcel,
            0,
            |room| {
                let head_bytes = PARCEL_HEAD_BYTES;
                let body = room.get_mut(head_bytes..PAYLOAD_BYTES)?;
                found = parcels.next_after(last, body);
                let Ok(Some((sequence, previous, length))) = found else {
                    return None;
                };
                number = sequence;
                write_parcel_head(room, sequence, previous)?;
                Some(head_bytes + length)
            },
            |bytes| channel.seal(Kind::Sealed as u8, counter, bytes),
        );
        match (found?, written) {
            (Some(_), Ok(bytes)) => {
                if self.flying.is_empty() {
                    self.resend.at_ms = now_ms.saturating_add(self.resend.step_ms);
                }
                // There is room: it is not full.
                let _ = self.flying.push(number);
                Ok(Some(bytes))
            }
            _ => {
                // The number was not used.
                channel.give_back(counter);
                Ok(None)
            }
        }
    }

    fn say_hello<'b>(&mut self, now_ms: u64, entropy: u64, stream: u32, out: &'b mut FrameBuffer) -> Option<&'b [u8]> {
        self.sessions = self.sessions.checked_add(1)?;
        let mut nonce = [0; NONCE_BYTES];
        let parts = (self.starts.to_le_bytes().into_iter())
            .chain(self.sessions.to_le_bytes())
            .chain(entropy.to_le_bytes());
        nonce.iter_mut().zip(parts).for_each(|(place, byte)| *place = byte);
        self.last_hello_ms = Some(now_ms);
        self.next_hello.tried(now_ms);
        let hello = Hello {
            device: self.device,
            key: self.key_number,
            stream,
            nonce,
        };
        self.hello = Some(hello);
        out.write_with(Kind::Hello, self.sessions, |room| {
            let bytes = hello.to_bytes();
            room.get_mut(..bytes.len())?.copy_from_slice(&bytes);
            Some(bytes.len())
        })
        .ok()
    }

    /// Seals a message of another part of the logger; none without a session.
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

/// Bytes of a parcel's head: its number and the one before.
const PARCEL_HEAD_BYTES: usize = 8;

fn write_parcel_head(room: &mut [u8], sequence: u32, previous: u32) -> Option<()> {
    let (place, rest) = room.split_first_chunk_mut::<4>()?;
    *place = sequence.to_le_bytes();
    *rest.first_chunk_mut::<4>()? = previous.to_le_bytes();
    Some(())
}

/// Number, number before and message of a parcel.
pub(super) fn read_parcel<'a>(frame: Frame<'a>) -> Option<(u32, u32, &'a [u8])> {
    let payload: &'a [u8] = frame.payload;
    let (sequence, rest) = payload.split_first_chunk::<4>()?;
    let (previous, message) = rest.split_first_chunk::<4>()?;
    Some((u32::from_le_bytes(*sequence), u32::from_le_bytes(*previous), message))
}

/// Seals a message.
pub(super) fn seal<'b>(
    channel: Option<&mut Channel>,
    kind: Kind,
    sequence: u32,
    message: &impl Serialize,
    out: &'b mut FrameBuffer,
) -> Result<&'b [u8], TooLong> {
    let channel = channel.ok_or(TooLong)?;
    let counter = channel.next_counter().ok_or(TooLong)?;
    out.write_sealed(
        counter,
        kind,
        sequence,
        |room| postcard::to_slice(message, room).ok().map(|written| written.len()),
        |bytes| channel.seal(Kind::Sealed as u8, counter, bytes),
    )
}

/// Opens a welcome: the base station's nonce, and what is sealed behind it as its frame number 0.
fn read_welcome(frame: Frame<'_>, key: &Key, hello: &Hello) -> Option<(Channel, Welcome)> {
    let (kind, counter) = (frame.kind as u8, frame.sequence);
    let (nonce, sealed) = frame.payload.split_first_chunk_mut::<NONCE_BYTES>()?;
    let (bytes, tag) = sealed.split_last_chunk_mut::<16>()?;
    let mut channel = Channel::new(End::Logger, key, hello, nonce);
    channel.open(kind, counter, bytes, tag).ok()?;
    let (welcome, _) = postcard::take_from_bytes::<Welcome>(bytes).ok()?;
    // A series that has a name keeps it.
    (hello.stream == 0 || hello.stream == welcome.stream).then_some((channel, welcome))
}
