//! A logger at the end of a serial line: bytes in, bytes out.
//!
//! Everything on the line belongs to a [session](crate::session): only a request of the base station that is fresh is looked at. It is answered
//! by one frame with its number, so a sender that waits for the answer never sends more than the logger can hold; a request that comes again,
//! because its answer was lost, does no harm. Passages and alerts go by way of the [outbox](crate::outbox): they are on the flash before
//! they are sent, and stay there until the base station has them on disk. What the logger watches with can be kept on the flash, too
//! ([`setup`]), and so can what it knows of the bridge.

mod setup;

pub use setup::CONFIGURATION_BYTES;

use embedded_storage::nor_flash::NorFlash;

use crate::logger::{Item, Logger};
use crate::outbox::{Class, Outbox, OutboxError};
use crate::session::packet::Vitals;
use crate::session::{LoggerEnd, ToLogger};
use crate::settings::{Identity, Settings};
use crate::slot::Slot;
use crate::wire::frame::Refusal;
use crate::wire::message::{
    Acknowledgement, Answer, Effort, Event, Notice, Outcome, Request, SetupRequest, SetupState, Status,
};
use crate::wire::{Decoder, FrameBuffer, Kind, Rejections};

pub use crate::wire::message::{Health, Restart};

/// Longest notice as it lies in the outbox.
pub const NOTICE_BYTES: usize = 272;

/// What the logger needs of the board it runs on.
pub trait Board {
    /// Sends bytes down the line; returns when the last is queued.
    fn send(&mut self, bytes: &[u8]);
    /// A counter that runs with the processor: clock ticks since the start; 0 where there is none.
    fn ticks(&mut self) -> u64;
    /// Time since the start, ms.
    fn now_ms(&mut self) -> u64;
    /// State that only the board knows.
    fn health(&mut self) -> Health;
    /// The base station asks for a restart; on a board this does not return.
    fn restart(&mut self);
}

/// State of the logger and of its line. Large, 106 KiB: it belongs in static memory.
#[derive(Debug, Clone)]
pub struct RemoteLogger<F> {
    decoder: Decoder,
    desk: Desk<F>,
}

/// Everything behind the decoder.
#[derive(Debug, Clone)]
struct Desk<F> {
    logger: Logger,
    out: FrameBuffer,
    ends: Slot<Ends<F>>,
    frames: u32,
    effort: Effort,
}

/// What lies on the flash, and who it goes to.
#[derive(Debug, Clone)]
struct Ends<F> {
    outbox: Outbox<F>,
    settings: Settings<F>,
    session: LoggerEnd,
    setup: SetupState,
    /// The logger watches with that, and with nothing that it was given since.
    by_setup: bool,
    /// The flash has failed, and nobody knows what it holds.
    failed: bool,
}

impl<F: NorFlash> Default for RemoteLogger<F> {
    fn default() -> Self {
        Self::new()
    }
}

impl<F: NorFlash> RemoteLogger<F> {
    /// A logger that hears nothing yet: see [`Self::open`].
    pub const fn new() -> Self {
        Self {
            decoder: Decoder::new(),
            desk: Desk {
                logger: Logger::new(),
                out: FrameBuffer::new(),
                ends: Slot::Empty,
                frames: 0,
                effort: Effort {
                    stream_ticks: 0,
                    identification_ticks: 0,
                    longest_slice_ticks: 0,
                    solver_steps: 0,
                },
            },
        }
    }

    // Not inlined: what is made here must not stand on the stack under the logger's work.
    /// Opens the outbox on `flash` and the line, and goes on with what `settings` keeps. Who the logger is then.
    ///
    /// # Errors
    /// Those of [`Outbox::open`]; [`OutboxError::Flash`] also if `settings` cannot be read.
    #[inline(never)]
    pub fn open(&mut self, flash: F, settings: F) -> Result<Identity, OutboxError> {
        let outbox = Outbox::open(flash)?;
        let mut settings = Settings::new(settings);
        let told = settings.identity().map_err(|_| OutboxError::Flash)?;
        let identity = told.unwrap_or(Identity::DEMO);
        let key = identity.key.clone();
        let session = LoggerEnd::new(identity.device, identity.key_number, key, outbox.starts());
        self.desk.ends = Slot::Full(Ends {
            outbox,
            settings,
            session,
            setup: SetupState::default(),
            by_setup: false,
            failed: false,
        });
        self.desk.load_setup();
        self.desk.restore_evidence();
        Ok(identity)
    }

    /// The recording ends here, as if the base station had said so.
    pub fn finish(&mut self) {
        self.desk.logger.finish();
    }

    /// The flash has failed: what it holds is not known until the logger starts again.
    pub fn has_failed(&self) -> bool {
        self.desk.has_failed()
    }

