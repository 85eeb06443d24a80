//! The track: the curve that wheels roll on is the one through the table, slope and curvature are those of that curve, a
//! generated track has the spectrum that it is named after, and a table that cannot be one is refused.

mod program;

use std::f64::consts::TAU;
use std::fs;
use std::path::{Path, PathBuf};

use host_sim::track::spectrum::Quantity;
use host_sim::track::summary::{spacing_m, summary};
use host_sim::track::{Profile, RAIL_DISTANCE_M, Rails, Spectrum, Stretch, generate, read, table};
use spanwatch::track::{Irregularity, Motion, Track};
use tempfile::TempDir;

use program::host_sim;

/// Rounding of values near one.
const ROUNDING: f64 = 1e-12;
const MOTIONS: [Motion; 3] = [Motion::Vertical, Motion::Lateral, Motion::Roll];
const SPECTRA: [Spectrum; 7] = [
    Spectrum::Fra1,
    Spectrum::Fra2,
    Spectrum::Fra3,
    Spectrum::Fra4,
    Spectrum::Fra5,
    Spectrum::Fra6,
    Spectrum::ErriLow,
];

fn at(track: &Profile, motion: Motion, x_m: f64) -> Irregularity<f64> {
    Track::<f64>::at(track, motion, x_m)
}

fn track_a() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/data/reference/track_a.csv")
}

/// Places at very uneven spacing, from 0 to `to`.
fn uneven(to: f64, count: usize) -> Vec<f64> {
    let raw: Vec<f64> = (0..count)
        .map(|i| i as f64 + 0.45 * (i as f64 * 2.4).sin() * f64::from(u8::from(i > 0)))
        .collect();
    let last = raw[count - 1];
    raw.iter().map(|x| x / last * to).collect()
}

#[test]
fn a_cubic_that_begins_and_ends_level_is_followed_exactly() {
    let places = uneven(1.0, 12);
    let cubic = |t: f64| t * t * (3.0 - 2.0 * t);
    let track = Profile::new(Rails::equal(places.clone(), places.iter().map(|&t| cubic(t)).collect()));
    for i in 0..=1000 {
        let t = f64::from(i) / 1000.0;
        let found = at(&track, Motion::Vertical, t);
        for (what, found, expected) in [
            ("value", found.value, cubic(t)),
            ("slope", found.slope, 6.0 * t * (1.0 - t)),
            ("curvature", found.curvature, 6.0 - 12.0 * t),
        ] {
            // The curvature comes from second differences of points 0.05 apart, which magnify rounding.
            assert!(
                (found - expected).abs() < 1e3 * ROUNDING,
                "{what} at {t}: {found} not {expected}"
            );
        }
    }
}

#[test]
fn slope_and_curvature_are_the_derivatives_of_the_curve_and_all_three_are_continuous() {
    let x = uneven(50.0, 60);
    let z = x.iter().map(|x| (0.7 * x).sin() + 0.3 * (1.9 * x).cos()).collect();
    let track = Profile::new(Rails::equal(x.clone(), z));
    const STEP: f64 = 1e-4;
    let curve = |x| at(&track, Motion::Vertical, x);
    for i in 1..2000 {
        let place = 50.0 * f64::from(i) / 2000.0;
        let [before, here, after] = [place - STEP, place, place + STEP].map(curve);
        let slope = (after.value - before.value) / (2.0 * STEP);
        let curvature = (after.slope - before.slope) / (2.0 * STEP);
        // Third derivatives are of the order of ten; they jump at points of the table.
        assert!((here.slope - slope).abs() < 1e-6, "slope at {place}");
        assert!((here.curvature - curvature).abs() < 1e-2, "curvature at {place}");
    }
    for &knot in &x[1..x.len() - 1] {
        let [before, after] = [knot - 1e-9, knot + 1e-9].map(curve);
        assert!((before.value - after.value).abs() < 1e-7);
        assert!((before.slope - after.slope).abs() < 1e-6);
        assert!(
            (before.curvature - after.curvature).abs() < 1e-5,
            "curvature jumps at {knot}"
        );
    }
    for end in [0.0, 50.0] {
        assert!(curve(end).slope.abs() < ROUNDING);
    }
}

