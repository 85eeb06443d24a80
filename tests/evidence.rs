//! Promises of the evidence: many passages say together what one least-squares solution of all of them says, in constant
//! memory; a slow loss is followed and a sudden one told; what is written comes back bit for bit or not at all; and an element
//! is called damaged when nothing else can be true, however uncertain each is for itself.

use host_sim::random::gaussian;
use nalgebra::{SMatrix, SVector};
use rand_core::SeedableRng;
use rand_xoshiro::Xoshiro256PlusPlus;
use spanwatch::capacity::ELEMENTS;
use spanwatch::identify::estimate::{ALARM_DEVIATIONS, Information, TOLD_APART};
use spanwatch::identify::evidence::{Basis, Change, EVIDENCE_BYTES, Evidence, EvidenceError, Forgetting};
use spanwatch::track::learnt::UNLEARNT;
use spanwatch::track::watch::Watch;
use spanwatch::wire::CRC32C;

/// Flexibilities gained.
type X = [f64; ELEMENTS];
const WHOLE: X = [0.0; ELEMENTS];
/// Samples of a passage.
const SAMPLES: usize = 60;
/// Some bridge, of whose track nothing was learnt.
const BASIS: Basis<'static> = Basis {
    bridge: 0x1234_5678,
    track: 0,
    spread: &UNLEARNT.spread,
};
/// Largest difference in damage between the sum of 30 passages in `f32` and their joint solution in `f64`: rounding, 1e-7 of each
/// sum, times the root of the condition number, some hundreds.
const JOINT_DAMAGE: f64 = 1e-4;
/// The same of the deviations, as a part of them.
const JOINT_DEVIATION: f64 = 1e-3;

/// A bridge whose response to a load at `s` along it depends on the flexibilities of the elements around it.
struct Passages {
    rng: Xoshiro256PlusPlus,
    /// Noise of a sample, in units of the response to a flexibility that grows by one.
    noise: f64,
    elements: usize,
    /// How much more than its own element a load feels, in elements: the more, the less the elements can be told apart.
    blur: f64,
    /// Whether an unknown change of all elements alike goes with each passage.
    temperature: bool,
}

impl Passages {
    fn new(seed: u64, noise: f64) -> Self {
        Self {
            rng: Xoshiro256PlusPlus::seed_from_u64(seed),
            noise,
            elements: ELEMENTS,
            blur: 0.2,
            temperature: false,
        }
    }

    /// The matrix and the vector of the next passage, in `f64`.
    fn next(&mut self, x: &X) -> (SMatrix<f64, ELEMENTS, ELEMENTS>, SVector<f64, ELEMENTS>) {
        let width = 0.7 + self.blur * gaussian(&mut self.rng).abs();
        let mut matrix = SMatrix::<f64, 11, 11>::zeros();
        let mut vector = SVector::<f64, 11>::zeros();
        let warmth = gaussian(&mut self.rng);
        for sample in 0..SAMPLES {
            let s = (sample as f64 + 0.5) / SAMPLES as f64 * self.elements as f64 - 0.5;
            let row = SVector::<f64, 11>::from_fn(|e, _| {
                let near = |e: f64| (-((s - e) / width).powi(2)).exp() / self.noise;
                if e < self.elements {
                    near(e as f64)
                } else if e == ELEMENTS && self.temperature {
                    (0..self.elements).map(|e| near(e as f64)).sum()
                } else {
                    0.0
                }
            });
            let truth: f64 = x.iter().zip(row.iter()).map(|(x, g)| x * g).sum();
            let response = truth + warmth * row[ELEMENTS] + gaussian(&mut self.rng);
            matrix += row * row.transpose();
            vector += row * response;
        }
        let mut small = matrix.fixed_view::<ELEMENTS, ELEMENTS>(0, 0).into_owned();
        let mut right = vector.fixed_rows::<ELEMENTS>(0).into_owned();
        if self.temperature {
            // The change of all elements, of which nothing is known beforehand, is marginalised.
            let side = matrix.fixed_view::<ELEMENTS, 1>(0, ELEMENTS).into_owned();
            small -= side * side.transpose() / matrix[(ELEMENTS, ELEMENTS)];
            right -= side * vector[ELEMENTS] / matrix[(ELEMENTS, ELEMENTS)];
        }
        (small, right)
    }

