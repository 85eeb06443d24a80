//! The base station's side. [`Station`] asks one logger over a [`Channel`] and takes what it reports: what `replay` and the tests use. [`base`]
//! attends to many loggers at once and stores what they say ([`store`]), as the program `base-station` does. Both have a [`line`] to each
//! logger; [`words`] say things in sentences.

pub mod base;
mod console;
mod line;
pub mod store;
pub mod words;

use std::collections::VecDeque;
use std::time::{Duration, Instant};

use anyhow::{Result, bail};
use spanwatch::bridge::ReducedBridge;
use spanwatch::session::packet::{Hello, Welcome};
use spanwatch::session::{Device, Key};
use spanwatch::settings::{Identity, Part};
use spanwatch::wire::message::{
    Acknowledgement, Answer, CHUNK_BYTES, Chunk, Configuration, Event, NewKey, Notice, Outcome, PassagePiece, Request,
    SampleBlock, SetupRequest, Status, TrackState,
};

use crate::channel::Channel;
use crate::keys::KeyRing;
use crate::model;
use line::{Desk, Kept, Line, new_series, now_ms};
use store::Origin;

/// The session is looked at so often.
const TURN: Duration = Duration::from_millis(100);
/// A logger that starts again has a session again within this time.
const SESSION_TIMEOUT: Duration = Duration::from_secs(90);
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

/// Something that a logger has said on its own.
#[derive(Debug, Clone, PartialEq)]
pub struct Heard {
    /// Whose it is, and its number.
    pub origin: Origin,
    /// As it came.
    pub message: Vec<u8>,
    /// What it says.
    pub notice: Notice,
}

/// The base station's end of a line to one logger.
pub struct Station {
    line: Line,
    desk: Queue,
    sequence: u32,
    /// The number of what was heard last.
    heard: u32,
    /// The last track that was sent to stay.
    track: Option<Vec<u8>>,
}

/// What the logger has said that nobody has heard.
struct Queue {
    keys: KeyRing,
    /// Name of the logger's series of numbers, where it has none.
    series: u32,
    heard: VecDeque<Heard>,
    /// Messages of another version of the program.
    unknown: u32,
    /// A logger, and its key, that the ring does not have.
    stranger: Option<(Device, u8)>,
    answer: Option<(u32, Answer)>,
}

impl Desk for Queue {
    fn welcome(&mut self, hello: &Hello) -> Option<(Key, Welcome)> {
        let Some(key) = self.keys.find(hello.device, hello.key) else {
            self.stranger = Some((hello.device, hello.key));
            return None;
        };
        let stream = if hello.stream == 0 { self.series } else { hello.stream };
        let welcome = Welcome {
            stream,
            stored: 0,
            time_ms: now_ms(),
        };
        Some((key, welcome))
    }

    fn message(&mut self, origin: Origin, message: &[u8]) -> Kept {
        match postcard::from_bytes(message) {
            Ok(notice) => self.heard.push_back(Heard {
                origin,
                message: message.to_vec(),
                notice,
            }),
            Err(_) => self.unknown += 1,
        }
        Kept::Later
    }

    /// Somebody else has that on disk.
    fn lost(&mut self, _logger: Device, _series: u32, _after: u32, _upto: u32) -> bool {
        true
    }

    fn answer(&mut self, number: u32, answer: Answer) {
        self.answer = Some((number, answer));
    }
}

impl Station {
    /// A station at the end of `channel`, for a logger that nobody gave a key.
    pub fn new(channel: Box<dyn Channel>) -> Self {
        Self::with_keys(channel, KeyRing::demo())
    }

    /// A station at the end of `channel`, for the loggers of this ring.
    pub fn with_keys(channel: Box<dyn Channel>, keys: KeyRing) -> Self {
        Self {
            line: Line::new(channel),
            desk: Queue {
                keys,
                series: new_series(),
                heard: VecDeque::new(),
                unknown: 0,
                stranger: None,
                answer: None,
            },
            sequence: 0,
            heard: 0,
            track: None,
        }
    }

    /// Frames of the logger that were accepted.
    pub fn frames(&self) -> u64 {
        self.line.frames()
    }

    /// Frames that were refused here, and messages that could not be read.
    pub fn rejected(&self) -> u32 {
        self.line.rejected().saturating_add(self.desk.unknown)
    }

    /// The next thing that the logger has said on its own. The logger keeps it until [`Self::confirm`] says that it is safe here.
    pub fn next_heard(&mut self) -> Option<Heard> {
        let heard = self.desk.heard.pop_front()?;
        self.heard = heard.origin.number;
        Some(heard)
    }

    /// What it says.
    pub fn next_event(&mut self) -> Option<Event> {
        self.next_heard().map(|heard| heard.notice.event)
    }

