//! The bridge model: it has the declared frequencies, a damaged one bends and swings as the finite elements do, and the
//! logger believes no bytes but those of a true model.

use heapless::String;
use host_sim::model::eigen::natural_modes;
use host_sim::model::{self, Structure};
use nalgebra::DVector;
use rand_core::{Rng, SeedableRng};
use rand_xoshiro::Xoshiro256PlusPlus;
use spanwatch::bridge::blob::Absurdity;
use spanwatch::bridge::{BlobError, Damage, ModalBridge, ReducedBridge, blob};
use spanwatch::capacity::{BASIS, ELEMENTS, MODEL_BLOB_BYTES, MODES};
use spanwatch::interaction::Scheme;
use spanwatch::interaction::scheme::ModeSteps;
use spanwatch::wire::CRC32C;

/// The declared frequencies are printed to six digits.
const PRINTED_DIGITS: f64 = 2e-6;

fn girder50() -> ReducedBridge<f64> {
    model::reduce::reduce(&model::shipped("girder50").expect("shipped")).expect("reduces")
}

fn damage(of: &[(usize, f64)]) -> Damage<f64> {
    let mut damage = [0.0; ELEMENTS];
    for &(element, loss) in of {
        damage[element - 1] = loss;
    }
    damage
}

#[test]
fn girder50_has_its_declared_frequencies() {
    let modal = ModalBridge::<f64, MODES>::new(&girder50(), &[0.0; ELEMENTS], &[]);
    for (k, declared) in [3.50002, 14.0015, 31.5168, 56.0928, 87.8454].iter().enumerate() {
        let error = modal.frequency_hz(k) / declared - 1.0;
        assert!(error.abs() < PRINTED_DIGITS, "mode {}: {error:e}", k + 1);
    }
    // An exact beam has f_k = k^2 f_1; the tenfold consistent-mass girder is a little too stiff, and less so the lower.
    let exact_hz = std::f64::consts::FRAC_PI_2 / 2500.0 * (1.55148e11_f64 / 5000.0).sqrt();
    let stiffer = modal.frequency_hz(0) / exact_hz - 1.0;
    assert!((0.0..1e-5).contains(&stiffer), "{stiffer:e}");
}

#[test]
fn thirty_per_cent_in_element_five_lowers_the_first_frequency_to_3_363_hz() {
    // The paper prints 3.37 for its own, unknown girder.
    let modal = ModalBridge::<f64, MODES>::new(&girder50(), &damage(&[(5, 0.30)]), &[]);
    assert!(
        (modal.frequency_hz(0) - 3.363).abs() < 5e-4,
        "{}",
        modal.frequency_hz(0)
    );
}

/// Damage patterns over which the reduced model is compared with all finite elements: single, edge, severe, mixed.
fn patterns() -> [Damage<f64>; 8] {
    [
        damage(&[]),
        damage(&[(5, 0.11)]),
        damage(&[(5, 0.41)]),
        damage(&[(5, 0.70)]),
        damage(&[(1, 0.70)]),
        damage(&[(1, 0.21), (5, 0.41)]),
        damage(&[(2, 0.3), (3, 0.5), (8, 0.7), (10, 0.1)]),
        [0.7, 0.0, 0.7, 0.0, 0.7, 0.0, 0.7, 0.0, 0.7, 0.0],
    ]
}

