//! The base station: asks a logger over a [`Channel`], takes what it reports, says it in words ([`words`]) and stores its
//! alerts ([`store`]).

pub mod store;
pub mod words;

use std::collections::VecDeque;
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

use anyhow::{Context, Result, bail};
use spanwatch::bridge::ReducedBridge;
use spanwatch::session::packet::Welcome;
use spanwatch::session::{Key, StationEnd, ToStation};
use spanwatch::wire::frame::Refusal;
use spanwatch::wire::message::{
    Acknowledgement, Answer, CHUNK_BYTES, Chunk, Configuration, Event, Outcome, PassagePiece, Request, SampleBlock,
    Status,
};
use spanwatch::wire::{Decoder, FrameBuffer, Kind};

use crate::channel::Channel;
use crate::model;

/// The session is looked at so often.
const TURN: Duration = Duration::from_millis(100);
/// A request that is not answered is sent again after this time; asking twice does no harm.
const ANSWER_TIMEOUT: Duration = Duration::from_secs(20);
/// So often to a logger that has never answered, ...
const FIRST_TRIES: u32 = 2;
/// ... and to one that has: it may be in the middle of a slice of work, minutes on the slowest board that we know.
const TRIES: u32 = 10;
/// So often something in pieces is begun again because a passage has taken the logger's room for it: passages are minutes apart.
const WHOLE_TRIES: u32 = 3;
/// Pause between two questions whether the logger is still busy.
const BUSY_PAUSE: Duration = Duration::from_millis(100);
/// An identification that takes longer hangs: a 16-car train takes minutes on the slowest board.
const BUSY_TIMEOUT: Duration = Duration::from_secs(3600);

/// The base station's end of a line to one logger.
pub struct Station {
    channel: Box<dyn Channel>,
    decoder: Decoder,
    out: FrameBuffer,
    sequence: u32,
    session: StationEnd,
    /// Name of the logger's series of numbers, where it has none.
    stream: u32,
    /// What the logger has said on its own and nobody has heard, with its number.
    events: VecDeque<(u32, Event)>,
    /// The number of what was heard last.
    heard: u32,
    frames: u64,
    /// The last track that was sent to stay.
    track: Option<Vec<u8>>,
}

impl Station {
    /// A station at the end of `channel`.
    pub fn new(channel: Box<dyn Channel>) -> Self {
        Self {
            channel,
            decoder: Decoder::new(),
            out: FrameBuffer::new(),
            sequence: 0,
            session: StationEnd::new(),
            stream: u32::from_le_bytes(chance()) | 1,
            events: VecDeque::new(),
            heard: 0,
            frames: 0,
            track: None,
        }
    }

    /// Frames of the logger that were accepted.
    pub fn frames(&self) -> u64 {
        self.frames
    }

    /// Frames that were refused here.
    pub fn rejected(&self) -> u32 {
        let refusals = self.session.refusals();
        let refused = (refusals.forged.saturating_add(refusals.replayed)).saturating_add(refusals.unsealed);
        self.decoder.rejections().total().saturating_add(refused)
    }

    /// The next thing that the logger has said on its own. The logger keeps it until [`Self::confirm`] says that it is safe here.
    pub fn next_event(&mut self) -> Option<Event> {
        let (number, event) = self.events.pop_front()?;
        self.heard = number;
        Some(event)
    }

    /// Everything that [`Self::next_event`] has given is on disk, or need not be: the logger may forget it.
    pub fn confirm(&mut self) -> Result<()> {
        self.session.stored(self.heard);
        self.say_what_is_due()
    }

    /// Configures the logger.
    pub fn configure(&mut self, configuration: &Configuration) -> Result<()> {
        self.command(&Request::Configure(configuration.clone())).map(|_| ())
    }

    /// Gives the logger a bridge model.
    pub fn load(&mut self, bridge: &ReducedBridge<f64>) -> Result<()> {
        self.send_whole(&model::to_blob(bridge)?, Request::Model)
    }

    /// Gives the logger a learnt track, as [`calibrate`](crate::calibrate) writes it.
    pub fn load_track(&mut self, track: &[u8]) -> Result<()> {
        self.send_whole(track, Request::Track)
    }

    /// Sees to it that the logger has a learnt track; one that it has been given already is not sent again, since that would take back
    /// that it has changed.
    pub fn keep_track(&mut self, track: &[u8]) -> Result<()> {
        if self.track.as_deref() != Some(track) {
            self.load_track(track)?;
            self.track = Some(track.to_vec());
        }
        Ok(())
    }

