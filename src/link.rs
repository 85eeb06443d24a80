//! A logger at the end of a serial line: bytes in, bytes out.
//!
//! Every request is answered at once by one frame with the request's number, so a sender that waits for the answer
//! never sends more than the logger can hold; a request that comes again, because its answer was lost, does no harm.
//! Passages and alerts follow on their own, numbered by the logger from 1.

use crate::logger::{Item, Logger};
use crate::wire::frame::Refusal;
use crate::wire::message::{Acknowledgement, Answer, Effort, Event, Outcome, Request, Status};
use crate::wire::{Decoder, FrameBuffer, Kind};

pub use crate::wire::message::{Health, Restart};

/// What the logger needs of the board it runs on.
pub trait Board {
    /// Sends bytes down the line; returns when the last is queued.
    fn send(&mut self, bytes: &[u8]);
    /// A counter that runs with the processor: clock ticks since the start; 0 where there is none.
    fn ticks(&mut self) -> u64;
    /// State that only the board knows.
    fn health(&mut self) -> Health;
}

/// State of the logger and of its line. Large, 105 KiB: it belongs in static memory.
#[derive(Debug, Clone)]
pub struct RemoteLogger {
    decoder: Decoder,
    desk: Desk,
}

/// Everything behind the decoder.
#[derive(Debug, Clone)]
struct Desk {
    logger: Logger,
    out: FrameBuffer,
    /// Number of the last event.
    events: u32,
    frames: u32,
    effort: Effort,
}

impl Default for RemoteLogger {
    fn default() -> Self {
        Self::new()
    }
}

impl RemoteLogger {
    /// A logger that waits for its first frame.
    pub const fn new() -> Self {
        Self {
            decoder: Decoder::new(),
            desk: Desk {
                logger: Logger::new(),
                out: FrameBuffer::new(),
                events: 0,
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

    /// Takes bytes from the line and answers the requests that they complete.
    pub fn receive(&mut self, bytes: &[u8], board: &mut impl Board) {
        for &byte in bytes {
            let Some(frame) = self.decoder.push(byte) else { continue };
            if frame.kind != Kind::Request {
                self.decoder.refuse(Refusal::Kind);
                continue;
            }
            let sequence = frame.sequence;
            match frame.message() {
                Some(request) => {
                    let rejected = self.decoder.rejections().total();
                    self.desk.answer(sequence, request, rejected, board);
                }
                None => self.decoder.refuse(Refusal::Payload),
            }
        }
    }

    /// Does one slice of the work that waits; true if there is more.
    pub fn poll(&mut self, board: &mut impl Board) -> bool {
        if !self.desk.logger.is_busy() {
            return false;
        }
        let start = board.ticks();
        let more = self.desk.logger.poll();
        let ticks = board.ticks().saturating_sub(start);
        let effort = &mut self.desk.effort;
        effort.identification_ticks = effort.identification_ticks.saturating_add(ticks);
        effort.longest_slice_ticks = effort.longest_slice_ticks.max(ticks);
        self.desk.tell(board);
        more
    }
}

impl Desk {
    // Not inlined: a request and a bridge model on their way must not stand on the stack while a search runs.
    #[inline(never)]
    fn answer(&mut self, sequence: u32, request: Request, rejected: u32, board: &mut impl Board) {
        self.frames = self.frames.saturating_add(1);
        let outcome = match request {
            Request::Configure(configuration) => {
                self.logger
                    .configure(configuration)
                    .map_or_else(Outcome::Configuration, |()| {
                        self.effort = Effort::default();
                        Outcome::Done
                    })
            }
            Request::Model(chunk) => self.logger.take_piece(Item::Model, &chunk),
            Request::Track(chunk) => self.logger.take_piece(Item::Track, &chunk),
            Request::Samples(block) => {
                let start = board.ticks();
                let taken = self.logger.push(block.first_sample, &block.counts);
                let ticks = board.ticks().saturating_sub(start);
                self.effort.stream_ticks = self.effort.stream_ticks.saturating_add(ticks);
                taken.map_or(Outcome::Samples, |()| Outcome::Done)
            }
            Request::Finish => {
                self.logger.finish();
                Outcome::Done
            }
            Request::Evidence { offset } => return self.tell_evidence(offset, sequence, board),
            Request::Restore(chunk) => self.logger.take_piece(Item::Evidence, &chunk),
            Request::Passage { offset } => return self.tell_passage(offset, sequence, board),
            Request::Status => {
                let answer = Answer::Status(self.status(rejected, board));
                return self.send(Kind::Answer, sequence, &answer, board);
            }
        };
        let busy = self.logger.is_busy();
        let answer = Answer::Acknowledgement(Acknowledgement { outcome, busy });
        self.send(Kind::Answer, sequence, &answer, board);
        self.tell(board);
    }

    // Not inlined: a piece that no other request needs.
    #[inline(never)]
    fn tell_evidence(&mut self, offset: u32, sequence: u32, board: &mut impl Board) {
        let chunk = self.logger.give_evidence(offset);
        self.send(Kind::Answer, sequence, &Answer::Evidence(chunk), board);
    }

    // Not inlined: a piece that no other request needs.
    #[inline(never)]
    fn tell_passage(&mut self, offset: u32, sequence: u32, board: &mut impl Board) {
        let piece = Answer::Passage(self.logger.give_passage(offset));
        self.send(Kind::Answer, sequence, &piece, board);
    }

    fn status(&self, rejected: u32, board: &mut impl Board) -> Status {
        Status {
            track: self.logger.track_state(),
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

    /// Sends what the logger has to say.
    fn tell(&mut self, board: &mut impl Board) {
        while let Some(event) = self.logger.next_event() {
            self.events = self.events.wrapping_add(1);
            log(&event);
            self.send(Kind::Event, self.events, &event, board);
        }
    }

    fn send(&mut self, kind: Kind, sequence: u32, message: &impl serde::Serialize, board: &mut impl Board) {
        // Every message fits: tests/frames.rs writes the largest of each.
        if let Ok(bytes) = self.out.write(kind, sequence, message) {
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
