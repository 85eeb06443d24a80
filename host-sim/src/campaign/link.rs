//! Faults of the line: two ends of a session, a line that does to every frame what lines do, ends that restart at any time.
//!
//! Alerts are numbered and made from their number, so that the base station's end can tell whether what it stores is what was sent, next in
//! order, and once. An end that restarts keeps what is on its flash or disk, and may lose what it was about to commit.

use std::collections::VecDeque;
use std::time::Instant;

use rayon::prelude::*;
use spanwatch::outbox::OutboxError;
use spanwatch::session::packet::{Vitals, Welcome};
use spanwatch::session::{Key, LoggerEnd, Parcels, StationEnd, ToLogger, ToStation};
use spanwatch::wire::{Decoder, FrameBuffer};

use super::line::{Chance, Fault, Line};

/// Bytes of an alert: what a real one takes.
const ALERT_BYTES: usize = 100;
/// Alerts that wait at most: a full outbox.
const BACKLOG: usize = 64;
/// Without anything under way, time goes on by this much, ms.
const IDLE_MS: u64 = 50;
/// Simulated time for one alert after which a cell is given up, ms: an hour.
const GIVE_UP_MS: u64 = 3_600_000;
const DEVICE: u32 = 7;
/// Clock of the base station when the campaign begins, ms since 1970.
const EPOCH_MS: u64 = 1_700_000_000_000;

/// What a cell of the grid has counted.
#[derive(Debug, Clone, Copy, Default)]
pub struct Counts {
    /// Alerts made.
    pub alerts: u64,
    /// Alerts stored.
    pub stored: u64,
    /// Alerts never stored.
    pub lost: u64,
    /// Alerts stored twice or out of order.
    pub duplicated: u64,
    /// Alerts stored with other bytes.
    pub wrong: u64,
    /// Faults of the line and restarts.
    pub faults: u64,
    /// Sessions that were made.
    pub sessions: u64,
    /// Frames put on the line.
    pub frames: u64,
    /// Simulated time, s.
    pub simulated_s: u64,
}

/// A cell of the grid.
#[derive(Debug, Clone, Copy)]
pub struct Cell {
    /// What goes wrong.
    pub fault: Fault,
    /// How often, per frame.
    pub rate: f64,
    /// What was counted.
    pub counts: Counts,
    /// Its seed.
    pub seed: u64,
    /// Time that it took, s.
    pub seconds: f64,
}

impl Cell {
    /// All alerts are stored, once, and right.
    pub fn is_clean(&self) -> bool {
        let Counts {
            alerts,
            stored,
            lost,
            duplicated,
            wrong,
            ..
        } = self.counts;
        stored == alerts && [lost, duplicated, wrong] == [0; 3]
    }
}

/// Rates of faults per frame.
pub const RATES: [f64; 6] = [0.0, 0.01, 0.05, 0.1, 0.2, 0.3];

/// Cells of the grid.
pub const CELLS: u64 = 1 + (Fault::EACH.len() * (RATES.len() - 1)) as u64;

/// Every fault at every rate, `alerts` in each cell; without a fault one cell. `done` hears of each.
pub fn run(alerts: u64, seed: u64, done: impl Fn(&Cell) + Sync) -> Vec<Cell> {
    let mut cells = vec![(Fault::Drop, 0.0)];
    for fault in Fault::EACH {
        cells.extend(RATES[1..].iter().map(|&rate| (fault, rate)));
    }
    cells
        .into_par_iter()
        .map(|(fault, rate)| {
            let cell = cell(fault, rate, alerts, seed);
            done(&cell);
            cell
        })
        .collect()
}

/// One cell.
pub fn cell(fault: Fault, rate: f64, alerts: u64, seed: u64) -> Cell {
    let start = Instant::now();
    let mut world = World::new(fault, rate, seed);
    world.run(alerts);
    let mut counts = world.counts;
    counts.lost = alerts - counts.stored.min(alerts);
    counts.alerts = alerts;
    counts.faults += world.up.faults + world.down.faults;
    counts.simulated_s = world.now_ms / 1000;
    Cell {
        fault,
        rate,
        counts,
        seed,
        seconds: start.elapsed().as_secs_f64(),
    }
}

/// An outbox in memory, which outlives restarts.
#[derive(Debug, Clone, Default)]
pub(super) struct Backlog {
    stream: u32,
    acknowledged: u32,
    made: u32,
    waiting: VecDeque<u32>,
}