#[test]
fn the_curvature_of_a_wave_is_off_by_the_part_that_the_module_says() {
    for points in [8, 16, 30] {
        let length = 1.0;
        let h = length / f64::from(points);
        let x: Vec<f64> = (0..=20 * points).map(|i| f64::from(i) * h).collect();
        let z = x.iter().map(|x| (TAU * x / length).cos()).collect();
        let track = Profile::new(Rails::equal(x, z));
        let error = at(&track, Motion::Vertical, 10.0).curvature / -(TAU / length).powi(2) - 1.0;
        let told = (TAU * h / length).powi(2) / 12.0;
        assert!(
            (error / told - 1.0).abs() < 0.1,
            "{points} points: {error} against {told}"
        );
    }
}

#[test]
fn rails_lead_the_wheelset_by_their_mean_and_their_difference() {
    let x: Vec<f64> = (0..50).map(f64::from).collect();
    let wave = |scale: f64, phase: f64| -> Vec<f64> { x.iter().map(|x| scale * (0.3 * x + phase).sin()).collect() };
    let rails = Rails {
        x_m: x.clone(),
        z_m: [wave(2e-3, 0.0), wave(1e-3, 1.0)],
        y_m: [wave(3e-3, 2.0), wave(1e-3, 3.0)],
    };
    let track = Profile::new(rails.clone());
    for (i, &x) in x.iter().enumerate() {
        let rise = |rail: &[f64]| rail[i] - rail[0];
        let [zl, zr] = [rise(&rails.z_m[0]), rise(&rails.z_m[1])];
        let [yl, yr] = [rise(&rails.y_m[0]), rise(&rails.y_m[1])];
        for (motion, expected) in
            MOTIONS
                .into_iter()
                .zip([(zl + zr) / 2.0, (yl + yr) / 2.0, (zl - zr) / RAIL_DISTANCE_M])
        {
            assert!(
                (at(&track, motion, x).value - expected).abs() < ROUNDING,
                "{motion:?} at {x}"
            );
        }
    }
}

#[test]
fn before_the_track_it_is_level_at_zero_and_behind_it_at_its_last_height() {
    let x = vec![-3.0, -1.0, 0.0, 2.0, 5.0];
    let track = Profile::new(Rails::equal(x, vec![7e-3, 8e-3, 9e-3, 8e-3, 1e-2]));
    assert_eq!(Track::<f64>::extent_m(&track), Some([-3.0, 5.0]));
    assert_eq!(at(&track, Motion::Vertical, -3.1), Irregularity::none());
    assert_eq!(at(&track, Motion::Vertical, f64::NAN), Irregularity::none());
    let begin = at(&track, Motion::Vertical, -3.0);
    assert_eq!((begin.value, begin.slope.abs() < ROUNDING), (0.0, true));
    let behind = at(&track, Motion::Vertical, 1e9);
    assert!((behind.value - 3e-3).abs() < ROUNDING);
    assert_eq!((behind.slope, behind.curvature), (0.0, 0.0));
    // The logger's numbers are the same, rounded.
    let single = Track::<f32>::at(&track, Motion::Vertical, 1.0);
    assert_eq!(single.value, at(&track, Motion::Vertical, 1.0).value as f32);
}

