//! Promises of the line: what one end writes the other reads; a changed bit, a cut, garbage or another version is refused
//! and counted by its reason; the decoder finds its way back at the next frame and never fails.

use host_sim::campaign::forgery::stuffed;
use rand_core::{Rng, SeedableRng};
use rand_xoshiro::Xoshiro256PlusPlus;
use spanwatch::capacity::{CHANNELS, ELEMENTS, PAYLOAD_BYTES};
use spanwatch::identify::evidence::Change;
use spanwatch::link::{CONFIGURATION_BYTES, NOTICE_BYTES};
use spanwatch::settings::Part;
use spanwatch::wire::frame::{FRAME_BYTES, Refusal};
use spanwatch::wire::message::{
    Acknowledgement, Alert, Answer, BLOCK_COUNTS, CHUNK_BYTES, Channel, Chunk, Configuration, Effort, Event, Fit,
    Health, Memory, NewKey, Notice, Outcome, PassagePiece, PassageReport, Quality, Quantity, Ranges, Request, Restart,
    RivalReport, SampleBlock, SetupRequest, SetupState, Status, TrackReport, Traffic, TrainKind, Trigger, Verdict,
};
use spanwatch::wire::{CRC32C, Decoder, FrameBuffer, Kind};

fn alert() -> Event {
    Event::Alert(Alert {
        bridge: "a bridge of 24 letters..".try_into().expect("fits"),
        passage: u32::MAX,
        start_sample: u64::MAX,
        damage_permille: [700; ELEMENTS].into_iter().collect(),
        std_permille: [u16::MAX; ELEMENTS].into_iter().collect(),
        low_permille: [700; ELEMENTS].into_iter().collect(),
        high_permille: [700; ELEMENTS].into_iter().collect(),
        passages: 1e3,
        rival: Some(RivalReport {
            whole: 10,
            damage_permille: [700; ELEMENTS].into_iter().collect(),
            loses_by: 14.0,
        }),
        certain: u16::MAX,
        objective: 1e-6,
        objective_healthy: 1e-3,
        forward_solves: u32::MAX,
    })
}

fn chunk() -> Chunk {
    Chunk {
        offset: u32::MAX,
        total: u32::MAX,
        bytes: [u8::MAX; CHUNK_BYTES].into_iter().collect(),
    }
}

/// The longest message of each kind.
fn requests() -> Vec<Request> {
    let channel = Channel {
        node: u16::MAX,
        quantity: Quantity::Acceleration,
        lsb: 1e-6,
        full_scale_counts: i32::MAX,
    };
    vec![
        Request::Configure(Configuration {
            sample_rate_hz: 200.0,
            channels: [channel; CHANNELS].into_iter().collect(),
            trigger: Trigger::default(),
            antialias_hz: Some(40.0),
            traffic: Some(Traffic {
                acceleration_mps2: -0.5,
                backward: true,
                train: TrainKind::Inspection2Dof,
                cars: 16,
                speed_mps: Some(75.0),
                entry_time_s: Some(1e9),
                load_factor: 1.0,
                ranges: Ranges::WIDEST,
            }),
            memory: Memory::default(),
            seed: u64::MAX,
        }),
        Request::Evidence { offset: u32::MAX },
        Request::Passage { offset: u32::MAX },
        Request::Track(chunk()),
        Request::Restore(chunk()),
        Request::Model(chunk()),
        Request::Samples(SampleBlock {
            first_sample: u64::MAX,
            counts: [i32::MIN; BLOCK_COUNTS].into_iter().collect(),
        }),
        Request::Finish,
        Request::Status,
        Request::Clear,
        Request::Restart,
        Request::Key(NewKey {
            device: u32::MAX,
            number: u8::MAX,
            key: [u8::MAX; 32],
        }),
        Request::Setup(SetupRequest::Begin),
        Request::Setup(SetupRequest::Keep),
        Request::Setup(SetupRequest::Reload),
        Request::Setup(SetupRequest::Read {
            part: Part::Configuration,
            offset: u32::MAX,
        }),
    ]
}

fn answers() -> Vec<Answer> {
    let quality = Quality {
        missing: u32::MAX,
        saturated: u32::MAX,
        stuck: u32::MAX,
    };
    vec![
        Answer::Acknowledgement(Acknowledgement {
            outcome: Outcome::Done,
            busy: true,
        }),
        Answer::Piece(chunk()),
        Answer::Passage(PassagePiece {
            passage: u32::MAX,
            first_sample: u64::MAX,
            channels: u8::MAX,
            total: u32::MAX,
            offset: u32::MAX,
            values: [f32::MIN; BLOCK_COUNTS].into_iter().collect(),
        }),
        Answer::Status(Status {
            samples: u64::MAX,
            passages: u32::MAX,
            alerts: u32::MAX,
            frames: u32::MAX,
            rejected: u32::MAX,
            quality,
            busy: true,
            waiting: u32::MAX,
            track: Default::default(),
            setup: SetupState {
                generation: u32::MAX,
                rolled_back: true,
            },
            starts: u32::MAX,
            key: u8::MAX,
            effort: Effort {
                stream_ticks: u64::MAX,
                identification_ticks: u64::MAX,
                longest_slice_ticks: u64::MAX,
                solver_steps: u64::MAX,
            },
            health: Health {
                overruns: u32::MAX,
                stack_peak_bytes: u32::MAX,
                restart: Restart::Watchdog,
            },
        }),
    ]
}