    fn information(&mut self, x: &X) -> Information {
        let (matrix, vector) = self.next(x);
        Information {
            matrix: matrix.cast(),
            vector: vector.cast(),
        }
    }
}

fn forgetting(long: f32, recent: f32) -> Forgetting {
    Forgetting::new(long, recent).expect("sound")
}

fn flexibility(damage: f64) -> f64 {
    1.0 / (1.0 - damage) - 1.0
}

fn one(e: usize, damage: f64) -> X {
    let mut x = WHOLE;
    x[e] = flexibility(damage);
    x
}

/// An evidence of some passages, in which all of it is in use.
fn some() -> Evidence {
    let mut passages = Passages::new(5, 0.1);
    let mut evidence = Evidence::new(forgetting(100.0, 10.0));
    for _ in 0..30 {
        evidence.add(&passages.information(&one(3, 0.2)));
    }
    evidence
}

fn written(evidence: &Evidence) -> Vec<u8> {
    let mut buffer = [0; EVIDENCE_BYTES];
    evidence
        .to_bytes(&BASIS, Watch::NEW, &mut buffer)
        .expect("room")
        .to_vec()
}

fn read(bytes: &[u8]) -> Result<Evidence, EvidenceError> {
    Evidence::from_bytes(bytes, &BASIS, forgetting(100.0, 10.0)).map(|(evidence, _)| evidence)
}

#[test]
fn many_passages_say_what_their_joint_least_squares_solution_says() {
    for seed in 0..20 {
        // Damages large enough for no bound to matter.
        let x: X = std::array::from_fn(|e| flexibility(0.1 + 0.04 * ((7 * e + seed as usize) % 10) as f64));
        for memory in [Forgetting::NEVER, forgetting(f32::INFINITY, 10.0)] {
            let mut passages = Passages::new(seed, 0.02);
            let mut evidence = Evidence::new(memory);
            let mut matrix = SMatrix::<f64, ELEMENTS, ELEMENTS>::zeros();
            let mut vector = SVector::<f64, ELEMENTS>::zeros();
            for _ in 0..30 {
                let (a, b) = passages.next(&x);
                matrix += a;
                vector += b;
                let information = Information {
                    matrix: a.cast(),
                    vector: b.cast(),
                };
                assert_eq!(evidence.add(&information), Change::None);
            }
            assert!((evidence.passages() - 30.0).abs() < 1e-4);
            let covariance = matrix.try_inverse().expect("definite");
            let joint = covariance * vector;
            let estimate = evidence.estimate(ELEMENTS);
            for e in 0..ELEMENTS {
                let damage = joint[e] / (1.0 + joint[e]);
                let off = (f64::from(estimate.damage[e]) - damage).abs();
                assert!(off < JOINT_DAMAGE, "seed {seed}, element {e}: off by {off:.1e}");
                let std = (1.0 - damage).powi(2) * covariance[(e, e)].sqrt();
                let ratio = f64::from(estimate.std[e]) / std;
                assert!(
                    (ratio - 1.0).abs() < JOINT_DEVIATION,
                    "seed {seed}, element {e}: {ratio}"
                );
                assert!(estimate.low[e] < estimate.damage[e] && estimate.damage[e] < estimate.high[e]);
            }
        }
    }
}

#[test]
fn a_slow_loss_is_followed_with_the_lag_that_the_memory_implies() {
    let (long, recent) = (40.0_f64, 8.0_f64);
    let lag = (recent * recent + long * (long + recent)) / (long + recent);
    let mut passages = Passages::new(1, 0.05);
    let mut evidence = Evidence::new(forgetting(long as f32, recent as f32));
    for _ in 0..200 {
        assert_eq!(evidence.add(&passages.information(&WHOLE)), Change::None);
    }
    // 10 % over 300 passages.
    let slope = flexibility(0.1) / 300.0;
    for passage in 0..300 {
        let mut x = WHOLE;
        x[4] = slope * f64::from(passage);
        assert_eq!(
            evidence.add(&passages.information(&x)),
            Change::None,
            "passage {passage}"
        );
        let estimate = evidence.estimate(ELEMENTS);
        // Four memories after the beginning the lag is its own to 2 %.
        if passage >= 200 {
            let expected = slope * (f64::from(passage) - lag);
            let found = flexibility(estimate.damage[4].into());
            // Four deviations, and the memory that still fills.
            let tolerance = 4.0 * f64::from(estimate.std[4]) + 0.02 * slope * lag;
            assert!(
                (found - expected).abs() < tolerance,
                "passage {passage}: {found} for {expected}"
            );
        }
    }
    let estimate = evidence.estimate(ELEMENTS);
    assert_eq!(estimate.certain(), 1 << 4, "{estimate:?}");
}