#[test]
fn the_reference_track_is_read_as_it_stands_and_its_curve_is_smooth() {
    let track = read(&track_a()).expect("reads");
    assert_eq!(track.rails().x_m.len(), 14_000);
    assert_eq!(Track::<f64>::extent_m(&track), Some([-150.0, 549.95]));
    let text = fs::read_to_string(track_a()).expect("the file");
    for line in text.lines().skip(1).step_by(7) {
        let (x, z) = line.split_once(',').expect("two columns");
        let [x, z]: [f64; 2] = [x, z].map(|text| text.parse().expect("a number"));
        assert!((at(&track, Motion::Vertical, x).value - 1e-3 * z).abs() < ROUNDING);
        assert_eq!(at(&track, Motion::Roll, x), Irregularity::none());
    }
    // Its shortest wave is 1.5 m: from point to point the curvature changes by at most 2 pi 0.05 / 1.5 of its size, and
    // by what the table's last digit, 1e-9 m, does to it (half of it, twelvefold, over 0.05^2).
    const TABLE_DIGIT: f64 = 0.5e-9 * 12.0 / (0.05 * 0.05);
    let curvature = |i: usize| at(&track, Motion::Vertical, -150.0 + 0.05 * i as f64).curvature;
    let largest = (0..3900).map(|i| curvature(i).abs()).fold(0.0, f64::max);
    for i in 1..3900 {
        let change = (curvature(i) - curvature(i - 1)).abs();
        assert!(
            change < TAU * 0.05 / 1.5 * largest + 2.0 * TABLE_DIGIT,
            "at point {i}: {change:e}"
        );
    }
}

fn mean_square(spectrum: Spectrum, quantity: Quantity, waves_m: [f64; 2]) -> f64 {
    integral(waves_m, |s| spectrum.density(quantity, s))
}

/// Integral of `density` over the waves a metre.
fn integral([short, long]: [f64; 2], density: impl Fn(f64) -> f64) -> f64 {
    // The substitution s = e^u makes the integrand gentle; trapezoids.
    const PARTS: i32 = 4000;
    let [low, high] = [(1.0 / long).ln(), (1.0 / short).ln()];
    let width = (high - low) / f64::from(PARTS);
    (0..=PARTS)
        .map(|i| {
            let s = (low + width * f64::from(i)).exp();
            let weight = if i == 0 || i == PARTS { 0.5 } else { 1.0 };
            weight * width * s * density(s)
        })
        .sum()
}

#[test]
fn the_spectra_have_the_root_mean_squares_that_their_module_states() {
    let rms_mm = |spectrum, waves| 1e3 * mean_square(spectrum, Quantity::Profile, waves).sqrt();
    for (spectrum, to_80, to_longest) in [
        (Spectrum::Fra1, 4.97, 29.0),
        (Spectrum::Fra2, 3.75, 21.9),
        (Spectrum::Fra3, 2.80, 16.3),
        (Spectrum::Fra4, 2.09, 12.2),
        (Spectrum::Fra5, 1.58, 9.2),
        (Spectrum::Fra6, 1.25, 7.3),
        (Spectrum::ErriLow, 2.07, 2.34),
    ] {
        let [short, long] = spectrum.waves_m();
        for (longest, stated) in [(80.0, to_80), (long, to_longest)] {
            let found = rms_mm(spectrum, [short, longest]);
            assert!(
                (found / stated - 1.0).abs() < 5e-3,
                "{spectrum:?} to {longest} m: {found}"
            );
        }
    }
    for (longest, stated) in [(60.0, 0.92), (25.0, 0.42)] {
        let found = rms_mm(Spectrum::Fra6, [1.524, longest]);
        assert!((found - stated).abs() < 5e-3, "{found}");
    }
}

/// Mean square in the band from `low` to `high` waves a metre of evenly spaced values: periodogram, Hann window.
fn band_mean_square(values: &[f64], spacing_m: f64, [low, high]: [f64; 2]) -> f64 {
    let count = values.len();
    let length = count as f64 * spacing_m;
    let window: Vec<f64> = (0..count)
        .map(|i| (std::f64::consts::PI * i as f64 / count as f64).sin().powi(2))
        .collect();
    let mean = values.iter().sum::<f64>() / count as f64;
    // The sum of the squared window is 3/8 of the count.
    let scale = 2.0 / (0.375 * (count * count) as f64);
    let bins = (low * length).ceil() as usize..(high * length).floor() as usize;
    let squares = bins.map(|k| {
        let (sin, cos) = (TAU * k as f64 / count as f64).sin_cos();
        let (mut re, mut im, mut s, mut c) = (0.0, 0.0, 0.0, 1.0);
        for (value, weight) in values.iter().zip(&window) {
            re += weight * (value - mean) * c;
            im += weight * (value - mean) * s;
            (s, c) = (s * cos + c * sin, c * cos - s * sin);
        }
        scale * (re * re + im * im)
    });
    squares.sum()
}