#[test]
fn a_damaged_reduced_model_is_the_full_one() {
    // The girder has 20 freedoms and the basis 20 vectors, so nothing is lost but rounding: of the f64 eigenvalues (their
    // condition, 1e6, times 1e-16, some times over) and, on the logger, of f32 (1e-7, a few times over, in ratios of neighbouring modes).
    const ROUNDING: f64 = 1e-9;
    const ROUNDING_F32: f64 = 3e-6;
    let girder = Structure::new(model::shipped("girder50").expect("shipped")).expect("assembles");
    let bridge = girder50();
    let (mut worst, mut worst_f32, mut worst_static) = (0.0_f64, 0.0_f64, 0.0_f64);
    for damage in patterns() {
        let stiffness = girder.stiffness(&damage);
        let exact = natural_modes(&stiffness, girder.mass()).expect("a positive stiffness matrix");
        let modal = ModalBridge::<f64, BASIS>::new(&bridge, &damage, &[5]);
        let logger = ModalBridge::<f32, BASIS>::new(&bridge.cast(), &damage.map(|d| d as f32), &[5]);
        for (k, exact) in exact.omega_squared.iter().enumerate().take(MODES) {
            worst = worst.max((modal.omega_squared[k] / exact - 1.0).abs());
            worst_f32 = worst_f32.max((f64::from(logger.omega_squared[k]) / exact - 1.0).abs());
        }
        // A unit load at mid-span, node 6.
        let at = girder.sensors[5].row[0].0;
        let mut load = DVector::zeros(girder.mass().nrows());
        load[at] = 1.0;
        let full = stiffness.cholesky().expect("held").solve(&load)[at];
        let reduced = modal.sensors[0]
            .component_div(&modal.omega_squared)
            .dot(&modal.sensors[0]);
        worst_static = worst_static.max((reduced / full - 1.0).abs());
    }
    println!("squared frequencies: {worst:.1e}, in f32 {worst_f32:.1e}; mid-span deflection: {worst_static:.1e}");
    assert!(
        worst < ROUNDING && worst_static < ROUNDING,
        "{worst:e} {worst_static:e}"
    );
    assert!(worst_f32 < ROUNDING_F32, "{worst_f32:e}");
}

#[test]
fn undamaged_modes_alone_would_not_do() {
    // Why the basis holds static vectors: with element 5 at 41 %, eight undamaged modes leave the first frequency 0.95 %
    // too high, which is more than 8 points of damage there.
    let damage = damage(&[(5, 0.41)]);
    let girder = Structure::new(model::shipped("girder50").expect("shipped")).expect("assembles");
    let exact = natural_modes(&girder.stiffness(&damage), girder.mass()).expect("positive");
    let modes = natural_modes(&girder.stiffness(&[]), girder.mass()).expect("positive");
    let eight = modes.shapes.columns(0, 8).into_owned();
    let projected = eight.transpose() * girder.stiffness(&damage) * &eight;
    let too_high = (projected.symmetric_eigenvalues().min() / exact.omega_squared[0]).sqrt() - 1.0;
    println!("f1 too high by {too_high:.2e} with 8 undamaged modes");
    assert!((0.009..0.010).contains(&too_high), "{too_high}");
}

#[test]
fn damping_is_two_per_cent_at_the_first_two_modes_and_keeps_its_coefficients_under_damage() {
    let bridge = girder50();
    let ratio = |modal: &ModalBridge<f64, MODES>, k: usize| modal.damping[k] / (2.0 * modal.omega_squared[k].sqrt());
    let healthy = ModalBridge::<f64, MODES>::new(&bridge, &[0.0; ELEMENTS], &[]);
    for k in 0..2 {
        assert!((ratio(&healthy, k) - 0.02).abs() < 1e-12);
    }
    // Stiffness-proportional damping takes over above: xi_3 = (p1 / w3 + p2 w3) / 2.
    assert!(ratio(&healthy, 2) > 0.02 && ratio(&healthy, 4) > ratio(&healthy, 3));
    let damaged = ModalBridge::<f64, MODES>::new(&bridge, &damage(&[(5, 0.7)]), &[]);
    let [p1, p2] = bridge.rayleigh;
    for k in 0..MODES {
        let expected = p1 + p2 * damaged.omega_squared[k];
        assert!((damaged.damping[k] / expected - 1.0).abs() < 1e-14);
    }
}

fn blob_of(bridge: &ReducedBridge<f32>) -> Vec<u8> {
    let mut buffer = vec![0; MODEL_BLOB_BYTES];
    blob::write(bridge, &mut buffer).expect("room").to_vec()
}

/// Replaces the checksum by the right one.
fn sealed(mut bytes: Vec<u8>) -> Vec<u8> {
    let body = bytes.len() - 4;
    let crc = CRC32C.checksum(&bytes[..body]).to_le_bytes();
    bytes[body..].copy_from_slice(&crc);
    bytes
}

