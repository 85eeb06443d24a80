//! Promises of the stream: the size of the blocks does not matter, memory is constant, bad samples are counted, flagged and
//! survived, and one passage does not spoil the next.

use spanwatch::logger::{ConfigurationError, Logger};
use spanwatch::wire::message::{
    Channel, Configuration, Event, Memory, PassageReport, Quality, Quantity, Ranges, Reason, Traffic, TrainKind,
    Trigger, Verdict,
};

const RATE_HZ: usize = 200;
const FULL_SCALE: i32 = 1 << 23;
const LSB_MPS2: f32 = 1e-5;

fn configuration(channels: usize) -> Configuration {
    let channel = Channel {
        node: 6,
        quantity: Quantity::Acceleration,
        lsb: LSB_MPS2,
        full_scale_counts: FULL_SCALE,
    };
    Configuration {
        sample_rate_hz: RATE_HZ as f32,
        channels: (0..channels).map(|_| channel).collect(),
        trigger: Trigger::default(),
        antialias_hz: Some(40.0),
        traffic: None,
        memory: Memory::default(),
        seed: 1,
    }
}

/// An inspection car that is announced with all that can be said of it.
const TRAIN: Traffic = Traffic {
    acceleration_mps2: 0.0,
    backward: false,
    train: TrainKind::Inspection2Dof,
    cars: 1,
    speed_mps: Some(20.0),
    entry_time_s: Some(1.0),
    load_factor: 1.0,
    ranges: Ranges::HELD,
};

/// Pseudo-random noise of a few counts, so that quiet channels are alive.
fn noise(sample: usize) -> i32 {
    let mixed = (sample as u32)
        .wrapping_mul(2_654_435_761)
        .rotate_left(13)
        .wrapping_mul(2_246_822_519);
    (mixed >> 27) as i32 - 16
}

/// A vibration of `amplitude` counts between two seconds, decaying afterwards, on a constant offset.
fn passage(samples: usize, from_s: usize, to_s: usize, amplitude: f64) -> Vec<i32> {
    (0..samples)
        .map(|k| {
            let t = k as f64 / RATE_HZ as f64;
            let decay = if t > to_s as f64 {
                (-(t - to_s as f64) * 4.0).exp()
            } else {
                1.0
            };
            let on = if t >= from_s as f64 { decay } else { 0.0 };
            (amplitude * on * (22.0 * t).sin()) as i32 + noise(k) + 5_000
        })
        .collect()
}

fn reports(logger: &mut Logger) -> Vec<PassageReport> {
    std::iter::from_fn(|| logger.next_event())
        .map(|event| match event {
            Event::Passage(report) => report,
            other => panic!("without a model: {other:?}"),
        })
        .collect()
}

fn run(configuration: &Configuration, counts: &[i32], rows_per_block: usize) -> (Vec<PassageReport>, Quality) {
    let mut logger = Box::new(Logger::new());
    logger.configure(configuration.clone()).expect("sound");
    let channels = configuration.channels.len();
    let mut all = Vec::new();
    for (block, counts) in counts.chunks(rows_per_block * channels).enumerate() {
        logger
            .push((block * rows_per_block) as u64, counts)
            .expect("whole rows");
        all.extend(reports(&mut logger));
    }
    logger.finish();
    all.extend(reports(&mut logger));
    (all, logger.quality())
}

#[test]
fn a_passage_is_found_with_its_time_before_and_free_vibration_after() {
    let (found, quality) = run(&configuration(1), &passage(20 * RATE_HZ, 5, 8, 4_000.0), 32);
    assert_eq!(quality, Quality::default());
    let [report] = found.as_slice() else {
        panic!("{found:?}")
    };
    let seconds = |sample: u64| sample as f64 / RATE_HZ as f64;
    let lead_s = f64::from(Trigger::default().lead_s);
    // The level takes its window, 0.25 s, to rise.
    assert!(
        (seconds(report.start_sample) - (5.0 - lead_s)).abs() < 0.25,
        "{report:?}"
    );
    assert!((8.0..9.5).contains(&seconds(report.end_sample)), "{report:?}");
    assert!(
        (report.peak[0] - 0.04).abs() < 0.001,
        "the offset is removed: {report:?}"
    );
    assert_eq!(report.verdict, Verdict::NotIdentified(Reason::NoModel));
}