#[test]
fn a_long_generated_track_has_its_spectrum_in_every_octave_for_mean_and_difference_of_the_rails() {
    let stretch = Stretch {
        from_m: 0.0,
        to_m: 6000.0,
        spacing_m: 0.125,
        ..Stretch::default()
    };
    for spectrum in [Spectrum::Fra6, Spectrum::ErriLow] {
        let track = generate(spectrum, 3, &stretch).expect("a track");
        let rails = track.rails();
        let combined = |[left, right]: &[Vec<f64>; 2], weights: [f64; 2]| -> Vec<f64> {
            (left.iter().zip(right))
                .map(|(l, r)| weights[0] * l + weights[1] * r)
                // Every fourth point resolves waves over 1 m.
                .step_by(4)
                .collect()
        };
        for (quantity, values) in [
            (Quantity::Profile, combined(&rails.z_m, [0.5, 0.5])),
            (Quantity::Alignment, combined(&rails.y_m, [0.5, 0.5])),
            (Quantity::CrossLevel, combined(&rails.z_m, [1.0, -1.0])),
        ] {
            for longest in [80.0, 40.0, 20.0, 10.0, 5.0] {
                let band = [1.0 / longest, 2.0 / longest];
                let found = band_mean_square(&values, 0.5, band);
                let expected = mean_square(spectrum, quantity, [0.5 * longest, longest]);
                // Waves under 20 m lie two bins of the periodogram apart, so the octave's mean square is no chance but that
                // of the windows' edges; longer waves share bins and beat.
                let tolerance = if longest < 20.0 { 0.02 } else { 0.25 };
                assert!(
                    (found / expected - 1.0).abs() < tolerance,
                    "{spectrum:?} {quantity:?} {longest} m: {} within {tolerance}",
                    found / expected
                );
            }
        }
    }
}

#[test]
fn over_many_seeds_tracks_of_a_class_are_as_rough_as_its_spectrum() {
    // Of 200 squares of normal numbers the root mean square scatters by 5 %: three standard deviations.
    const SEEDS: u64 = 200;
    const TOLERANCE: f64 = 0.15;
    let (from, to) = (-120.0, 45.0);
    let stretch = Stretch {
        spacing_m: 0.125,
        vertical_only: true,
        ..Stretch::default()
    };
    // Classes 1 to 5 are class 6, scaled.
    for spectrum in [Spectrum::Fra6, Spectrum::ErriLow] {
        let waves_m = [spectrum.waves_m()[0], stretch.longest_m];
        // Mean square of the rise between two places, away from the faded ends.
        let expected = integral(waves_m, |s| {
            2.0 * (1.0 - (TAU * s * (to - from)).cos()) * spectrum.density(Quantity::Profile, s)
        });
        let squares = (0..SEEDS).map(|seed| {
            let track = generate(spectrum, seed, &stretch).expect("a track");
            (at(&track, Motion::Vertical, to).value - at(&track, Motion::Vertical, from).value).powi(2)
        });
        let found = squares.sum::<f64>() / SEEDS as f64;
        assert!(
            ((found / expected).sqrt() - 1.0).abs() < TOLERANCE,
            "{spectrum:?}: {} mm against {} mm",
            1e3 * found.sqrt(),
            1e3 * expected.sqrt()
        );
    }
}