impl Backlog {
    /// So many alerts more.
    pub(super) fn make(&mut self, alerts: u32) {
        self.waiting.extend(self.made + 1..=self.made + alerts);
        self.made += alerts;
    }

    /// Alerts so far.
    pub(super) fn made(&self) -> u32 {
        self.made
    }

    /// Alerts up to here are confirmed.
    pub(super) fn confirmed(&self) -> u32 {
        self.acknowledged
    }
}

impl Parcels for Backlog {
    fn stream(&self) -> u32 {
        self.stream
    }

    fn name_stream(&mut self, stream: u32) -> Result<(), OutboxError> {
        self.stream = stream;
        Ok(())
    }

    fn acknowledged(&self) -> u32 {
        self.acknowledged
    }

    fn next_after(&mut self, sequence: u32, buffer: &mut [u8]) -> Result<Option<(u32, u32, usize)>, OutboxError> {
        let Some(first) = self.waiting.front() else {
            return Ok(None);
        };
        let Some(&next) = self
            .waiting
            .get(sequence.saturating_add(1).saturating_sub(*first) as usize)
        else {
            return Ok(None);
        };
        buffer[..ALERT_BYTES].copy_from_slice(&alert(next));
        Ok(Some((next, next - 1, ALERT_BYTES)))
    }

    fn acknowledge(&mut self, sequence: u32) -> Result<(), OutboxError> {
        if sequence > self.made {
            return Err(OutboxError::NotSent);
        }
        self.acknowledged = self.acknowledged.max(sequence);
        while self.waiting.front().is_some_and(|&first| first <= sequence) {
            self.waiting.pop_front();
        }
        Ok(())
    }
}

/// The alert of a number.
pub(super) fn alert(number: u32) -> [u8; ALERT_BYTES] {
    let mut word = u64::from(number).wrapping_mul(0x9E37_79B9_7F4A_7C15);
    std::array::from_fn(|_| {
        word = word.rotate_left(7).wrapping_mul(0xD129_0D3B_3BB1_2F35);
        (word >> 56) as u8
    })
}

struct World {
    fault: Fault,
    rate: f64,
    chance: Chance,
    now_ms: u64,
    key: Key,
    starts: u32,
    backlog: Backlog,
    logger: LoggerEnd,
    logger_decoder: Decoder,
    station: StationEnd,
    station_decoder: Decoder,
    /// What is on the base station's disk: everything up to here.
    disk: u32,
    stream: u32,
    up: Line,
    down: Line,
    out: FrameBuffer,
    counts: Counts,
}

impl World {
    fn new(fault: Fault, rate: f64, seed: u64) -> Self {
        let key = Key::new(*b"a key that only this test knows.");
        Self {
            fault,
            rate,
            chance: Chance::new(seed),
            now_ms: 1,
            logger: LoggerEnd::new(DEVICE, 1, key.clone(), 1),
            key,
            starts: 1,
            backlog: Backlog::default(),
            logger_decoder: Decoder::new(),
            station: StationEnd::new(),
            station_decoder: Decoder::new(),
            disk: 0,
            stream: 0,
            up: Line::default(),
            down: Line::default(),
            out: FrameBuffer::new(),
            counts: Counts::default(),
        }
    }

    fn run(&mut self, alerts: u64) {
        let (mut last_stored, mut last_ms) = (0, 0);
        while self.counts.stored < alerts {
            let left = (alerts - u64::from(self.backlog.made())) as usize;
            let room = BACKLOG - self.backlog.waiting.len();
            self.backlog.make(left.min(room) as u32);
            if left == 0 && self.backlog.waiting.len() < BACKLOG / 2 {
                // The faults end.
                self.rate = 0.0;
            }
            self.step();
            if self.counts.stored > last_stored {
                (last_stored, last_ms) = (self.counts.stored, self.now_ms);
            } else if self.now_ms > last_ms + GIVE_UP_MS {
                return;
            }
        }
    }

