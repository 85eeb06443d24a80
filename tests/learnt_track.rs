//! What was learnt of a track: how it travels, what it does to an estimate, and when it no longer holds.

use host_sim::random::gaussian;
use nalgebra::{SMatrix, SVector};
use rand_core::SeedableRng;
use rand_xoshiro::Xoshiro256PlusPlus;
use spanwatch::capacity::{ELEMENTS, PROFILE_COEFFICIENTS};
use spanwatch::identify::estimate::Information;
use spanwatch::identify::evidence::{Basis, EVIDENCE_BYTES, Evidence, Forgetting};
use spanwatch::interaction::{Direction, Run};
use spanwatch::track::blob::{TRACK_BLOB_BYTES, TrackError, read_into, write};
use spanwatch::track::learnt::{LearntTrack, UNLEARNT, Unexplained, speed_band};
use spanwatch::track::profile::{Knots, Profile, Stretch};
use spanwatch::track::watch::{Finding, Watch, unseen};
use spanwatch::track::{Motion, Track};
use spanwatch::wire::message::TrainKind;

const BRIDGE: u32 = 0x5eed;

fn chance(seed: u64) -> impl FnMut() -> f64 {
    let mut rng = Xoshiro256PlusPlus::seed_from_u64(seed);
    move || gaussian(&mut rng)
}

fn coefficients(knots: &Knots<f32>) -> Vec<f32> {
    let mut normal = chance(1);
    (0..knots.coefficients()).map(|_| 2e-3 * normal() as f32).collect()
}

fn knots() -> Knots<f32> {
    let stretch = |from_m, spacing_m, spans| Stretch {
        from_m,
        spacing_m,
        spans,
    };
    Knots::new(&[stretch(-139.0, 4.0, 34), stretch(-3.0, 0.5, 108), stretch(51.0, 3.0, 8)]).expect("they join")
}

fn learnt() -> LearntTrack {
    let mut normal = chance(2);
    let knots = knots();
    LearntTrack {
        profile: Profile::new(knots.clone(), &coefficients(&knots)),
        stiffness: 0.98,
        damping: 1.3,
        spread: SMatrix::from_fn(|i, j| match i.cmp(&j) {
            std::cmp::Ordering::Less => 0.0,
            std::cmp::Ordering::Equal => 0.01 + 0.002 * normal().abs() as f32,
            std::cmp::Ordering::Greater => 0.004 * normal() as f32,
        }),
        unexplained: [Unexplained {
            floor: 1e-6,
            part: 2.5e-3,
        }; 3],
        scatter: 0.02,
        passages: 60,
        speeds: [0, 1 << speed_band(65.0)],
    }
}

fn blob(buffer: &mut [u8]) -> &[u8] {
    write(&learnt(), &coefficients(&knots()), BRIDGE, buffer).expect("room")
}

#[test]
fn a_track_comes_back_as_it_was_written() {
    let mut buffer = [0; TRACK_BLOB_BYTES];
    let bytes = blob(&mut buffer);
    let mut read = UNLEARNT.clone();
    read_into(bytes, BRIDGE, &mut read).expect("sound");
    assert_eq!(read, learnt());
    println!("{} bytes", bytes.len());
}

#[test]
fn the_largest_profile_has_room() {
    let stretch = Stretch {
        from_m: 0.0,
        spacing_m: 1.0,
        spans: PROFILE_COEFFICIENTS as u16 + 3,
    };
    let knots = Knots::new(&[stretch]).expect("as many as there is memory for");
    let track = LearntTrack {
        profile: Profile::new(knots.clone(), &[]),
        ..learnt()
    };
    let heights = vec![1e-3; knots.coefficients()];
    write(&track, &heights, BRIDGE, &mut [0; TRACK_BLOB_BYTES]).expect("room");
    let more = Stretch {
        spans: stretch.spans + 1,
        ..stretch
    };
    assert!(Knots::new(&[more]).is_none());
}