#[test]
fn a_seed_makes_the_same_track_again_another_seed_another() {
    let stretch = Stretch::default();
    let make = |seed, stretch: &Stretch| generate(Spectrum::Fra4, seed, stretch).expect("a track");
    let first = make(1, &stretch);
    assert_eq!(first.rails(), make(1, &stretch).rails());
    assert_ne!(first.rails(), make(2, &stretch).rails());
    // With and without the other irregularities the profile is the same.
    let alike = make(
        1,
        &Stretch {
            vertical_only: true,
            ..stretch
        },
    );
    for x in [-130.0, -20.0, 3.0, 44.4] {
        let [with, without] = [&first, &alike].map(|track| at(track, Motion::Vertical, x).value);
        assert!((with - without).abs() < ROUNDING);
        assert_eq!(at(&alike, Motion::Roll, x), Irregularity::none());
        assert_eq!(at(&alike, Motion::Lateral, x), Irregularity::none());
    }
}

#[test]
fn a_generated_track_begins_and_ends_level() {
    for spectrum in SPECTRA {
        let track = generate(spectrum, 5, &Stretch::default()).expect("a track");
        for motion in MOTIONS {
            let usual = summary(&track, motion).curvature.value.abs();
            for x in [-140.0, 60.0] {
                let end = at(&track, motion, x);
                // Curvature at the ends: half a spacing's worth of the fade.
                assert!(
                    end.slope.abs() < ROUNDING && end.curvature.abs() < 0.02 * usual,
                    "{spectrum:?} {end:?}"
                );
            }
            assert_eq!(at(&track, motion, -140.0).value, 0.0);
        }
    }
}

#[test]
fn the_fade_bends_a_track_no_more_than_its_own_waves_do() {
    for seed in 0..20 {
        let track = generate(Spectrum::Fra6, seed, &Stretch::default()).expect("a track");
        let largest = |from: i32, to: i32| {
            (20 * from..20 * to)
                .map(|i| at(&track, Motion::Vertical, f64::from(i) / 20.0).curvature.abs())
                .fold(0.0, f64::max)
        };
        let (faded, own) = (largest(-140, -130).max(largest(50, 60)), largest(-130, 50));
        assert!(faded < 1.5 * own, "seed {seed}: {faded:e} against {own:e}");
    }
}

#[test]
fn what_is_written_is_read_again() {
    let folder = TempDir::new().expect("a folder");
    let path = folder.path().join("t.csv");
    for (vertical_only, header) in [
        (true, "x_m,z_irregularity_mm"),
        (false, "x_m,z_left_mm,z_right_mm,y_left_mm,y_right_mm"),
    ] {
        let stretch = Stretch {
            vertical_only,
            ..Stretch::default()
        };
        let made = generate(Spectrum::ErriLow, 8, &stretch).expect("a track");
        let text = table::text(made.rails());
        assert_eq!(text.lines().next(), Some(header));
        fs::write(&path, text).expect("writes");
        let read = read(&path).expect("reads");
        assert_eq!(read.rails().x_m.len(), 4001);
        assert_eq!(spacing_m(&read)[1], spacing_m(&read)[1].clamp(0.0499, 0.0501));
        for motion in MOTIONS {
            for i in -1400..600 {
                let x = f64::from(i) / 10.0;
                let [a, b] = [&made, &read].map(|track| at(track, motion, x));
                assert!((a.value - b.value).abs() < 1e-10 && (a.curvature - b.curvature).abs() < 1e-7);
            }
        }
    }
}

/// The sentence with which a table is refused, without its path.
fn refusal(text: &str) -> String {
    let folder = TempDir::new().expect("a folder");
    let path = folder.path().join("t.csv");
    fs::write(&path, text).expect("writes");
    let sentence = format!("{:#}", read(&path).expect_err(text));
    let beginning = format!("{}: ", path.display());
    sentence
        .strip_prefix(&beginning)
        .unwrap_or_else(|| panic!("{sentence} does not name its file first"))
        .to_owned()
}

