//! Promises of the session: whatever the line does and whichever end restarts, every alert is stored once; nothing that an attacker sends is
//! accepted, or answered at greater length than it has; a logger without a base station speaks seldom; its clock follows.

use host_sim::campaign::{attack, link};
use spanwatch::outbox::OutboxError;
use spanwatch::session::packet::{Vitals, Welcome};
use spanwatch::session::{HEARTBEAT_MS, Hello, Key, LoggerEnd, Parcels, StationEnd, ToLogger, ToStation};
use spanwatch::settings::Identity;
use spanwatch::wire::message::Request;
use spanwatch::wire::{Decoder, FrameBuffer, Kind};

/// Alerts in each cell of the short campaign, and attacks of each kind; `host-sim evaluate link` makes as many as one likes.
const ALERTS: u64 = 4_000;
const ATTACKS: u64 = 15_000;
const SEED: u64 = 1;
/// The base station's clock at the beginning, ms since 1970.
const EPOCH_MS: u64 = 1_700_000_000_000;

#[test]
fn every_alert_is_stored_once_whatever_the_line_does() {
    for cell in link::run(ALERTS, SEED, |_| ()) {
        assert!(cell.is_clean(), "{cell:?}");
        assert!(cell.rate == 0.0 || cell.counts.faults > 0, "{cell:?}");
    }
}

#[test]
fn nothing_of_an_attacker_is_accepted_or_answered_at_length() {
    for row in attack::run(ATTACKS, SEED, |_| ()) {
        assert!(row.is_clean(), "{row:?}");
    }
}

/// No messages.
struct Nothing;

impl Parcels for Nothing {
    fn stream(&self) -> u32 {
        1
    }

    fn name_stream(&mut self, _stream: u32) -> Result<(), OutboxError> {
        Ok(())
    }

    fn acknowledged(&self) -> u32 {
        0
    }

    fn next_after(&mut self, _sequence: u32, _buffer: &mut [u8]) -> Result<Option<(u32, u32, usize)>, OutboxError> {
        Ok(None)
    }

    fn acknowledge(&mut self, _sequence: u32) -> Result<(), OutboxError> {
        Ok(())
    }
}

/// Two ends on a line that takes a while.
struct Pair {
    logger: LoggerEnd,
    station: StationEnd,
    station_key: Key,
    decoders: [Decoder; 2],
    now_ms: u64,
    requests: Vec<Request>,
    kinds: Vec<Kind>,
}

impl Pair {
    fn new(key: Key, station_key: Key) -> Self {
        Self {
            logger: LoggerEnd::new(1, 1, key, 1),
            station: StationEnd::new(),
            station_key,
            decoders: [Decoder::new(), Decoder::new()],
            now_ms: 0,
            requests: vec![],
            kinds: vec![],
        }
    }

    fn logger_hears(&mut self, bytes: &[u8]) {
        for &byte in bytes {
            let Some(frame) = self.decoders[0].push(byte) else {
                continue;
            };
            if let Ok(ToLogger::Request(frame)) = self.logger.on_frame(frame, self.now_ms, &mut Nothing) {
                self.requests.extend(frame.message::<Request>());
            }
        }
    }

    /// What the logger says now.
    fn said(&mut self) -> Vec<Vec<u8>> {
        let mut out = FrameBuffer::new();
        let mut said = vec![];
        while let Ok(Some(frame)) = self
            .logger
            .poll(self.now_ms, 0, &mut Nothing, |_| Vitals::default(), &mut out)
        {
            said.push(frame.to_vec());
        }
        said
    }

    fn turn(&mut self, step_ms: u64) {
        let mut out = FrameBuffer::new();
        for bytes in self.said() {
            self.now_ms += step_ms;
            for byte in bytes {
                let Some(frame) = self.decoders[1].push(byte) else {
                    continue;
                };
                self.kinds.push(frame.kind);
                if let ToStation::Hello(hello) = self.station.on_frame(frame, EPOCH_MS + self.now_ms) {
                    let welcome = Welcome {
                        stream: 1,
                        stored: 0,
                        time_ms: 0,
                    };
                    let frame = self.station.welcome(
                        &hello,
                        &self.station_key,
                        [3; 16],
                        welcome,
                        EPOCH_MS + self.now_ms,
                        &mut out,
                    );
                    let frame = frame.expect("fits").to_vec();
                    self.logger_hears(&frame);
                }
            }
        }
        let mut answers = vec![];
        while let Some(frame) = self.station.poll(EPOCH_MS + self.now_ms, &mut out) {
            answers.push(frame.to_vec());
        }
        self.now_ms += step_ms;
        answers.iter().for_each(|frame| self.logger_hears(frame));
    }
}

