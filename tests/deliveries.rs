//! Promises of what travels in pieces: a model that begins to come ends an identification and says so, one that never becomes whole
//! blocks nothing and changes nothing, an evidence that comes or goes disturbs no identification, and no lost answer does harm.

use std::io;
use std::path::Path;
use std::time::Duration;

use host_sim::channel::{Channel, InProcess};
use host_sim::model;
use host_sim::replay::{self, Prepared};
use host_sim::station::Station;
use spanwatch::bridge::BlobError;
use spanwatch::capacity::MODEL_BLOB_BYTES;
use spanwatch::logger::{Item, Logger};
use spanwatch::wire::message::{BLOCK_COUNTS, CHUNK_BYTES, Chunk, Event, Outcome, Reason, Verdict};

/// Slices of work after which something else happens: well within an identification of `case1-60kmh`, which takes hundreds.
const SLICES: usize = 40;

fn case1() -> Prepared {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("recordings/case1-60kmh.csv");
    replay::prepare(&path, None, replay::DEFAULT_SEED).expect("a shipped recording")
}

fn blob(prepared: &Prepared) -> Vec<u8> {
    model::to_blob(prepared.bridge.as_ref().expect("a bridge")).expect("room")
}

fn pieces(bytes: &[u8]) -> Vec<Chunk> {
    let piece = |(n, part): (usize, &[u8])| Chunk {
        offset: (n * CHUNK_BYTES) as u32,
        total: bytes.len() as u32,
        bytes: part.iter().copied().collect(),
    };
    bytes.chunks(CHUNK_BYTES).enumerate().map(piece).collect()
}

/// A logger with its model and its configuration.
fn logger(prepared: &Prepared) -> Box<Logger> {
    let mut logger = Box::new(Logger::new());
    for piece in &pieces(&blob(prepared)) {
        assert_eq!(logger.take_piece(Item::Model, piece), Outcome::Done);
    }
    logger.configure(prepared.configuration.clone()).expect("sound");
    logger
}

/// A passage comes.
fn pass(logger: &mut Logger, prepared: &Prepared) {
    logger.push(0, &prepared.recording.to_counts()).expect("whole rows");
    logger.finish();
    assert!(logger.is_busy());
}

fn work(logger: &mut Logger, slices: usize) {
    for _ in 0..slices {
        assert!(logger.poll());
    }
}

/// What it says to the end of its work.
fn told(logger: &mut Logger) -> Vec<Event> {
    while logger.poll() {}
    std::iter::from_fn(|| logger.next_event()).collect()
}

/// What it says of a passage that nothing disturbs.
fn undisturbed(prepared: &Prepared) -> Vec<Event> {
    let mut logger = logger(prepared);
    pass(&mut logger, prepared);
    let told = told(&mut logger);
    assert!(matches!(told.as_slice(), [Event::Alert(_), Event::Passage(_)]));
    told
}

fn fetch(logger: &mut Logger, mut bytes: Vec<u8>) -> Vec<u8> {
    loop {
        let chunk = logger.give_evidence(bytes.len() as u32);
        bytes.extend_from_slice(&chunk.bytes);
        if bytes.len() >= chunk.total as usize {
            return bytes;
        }
    }
}

#[test]
fn a_model_that_begins_to_come_ends_an_identification_and_the_next_passage_is_identified() {
    let prepared = case1();
    let pieces = pieces(&blob(&prepared));
    let mut logger = logger(&prepared);
    pass(&mut logger, &prepared);
    work(&mut logger, SLICES);
    assert_eq!(logger.take_piece(Item::Model, &pieces[0]), Outcome::Done);
    assert!(!logger.is_busy());
    let told_so = told(&mut logger);
    let [Event::Passage(report)] = told_so.as_slice() else {
        panic!("{told_so:?}")
    };
    assert_eq!(report.verdict, Verdict::NotIdentified(Reason::Interrupted));
    for piece in &pieces[1..] {
        assert_eq!(logger.take_piece(Item::Model, piece), Outcome::Done);
    }
    logger.configure(prepared.configuration.clone()).expect("sound");
    pass(&mut logger, &prepared);
    assert_eq!(told(&mut logger), undisturbed(&prepared));
}