#[test]
fn a_sudden_loss_is_told_and_certain_within_thirty_passages_and_the_old_bridge_is_forgotten() {
    const WITHIN: usize = 30;
    for seed in 0..40 {
        let element = seed as usize % ELEMENTS;
        // One passage alone is far from certain: 10 % are four of its deviations. The recent memory is half full of the
        // new bridge after 14.
        let mut passages = Passages::new(seed, 0.05);
        let mut evidence = Evidence::new(forgetting(2000.0, 20.0));
        for _ in 0..1000 {
            assert_eq!(evidence.add(&passages.information(&WHOLE)), Change::None);
        }
        assert_eq!(evidence.estimate(ELEMENTS).certain(), 0);
        let x = one(element, 0.1);
        let told = (1..=WITHIN).find(|_| evidence.add(&passages.information(&x)) == Change::Sudden);
        let told = told.unwrap_or_else(|| panic!("seed {seed}: not told"));
        let certain = (told..=WITHIN).find(|_| {
            let certain = evidence.estimate(ELEMENTS).certain();
            evidence.add(&passages.information(&x));
            certain == 1 << element
        });
        assert!(
            certain.is_some(),
            "seed {seed}: told after {told}, {:?}",
            evidence.estimate(ELEMENTS)
        );
        for _ in 0..200 {
            assert_eq!(evidence.add(&passages.information(&x)), Change::None, "seed {seed}");
        }
        let estimate = evidence.estimate(ELEMENTS);
        // Four deviations and what is left of the old bridge.
        let off = (estimate.damage[element] - 0.1).abs();
        assert!(off < 4.0 * estimate.std[element] + 0.002, "seed {seed}: {estimate:?}");
    }
}

#[test]
fn without_a_change_a_hundred_thousand_passages_tell_none() {
    // The last is so blurred that a passage's matrix is singular to `f32`.
    let cases = [
        (WHOLE, false, 0.2),
        (one(6, 0.3), true, 0.2),
        (one(6, 0.3), false, 2.0),
        (one(6, 0.3), true, 2.0),
    ];
    for (case, (x, temperature, blur)) in cases.into_iter().enumerate() {
        let mut passages = Passages::new(case as u64, 0.05);
        passages.temperature = temperature;
        passages.blur = blur;
        let mut evidence = Evidence::new(forgetting(2000.0, 20.0));
        for passage in 0..25_000 {
            let change = evidence.add(&passages.information(&x));
            assert_eq!(change, Change::None, "case {case}, passage {passage}");
        }
        let expected = if x == WHOLE { 0 } else { 1 << 6 };
        assert_eq!(evidence.estimate(ELEMENTS).certain(), expected);
        // The effective number of both memories in equilibrium.
        assert!((evidence.passages() - 2021.0).abs() < 5.0, "{}", evidence.passages());
    }
}

#[test]
fn a_stranger_is_left_out_and_two_that_agree_are_a_new_beginning() {
    let mut passages = Passages::new(6, 0.01);
    let mut evidence = Evidence::new(forgetting(100.0, 10.0));
    for _ in 0..20 {
        evidence.add(&passages.information(&WHOLE));
    }
    let before = evidence.clone();
    assert_eq!(evidence.add(&passages.information(&one(2, 0.5))), Change::Outlier);
    assert_eq!(evidence.information(), before.information(), "left out");
    assert_eq!(evidence.add(&passages.information(&WHOLE)), Change::None);
    // Two that contradict each other are two strangers; the third agrees with the second.
    assert_eq!(evidence.add(&passages.information(&one(2, 0.5))), Change::Outlier);
    assert_eq!(evidence.add(&passages.information(&one(7, 0.4))), Change::Outlier);
    assert_eq!(evidence.add(&passages.information(&one(7, 0.4))), Change::Sudden);
    assert_eq!(evidence.passages(), 2.0);
    let estimate = evidence.estimate(ELEMENTS);
    assert_eq!(estimate.certain(), 1 << 7);
    assert!((estimate.damage[7] - 0.4).abs() < 0.02);
}