#[test]
fn a_blob_is_read_back_as_it_was_written_and_is_small() {
    /// 20 vectors of a basis for 20 factors, 22 shapes on the path and 11 sensors are 1060 numbers of 4 bytes; names,
    /// positions and counts take the rest.
    const BLOB_BYTES: usize = 4500;
    let bridge = girder50().cast::<f32>();
    let bytes = blob_of(&bridge);
    println!("girder50: {} bytes", bytes.len());
    assert!(bytes.len() <= BLOB_BYTES, "{}", bytes.len());
    assert_eq!(blob::read(&bytes), Ok(bridge.clone()));
    assert_eq!(
        blob::write(&bridge, &mut vec![0; bytes.len() - 1]),
        Err(BlobError::NoRoom)
    );
    assert_eq!(blob::write(&bridge, &mut [0; 3]), Err(BlobError::NoRoom));
    assert_eq!(
        blob::write(&bridge, &mut vec![0; bytes.len()]).map(<[u8]>::len),
        Ok(bytes.len())
    );
}

#[test]
fn every_flipped_bit_and_every_cut_is_refused() {
    let mut bytes = blob_of(&girder50().cast());
    for bit in 0..8 * bytes.len() {
        bytes[bit / 8] ^= 1 << (bit % 8);
        let refused = blob::read(&bytes).expect_err("a flipped bit");
        match bit / 8 {
            0..4 => assert_eq!(refused, BlobError::NotAModel),
            4 => assert!(matches!(refused, BlobError::Version { .. })),
            _ => assert_eq!(refused, BlobError::Checksum),
        }
        bytes[bit / 8] ^= 1 << (bit % 8);
    }
    for length in 0..bytes.len() {
        assert!(blob::read(&bytes[..length]).is_err(), "cut to {length} bytes");
        // Even if someone gave the cut piece a right checksum.
        if length >= 9 {
            assert_eq!(
                blob::read(&sealed(bytes[..length].to_vec())),
                Err(BlobError::Malformed),
                "{length}"
            );
        }
    }
    let mut longer = bytes.clone();
    longer.push(0);
    assert_eq!(blob::read(&longer), Err(BlobError::Checksum));
    assert_eq!(blob::read(&sealed(longer)), Err(BlobError::Malformed));
}

#[test]
fn another_version_is_refused_by_its_number() {
    let mut bytes = blob_of(&girder50().cast());
    bytes[4] = 7;
    let error = blob::read(&sealed(bytes)).expect_err("another version");
    assert_eq!(error, BlobError::Version { found: 7 });
    let sentence = error.to_string();
    assert!(
        sentence.contains("version 7") && sentence.contains("build the model again"),
        "{sentence}"
    );
}