#[test]
fn what_was_changed_on_its_way_is_refused_and_changes_nothing() {
    let mut buffer = [0; TRACK_BLOB_BYTES];
    let sound = blob(&mut buffer).to_vec();
    let mut track = UNLEARNT.clone();
    for bit in 0..8 * sound.len() {
        let mut bytes = sound.clone();
        bytes[bit / 8] ^= 1 << (bit % 8);
        assert!(read_into(&bytes, BRIDGE, &mut track).is_err(), "bit {bit}");
    }
    for end in 0..sound.len() {
        assert!(read_into(&sound[..end], BRIDGE, &mut track).is_err(), "{end} bytes");
    }
    assert_eq!(read_into(&sound, BRIDGE + 1, &mut track), Err(TrackError::Bridge));
    assert_eq!(track, UNLEARNT);
}

/// Rounding of ten rows in `f32`, as a part of the largest entry.
const ROUNDED: f64 = 1e-5;

#[test]
fn numbers_that_no_track_has_are_refused() {
    let refused = |track: &LearntTrack, coefficients: &[f32]| {
        let mut buffer = [0; TRACK_BLOB_BYTES];
        let bytes = write(track, coefficients, BRIDGE, &mut buffer).expect("room");
        let mut read = UNLEARNT.clone();
        assert_eq!(read_into(bytes, BRIDGE, &mut read), Err(TrackError::Contents));
        assert_eq!(read, UNLEARNT);
    };
    // Curves through knots so close are no numbers.
    for spacing_m in [1e-38, 1e-20, 1e-3] {
        let close = Stretch {
            from_m: 0.0,
            spacing_m,
            spans: 20,
        };
        let knots = Knots::new(&[close]).expect("knots");
        let coefficients = coefficients(&knots);
        let profile = Profile::new(knots, &coefficients);
        refused(&LearntTrack { profile, ..learnt() }, &coefficients);
    }
    // Passages seen against a reference as uncertain as that say nothing that is a number.
    for (place, value) in [((9, 0), 1e30), ((3, 3), 100.0), ((2, 2), 2e-30)] {
        let mut track = learnt();
        track.spread[place] = value;
        refused(&track, &coefficients(&knots()));
    }
}

#[test]
fn an_evidence_that_another_track_leaves_nothing_of_can_be_gone_on_from() {
    let mut track = learnt();
    track.spread = SMatrix::identity() * 5.0;
    let basis = Basis {
        bridge: 7,
        track: 1,
        spread: &track.spread,
    };
    let mut evidence = Evidence::new(Forgetting::NEVER);
    let mut huge = passages(0.0, 1.0);
    huge.matrix *= 3e38;
    evidence.add(&huge);
    evidence.retire(&track);
    let mut buffer = [0; EVIDENCE_BYTES];
    let bytes = evidence.to_bytes(&basis, Watch::NEW, &mut buffer).expect("room");
    let read = Evidence::from_bytes(bytes, &basis, Forgetting::NEVER);
    assert_eq!(read, Ok((evidence, Some(Watch::NEW))));
}