fn events() -> Vec<Event> {
    let report = PassageReport {
        passage: 1,
        start_sample: 2,
        end_sample: 3,
        peak: [1.0; CHANNELS].into_iter().collect(),
        level_db: 100.0,
        quality: Quality::default(),
        verdict: Verdict::Healthy {
            fit: Fit {
                objective: 1.0,
                unexplained: 0.5,
                speed_mps: 75.0,
                entry_time_s: 1e9,
                load_factor: 1.0,
                stiffness: 1.0,
                change: Change::Sudden,
            },
            hidden_permille: u16::MAX,
        },
    };
    let track = TrackReport {
        passage: u32::MAX,
        start_sample: u64::MAX,
        since: u32::MAX,
        misfit: f32::INFINITY,
        mean_misfit: f32::MIN,
    };
    vec![Event::Passage(report), alert(), Event::Track(track)]
}

fn bytes_of(kind: Kind, sequence: u32, message: &impl serde::Serialize) -> Vec<u8> {
    let mut buffer = FrameBuffer::new();
    buffer
        .write(kind, sequence, message)
        .expect("every message fits")
        .to_vec()
}

/// Events that a decoder reads from `bytes`, with their sequence numbers.
fn read_events(decoder: &mut Decoder, bytes: &[u8]) -> Vec<(u32, Event)> {
    let mut found = Vec::new();
    for &byte in bytes {
        let Some(frame) = decoder.push(byte) else { continue };
        let read = (frame.sequence, frame.message());
        match read {
            (sequence, Some(event)) => found.push((sequence, event)),
            (_, None) => decoder.refuse(Refusal::Payload),
        }
    }
    found
}

#[test]
fn every_message_fits_a_frame_and_comes_back_the_same() {
    let mut decoder = Decoder::new();
    let mut read = |bytes: &[u8], kind: Kind, check: &dyn Fn(&spanwatch::wire::Frame<'_>) -> bool| {
        assert!(bytes.len() <= FRAME_BYTES);
        assert!(
            bytes[1..bytes.len() - 1].iter().all(|&byte| byte != 0),
            "zeros only at the ends"
        );
        let frames: usize = bytes
            .iter()
            .filter(|&&byte| {
                decoder
                    .push(byte)
                    .is_some_and(|frame| frame.kind == kind && frame.sequence == 77 && check(&frame))
            })
            .count();
        assert_eq!(frames, 1);
    };
    for request in requests() {
        if let Request::Configure(configuration) = &request {
            assert!(
                postcard::to_slice(configuration, &mut [0; CONFIGURATION_BYTES]).is_ok(),
                "it fits the flash"
            );
        }
        let bytes = bytes_of(Kind::Request, 77, &request);
        read(&bytes, Kind::Request, &|frame| {
            frame.message::<Request>() == Some(request.clone())
        });
    }
    for answer in answers() {
        let bytes = bytes_of(Kind::Answer, 77, &answer);
        read(&bytes, Kind::Answer, &|frame| {
            frame.message::<Answer>().as_ref() == Some(&answer)
        });
    }
    for event in events() {
        let notice = Notice {
            start: u32::MAX,
            uptime_ms: u64::MAX,
            event: event.clone(),
        };
        assert!(
            postcard::to_slice(&notice, &mut [0; NOTICE_BYTES]).is_ok(),
            "it fits the outbox"
        );
        let bytes = bytes_of(Kind::Event, 77, &event);
        read(&bytes, Kind::Event, &|frame| {
            frame.message::<Event>() == Some(event.clone())
        });
    }
    assert_eq!(decoder.rejections().total(), 0);
}

#[test]
fn a_frame_that_is_stuffed_in_its_place_is_the_same_as_beside_it_at_every_length() {
    // Two bytes of a payload are the slice's length.
    for length in 0..=PAYLOAD_BYTES - 2 {
        for zero_every in [1, 2, 100, 253, 254, 255, 256, usize::MAX] {
            let message: Vec<u8> = (1..=length).map(|k| u8::from(k % zero_every != 0)).collect();
            let line = bytes_of(Kind::Event, 0x0101_0101, &message.as_slice());
            let mut room = [0; PAYLOAD_BYTES];
            let payload = postcard::to_slice(&message, &mut room).expect("room");
            let mut bare = vec![spanwatch::wire::message::VERSION, Kind::Event as u8, 1, 1, 1, 1];
            bare.extend_from_slice(&(payload.len() as u16).to_le_bytes());
            bare.extend_from_slice(payload);
            bare.extend_from_slice(&CRC32C.checksum(&bare).to_le_bytes());
            assert_eq!(line, stuffed(&bare), "{length} bytes, a zero every {zero_every}");
            assert!(line.len() <= FRAME_BYTES);
        }
    }
}