#[test]
fn a_model_that_is_broken_off_blocks_no_passage_and_its_sender_begins_again() {
    let prepared = case1();
    let pieces = pieces(&blob(&prepared));
    let mut logger = logger(&prepared);
    for piece in &pieces[..5] {
        assert_eq!(logger.take_piece(Item::Model, piece), Outcome::Done);
    }
    pass(&mut logger, &prepared);
    work(&mut logger, SLICES);
    // Too late; and what was taken before is still known to have been taken.
    assert_eq!(logger.take_piece(Item::Model, &pieces[5]), Outcome::Chunk);
    assert_eq!(logger.take_piece(Item::Model, &pieces[4]), Outcome::Done);
    assert_eq!(logger.take_piece(Item::Model, &pieces[5]), Outcome::Chunk);
    assert_eq!(told(&mut logger), undisturbed(&prepared));
    for piece in &pieces {
        assert_eq!(logger.take_piece(Item::Model, piece), Outcome::Done);
    }
    logger.configure(prepared.configuration.clone()).expect("sound");
    pass(&mut logger, &prepared);
    assert_eq!(told(&mut logger), undisturbed(&prepared));
}

#[test]
fn an_evidence_that_goes_or_comes_disturbs_no_identification_and_no_model() {
    let prepared = case1();
    let mut logger = logger(&prepared);
    let empty = fetch(&mut logger, vec![]);
    pass(&mut logger, &prepared);
    work(&mut logger, SLICES);
    for piece in &pieces(&empty) {
        assert_eq!(logger.take_piece(Item::Evidence, piece), Outcome::Done);
        work(&mut logger, 1);
    }
    // All pieces are of the state that was at the first, even if the passage is decided before the last.
    let first = logger.give_evidence(0).bytes.to_vec();
    assert_eq!(told(&mut logger), undisturbed(&prepared));
    assert_eq!(fetch(&mut logger, first), empty);
    let one = fetch(&mut logger, vec![]);
    assert_ne!(one, empty);

    // Between the pieces of a model.
    let model = pieces(&blob(&prepared));
    let (begin, end) = model.split_at(3);
    for piece in begin {
        assert_eq!(logger.take_piece(Item::Model, piece), Outcome::Done);
    }
    assert_eq!(fetch(&mut logger, vec![]), one);
    for piece in pieces(&empty) {
        assert_eq!(logger.take_piece(Item::Evidence, &piece), Outcome::Done);
    }
    for piece in end {
        assert_eq!(logger.take_piece(Item::Model, piece), Outcome::Done);
    }
    assert_eq!(fetch(&mut logger, vec![]), empty);
}

#[test]
fn a_piece_whose_answer_was_lost_is_answered_as_before() {
    let prepared = case1();
    let good = pieces(&blob(&prepared));
    let last = good.last().expect("a piece");
    let mut logger = logger(&prepared);
    pass(&mut logger, &prepared);
    work(&mut logger, SLICES);
    // The model's last piece once more, though its room is long taken.
    assert_eq!(logger.take_piece(Item::Model, last), Outcome::Done);
    assert_eq!(told(&mut logger), undisturbed(&prepared));

    // Every piece twice; and a refusal stays one.
    let mut changed = blob(&prepared);
    changed[1000] ^= 1;
    let bad = pieces(&changed);
    for piece in &bad {
        let outcome = logger.take_piece(Item::Model, piece);
        assert_eq!(logger.take_piece(Item::Model, piece), outcome);
        let whole = piece == bad.last().expect("a piece");
        let expected = if whole {
            Outcome::Model(BlobError::Checksum)
        } else {
            Outcome::Done
        };
        assert_eq!(outcome, expected);
    }
}