#[test]
fn covariances_of_passages_and_reference_add() {
    let track = learnt();
    let mut normal = chance(3);
    for (weight, rows) in [(1.0, 40), (1e3, 40), (1e6, 40), (1e2, 4)] {
        let mut exact = SMatrix::<f64, ELEMENTS, ELEMENTS>::zeros();
        let mut vector = SVector::<f64, ELEMENTS>::zeros();
        for _ in 0..rows {
            let row = SVector::<f64, ELEMENTS>::from_fn(|_, _| normal());
            exact += row * row.transpose() * weight;
            vector += row * (weight * 0.1);
        }
        let information = Information {
            matrix: exact.map(|value| value as f32),
            vector: vector.map(|value| value as f32),
        };
        let relative = track.relative(&information);
        let l = track.spread.map(f64::from);
        let b = l * l.transpose();
        // (1 + I B)^-1 I, which holds for a singular I, too.
        let factor = (SMatrix::<f64, ELEMENTS, ELEMENTS>::identity() + exact * b).lu();
        let (matrix, right) = (
            factor.solve(&exact).expect("regular"),
            factor.solve(&vector).expect("regular"),
        );
        let off = (relative.matrix.map(f64::from) - matrix).amax() / matrix.amax();
        let off_vector = (relative.vector.map(f64::from) - right).amax() / right.amax();
        println!("weight {weight}, {rows} rows: {off:.1e}, {off_vector:.1e}");
        assert!(off < ROUNDED && off_vector < ROUNDED, "{off}, {off_vector}");
    }
    // As badly conditioned as an evidence is: elements that are hardly told apart, known a thousand times as well as the reference.
    for (weight, blur) in [(1e2, 1.0), (1e4, 1.0), (1e6, 1.0), (1e6, 1.5)] {
        let near = |s: f64, e: usize| (-((s - e as f64) / blur).powi(2)).exp();
        let mut exact = SMatrix::<f64, ELEMENTS, ELEMENTS>::zeros();
        for sample in 0..200 {
            let s = f64::from(sample) / 20.0 - 0.5;
            let row = SVector::<f64, ELEMENTS>::from_fn(|e, _| near(s, e));
            exact += row * row.transpose() * weight;
        }
        let information = Information {
            matrix: exact.map(|value| value as f32),
            vector: SVector::zeros(),
        };
        // The logger's own numbers, which are rounded already.
        let given = information.matrix.map(f64::from);
        let l = track.spread.map(f64::from);
        let b = l * l.transpose();
        let factor = (SMatrix::<f64, ELEMENTS, ELEMENTS>::identity() + given * b).lu();
        let matrix = factor.solve(&given).expect("regular");
        let (relative, covariance) = (track.relative(&information), matrix.try_inverse().expect("regular"));
        let variances = relative.variances().expect("numbers");
        let off = (0..ELEMENTS)
            .map(|e| (f64::from(variances[e]) / covariance[(e, e)]).sqrt().ln().abs())
            .fold(0.0, f64::max);
        println!("weight {weight}, blur {blur}: deviations off by {off:.1e}");
        assert!(off < 0.01, "{off}");
    }
    let any = Information {
        matrix: SMatrix::identity(),
        vector: SVector::repeat(1.0),
    };
    assert_eq!(UNLEARNT.relative(&any), any, "what is known exactly has no part in it");
}

#[test]
fn no_number_of_passages_knows_more_than_the_reference() {
    let track = learnt();
    let mut evidence = Evidence::new(Forgetting::NEVER);
    let passage = Information {
        matrix: SMatrix::identity() * 1e4,
        vector: SVector::zeros(),
    };
    for _ in 0..1000 {
        evidence.add(&passage);
    }
    let b = track.spread * track.spread.transpose();
    let known = evidence.against(&track).estimate(ELEMENTS);
    for e in 0..ELEMENTS {
        let floor = b[(e, e)].sqrt();
        assert!(
            known.std[e] >= 0.999 * floor && known.std[e] < 1.1 * floor,
            "{} for {floor}",
            known.std[e]
        );
    }
}

#[test]
fn an_evidence_that_is_restored_on_another_track_is_kept_as_if_it_had_been_retired() {
    let track = learnt();
    let of = |crc, spread| Basis {
        bridge: 7,
        track: crc,
        spread,
    };
    let mut evidence = Evidence::new(Forgetting::NEVER);
    for _ in 0..20 {
        evidence.add(&passages(0.0, 0.02));
    }
    let mut watch = Watch::NEW;
    watch.judge(&track, 1, Some(0.7));
    for passage in 2..5 {
        watch.judge(&track, passage, None);
    }
    let mut buffer = [0; EVIDENCE_BYTES];
    let bytes = evidence
        .to_bytes(&of(1, &track.spread), watch, &mut buffer)
        .expect("room");
    let restored = |basis: &Basis<'_>| Evidence::from_bytes(bytes, basis, Forgetting::NEVER).expect("sound");
    let (same, kept) = restored(&of(1, &track.spread));
    assert_eq!(same, evidence);
    let kept = kept.expect("it is the same track");
    assert!(kept.has_changed() && kept.mean() == watch.mean());
    let mut retired = evidence.clone();
    retired.retire(&track);
    for (crc, spread) in [(2, &track.spread), (2, &UNLEARNT.spread), (0, &UNLEARNT.spread)] {
        assert_eq!(
            restored(&of(crc, spread)),
            (retired.clone(), None),
            "the new track's own spread does not matter"
        );
    }

    // What was found before any track was learnt took the rails for smooth.
    let mut buffer = [0; EVIDENCE_BYTES];
    let bytes = evidence
        .to_bytes(&of(0, &UNLEARNT.spread), Watch::NEW, &mut buffer)
        .expect("room");
    let restored = Evidence::from_bytes(bytes, &of(1, &track.spread), Forgetting::NEVER);
    assert_eq!(restored, Ok((Evidence::new(Forgetting::NEVER), None)));
}