#[test]
fn a_table_that_cannot_be_a_track_is_refused_with_a_sentence_that_says_what_to_mend() {
    let rows = |values: &str| format!("x_m,z_irregularity_mm\n{values}");
    let mut gap = String::from("x_m,z_irregularity_mm\n");
    for i in (0..100).chain(160..200) {
        gap += &format!("{},0.1\n", f64::from(i) * 0.05);
    }
    for (text, sentence) in [
        (
            gap,
            "line 102: the track has a gap from 4.95 m to 8 m, where points are usually 0.05 m apart; put in the points \
             that are missing, or take the part on one side of the gap",
        ),
        (
            rows("0,0\n1,0\n2,0\n1.5,0\n"),
            "line 5, column x_m: 1.5 m does not come after 2 m; sort the rows by place, one a place",
        ),
        (
            rows("0,0\n1,0\n1,0\n2,0\n"),
            "line 4, column x_m: 1 m does not come after 1 m; sort the rows by place, one a place",
        ),
        (
            rows("0,0\n1,0\n1.00001,0\n2,0\n"),
            "line 4, column x_m: 1.00001 m lies less than 0.0001 m behind 1 m; check the unit of the column",
        ),
        (
            rows("0,0\n1,high\n2,0\n3,0\n"),
            "line 3, column z_irregularity_mm: \"high\" is not a number",
        ),
        (
            rows("0,0\n1,\n2,0\n3,0\n"),
            "line 3, column z_irregularity_mm: \"\" is not a number",
        ),
        (
            rows("0,0\n1,nan\n2,0\n3,0\n"),
            "line 3, column z_irregularity_mm: nan is not a finite number; leave the row out instead",
        ),
        (
            rows("0,0\ninf,0\n2,0\n3,0\n"),
            "line 3, column x_m: inf is not a finite number; leave the row out instead",
        ),
        (
            rows("0,0\n1,-150\n2,0\n3,0\n"),
            "line 3, column z_irregularity_mm: -150 mm is more than 100 mm; check the unit of the column",
        ),
        (
            rows("0,0\n1e6,0\n2e6,0\n3e6,0\n"),
            "line 3, column x_m: 1e6 m is more than 100000 m; check the unit of the column",
        ),
        (rows("0,0\n1\n2,0\n3,0\n"), "line 3: 1 columns, but line 1 names 2"),
        (rows("0,0\n1,0\n2,0\n"), "3 points only; a track needs at least 4"),
        (rows("0,0\n"), "1 point only; a track needs at least 4"),
        (rows(""), "0 points only; a track needs at least 4"),
        (
            "0,0\n1,0\n2,0\n3,0\n4,0\n".to_owned(),
            "line 1: the first column must be \"x_m\", not \"0\"; the first line names the columns, with commas between them",
        ),
        (
            "x_m\n0\n".to_owned(),
            "line 1: there is no column \"z_irregularity_mm\", nor z_left_mm and z_right_mm for each rail",
        ),
        (
            "x_m,z_left_mm\n0,0\n".to_owned(),
            "line 1: there is a column \"z_left_mm\" but no \"z_right_mm\"; name both rails",
        ),
        (
            "x_m,z_irregularity_mm,y_right_mm\n0,0,0\n".to_owned(),
            "line 1: there is a column \"y_right_mm\" but no \"y_left_mm\"; name both rails",
        ),
        (
            "x_m,z_irregularity_mm,z_left_mm,z_right_mm\n0,0,0,0\n".to_owned(),
            "line 1: there are z_irregularity_mm and z_left_mm, z_right_mm at once; give both rails one height, or each \
             its own",
        ),
        (
            "x_m,z_irregularity_mm,z_irregularity_mm\n0,0,0\n".to_owned(),
            "line 1: column \"z_irregularity_mm\" is there twice",
        ),
        (
            "x_m,z_cm\n0,0\n".to_owned(),
            "line 1: column \"z_cm\" is none of a track; its columns are x_m, then z_irregularity_mm or z_left_mm and \
             z_right_mm, and y_left_mm and y_right_mm where the rails are not straight",
        ),
    ] {
        assert_eq!(refusal(&text), sentence);
    }
    let absent = Path::new("no such folder/t.csv");
    let sentence = format!("{:#}", read(absent).expect_err("absent"));
    assert!(sentence.starts_with("cannot read no such folder/t.csv"), "{sentence}");
}