    /// The last passage that the learnt track did not explain, as its first piece, and the values of all pieces; none if the logger
    /// has it no longer.
    pub fn strange_passage(&mut self) -> Result<Option<(PassagePiece, Vec<f32>)>> {
        let mut whole: Option<(PassagePiece, Vec<f32>)> = None;
        loop {
            let offset = whole.as_ref().map_or(0, |(_, values)| values.len() as u32);
            let Answer::Passage(piece) = self.ask(&Request::Passage { offset })? else {
                bail!("the logger answers a question with something else: is it of another version?");
            };
            let (first, values) = whole.get_or_insert_with(|| (piece.clone(), vec![]));
            if piece.passage == 0 || piece.values.is_empty() || piece.passage != first.passage {
                // There is none, or another one has come meanwhile.
                return Ok(None);
            }
            values.extend_from_slice(&piece.values);
            if values.len() >= piece.total as usize {
                return Ok(whole);
            }
        }
    }

    /// What all passages say of the bridge, as the logger keeps it.
    pub fn evidence(&mut self) -> Result<Vec<u8>> {
        let mut bytes = vec![];
        loop {
            let offset = bytes.len() as u32;
            let Answer::Evidence(chunk) = self.ask(&Request::Evidence { offset })? else {
                bail!("the logger answers a question with something else: is it of another version?");
            };
            bytes.extend_from_slice(&chunk.bytes);
            if chunk.bytes.is_empty() || bytes.len() >= chunk.total as usize {
                return Ok(bytes);
            }
        }
    }

    /// Lets the logger go on from what an earlier one knew of the bridge.
    pub fn restore(&mut self, evidence: &[u8]) -> Result<()> {
        self.send_whole(evidence, Request::Restore)
    }

    /// Sends bytes in pieces; begins again if the logger has lost those before.
    fn send_whole(&mut self, bytes: &[u8], request: fn(Chunk) -> Request) -> Result<()> {
        for _ in 1..WHOLE_TRIES {
            let answer = self.send_pieces(bytes, request)?;
            if answer.outcome != Outcome::Chunk {
                return done(answer).map(|_| ());
            }
        }
        self.send_pieces(bytes, request).and_then(done).map(|_| ())
    }

    /// Sends bytes in pieces, up to the first that is refused as out of order; what the last one sent was answered.
    fn send_pieces(&mut self, bytes: &[u8], request: fn(Chunk) -> Request) -> Result<Acknowledgement> {
        let mut offset = 0;
        loop {
            let piece = bytes.iter().skip(offset).take(CHUNK_BYTES).copied().collect();
            let answer = self.acknowledged(&request(Chunk {
                offset: offset as u32,
                total: bytes.len() as u32,
                bytes: piece,
            }))?;
            offset += CHUNK_BYTES;
            if answer.outcome == Outcome::Chunk || offset >= bytes.len() {
                return Ok(answer);
            }
            done(answer)?;
        }
    }

    /// Sends samples, whether the logger is busy or not, as a sensor would; tells whether it is identifying something now.
    pub fn offer(&mut self, first_sample: u64, counts: &[i32]) -> Result<bool> {
        self.command(&Request::Samples(SampleBlock {
            first_sample,
            counts: counts.iter().copied().collect(),
        }))
    }

    /// Sends samples; then waits until the logger has time for more.
    pub fn samples(&mut self, first_sample: u64, counts: &[i32]) -> Result<()> {
        if self.offer(first_sample, counts)? {
            self.wait_until_idle()?;
        }
        Ok(())
    }

    /// Ends the recording and waits until everything in it has been identified.
    pub fn finish(&mut self) -> Result<Status> {
        self.command(&Request::Finish)?;
        self.wait_until_idle()
    }

    /// Waits until the logger has nothing to do, and all that it has to say is here.
    fn wait_until_idle(&mut self) -> Result<Status> {
        let start = Instant::now();
        loop {
            let Answer::Status(status) = self.ask(&Request::Status)? else {
                bail!("the logger answers a question with something else: is it of another version?");
            };
            if !status.busy && self.events.len() >= status.waiting as usize {
                return Ok(status);
            }
            if start.elapsed() > BUSY_TIMEOUT {
                bail!("the logger has been identifying one passage for an hour");
            }
            self.listen(BUSY_PAUSE)?;
        }
    }

    /// A request that the logger must do; whether it is busy now.
    fn command(&mut self, request: &Request) -> Result<bool> {
        self.acknowledged(request).and_then(done)
    }