#[test]
fn what_was_believed_while_the_rails_crept_is_given_up_and_what_was_known_long_before_is_not() {
    let track = learnt();
    let mut evidence = Evidence::new(Forgetting::new(1000.0, 20.0).expect("memories"));
    for _ in 0..200 {
        evidence.add(&passages(0.0, 0.02));
    }
    let healthy = evidence.against(&track).centre().expect("a centre")[4];
    for _ in 0..14 {
        evidence.add(&passages(0.03, 0.02));
    }
    let astray = evidence.against(&track).centre().expect("a centre")[4] - healthy;
    evidence.forget_recent();
    let left = evidence.against(&track).centre().expect("a centre")[4] - healthy;
    println!("astray by {:.2} points, {:.2} left", 100.0 * astray, 100.0 * left);
    assert!(left < 0.4 * astray, "{left} of {astray}");
    assert!(evidence.passages() > 150.0, "{}", evidence.passages());
}

/// Passages, the deviation of a damage found in each of them.
fn passages(loss: f32, deviation: f32) -> Information {
    let weight = deviation.powi(-2);
    let mut vector = SVector::zeros();
    vector[4] = weight * (1.0 / (1.0 - loss) - 1.0);
    Information {
        matrix: SMatrix::identity() * weight,
        vector,
    }
}

#[test]
fn what_an_earlier_track_told_of_the_bridge_is_kept_until_the_new_one_contradicts_it() {
    let track = learnt();
    let mut evidence = Evidence::new(Forgetting::NEVER);
    for _ in 0..20 {
        evidence.add(&passages(0.0, 0.02));
    }
    let before = evidence.against(&track).estimate(ELEMENTS);
    evidence.retire(&track);
    assert_eq!(evidence.against(&track).estimate(ELEMENTS), before);
    assert_eq!(evidence.passages(), 20.0);

    // Through a restart.
    let basis = Basis {
        bridge: 7,
        track: 1,
        spread: &track.spread,
    };
    let mut buffer = [0; EVIDENCE_BYTES];
    let bytes = evidence.to_bytes(&basis, Watch::NEW, &mut buffer).expect("room");
    assert_eq!(
        Evidence::from_bytes(bytes, &basis, Forgetting::NEVER),
        Ok((evidence.clone(), Some(Watch::NEW)))
    );

    // The bridge is as it was: both count.
    evidence.add(&passages(0.0, 0.02));
    assert!(!evidence.outlive(&track) && evidence.passages() == 21.0);
    let together = evidence.against(&track).estimate(ELEMENTS);
    assert!(together.std[4] < before.std[4]);

    // It is not: what was known is given up.
    let mut damaged = Evidence::new(Forgetting::NEVER);
    for _ in 0..20 {
        damaged.add(&passages(0.0, 0.02));
    }
    damaged.retire(&track);
    for _ in 0..20 {
        damaged.add(&passages(0.3, 0.02));
    }
    assert!(damaged.outlive(&track));
    let found = damaged.against(&track).estimate(ELEMENTS);
    assert!(
        (found.damage[4] - 0.3).abs() < 0.01 && damaged.passages() == 20.0,
        "{found:?}"
    );
}