    fn step(&mut self) {
        if matches!(self.fault, Fault::Reboot | Fault::All) && self.chance.happens(self.rate / 10.0) {
            self.counts.faults += 1;
            match self.chance.below(2) {
                0 => {
                    self.starts += 1;
                    self.logger = LoggerEnd::new(DEVICE, 1, self.key.clone(), self.starts);
                    self.logger_decoder = Decoder::new();
                }
                _ => {
                    self.station = StationEnd::new();
                    self.station_decoder = Decoder::new();
                }
            }
        }
        while let Some(bytes) = self.up.arrived(self.now_ms) {
            self.station_hears(&bytes);
        }
        while let Some(bytes) = self.down.arrived(self.now_ms) {
            for byte in bytes {
                let Some(frame) = self.logger_decoder.push(byte) else {
                    continue;
                };
                let heard = self.logger.on_frame(frame, self.now_ms, &mut self.backlog);
                self.counts.wrong += u64::from(matches!(heard, Ok(ToLogger::Request(_)) | Err(_)));
            }
        }
        let entropy = 0;
        while let Ok(Some(frame)) = self.logger.poll(
            self.now_ms,
            entropy,
            &mut self.backlog,
            |_| Vitals::default(),
            &mut self.out,
        ) {
            self.counts.frames += 1;
            self.up
                .send(frame, self.now_ms, self.fault, self.rate, &mut self.chance);
        }
        while let Some(frame) = self.station.poll(EPOCH_MS + self.now_ms, &mut self.out) {
            self.counts.frames += 1;
            self.down
                .send(frame, self.now_ms, self.fault, self.rate, &mut self.chance);
        }
        let next = [self.up.next_ms(), self.down.next_ms()].into_iter().flatten().min();
        self.now_ms = next.map_or(self.now_ms + IDLE_MS, |at| {
            at.clamp(self.now_ms + 1, self.now_ms + IDLE_MS)
        });
    }

    fn station_hears(&mut self, bytes: &[u8]) {
        for &byte in bytes {
            let Some(frame) = self.station_decoder.push(byte) else {
                continue;
            };
            match self.station.on_frame(frame, EPOCH_MS + self.now_ms) {
                ToStation::Hello(hello) if hello.device == DEVICE => {
                    if hello.stream == 0 && self.stream == 0 {
                        self.stream = 1 + self.chance.below(1 << 30) as u32;
                    }
                    let nonce = self.chance.bytes(16).try_into().unwrap_or_default();
                    let welcome = Welcome {
                        stream: self.stream,
                        stored: self.disk,
                        time_ms: EPOCH_MS + self.now_ms,
                    };
                    self.counts.sessions += 1;
                    if let Some(frame) =
                        self.station
                            .welcome(&hello, &self.key, nonce, welcome, EPOCH_MS + self.now_ms, &mut self.out)
                    {
                        self.down
                            .send(frame, self.now_ms, self.fault, self.rate, &mut self.chance);
                    }
                }
                ToStation::Parcel { sequence, message, .. } => {
                    // The disk is full now and then, and nothing is confirmed then.
                    if self.rate > 0.0 && self.chance.below(1000) == 0 {
                        self.station.not_stored();
                        continue;
                    }
                    self.counts.duplicated += u64::from(sequence != self.disk + 1);
                    self.counts.wrong += u64::from(message != alert(sequence));
                    self.counts.stored += 1;
                    self.disk = sequence;
                    self.station.stored(sequence);
                }
                ToStation::Lost { .. } | ToStation::Answer(_) => self.counts.wrong += 1,
                _ => {}
            }
        }
    }
}

/// The cells as text, and their sum.
pub fn table(cells: &[Cell]) -> String {
    use std::fmt::Write as _;
    let mut text = String::from(
        "| fault | rate | alerts | stored | lost | twice | wrong | faults | sessions | frames an alert | simulated, s | s |\n\
         |---|---|---|---|---|---|---|---|---|---|---|---|\n",
    );
    for cell in cells {
        let c = &cell.counts;
        let fault = format!("{:?}", cell.fault).to_lowercase();
        let name = if cell.rate == 0.0 { "none" } else { &fault };
        // Writing to a string cannot fail.
        let _ = writeln!(
            text,
            "| {name} | {:.0} % | {} | {} | {} | {} | {} | {} | {} | {:.1} | {} | {:.1} |",
            cell.rate * 100.0,
            c.alerts,
            c.stored,
            c.lost,
            c.duplicated,
            c.wrong,
            c.faults,
            c.sessions,
            c.frames as f64 / c.alerts.max(1) as f64,
            c.simulated_s,
            cell.seconds
        );
    }
    text
}