    // Not inlined: a request must not stand on the stack under the search.
    /// Takes bytes from the line and answers the requests that they complete.
    #[inline(never)]
    pub fn receive(&mut self, bytes: &[u8], board: &mut impl Board) {
        for &byte in bytes {
            let Some(frame) = self.decoder.push(byte) else { continue };
            let Some(ends) = self.desk.ends.as_mut() else { continue };
            let frame = match ends.session.on_frame(frame, board.now_ms(), &mut ends.outbox) {
                Ok(ToLogger::Request(frame)) => frame,
                Ok(ToLogger::Nothing) => continue,
                Err(_) => {
                    ends.failed = true;
                    continue;
                }
            };
            let sequence = frame.sequence;
            match frame.message() {
                Some(request) => {
                    let rejected = self.decoder.rejections().total();
                    self.desk.answer(sequence, request, rejected, board);
                }
                None => self.decoder.refuse(Refusal::Payload),
            }
        }
        self.desk.send_what_is_due(self.decoder.rejections(), board);
    }

    /// Does one slice of the work that waits, and sends what is due; true if there is more.
    pub fn poll(&mut self, board: &mut impl Board) -> bool {
        let mut more = false;
        if self.desk.logger.is_busy() {
            let start = board.ticks();
            more = self.desk.logger.poll();
            let ticks = board.ticks().saturating_sub(start);
            let effort = &mut self.desk.effort;
            effort.identification_ticks = effort.identification_ticks.saturating_add(ticks);
            effort.longest_slice_ticks = effort.longest_slice_ticks.max(ticks);
            self.desk.tell(board.now_ms());
        }
        self.desk.send_what_is_due(self.decoder.rejections(), board);
        more
    }
}

impl<F: NorFlash> Desk<F> {
    // Not inlined: a request and a bridge model on their way must not stand on the stack while a search runs.
    #[inline(never)]
    fn answer(&mut self, sequence: u32, request: Request, rejected: u32, board: &mut impl Board) {
        self.frames = self.frames.saturating_add(1);
        let answer = match request {
            Request::Evidence { offset } => Answer::Piece(self.logger.give_evidence(offset)),
            Request::Passage { offset } => Answer::Passage(self.logger.give_passage(offset)),
            Request::Status => Answer::Status(self.status(rejected, board)),
            Request::Setup(SetupRequest::Read { part, offset }) => Answer::Piece(self.give_setup(part, offset)),
            Request::Restart => {
                self.acknowledge(sequence, Outcome::Done, board);
                return board.restart();
            }
            Request::Key(key) => {
                let outcome = self.take_key(&key);
                self.acknowledge(sequence, outcome, board);
                if outcome == Outcome::Done {
                    self.use_key(&key);
                }
                return;
            }
            request => {
                let outcome = self.obey(request, board);
                return self.acknowledge(sequence, outcome, board);
            }
        };
        self.send(sequence, &answer, board);
    }

    // Not inlined, as [`Self::answer`].
    #[inline(never)]
    fn obey(&mut self, request: Request, board: &mut impl Board) -> Outcome {
        match request {
            Request::Configure(configuration) => self.configure(configuration),
            Request::Model(chunk) => self.take_piece(Item::Model, &chunk),
            Request::Track(chunk) => self.take_piece(Item::Track, &chunk),
            Request::Restore(chunk) => self.take_piece(Item::Evidence, &chunk),
            Request::Samples(block) => {
                let start = board.ticks();
                let taken = self.logger.push(block.first_sample, &block.counts);
                let ticks = board.ticks().saturating_sub(start);
                self.effort.stream_ticks = self.effort.stream_ticks.saturating_add(ticks);
                taken.map_or(Outcome::Samples, |()| Outcome::Done)
            }
            Request::Setup(request) => self.set_up(request),
            Request::Finish => {
                self.logger.finish();
                Outcome::Done
            }
            Request::Clear => {
                if self.setup_state().generation > 0 {
                    self.load_setup();
                }
                self.logger.clear();
                self.keep_evidence();
                Outcome::Done
            }
            _ => Outcome::Done,
        }
    }

    fn acknowledge(&mut self, sequence: u32, outcome: Outcome, board: &mut impl Board) {
        let busy = self.logger.is_busy();
        let answer = Answer::Acknowledgement(Acknowledgement { outcome, busy });
        self.send(sequence, &answer, board);
        self.tell(board.now_ms());
    }

    fn status(&mut self, rejected: u32, board: &mut impl Board) -> Status {
        let setup = self.setup_state();
        let ends = self.ends.as_mut();
        let (fill, starts, key) = ends.map_or((None, 0, 0), |ends| {
            let starts = ends.outbox.starts();
            (ends.outbox.fill().ok(), starts, ends.session.key_number())
        });
        Status {
            waiting: fill.map_or(0, |fill| fill.alerts.saturating_add(fill.reports)),
            track: self.logger.track_state(),
            setup,
            starts,
            key,
            samples: self.logger.samples(),
            passages: self.logger.passages(),
            alerts: self.logger.alerts(),
            frames: self.frames,
            rejected,
            quality: self.logger.quality(),
            busy: self.logger.is_busy(),
            effort: Effort {
                solver_steps: self.logger.solver_steps(),
                ..self.effort
            },
            health: board.health(),
        }
    }