#[test]
fn what_is_not_known_of_a_train_stays_unknown_on_the_line() {
    let Some(Request::Configure(announced)) = requests().into_iter().next() else {
        panic!("a configuration")
    };
    for (speed_mps, entry_time_s) in [(None, None), (None, Some(2.5)), (Some(20.0), None)] {
        let mut configuration = announced.clone();
        let traffic = configuration.traffic.as_mut().expect("a train");
        (traffic.speed_mps, traffic.entry_time_s) = (speed_mps, entry_time_s);
        configuration.channels[0].quantity = Quantity::Displacement;
        assert!(configuration.check().is_ok());
        let request = Request::Configure(configuration);
        let bytes = bytes_of(Kind::Request, 1, &request);
        let mut decoder = Decoder::new();
        let mut read = Vec::new();
        for &byte in &bytes {
            read.extend(decoder.push(byte).and_then(|frame| frame.message::<Request>()));
        }
        assert_eq!(read, [request]);
    }
}

#[test]
fn no_single_or_double_flipped_bit_makes_another_message_of_an_alert() {
    let bytes = bytes_of(Kind::Event, 5, &alert());
    println!("the longest alert takes {} bytes on the line", bytes.len());
    let bits = bytes.len() * 8;
    let mut refused = 0_u64;
    let mut try_one = |flips: &[usize]| {
        let mut changed = bytes.clone();
        for flip in flips {
            changed[flip / 8] ^= 1 << (flip % 8);
        }
        let mut decoder = Decoder::new();
        let mut found = read_events(&mut decoder, &changed);
        // The zero that ended a damaged frame may have to be the next one's.
        found.extend(read_events(&mut decoder, &[0]));
        assert!(found.iter().all(|event| *event == (5, alert())), "{flips:?}");
        refused += u64::from(decoder.rejections().total() > 0);
    };
    for first in 0..bits {
        try_one(&[first]);
    }
    let mut rng = Xoshiro256PlusPlus::seed_from_u64(1);
    for _ in 0..200_000 {
        let [first, second] = [0, 1].map(|_| (rng.next_u64() % bits as u64) as usize);
        try_one(&[first, second]);
    }
    assert!(refused > 190_000);
}

#[test]
fn every_cut_is_refused_and_the_next_frame_is_read() {
    let bytes = bytes_of(Kind::Event, 5, &alert());
    for cut in 2..bytes.len() - 1 {
        let mut line = bytes[..cut].to_vec();
        line.extend_from_slice(&bytes);
        let mut decoder = Decoder::new();
        assert_eq!(read_events(&mut decoder, &line).len(), 1, "cut at {cut}");
        assert_eq!(decoder.rejections().total(), 1, "cut at {cut}");
    }
}

#[test]
fn after_any_garbage_the_next_frame_is_read_in_blocks_of_any_size() {
    let bytes = bytes_of(Kind::Event, 9, &alert());
    let mut rng = Xoshiro256PlusPlus::seed_from_u64(2);
    let mut decoder = Decoder::new();
    for round in 0..20_000 {
        let length = (rng.next_u64() % 1500) as usize;
        let garbage: Vec<u8> = (0..length).map(|_| rng.next_u64() as u8).collect();
        assert!(read_events(&mut decoder, &garbage).is_empty(), "round {round}");
        assert_eq!(read_events(&mut decoder, &bytes), [(9, alert())], "round {round}");
    }
    let rejections = decoder.rejections();
    assert!(rejections.too_short > 0 && rejections.checksum > 0 && rejections.too_long > 0);
}

#[test]
fn each_reason_has_its_own_count() {
    let mut decoder = Decoder::new();
    let mut feed = |bare: &[u8]| {
        // A frame with a right checksum, whatever is in it.
        let mut bare = bare.to_vec();
        bare.extend_from_slice(&CRC32C.checksum(&bare).to_le_bytes());
        let mut line = vec![0];
        for part in bare.split(|&byte| byte == 0) {
            assert!(part.len() < 254);
            line.push(part.len() as u8 + 1);
            line.extend_from_slice(part);
        }
        line.push(0);
        read_events(&mut decoder, &line);
        *decoder.rejections()
    };
    let version = spanwatch::wire::message::VERSION;
    assert_eq!(feed(&[version + 1, 3, 1, 1, 1, 1, 0, 0]).version, 1);
    assert_eq!(feed(&[version, 99, 1, 1, 1, 1, 0, 0]).kind, 1);
    assert_eq!(feed(&[version, 3, 1, 1, 1, 1, 9, 0]).length, 1);
    assert_eq!(feed(&[version, 3, 1, 1, 1, 1, 1, 0, 200]).payload, 1);
    assert_eq!(feed(&[1, 2, 3]).too_short, 1);
    assert_eq!(feed(&[]).total(), 6);
}