#[test]
fn values_that_no_bridge_has_are_refused_though_their_checksum_is_right() {
    type Doctor = fn(&mut ReducedBridge<f32>);
    let absurd: &[(Absurdity, Doctor)] = &[
        (Absurdity::Frequency, |b| b.lambda[3] = f32::NAN),
        (Absurdity::Frequency, |b| b.lambda[0] = -480.0),
        (Absurdity::Frequency, |b| b.lambda[19] = f32::INFINITY),
        (Absurdity::Frequency, |b| b.basis = 0),
        (Absurdity::Order, |b| b.lambda.swap_rows(0, 1)),
        (Absurdity::Damping, |b| b.rayleigh[0] = -0.1),
        (Absurdity::Damping, |b| b.rayleigh[1] = f32::NAN),
        (Absurdity::Damping, |b| b.rayleigh[1] = 1.0),
        (Absurdity::Damping, |b| b.rayleigh[0] = f32::INFINITY),
        (Absurdity::Shape, |b| b.path.displacement[(0, 5)] = f32::NAN),
        (Absurdity::Shape, |b| b.sensors[(2, 1)] = f32::NEG_INFINITY),
        (Absurdity::Shape, |b| b.sensors[(0, 5)] = 1e3),
        (Absurdity::Shape, |b| b.path.slope[(0, 0)] = -1e20),
        (Absurdity::Element, |b| b.factor_element[4] = 10),
        (Absurdity::Stiffness, |b| b.factors[(0, 0)] += 0.1),
        (Absurdity::Stiffness, |b| b.factor_count -= 2),
        (Absurdity::Stiffness, |b| b.factor_count = 0),
        (Absurdity::PathOrder, |b| b.path.position_m.swap(3, 4)),
        (Absurdity::PathOrder, |b| b.path.position_m[4] = b.path.position_m[3]),
        // So short an element that its slopes are no numbers.
        (Absurdity::PathOrder, |b| {
            b.path.position_m[4] = b.path.position_m[3] + 1e-4
        }),
        (Absurdity::Path, |b| b.path.position_m[10] = 1e6),
        (Absurdity::Path, |b| b.path.position_m[10] = f32::NAN),
        (Absurdity::Path, |b| b.path.position_m[0] = -1.0),
        (Absurdity::Path, |b| b.path.position_m[0] = 1.0),
        (Absurdity::Path, |b| b.path.nodes = 1),
        (Absurdity::Path, |b| b.path.nodes = 0),
        (Absurdity::Sensors, |b| b.sensor_count = 0),
    ];
    let bridge = girder50().cast::<f32>();
    for (i, (reason, doctor)) in absurd.iter().enumerate() {
        let mut doctored = bridge.clone();
        doctor(&mut doctored);
        let refused = blob::read(&blob_of(&doctored)).map(|_| "believed");
        assert_eq!(refused, Err(BlobError::Absurd(*reason)), "doctored bridge {i}");
    }
    for elements in [0, 11, 255] {
        let doctored = ReducedBridge {
            elements,
            ..bridge.clone()
        };
        assert_eq!(
            blob::read(&blob_of(&doctored)),
            Err(BlobError::TooLarge),
            "{elements} elements"
        );
    }
    let renamed = ReducedBridge {
        name: String::new(),
        ..bridge
    };
    assert!(blob::read(&blob_of(&renamed)).is_ok(), "a name is no physics");
}

#[test]
fn a_mode_that_does_not_swing_at_all_is_stepped_by_numbers() {
    let h = 2.5e-3_f32;
    for omega_squared in [4e-3_f32, 500.0, 2e6, 4e13] {
        for damping in [0.0_f32, 1.0, 2.0 * omega_squared.sqrt(), 1e5, 1e15] {
            let steps = ModeSteps::<f32, 1>::new(Scheme::Exact, h, &[omega_squared].into(), &[damping].into());
            let numbers = [steps.beta_h2[0], steps.damping[0], steps.effective[0]];
            assert!(
                numbers.iter().all(|value| value.is_finite()),
                "{omega_squared} {damping}: {numbers:?}"
            );
            assert!(
                steps.effective[0] >= 1.0 || damping == 0.0,
                "{omega_squared} {damping}: {numbers:?}"
            );
        }
    }
}

#[test]
fn no_bytes_make_the_reader_panic() {
    const SHORT: u32 = 200_000;
    const CHANGED: u32 = 20_000;
    let mut rng = Xoshiro256PlusPlus::seed_from_u64(45);
    let mut buffer = [0_u8; 64];
    for _ in 0..SHORT {
        let length = rng.next_u32() as usize % buffer.len();
        rng.fill_bytes(&mut buffer[..length]);
        assert!(blob::read(&buffer[..length]).is_err());
        // The same behind a right head and with a right checksum, so that the fields are reached.
        if length >= 9 {
            buffer[..4].copy_from_slice(b"SWBM");
            buffer[4] = blob::FORMAT_VERSION;
            assert!(blob::read(&sealed(buffer[..length].to_vec())).is_err());
        }
    }
    // A true model with some bytes changed and a right checksum: whatever is believed can be used.
    let bytes = blob_of(&girder50().cast());
    let mut believed = 0;
    for _ in 0..CHANGED {
        let mut changed = bytes.clone();
        for _ in 0..1 + rng.next_u32() % 4 {
            let at = 5 + rng.next_u32() as usize % (bytes.len() - 5);
            changed[at] = rng.next_u32() as u8;
        }
        if let Ok(bridge) = blob::read(&sealed(changed)) {
            believed += 1;
            let modal = ModalBridge::<f32, MODES>::new(&bridge, &[0.7; ELEMENTS], &[0]);
            assert!(modal.omega_squared.iter().all(|w2| *w2 > 0.0));
        }
    }
    println!("of {CHANGED} changed models {believed} were believed: their values are those of some bridge");
}