#[test]
fn what_is_no_information_changes_nothing() {
    let mut evidence = some();
    let before = evidence.clone();
    let good = Passages::new(9, 0.1).information(&WHOLE);
    let broken: [fn(&mut Information); 6] = [
        |i| *i = Information::ZERO,
        |i| i.matrix[(3, 3)] = f32::NAN,
        |i| i.vector[3] = f32::INFINITY,
        |i| i.matrix[(3, 3)] = -i.matrix[(3, 3)],
        |i| i.matrix[(4, 3)] = 2.0 * i.matrix[(3, 3)],
        |i| i.matrix[(3, 3)] = 0.0,
    ];
    for (case, spoil) in broken.into_iter().enumerate() {
        let mut bad = good;
        spoil(&mut bad);
        assert_eq!(evidence.add(&bad), Change::Unusable, "case {case}");
        assert_eq!(evidence, before, "case {case}");
    }
}

#[test]
fn bytes_survive_a_restart_bit_for_bit_and_all_goes_on_as_if_there_had_been_none() {
    let mut evidence = some();
    let bytes = written(&evidence);
    assert_eq!(bytes.len(), EVIDENCE_BYTES);
    assert_eq!(bytes.len(), 1312);
    let mut restarted = read(&bytes).expect("sound");
    assert_eq!(restarted, evidence);
    assert_eq!(written(&restarted), bytes);
    let mut passages = Passages::new(10, 0.1);
    for _ in 0..50 {
        let passage = passages.information(&one(3, 0.4));
        assert_eq!(restarted.add(&passage), evidence.add(&passage));
    }
    assert_eq!(written(&restarted), written(&evidence));
    // An empty one, too, and one so old that an element last seen long ago has faded to nothing.
    let empty = Evidence::new(forgetting(100.0, 10.0));
    assert_eq!(read(&written(&empty)), Ok(empty));
    passages.elements = 4;
    for _ in 0..12_000 {
        evidence.add(&passages.information(&WHOLE));
    }
    assert_eq!(
        read(&written(&evidence)).map(|read| written(&read)),
        Ok(written(&evidence))
    );
    assert_eq!(evidence.estimate(ELEMENTS).std[9], 1.0);
}

#[test]
fn every_flipped_bit_every_cut_and_every_byte_more_is_refused() {
    let bytes = written(&some());
    for bit in 0..8 * bytes.len() {
        let mut flipped = bytes.clone();
        flipped[bit / 8] ^= 1 << (bit % 8);
        assert!(read(&flipped).is_err(), "bit {bit}");
    }
    for length in 0..bytes.len() {
        assert_eq!(read(&bytes[..length]), Err(EvidenceError::Length), "{length} bytes");
    }
    let mut longer = bytes.clone();
    longer.push(0);
    assert_eq!(read(&longer), Err(EvidenceError::Length));
    let mut buffer = [0; EVIDENCE_BYTES];
    for room in 0..EVIDENCE_BYTES {
        assert_eq!(some().to_bytes(&BASIS, Watch::NEW, &mut buffer[..room]), None);
    }
}

#[test]
fn another_bridge_and_another_version_are_refused_by_name() {
    let bytes = written(&some());
    let other = Evidence::from_bytes(
        &bytes,
        &Basis {
            bridge: BASIS.bridge + 1,
            ..BASIS
        },
        forgetting(100.0, 10.0),
    );
    assert_eq!(other.err(), Some(EvidenceError::Bridge));
    let mut newer = bytes.clone();
    newer[4] += 1;
    assert_eq!(read(&newer), Err(EvidenceError::Version { found: newer[4] }));
    let mut foreign = bytes;
    foreign[..4].copy_from_slice(b"SWBM");
    assert_eq!(read(&foreign), Err(EvidenceError::NotEvidence));
}