#[test]
fn a_changed_track_is_told_once_and_a_strange_train_is_not_taken_for_one() {
    let track = learnt();
    let mut watch = Watch::NEW;
    let mut normal = chance(4);
    let mut same = || Some(normal() as f32);
    for passage in 1..=100 {
        assert_eq!(watch.judge(&track, passage, same()), Finding::Same);
    }
    // Two strangers in a row, one of them not explained at all.
    assert_eq!(watch.judge(&track, 101, Some(40.0)), Finding::Another);
    assert_eq!(watch.judge(&track, 102, None), Finding::Another);
    assert_eq!(watch.judge(&track, 103, same()), Finding::Same);
    // A large change.
    let told: Vec<Finding> = (104..109)
        .map(|passage| watch.judge(&track, passage, Some(12.0)))
        .collect();
    assert_eq!(
        told,
        [
            Finding::Another,
            Finding::Another,
            Finding::Changed {
                since: 104,
                creeping: false
            },
            Finding::Another,
            Finding::Another
        ]
    );
    assert!(watch.has_changed());
    // A small one, of which no passage alone tells: twice what can stay unseen.
    let mut watch = Watch::NEW;
    let shift = 2.0 * (1.0 + unseen(&track)).ln() / track.scatter;
    for passage in 1..=30 {
        watch.judge(&track, passage, same());
    }
    let told = (31..131).find_map(
        |passage| match watch.judge(&track, passage, same().map(|z| z + shift)) {
            Finding::Changed { since, creeping } => Some((passage, since, creeping)),
            _ => None,
        },
    );
    let (passage, since, creeping) = told.expect("told");
    assert!(creeping);
    println!("changed with passage 31, told at {passage}, since {since}");
    assert!(passage < 71 && (21..41).contains(&since), "{passage}, {since}");
}

#[test]
fn ten_healthy_years_raise_no_false_alarm() {
    let track = learnt();
    let mut watch = Watch::NEW;
    let mut normal = chance(5);
    for passage in 1..=200 * 365 * 10 {
        assert_eq!(
            watch.judge(&track, passage, Some(normal() as f32)),
            Finding::Same,
            "passage {passage}"
        );
    }
}

#[test]
fn trains_at_other_speeds_are_not_known() {
    let track = learnt();
    assert!(
        track.knows(TrainKind::Shinkansen3d, &Run::at(65.0)) && track.knows(TrainKind::Shinkansen3d, &Run::at(67.0))
    );
    assert!(
        !track.knows(TrainKind::Shinkansen3d, &Run::at(50.0))
            && !track.knows(TrainKind::Inspection2Dof, &Run::at(65.0))
    );
    let back = Run {
        direction: Direction::Backward,
        ..Run::at(65.0)
    };
    assert!(!track.knows(TrainKind::Shinkansen3d, &back));
}

#[test]
fn value_slope_and_curvature_are_of_one_curve() {
    let knots = knots();
    let profile = Profile::new(
        Knots::new(
            &knots
                .stretches()
                .iter()
                .map(|s| Stretch {
                    from_m: f64::from(s.from_m),
                    spacing_m: f64::from(s.spacing_m),
                    spans: s.spans,
                })
                .collect::<Vec<_>>(),
        )
        .expect("they join"),
        &coefficients(&knots).into_iter().map(f64::from).collect::<Vec<_>>(),
    );
    let step = 1e-5;
    let mut x = -138.93;
    while x < 74.0 {
        let [before, here, after] = [-step, 0.0, step].map(|by| profile.at(Motion::Vertical, x + by));
        let slope = (after.value - before.value) / (2.0 * step);
        let curvature = (after.slope - before.slope) / (2.0 * step);
        assert!(
            (slope - here.slope).abs() < 1e-8 && (curvature - here.curvature).abs() < 1e-6,
            "at {x} m"
        );
        x += 0.37;
    }
    // Continuous at the knots, where the pieces join, to the second derivative.
    for j in 0..knots.count() {
        let x = f64::from(knots.knot(j).expect("a knot"));
        let [before, after] = [-1e-9, 1e-9].map(|by| profile.at(Motion::Vertical, x + by));
        assert!(
            (before.value - after.value).abs() < 1e-9 && (before.slope - after.slope).abs() < 1e-9,
            "at {x} m"
        );
        assert!((before.curvature - after.curvature).abs() < 1e-6, "at {x} m");
    }
}