#[test]
fn any_block_size_gives_the_same_result() {
    let mut counts = passage(40 * RATE_HZ, 5, 8, 4_000.0);
    for (sample, later) in passage(40 * RATE_HZ, 20, 25, 9_000.0).into_iter().enumerate() {
        counts[sample] += later - 5_000;
    }
    // A channel of its own beside it.
    let counts: Vec<i32> = counts.iter().flat_map(|&count| [count, count / 3 - 1_000]).collect();
    let expected = run(&configuration(2), &counts, 1);
    assert_eq!(expected.0.len(), 2);
    for rows in [2, 3, 7, 48, 100, 1000, 8000] {
        assert_eq!(run(&configuration(2), &counts, rows), expected, "blocks of {rows}");
    }
}

#[test]
fn a_click_is_no_passage_and_a_louder_background_is_learnt() {
    let mut counts: Vec<i32> = (0..60 * RATE_HZ).map(noise).collect();
    counts[3_000] = 200_000;
    assert_eq!(run(&configuration(1), &counts, 48).0.len(), 0);

    // Something drones on and never stops: one long event, then it is the background.
    let counts: Vec<i32> = (0..800 * RATE_HZ)
        .map(|k| noise(k) + if k > 100 * RATE_HZ { noise(7 * k) * 30 } else { 0 })
        .collect();
    let (found, _) = run(&configuration(1), &counts, 48);
    assert_eq!(found.len(), 1, "{found:?}");
}

#[test]
fn gaps_saturated_and_stuck_samples_are_counted_and_flagged() {
    let counts = passage(20 * RATE_HZ, 5, 8, 4_000.0);
    let mut logger = Box::new(Logger::new());
    logger.configure(configuration(1)).expect("sound");
    let mut bad = counts.clone();
    bad[1_200..1_210].fill(FULL_SCALE);
    bad[1_300..1_350].fill(777);
    // 30 samples are missing within the passage, and 10,000 after it.
    logger.push(0, &bad[..1_400]).expect("whole");
    logger.push(1_430, &bad[1_430..]).expect("whole");
    logger.push(14_000, &counts).expect("whole");
    logger.finish();
    let found = reports(&mut logger);
    assert_eq!(found.len(), 2, "{found:?}");
    let stuck = 50 - 1 - 19;
    assert_eq!(
        found[0].quality,
        Quality {
            missing: 30,
            saturated: 10,
            stuck
        }
    );
    assert_eq!(found[1].quality, Quality::default());
    assert_eq!(logger.quality().missing, 30 + 10_000);
}

#[test]
fn a_block_that_comes_twice_counts_once() {
    let counts = passage(20 * RATE_HZ, 5, 8, 4_000.0);
    let mut logger = Box::new(Logger::new());
    logger.configure(configuration(1)).expect("sound");
    for (block, part) in counts.chunks(100).enumerate() {
        for _ in 0..2 {
            logger.push(block as u64 * 100, part).expect("whole");
        }
    }
    logger.finish();
    assert_eq!(logger.samples(), counts.len() as u64);
    assert_eq!(reports(&mut logger), run(&configuration(1), &counts, 100).0);
}

