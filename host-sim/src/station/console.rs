//! Orders to a logger through a running base station, which alone has the line to it.
//!
//! Whoever has the console's key talks to the base station as to the logger itself: by the same frames and the same session. A first line in
//! the clear, `12\n`, says which logger. What the logger has said since then comes as from the logger's outbox, out of the database.

use std::io::{ErrorKind, Read, Write};
use std::net::TcpStream;
use std::sync::mpsc::{self, Receiver, TryRecvError};
use std::time::{Duration, Instant};

use anyhow::{Context, Result, bail};
use spanwatch::outbox::OutboxError;
use spanwatch::session::packet::Vitals;
use spanwatch::session::{Device, LoggerEnd, Parcels, ToLogger};
use spanwatch::settings::SettingsError;
use spanwatch::wire::message::{Acknowledgement, Answer, Outcome, Request, SetupRequest};
use spanwatch::wire::{Decoder, FrameBuffer, Kind};

use super::base::{Base, Order, Said};
use super::line::chance;
use super::store::Store;

/// Longest first line.
const FIRST_LINE_BYTES: usize = 16;
/// The line is looked at so often.
const TURN: Duration = Duration::from_millis(2);
/// The database so often.
const LOOK: Duration = Duration::from_millis(50);

/// What the logger has said, from the database.
struct Stored {
    store: Store,
    logger: Device,
    /// Place in the file of what was confirmed last.
    confirmed: u32,
}

impl Parcels for Stored {
    fn stream(&self) -> u32 {
        1
    }

    fn name_stream(&mut self, _stream: u32) -> Result<(), OutboxError> {
        Ok(())
    }

    fn acknowledged(&self) -> u32 {
        self.confirmed
    }

    fn next_after(&mut self, sequence: u32, buffer: &mut [u8]) -> Result<Option<(u32, u32, usize)>, OutboxError> {
        let after = sequence.max(self.confirmed);
        let Ok(found) = self.store.message_after(self.logger, after) else {
            return Ok(None);
        };
        Ok(found.and_then(|(place, message)| {
            buffer.get_mut(..message.len())?.copy_from_slice(&message);
            Some((place, after, message.len()))
        }))
    }

    fn acknowledge(&mut self, sequence: u32) -> Result<(), OutboxError> {
        self.confirmed = self.confirmed.max(sequence);
        Ok(())
    }
}

/// Says that somebody gives orders, as long as they do.
struct Present<'b>(&'b Base, Device);

impl<'b> Present<'b> {
    fn new(base: &'b Base, logger: Device) -> Self {
        base.count_console(logger, true);
        Self(base, logger)
    }
}

impl Drop for Present<'_> {
    fn drop(&mut self) {
        self.0.count_console(self.1, false);
    }
}

/// Attends to one who gives orders, until they are gone.
pub(super) fn attend(line: &TcpStream, base: &Base) -> Result<()> {
    line.set_nodelay(true)?;
    line.set_read_timeout(Some(TURN))?;
    let (mut hear, mut say) = (line, line);
    let logger = first_line(&mut hear)?;
    let _present = Present::new(base, logger);
    let store = Store::open(&base.database)?;
    let mut stored = Stored {
        confirmed: store.last_message(logger)?,
        store,
        logger,
    };
    let mut end = LoggerEnd::new(logger, 0, base.keys.ring()?.console(), u32::from_le_bytes(chance()));
    let (mut decoder, mut out) = (Decoder::new(), FrameBuffer::new());
    let start = Instant::now();
    let now_ms = || start.elapsed().as_millis() as u64;
    let mut open: Option<Open> = None;
    let mut looked = start;
    loop {
        let mut buffer = [0; 1024];
        let count = match hear.read(&mut buffer) {
            Ok(0) => return Ok(()),
            Ok(count) => count,
            Err(error) if matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut) => 0,
            Err(error) if error.kind() == ErrorKind::ConnectionReset => return Ok(()),
            Err(error) => return Err(error).context("cannot hear the console"),
        };
        for &byte in &buffer[..count] {
            let Some(frame) = decoder.push(byte) else { continue };
            let Ok(ToLogger::Request(frame)) = end.on_frame(frame, now_ms(), &mut stored) else {
                continue;
            };
            let Some(request) = frame.message::<Request>() else {
                continue;
            };
            open = Some(Open::new(frame.sequence, request, logger, base));
        }
        let answer = open.as_mut().and_then(|open| open.answer(logger, base));
        // What was said before the answer comes before it.
        if answer.is_some() || count > 0 || looked.elapsed() >= LOOK {
            looked = Instant::now();
            let entropy = u64::from_le_bytes(chance());
            while let Ok(Some(bytes)) = end.poll(now_ms(), entropy, &mut stored, |_| Vitals::default(), &mut out) {
                say.write_all(bytes)?;
            }
        }
        if let Some((number, answer)) = answer {
            open = None;
            if let Ok(bytes) = end.seal(Kind::Answer, number, &answer, &mut out) {
                say.write_all(bytes)?;
            }
        }
    }
}