#[test]
fn the_command_line_makes_tracks_and_shows_them() {
    let folder = TempDir::new().expect("a folder");
    let folder = folder.path();
    let succeeds = |arguments: &[&str]| {
        let output = host_sim(folder, arguments);
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        String::from_utf8(output.stdout).expect("UTF-8")
    };
    for spectrum in ["fra1", "fra6", "erri-low"] {
        let flags = ["--spectrum", spectrum, "--seed", "4", "-o", "t.csv"];
        let made = succeeds(&[&["track", "generate"], &flags[..]].concat());
        let shown = succeeds(&["track", "show", "t.csv", "--picture", "t.svg"]);
        assert!(made.starts_with("wrote t.csv: 4001 points, "), "{made}");
        for words in [
            "-140 m to 60 m from node 1",
            "4001, 0.05 m apart",
            "shortest wave        0.4 m",
            "mm rms",
            "largest slope",
            "curvature",
            "cross-level",
        ] {
            assert!(shown.contains(words), "no {words} in\n{shown}");
        }
        let picture = fs::read_to_string(folder.join("t.svg")).expect("a picture");
        assert!(picture.starts_with("<svg") && !picture.contains("NaN"));
    }
    let shown = succeeds(&["track", "show", track_a().to_str().expect("a path")]);
    assert!(shown.contains("vertical             0.667 mm rms"), "{shown}");
    assert!(shown.contains("cross-level          none"), "{shown}");
}

#[test]
fn bad_flags_end_with_code_two_one_sentence_and_nothing_written() {
    let folder = TempDir::new().expect("a folder");
    fs::write(folder.path().join("bad.csv"), "x_m,z_irregularity_mm\n0,0\n").expect("writes");
    let generate = |flags: &[&'static str]| -> Vec<&'static str> {
        [
            &["track", "generate", "--spectrum", "fra6", "--seed", "1", "-o", "t.csv"],
            flags,
        ]
        .concat()
    };
    for (arguments, words) in [
        (
            generate(&["--to-m", "-120"]),
            "--to-m -120 must lie at least 30 m after --from-m -140",
        ),
        (
            generate(&["--from-m", "nan"]),
            "--from-m must be within 100000 m of node 1, not NaN",
        ),
        (
            generate(&["--spacing-m", "0.5"]),
            "--spacing-m must be positive and at most 0.191 m",
        ),
        (generate(&["--spacing-m", "0"]), "--spacing-m must be positive"),
        (generate(&["--spacing-m", "1e-5"]), "take a larger --spacing-m"),
        (
            generate(&["--longest-m", "400"]),
            "--longest-m must be 6.1 to 304.8 m for this spectrum, not 400",
        ),
        (
            vec!["track", "show", "bad.csv"],
            "bad.csv: 1 point only; a track needs at least 4",
        ),
        (
            vec!["track", "show", "bad.csv", "--picture", "p.svg"],
            "bad.csv: 1 point only",
        ),
        (vec!["track", "show", "none.csv"], "cannot read none.csv"),
        (
            vec![
                "track",
                "generate",
                "--spectrum",
                "fra6",
                "--seed",
                "1",
                "-o",
                "no/t.csv",
            ],
            "its folder does not exist; create it first",
        ),
        (
            vec!["track", "generate", "--spectrum", "fra7", "--seed", "1", "-o", "t.csv"],
            "fra7",
        ),
    ] {
        let output = host_sim(folder.path(), &arguments);
        let sentence = String::from_utf8(output.stderr).expect("UTF-8");
        assert_eq!(output.status.code(), Some(2), "{arguments:?}: {sentence}");
        assert!(
            sentence.starts_with("error: ") && sentence.contains(words),
            "{sentence}"
        );
        assert_eq!(
            fs::read_dir(folder.path()).expect("a folder").count(),
            1,
            "{arguments:?}"
        );
    }
}