    /// A request whose answer is an acknowledgement.
    fn acknowledged(&mut self, request: &Request) -> Result<Acknowledgement> {
        match self.ask(request)? {
            Answer::Acknowledgement(answer) => Ok(answer),
            _ => bail!("the logger answers a request with something else: is it of another version?"),
        }
    }

    /// Sends a request until it is answered.
    fn ask(&mut self, request: &Request) -> Result<Answer> {
        self.sequence = self.sequence.wrapping_add(1);
        let tries = if self.frames == 0 { FIRST_TRIES } else { TRIES };
        for _ in 0..tries {
            let deadline = Instant::now() + ANSWER_TIMEOUT;
            let mut session = None;
            while let Some(left) = deadline.checked_duration_since(Instant::now()) {
                // A logger that has begun a new session may not have heard what was said in the old one.
                if self.session.is_up() && session != Some(self.session.sessions()) {
                    session = Some(self.session.sessions());
                    let frame = (self.session)
                        .seal(Kind::Request, self.sequence, request, &mut self.out)
                        .ok()
                        .context("the request does not fit into a frame")?;
                    self.channel.send(frame).context("cannot send to the logger")?;
                }
                if let Some(answer) = self.listen(left)? {
                    return Ok(answer);
                }
            }
        }
        let refused = match self.rejected() {
            0 => String::new(),
            count => {
                format!("; {count} frames from it were refused, so it may speak another version or have another key")
            }
        };
        bail!(
            "the logger does not answer: {tries} tries of {} s{refused}",
            ANSWER_TIMEOUT.as_secs()
        );
    }

    fn say_what_is_due(&mut self) -> Result<()> {
        while let Some(frame) = self.session.poll(now_ms(), &mut self.out) {
            self.channel.send(frame).context("cannot send to the logger")?;
        }
        Ok(())
    }

    /// Takes what the line gives within `timeout`, or a turn of the session; ends early with the answer to the last request.
    fn listen(&mut self, timeout: Duration) -> Result<Option<Answer>> {
        self.say_what_is_due()?;
        let mut buffer = [0; 1024];
        let count = self
            .channel
            .receive(&mut buffer, timeout.min(TURN))
            .context("cannot hear the logger")?;
        let mut found = None;
        for &byte in &buffer[..count] {
            let Some(frame) = self.decoder.push(byte) else { continue };
            self.frames += 1;
            match self.session.on_frame(frame, now_ms()) {
                ToStation::Hello(hello) => {
                    let stream = if hello.stream == 0 { self.stream } else { hello.stream };
                    let welcome = Welcome {
                        stream,
                        stored: 0,
                        time_ms: now_ms(),
                    };
                    let frame = (self.session).welcome(&hello, &Key::DEMO, chance(), welcome, now_ms(), &mut self.out);
                    if let Some(frame) = frame {
                        self.channel.send(frame).context("cannot send to the logger")?;
                    }
                }
                ToStation::Parcel { sequence, message, .. } => match postcard::from_bytes(message) {
                    Ok(event) => self.events.push_back((sequence, event)),
                    Err(_) => self.decoder.refuse(Refusal::Payload),
                },
                // Somebody else has that on disk.
                ToStation::Lost { acknowledged, .. } => self.session.stored(acknowledged),
                ToStation::Answer(frame) => match frame.message() {
                    // An answer to a request that was asked again comes twice.
                    Some(answer) if frame.sequence == self.sequence => found = Some(answer),
                    Some(_) => {}
                    None => self.decoder.refuse(Refusal::Payload),
                },
                _ => {}
            }
        }
        Ok(found)
    }
}

/// Random bytes.
fn chance<const N: usize>() -> [u8; N] {
    let mut bytes = [0; N];
    getrandom::fill(&mut bytes).expect("the system has random numbers");
    bytes
}

/// The clock, ms since 1970.
fn now_ms() -> u64 {
    let since = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
    since.as_millis() as u64
}

/// Whether the logger is busy, if it has done what it was asked.
fn done(answer: Acknowledgement) -> Result<bool> {
    match answer.outcome {
        Outcome::Done => Ok(answer.busy),
        Outcome::Configuration(error) => bail!("the logger refuses its configuration: {error}"),
        Outcome::Model(error) => bail!("the logger refuses the bridge model: {error}"),
        Outcome::Track(error) => bail!("the logger refuses the track: {error}"),
        Outcome::Samples => bail!("the logger refuses the samples: it has no configuration, or they fit no channels"),
        Outcome::Chunk => {
            bail!("the logger refuses a piece of the bridge model or the evidence: it is out of order or too long")
        }
        Outcome::Evidence(error) => bail!("the logger refuses the evidence: {error}"),
    }
}