/// A request that is not answered yet.
struct Open {
    number: u32,
    request: Request,
    answer: Receiver<Answer>,
    ordered: Instant,
}

impl Open {
    fn new(number: u32, request: Request, logger: Device, base: &Base) -> Self {
        let (reply, answer) = mpsc::channel();
        let order = Order { request, reply };
        let request = order.request.clone();
        let allowed = is_allowed(&request, logger, base);
        if let Some(order) = worth_a_word(&request) {
            base.say(Said::Ordered { logger, order, allowed });
        }
        if allowed {
            base.order(logger, order);
        } else {
            let refusal = Acknowledgement {
                outcome: Outcome::Settings(SettingsError::Refused),
                busy: false,
            };
            let _ = order.reply.send(Answer::Acknowledgement(refusal));
        }
        Self {
            number,
            request,
            answer,
            ordered: Instant::now(),
        }
    }

    /// The answer, once it is there. A logger whose line was lost is asked again when it is back.
    fn answer(&mut self, logger: Device, base: &Base) -> Option<(u32, Answer)> {
        match self.answer.try_recv() {
            Ok(answer) => return Some((self.number, answer)),
            Err(TryRecvError::Empty) => {}
            Err(TryRecvError::Disconnected) if self.ordered.elapsed() < LOOK => {}
            Err(TryRecvError::Disconnected) => *self = Self::new(self.number, self.request.clone(), logger, base),
        }
        None
    }
}

/// What an order changes for good, or for long.
fn worth_a_word(request: &Request) -> Option<&'static str> {
    match request {
        Request::Configure(_) => Some("configure"),
        Request::Setup(SetupRequest::Begin) => Some("begin a setup"),
        Request::Setup(SetupRequest::Keep) => Some("keep the setup"),
        Request::Setup(SetupRequest::Reload) => Some("go back to the setup that it keeps"),
        Request::Clear => Some("forget what the passages said of the bridge"),
        Request::Key(_) => Some("use another key"),
        Request::Restart => Some("start again"),
        _ => None,
    }
}

/// A key that the base station does not have would shut the logger out.
fn is_allowed(request: &Request, logger: Device, base: &Base) -> bool {
    let Request::Key(new) = request else { return true };
    let known = base.keys.ring().ok().and_then(|ring| ring.find(new.device, new.number));
    new.device == logger && known.is_some_and(|key| *key.bytes() == new.key)
}

/// Which logger is meant.
fn first_line(hear: &mut impl Read) -> Result<Device> {
    let deadline = Instant::now() + Duration::from_secs(5);
    let mut text = vec![];
    while Instant::now() < deadline && text.len() < FIRST_LINE_BYTES {
        let mut byte = [0];
        match hear.read(&mut byte) {
            Ok(0) => break,
            Ok(_) if byte == *b"\n" => {
                let text = String::from_utf8_lossy(&text);
                return text
                    .trim()
                    .parse()
                    .with_context(|| format!("\"{text}\" is no number of a logger"));
            }
            Ok(_) => text.extend(byte),
            Err(error) if matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut) => {}
            Err(error) => return Err(error).context("cannot hear the console"),
        }
    }
    bail!("it did not say which logger it means");
}