#[test]
fn pieces_that_belong_to_nothing_are_refused_and_disturb_nothing() {
    let prepared = case1();
    let model = pieces(&blob(&prepared));
    let mut logger = logger(&prepared);
    let evidence = pieces(&fetch(&mut logger, vec![]));
    pass(&mut logger, &prepared);
    work(&mut logger, SLICES);
    let refused = |logger: &mut Logger, item: Item, chunk: &Chunk| {
        assert_eq!(logger.take_piece(item, chunk), Outcome::Chunk);
        assert!(logger.is_busy());
    };
    refused(&mut logger, Item::Model, &model[3]);
    for (total, offset) in [(MODEL_BLOB_BYTES as u32 + 1, 0), (10, 0), (u32::MAX, u32::MAX)] {
        let chunk = Chunk {
            offset,
            total,
            ..model[0].clone()
        };
        refused(&mut logger, Item::Model, &chunk);
        refused(&mut logger, Item::Evidence, &chunk);
    }
    // A model's piece does not go on from an evidence's, nor the other way round.
    assert_eq!(logger.take_piece(Item::Evidence, &evidence[0]), Outcome::Done);
    refused(&mut logger, Item::Model, &model[1]);
    assert_eq!(logger.take_piece(Item::Evidence, &evidence[1]), Outcome::Done);
    refused(&mut logger, Item::Evidence, &evidence[3]);
    assert_eq!(told(&mut logger), undisturbed(&prepared));
    assert_eq!(logger.take_piece(Item::Model, &model[0]), Outcome::Done);
    assert_eq!(logger.take_piece(Item::Evidence, &evidence[1]), Outcome::Chunk);
    assert_eq!(logger.take_piece(Item::Model, &model[2]), Outcome::Chunk);
    assert_eq!(logger.take_piece(Item::Model, &model[1]), Outcome::Done);
}

/// A line on which, after so many frames of the station, a recording ends.
struct EndsAfter {
    logger: InProcess,
    frames: usize,
}

impl Channel for EndsAfter {
    fn send(&mut self, bytes: &[u8]) -> io::Result<()> {
        if self.frames == 0 {
            self.logger.finish();
        }
        self.frames = self.frames.wrapping_sub(1);
        self.logger.send(bytes)
    }

    fn receive(&mut self, buffer: &mut [u8], timeout: Duration) -> io::Result<usize> {
        self.logger.receive(buffer, timeout)
    }
}

#[test]
fn the_base_station_begins_again_where_a_passage_has_taken_the_room() {
    let prepared = case1();
    let bridge = prepared.bridge.as_ref().expect("a bridge");
    let (model, counts) = (
        blob(&prepared).len().div_ceil(CHUNK_BYTES),
        prepared.recording.to_counts(),
    );
    // The passage is open when its recording is cut off, in the middle of the second model.
    let blocks = counts.len().div_ceil(BLOCK_COUNTS);
    let mut station = Station::new(Box::new(EndsAfter {
        logger: InProcess::new(),
        frames: model + 1 + blocks + model / 2,
    }));
    station.load(bridge).expect("taken");
    station.configure(&prepared.configuration).expect("taken");
    for (block, counts) in counts.chunks(BLOCK_COUNTS).enumerate() {
        assert!(!station.offer((block * BLOCK_COUNTS) as u64, counts).expect("taken"));
    }
    station.load(bridge).expect("taken at the second try");
    let status = station.finish().expect("an answer");
    assert_eq!((status.passages, status.alerts, status.rejected), (1, 0, 0));
    let Some(Event::Passage(report)) = station.next_event() else {
        panic!("the passage")
    };
    assert_eq!(report.verdict, Verdict::NotIdentified(Reason::Interrupted));
    assert_eq!(station.next_event(), None);
}