#[test]
fn what_makes_no_sense_is_refused() {
    let mut logger = Box::new(Logger::new());
    assert!(logger.push(0, &[1, 2, 3]).is_err(), "no configuration yet");
    let refused = |change: fn(&mut Configuration)| {
        let mut configuration = configuration(2);
        configuration.traffic = Some(TRAIN);
        assert!(configuration.check().is_ok());
        change(&mut configuration);
        configuration.check().is_err()
    };
    assert!(refused(|c| c.sample_rate_hz = f32::NAN));
    assert!(refused(|c| c.sample_rate_hz = 0.0));
    assert!(refused(|c| c.channels.clear()));
    assert!(refused(|c| c.channels[0].lsb = -1.0));
    assert!(refused(|c| c.channels[1].full_scale_counts = 0));
    assert!(refused(|c| c.trigger.window_s = 0.0));
    assert!(refused(|c| c.trigger.off_ratio = 5.0));
    assert!(refused(|c| c.trigger.lead_s = f32::INFINITY));
    assert!(refused(|c| c.trigger.off_duration_s = 1e8));
    assert!(
        refused(|c| (c.trigger.on_duration_s, c.trigger.off_duration_s) = (0.05, 0.05)),
        "more passages may end in one block than there is room for"
    );
    assert!(refused(|c| c.trigger.on_ratio = 1e20));
    assert!(refused(|c| c.sample_rate_hz = 10.0), "a window of 2 samples");
    assert!(refused(|c| c.antialias_hz = Some(0.0)));
    assert!(refused(|c| c.traffic.as_mut().expect("there").cars = 17));
    assert!(refused(
        |c| c.traffic.as_mut().expect("there").speed_mps = Some(f32::NAN)
    ));
    assert!(refused(
        |c| c.traffic.as_mut().expect("there").entry_time_s = Some(f64::INFINITY)
    ));
    assert!(refused(|c| c.traffic.as_mut().expect("there").load_factor = 0.0));
    for bad in [-0.01, f32::NAN, f32::INFINITY, 11.0] {
        for range in 0..4 {
            let mut configuration = configuration(1);
            configuration.traffic = Some(TRAIN);
            let ranges = &mut configuration.traffic.as_mut().expect("there").ranges;
            *[
                &mut ranges.speed,
                &mut ranges.entry_s,
                &mut ranges.load,
                &mut ranges.stiffness,
            ][range] = bad;
            assert_eq!(configuration.check(), Err(ConfigurationError::Ranges), "{range}: {bad}");
        }
    }
    assert!(refused(|c| c.channels[0].lsb = 1e-13), "no acceleration is so small");
    assert!(refused(|c| for channel in &mut c.channels {
        channel.quantity = Quantity::Displacement;
    }));

    logger.configure(configuration(2)).expect("sound");
    assert!(logger.push(0, &[1, 2, 3]).is_err(), "one and a half rows");
}

#[test]
fn a_sensor_that_dies_does_not_blind_the_others() {
    // Two channels, of which the second falls silent; then four trains.
    let trains = |c: usize| {
        let mut counts = vec![0; 120 * RATE_HZ];
        for (n, from_s) in [30, 50, 70, 90].into_iter().enumerate() {
            for (sample, later) in passage(120 * RATE_HZ, from_s, from_s + 4, 4_000.0)
                .into_iter()
                .enumerate()
            {
                counts[sample] += if n == 0 { later } else { later - 5_000 - noise(sample) };
            }
        }
        if c == 1 {
            counts[20 * RATE_HZ..].fill(0);
        }
        counts
    };
    let counts: Vec<i32> = trains(0).into_iter().zip(trains(1)).flat_map(|(a, b)| [a, b]).collect();
    let (found, quality) = run(&configuration(2), &counts, 48);
    let trains = found.iter().filter(|report| report.end_sample > 25 * RATE_HZ as u64);
    assert_eq!(trains.count(), 4, "{found:?}");
    assert!(quality.stuck > 90 * RATE_HZ as u32);
}

#[test]
fn a_sender_that_loses_count_is_told() {
    let counts = passage(20 * RATE_HZ, 5, 8, 4_000.0);
    let mut logger = Box::new(Logger::new());
    logger.configure(configuration(1)).expect("sound");
    logger.push(0, &counts[..1_000]).expect("whole");
    logger.push(500, &counts[500..1_000]).expect("the last block once more");
    assert!(logger.push(0, &counts[..500]).is_err());
    assert!(logger.push(u64::MAX - 10, &counts[..500]).is_err());
    logger.push(1_000, &counts[1_000..]).expect("goes on");
    assert_eq!(logger.samples(), counts.len() as u64);
}