#[test]
fn numbers_that_are_no_sum_of_passages_are_refused_even_with_the_right_checksum() {
    let bytes = written(&some());
    // Offsets of the first numbers: the head, and a count before each memory.
    let (long, memory) = (14, 4 * 65 + 1);
    let (recent, counts) = (long + memory, long + 4 * memory - 1);
    let settling = counts + 4 * 4;
    let spread = settling + 4 + 1;
    let rewritten = |at: usize, number: f32| {
        let mut bytes = bytes.clone();
        bytes[at..at + 4].copy_from_slice(&number.to_le_bytes());
        let end = bytes.len() - 4;
        let crc = CRC32C.checksum(&bytes[..end]).to_le_bytes();
        bytes[end..].copy_from_slice(&crc);
        read(&bytes)
    };
    let number = |at: usize| f32::from_le_bytes(bytes[at..at + 4].try_into().expect("four"));
    assert!(rewritten(long, number(long)).is_ok(), "offsets are right");
    for at in [
        long,
        long + 4,
        long + 4 * 60,
        recent,
        recent + 4,
        recent + 4 * 60,
        counts,
        counts + 4,
        settling,
        spread,
        spread + 4 * 54,
    ] {
        for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
            assert_eq!(rewritten(at, bad), Err(EvidenceError::Contents), "byte {at}: {bad}");
        }
    }
    for at in [long, recent, counts, counts + 4, settling, spread] {
        assert_eq!(rewritten(at, -1.0), Err(EvidenceError::Contents), "byte {at}");
    }
    // An off-diagonal entry larger than its diagonals; a diagonal of nothing beside entries; passages without any.
    for (at, value) in [
        (long + 4, 2.0 * number(long).max(number(long + 8))),
        (long, 0.0),
        (counts, 0.0),
    ] {
        assert_eq!(rewritten(at, value), Err(EvidenceError::Contents), "byte {at}");
    }
}

#[test]
fn memories_that_make_no_sense_are_refused() {
    for (long, recent) in [
        (-1.0, 1.0),
        (f32::NAN, 10.0),
        (100.0, f32::NAN),
        (0.5, 0.2),
        (10.0, 10.0),
        (10.0, 20.0),
        (10.0, 0.0),
        (f32::NEG_INFINITY, 1.0),
    ] {
        assert_eq!(
            Forgetting::new(long, recent),
            Err(EvidenceError::Forgetting),
            "{long}, {recent}"
        );
    }
    for (long, recent) in [(0.0, 0.0), (f32::INFINITY, 0.0), (f32::INFINITY, 10.0), (100.0, 1.0)] {
        assert!(Forgetting::new(long, recent).is_ok(), "{long}, {recent}");
    }
}

#[test]
fn a_loss_under_an_unknown_temperature_is_certain_though_every_deviation_is_large() {
    let mut passages = Passages::new(11, 0.02);
    passages.temperature = true;
    let mut evidence = Evidence::new(Forgetting::NEVER);
    for _ in 0..20 {
        evidence.add(&passages.information(&one(5, 0.2)));
    }
    let information = evidence.information();
    let estimate = information.estimate(ELEMENTS);
    assert!(
        estimate.damage[5] < ALARM_DEVIATIONS * estimate.std[5],
        "not by its deviation: {estimate:?}"
    );
    assert_eq!(estimate.certain(), 1 << 5, "{estimate:?}");
    assert!((estimate.damage[5] - 0.2).abs() < 0.01, "{estimate:?}");
    // That it is whole would need all others to be stiffer; nothing can stand in for it.
    assert_eq!(information.inseparable(ELEMENTS, 5), 0);
    let rival = information.rival(ELEMENTS, 5).expect("definite");
    assert_eq!(rival.significance, estimate.significance[5]);
    assert_eq!(rival.damage[5], 0.0);
}

/// The same as seen by a train to which elements `a` and `b` are one.
fn mirrored(information: &Information, a: usize, b: usize) -> Information {
    let mut mirror = SMatrix::<f64, ELEMENTS, ELEMENTS>::identity();
    mirror.fixed_view_mut::<1, 1>(b, b).fill(0.0);
    mirror[(a, b)] = 1.0;
    Information {
        matrix: (mirror.transpose() * information.matrix.cast::<f64>() * mirror).cast(),
        vector: (mirror.transpose() * information.vector.cast::<f64>()).cast(),
    }
}