    // Not inlined: a notice must not stand on the stack under the search.
    /// Puts what the logger has to say on the flash.
    #[inline(never)]
    fn tell(&mut self, now_ms: u64) {
        let mut learnt = false;
        while let Some(event) = self.logger.next_event() {
            log(&event);
            learnt |= match &event {
                Event::Passage(report) => report.verdict.fit().is_some(),
                Event::Track(_) => true,
                Event::Alert(_) => false,
            };
            let Some(ends) = self.ends.as_mut() else { continue };
            let class = match event {
                Event::Alert(_) => Class::Alert,
                Event::Passage(_) | Event::Track(_) => Class::Report,
            };
            let notice = Notice {
                start: ends.outbox.starts(),
                uptime_ms: now_ms,
                event,
            };
            let mut bytes = [0; NOTICE_BYTES];
            // Every notice fits: tests/frames.rs writes the largest of each.
            let Ok(bytes) = postcard::to_slice(&notice, &mut bytes) else {
                continue;
            };
            match ends.outbox.append(class, bytes) {
                // It was counted, and is told with the next heartbeat.
                Ok(_) | Err(OutboxError::Full) => {}
                Err(_) => ends.failed = true,
            }
        }
        if learnt {
            self.keep_evidence();
        }
    }

    // Not inlined: a frame that is sealed must not stand on the stack under the search.
    /// Sends what the session has to send now.
    #[inline(never)]
    fn send_what_is_due(&mut self, rejections: &Rejections, board: &mut impl Board) {
        let Some(ends) = self.ends.as_mut() else { return };
        let (passages, alerts, setup) = (self.logger.passages(), self.logger.alerts(), ends.setup);
        loop {
            let (now_ms, entropy) = (board.now_ms(), board.ticks());
            let (refusals, offset) = (ends.session.refusals(), ends.session.clock_offset_ms());
            let vitals = |outbox: &mut Outbox<F>| {
                let fill = outbox.fill().unwrap_or_default();
                let ledger = outbox.ledger();
                Vitals {
                    health: board.health(),
                    setup,
                    passages,
                    alerts,
                    alerts_waiting: fill.alerts,
                    reports_waiting: fill.reports,
                    fill_permille: (u64::from(fill.bytes) * 1000 / u64::from(fill.capacity.max(1))) as u16,
                    alerts_dropped: ledger.alerts_dropped,
                    reports_dropped: ledger.reports_dropped,
                    unreadable: ledger.unreadable,
                    wear: outbox.wear().most,
                    rejections: rejections.by_reason().into_iter().collect(),
                    forged: refusals.forged,
                    replayed: refusals.replayed,
                    unsealed: refusals.unsealed,
                    clock_offset_ms: offset,
                }
            };
            let due = ends
                .session
                .poll(now_ms, entropy, &mut ends.outbox, vitals, &mut self.out);
            match due {
                Ok(Some(bytes)) => board.send(bytes),
                Ok(None) => return,
                Err(_) => {
                    ends.failed = true;
                    return;
                }
            }
        }
    }

    fn has_failed(&self) -> bool {
        self.ends.as_ref().is_some_and(|ends| ends.failed)
    }

    fn send(&mut self, sequence: u32, answer: &Answer, board: &mut impl Board) {
        let Some(ends) = self.ends.as_mut() else { return };
        // Every message fits: tests/frames.rs writes the largest of each.
        if let Ok(bytes) = ends.session.seal(Kind::Answer, sequence, answer, &mut self.out) {
            board.send(bytes);
        }
    }
}

/// Tells a person at the debugger what the base station is told.
fn log(event: &Event) {
    #[cfg(feature = "defmt")]
    match event {
        Event::Passage(report) => defmt::info!(
            "passage {=u32}, samples {=u64} to {=u64}: {}",
            report.passage,
            report.start_sample,
            report.end_sample,
            report.verdict
        ),
        Event::Track(report) => defmt::warn!(
            "passage {=u32}: the track has changed, {=f32} deviations more are left",
            report.passage,
            report.misfit
        ),
        Event::Alert(alert) => defmt::warn!(
            "alert of passage {=u32}: elements {=u16:#b} damaged, per mille {=[?]}",
            alert.passage,
            alert.certain,
            alert.damage_permille.as_slice()
        ),
    }
    #[cfg(not(feature = "defmt"))]
    let _ = event;
}