#[test]
fn the_last_samples_that_can_be_counted_are_taken() {
    let mut logger = Box::new(Logger::new());
    logger.configure(configuration(1)).expect("sound");
    assert_eq!(logger.push(u64::MAX - 3, &[1, 2, 3]), Ok(()));
    assert!(logger.push(u64::MAX, &[4]).is_err());
    assert_eq!(logger.samples(), 3);
}

#[test]
fn an_empty_block_says_nothing_of_a_gap() {
    let counts: Vec<i32> = (0..400).map(noise).collect();
    let mut logger = Logger::new();
    logger.configure(configuration(1)).expect("a configuration");
    logger.push(0, &counts[..96]).expect("a block");
    for _ in 0..2 {
        logger.push(196, &[]).expect("an empty block");
    }
    logger.push(196, &counts[196..292]).expect("a block");
    assert_eq!(logger.quality().missing, 100);
}

/// An accelerometer, and a displacement sensor of 0.1 µm a count beside it.
fn mixed() -> Configuration {
    let mut mixed = configuration(2);
    mixed.channels[1].quantity = Quantity::Displacement;
    mixed.channels[1].lsb = 1e-7;
    mixed
}

#[test]
fn a_displacement_beside_an_acceleration_changes_nothing_of_what_is_found() {
    let accelerations = passage(20 * RATE_HZ, 5, 8, 4_000.0);
    let (alone, _) = run(&configuration(1), &accelerations, 32);
    // It sags by 8 mm while the train is there, on an offset of 20 mm.
    let sag = |k: usize| {
        if (5 * RATE_HZ..8 * RATE_HZ).contains(&k) {
            -80_000
        } else {
            0
        }
    };
    let counts: Vec<i32> = (accelerations.iter().enumerate())
        .flat_map(|(k, &acceleration)| [acceleration, 200_000 + sag(k) + noise(k + 7)])
        .collect();
    let (found, quality) = run(&mixed(), &counts, 32);
    assert_eq!(quality, Quality::default());
    let ([alone], [found]) = (alone.as_slice(), found.as_slice()) else {
        panic!("{alone:?} {found:?}")
    };
    assert_eq!(
        (found.start_sample, found.end_sample),
        (alone.start_sample, alone.end_sample)
    );
    assert_eq!((found.peak[0], found.level_db), (alone.peak[0], alone.level_db));
    // In metres, without its offset, to a hundredth.
    assert!((found.peak[1] - 8e-3).abs() < 8e-5, "{found:?}");
}

#[test]
fn a_displacement_that_moves_alone_is_no_passage() {
    // The sun bends the bridge by millimetres, and somebody leans against the sensor.
    let counts: Vec<i32> = (0..60 * RATE_HZ)
        .flat_map(|k| {
            let leans = if (30 * RATE_HZ..33 * RATE_HZ).contains(&k) {
                50_000
            } else {
                0
            };
            [noise(k), (k as i32) * 4 + leans + noise(k + 7)]
        })
        .collect();
    assert_eq!(run(&mixed(), &counts, 48).0, []);
}

#[test]
fn a_saturated_or_stuck_displacement_is_counted_like_any_other_channel() {
    let accelerations = passage(20 * RATE_HZ, 5, 8, 4_000.0);
    let counts: Vec<i32> = (accelerations.iter().enumerate())
        .flat_map(|(k, &acceleration)| {
            let displacement = match k {
                1_200..1_210 => FULL_SCALE,
                1_300..1_350 => 777,
                _ => noise(k + 7),
            };
            [acceleration, displacement]
        })
        .collect();
    let (found, _) = run(&mixed(), &counts, 32);
    let stuck = 50 - 1 - 19;
    assert_eq!(
        found[0].quality,
        Quality {
            missing: 0,
            saturated: 10,
            stuck
        }
    );
}

#[test]
fn a_logger_with_displacements_alone_is_told_what_it_needs() {
    let mut alone = mixed();
    alone.channels.remove(0);
    let error = alone.check().expect_err("no acceleration");
    assert_eq!(error, ConfigurationError::NoAcceleration);
    assert!(
        error
            .to_string()
            .contains("at least one channel must measure an acceleration"),
        "{error}"
    );
}