#[test]
fn of_two_mirror_images_neither_is_certain_and_each_is_named_as_the_other_s_double() {
    for seed in 0..10 {
        let mut passages = Passages::new(seed, 0.02);
        let mut evidence = Evidence::new(Forgetting::NEVER);
        for _ in 0..100 {
            evidence.add(&mirrored(&passages.information(&one(2, 0.3)), 2, 7));
        }
        let information = evidence.information();
        let estimate = information.estimate(ELEMENTS);
        assert_eq!(estimate.certain(), 0, "{estimate:?}");
        for (e, double) in [(2, 7), (7, 2)] {
            assert!(estimate.significance[e] < TOLD_APART, "{estimate:?}");
            if estimate.damage[e] > 0.05 {
                assert_eq!(
                    information.inseparable(ELEMENTS, e),
                    1 << double,
                    "seed {seed}, element {e}"
                );
                let rival = information.rival(ELEMENTS, e).expect("definite");
                assert!((rival.damage[double] - 0.3).abs() < 0.01, "{rival:?}");
            }
        }
        assert!(estimate.damage[2].max(estimate.damage[7]) > 0.05);
        assert_eq!((estimate.std[2], estimate.low[2], estimate.high[2]), (1.0, 0.0, 0.7));
        assert!(estimate.std[4] < 0.1, "the others are served");
    }
}

#[test]
fn the_significance_of_an_element_that_nothing_is_mixed_up_with_is_its_damage_in_deviations() {
    let mut information = Information::ZERO;
    for e in 0..ELEMENTS {
        // Deviations of 0.01, the estimates 0.1, 0.2, ...
        information.matrix[(e, e)] = 1e4;
        information.vector[e] = 1e3 * (e + 1) as f32;
    }
    let estimate = information.estimate(ELEMENTS);
    for e in 0..ELEMENTS {
        let x = 0.1 * (e + 1) as f32;
        let expected = x / 0.01;
        assert!((estimate.significance[e] / expected - 1.0).abs() < 1e-3, "{estimate:?}");
        assert!((estimate.damage[e] - x / (1.0 + x)).abs() < 1e-6);
        assert!((estimate.std[e] - 0.01 / (1.0 + x).powi(2)).abs() < 1e-6);
    }
}

#[test]
fn an_element_that_no_passage_has_seen_is_unknown_and_the_others_are_served() {
    let mut passages = Passages::new(12, 0.02);
    let mut information = passages.information(&one(2, 0.3));
    information.matrix.row_mut(8).fill(0.0);
    information.matrix.column_mut(8).fill(0.0);
    information.vector[8] = 0.0;
    let estimate = information.estimate(ELEMENTS);
    let unseen = (
        estimate.damage[8],
        estimate.std[8],
        estimate.low[8],
        estimate.high[8],
        estimate.significance[8],
    );
    assert_eq!(unseen, (0.0, 1.0, 0.0, 0.7, 0.0));
    assert_eq!(estimate.certain(), 1 << 2, "{estimate:?}");
}

#[test]
fn elements_that_a_bridge_does_not_have_are_zero_and_no_numbers_say_nothing() {
    let mut passages = Passages::new(13, 0.02);
    passages.elements = 6;
    let estimate = passages.information(&one(2, 0.3)).estimate(6);
    assert_eq!(estimate.certain(), 1 << 2);
    for e in 6..ELEMENTS {
        let all = [
            estimate.damage[e],
            estimate.std[e],
            estimate.low[e],
            estimate.high[e],
            estimate.significance[e],
        ];
        assert_eq!(all, [0.0; 5]);
    }
    let mut broken = passages.information(&WHOLE);
    broken.vector[0] = f32::NAN;
    for nothing in [broken, Information::ZERO] {
        let estimate = nothing.estimate(6);
        assert_eq!(estimate.certain(), 0);
        assert_eq!((estimate.std[0], estimate.high[5], estimate.high[6]), (1.0, 0.7, 0.0));
        assert_eq!(nothing.inseparable(6, 0), 0);
        assert_eq!(nothing.inseparable(6, 99), 0);
        assert_eq!(nothing.rival(6, 99), None);
    }
}

#[test]
fn intervals_hold_the_true_losses_nineteen_times_of_twenty() {
    let mut passages = Passages::new(14, 0.03);
    let x: X = std::array::from_fn(|e| [0.0, 0.02, 0.1, 0.5, 0.0][e % 5]);
    let mut held = 0;
    const DRAWS: usize = 5000;
    for _ in 0..DRAWS {
        let estimate = passages.information(&x).estimate(ELEMENTS);
        for ((x, low), high) in x.iter().zip(estimate.low).zip(estimate.high) {
            let truth = (x / (1.0 + x)) as f32;
            held += usize::from(low <= truth && truth <= high);
        }
    }
    let coverage = held as f64 / (DRAWS * ELEMENTS) as f64;
    // Chance leaves 0.1 %, more as the elements of a passage are not independent.
    assert!((0.945..0.955).contains(&coverage), "{coverage}");
}