fn key(byte: u8) -> Key {
    Key::new([byte; 32])
}

#[test]
fn a_request_is_taken_once_and_only_after_both_ends_are_sure() {
    let mut pair = Pair::new(key(1), key(1));
    let mut out = FrameBuffer::new();
    assert!(pair.station.seal(Kind::Request, 1, &Request::Finish, &mut out).is_err());
    let clear = out.write(Kind::Request, 1, &Request::Finish).expect("short").to_vec();
    pair.logger_hears(&clear);
    for _ in 0..3 {
        pair.turn(1);
    }
    assert!(pair.logger.is_up() && pair.station.is_up());
    let sealed = pair
        .station
        .seal(Kind::Request, 2, &Request::Status, &mut out)
        .expect("up");
    let sealed = sealed.to_vec();
    for frame in [&sealed, &sealed, &clear] {
        pair.logger_hears(frame);
    }
    assert_eq!(pair.requests, [Request::Status]);
    let refusals = pair.logger.refusals();
    assert_eq!((refusals.forged, refusals.replayed, refusals.unsealed), (0, 1, 2));
}

#[test]
fn a_hello_that_was_changed_on_its_way_makes_no_session() {
    let change: [fn(&mut Hello); 4] = [
        |_| (),
        |hello| hello.stream = 77,
        |hello| hello.device = 2,
        |hello| hello.nonce[0] ^= 1,
    ];
    for (n, change) in change.into_iter().enumerate() {
        let mut pair = Pair::new(key(1), key(1));
        let hello = pair.said().concat();
        let hello = hello
            .iter()
            .find_map(|&byte| Hello::from_bytes(pair.decoders[1].push(byte)?.payload()));
        let mut hello = hello.expect("it says hello first");
        change(&mut hello);
        let welcome = Welcome {
            stream: hello.stream,
            stored: 9,
            time_ms: EPOCH_MS,
        };
        let mut out = FrameBuffer::new();
        let offer = pair.station.welcome(&hello, &key(1), [3; 16], welcome, 0, &mut out);
        pair.logger_hears(offer.expect("an offer"));
        assert_eq!(pair.logger.is_up(), n == 0, "{hello:?}");
    }
}

#[test]
fn another_key_makes_no_session_and_a_new_key_makes_the_next() {
    let mut pair = Pair::new(key(1), key(2));
    for _ in 0..50 {
        pair.turn(100);
    }
    assert!(!pair.logger.is_up() && !pair.station.is_up());
    assert!(pair.logger.refusals().forged > 0);
    // The key is replaced: the session comes up with the next hello.
    pair.logger.replace_identity(Identity {
        device: 1,
        key_number: 2,
        key: key(2),
    });
    for _ in 0..20 {
        pair.turn(1000);
    }
    assert!(pair.logger.is_up() && pair.station.is_up());
    assert!(!key(1).is_demo() && Key::DEMO.is_demo());
}

#[test]
fn a_logger_that_nobody_answers_speaks_seldom_and_says_nothing_secret() {
    let mut pair = Pair::new(key(1), key(1));
    let mut frames = 0;
    while pair.now_ms < 3_600_000 {
        for bytes in pair.said() {
            frames += 1;
            let mut decoder = Decoder::new();
            let kinds: Vec<Kind> = bytes
                .iter()
                .filter_map(|&byte| decoder.push(byte).map(|frame| frame.kind))
                .collect();
            assert_eq!(kinds, [Kind::Hello]);
        }
        pair.now_ms += 500;
    }
    assert!((60..=70).contains(&frames), "{frames} hellos in an hour");
}

#[test]
fn a_session_that_is_no_longer_answered_ends_and_comes_again() {
    let mut pair = Pair::new(key(1), key(1));
    for _ in 0..3 {
        pair.turn(1);
    }
    assert!(pair.logger.is_up());
    let end_ms = pair.now_ms + 4 * HEARTBEAT_MS + 1000;
    while pair.now_ms < end_ms {
        let _ = pair.said();
        pair.now_ms += 100;
    }
    assert!(!pair.logger.is_up());
    for _ in 0..200 {
        pair.turn(100);
    }
    assert!(pair.logger.is_up() && pair.station.is_up());
}

#[test]
fn the_logger_knows_the_time_to_half_a_round_trip() {
    for delay_ms in [0, 20, 300] {
        let mut pair = Pair::new(key(1), key(1));
        for _ in 0..100 {
            pair.turn(delay_ms);
            pair.now_ms += 1000;
        }
        let offset = pair.logger.clock_offset_ms().expect("told");
        let error = offset.abs_diff(EPOCH_MS.cast_signed());
        assert!(error <= 2 * delay_ms, "{error} ms with {delay_ms} ms each way");
    }
}