    /// Everything that [`Self::next_heard`] has given is on disk, or need not be: the logger may forget it.
    pub fn confirm(&mut self) -> Result<()> {
        self.line.confirm(self.heard)
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

    /// Sees to it that the logger has a learnt track; one that it has been given already and still has is not sent again, since that would
    /// take back that it has changed.
    pub fn keep_track(&mut self, track: &[u8]) -> Result<()> {
        let has_one = self.status()?.track != TrackState::Unknown;
        if !has_one || self.track.as_deref() != Some(track) {
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
        self.fetch_whole(|offset| Request::Evidence { offset })
    }

    /// A part of the setup that the logger keeps over a restart; nothing where it has none.
    pub fn setup(&mut self, part: Part) -> Result<Vec<u8>> {
        self.fetch_whole(|offset| Request::Setup(SetupRequest::Read { part, offset }))
    }

    /// What the logger is given from now on it also writes to its flash, ...
    pub fn begin_setup(&mut self) -> Result<()> {
        self.command(&Request::Setup(SetupRequest::Begin)).map(|_| ())
    }

    /// ... and starts with from now on.
    pub fn keep_setup(&mut self) -> Result<()> {
        self.command(&Request::Setup(SetupRequest::Keep)).map(|_| ())
    }

    /// The logger goes back to the setup that it keeps.
    pub fn reload_setup(&mut self) -> Result<()> {
        self.command(&Request::Setup(SetupRequest::Reload)).map(|_| ())
    }

    /// The logger forgets what all passages say of the bridge, as after a repair.
    pub fn clear(&mut self) -> Result<()> {
        self.command(&Request::Clear).map(|_| ())
    }

    /// How the logger is.
    pub fn status(&mut self) -> Result<Status> {
        match self.ask(&Request::Status)? {
            Answer::Status(status) => Ok(status),
            _ => bail!("the logger answers a question with something else: is it of another version?"),
        }
    }

    /// The logger starts again.
    pub fn restart(&mut self) -> Result<()> {
        let before = self.status()?.starts;
        self.command(&Request::Restart)?;
        let deadline = Instant::now() + SESSION_TIMEOUT;
        while self.status()?.starts == before {
            if Instant::now() > deadline {
                bail!("the logger has not started again for {} s", SESSION_TIMEOUT.as_secs());
            }
            self.line.turn(BUSY_PAUSE, &mut self.desk)?;
        }
        Ok(())
    }

    /// Gives the logger another key. Its answer to what it is asked next is one by that key: it has given up the session by the old one.
    pub fn replace_identity(&mut self, identity: &Identity) -> Result<()> {
        self.desk.keys.trust(identity);
        self.command(&Request::Key(NewKey {
            device: identity.device,
            number: identity.key_number,
            key: *identity.key.bytes(),
        }))?;
        let key = self.status()?.key;
        if key != identity.key_number {
            bail!("the logger still has its key {key}");
        }
        Ok(())
    }

    /// Fetches something that comes in pieces.
    fn fetch_whole(&mut self, request: impl Fn(u32) -> Request) -> Result<Vec<u8>> {
        let mut bytes = vec![];
        loop {
            let offset = bytes.len() as u32;
            let Answer::Piece(chunk) = self.ask(&request(offset))? else {
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

    /// The recording ends here; does not wait for what comes of it.
    pub fn end_passage(&mut self) -> Result<()> {
        self.command(&Request::Finish).map(|_| ())
    }

    /// Ends the recording and waits until everything in it has been identified.
    pub fn finish(&mut self) -> Result<Status> {
        self.end_passage()?;
        self.wait_until_idle()
    }

    /// Waits until the logger has nothing to do, and all that it has to say is here.
    fn wait_until_idle(&mut self) -> Result<Status> {
        let start = Instant::now();
        loop {
            let status = self.status()?;
            if !status.busy && self.desk.heard.len() >= status.waiting as usize {
                return Ok(status);
            }
            if start.elapsed() > BUSY_TIMEOUT {
                bail!("the logger has been identifying one passage for an hour");
            }
            self.line.turn(BUSY_PAUSE, &mut self.desk)?;
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
        let tries = if self.frames() == 0 { FIRST_TRIES } else { TRIES };
        for _ in 0..tries {
            let deadline = Instant::now() + ANSWER_TIMEOUT;
            let mut session = None;
            while let Some(left) = deadline.checked_duration_since(Instant::now()) {
                // A logger that has begun a new session may not have heard what was said in the old one.
                if self.line.logger().is_some() && session != Some(self.line.sessions()) {
                    session = Some(self.line.sessions());
                    self.line.request(self.sequence, request)?;
                }
                self.line.turn(left.min(TURN), &mut self.desk)?;
                match self.desk.answer.take() {
                    Some((number, answer)) if number == self.sequence => return Ok(answer),
                    // An answer to a request that was asked again comes twice.
                    _ => {}
                }
            }
        }
        if let Some((device, key)) = self.desk.stranger.filter(|_| self.line.sessions() == 0) {
            bail!(
                "the logger says that it is number {device} with its key {key}, which the file of keys does not have (host-sim keys)"
            );
        }
        let refused = match self.rejected() {
            0 => String::new(),
            count => {
                format!("; {count} frames from it were refused, so it may speak another version or have another key")
            }
        };
        bail!(
            "the logger does not answer: {tries} tries of {} s{refused}; is it switched on, on the line (of the base station), and the key right?",
            ANSWER_TIMEOUT.as_secs()
        );
    }
}

/// Whether the logger is busy, if it has done what it was asked.
fn done(answer: Acknowledgement) -> Result<bool> {
    match answer.outcome {
        Outcome::Done => Ok(answer.busy),
        Outcome::Configuration(error) => bail!("the logger refuses its configuration: {error}"),
        Outcome::Model(error) => bail!("the logger refuses the bridge model: {error}"),
        Outcome::Track(error) => bail!("the logger refuses the track: {error}"),
        Outcome::Samples => bail!(
            "the logger refuses the samples: it has started again, or has no configuration, or they fit no channels; replay again"
        ),
        Outcome::Chunk => {
            bail!("the logger refuses a piece of the bridge model or the evidence: it is out of order or too long")
        }
        Outcome::Evidence(error) => bail!("the logger refuses the evidence: {error}"),
        Outcome::Settings(error) => bail!("the logger, or its base station, does not take it: {error}"),
    }
}
