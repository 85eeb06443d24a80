//! The figures on the pages under docs/ are what the commands give, and choices in the code follow from them.

use std::fs;
use std::path::Path;
use std::process::Command;

use host_sim::model::frame::constraint::combine;
use host_sim::model::influence::{InfluenceLine, wheels};
use host_sim::prediction::{low_passed, rdso45m, viaduct24};
use host_sim::study::accuracy::{self, CASES, SCHEMES, STEPS};
use host_sim::study::{node_maxima, precision};
use host_sim::validate::compare::rms;
use host_sim::{model, model::Structure};
use nalgebra::{DMatrix, DVector};
use spanwatch::interaction::simulation::LONGEST_STEP_S;

/// Two digits on a page are within 5 % of a number; a little more for the coarser converged solution of the test.
const TWO_DIGITS: f64 = 0.06;

fn page(name: &str) -> String {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../docs").join(name);
    fs::read_to_string(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display()))
}

/// Cells of all rows of a page's tables whose first cells are these.
fn rows(page: &str, first: &[&str]) -> Vec<Vec<String>> {
    (page.lines())
        .filter_map(|line| line.trim().strip_prefix('|')?.strip_suffix('|'))
        .map(|line| line.split('|').map(|cell| cell.trim().to_owned()).collect::<Vec<_>>())
        .filter(|cells| cells.len() >= first.len() && first.iter().zip(cells).all(|(a, b)| a == b))
        .collect()
}

fn row(page: &str, first: &[&str]) -> Vec<String> {
    rows(page, first)
        .into_iter()
        .next()
        .unwrap_or_else(|| panic!("no row {first:?}"))
}

fn number(cell: &str) -> f64 {
    cell.parse().unwrap_or_else(|_| panic!("{cell:?} is no number"))
}

#[track_caller]
fn close(found: f64, on_page: f64, part: f64, what: &str) {
    assert!(
        (found - on_page).abs() <= part * on_page.abs(),
        "{what}: {found}, on the page {on_page}"
    );
}

#[test]
fn the_default_step_is_the_one_that_keeps_a_thousandth_in_every_case() {
    /// Steps a sample of the converged solution: 0.1 ms, four times less work than the page's.
    const CONVERGED: u32 = 50;
    /// Steps that are looked at, 5 to 0.5 ms, and those beside which that solution is exact to the page's two digits.
    const COMPARED: usize = 6;
    const TOLD: usize = 5;
    let page = page("accuracy.md");
    let bridge = Structure::new(model::shipped("girder50").expect("shipped")).expect("stands");
    // Worst over the cases, by scheme and step.
    let mut worst = [[0.0_f64; COMPARED]; SCHEMES.len()];
    for case in CASES {
        let comparison = accuracy::compare(&bridge, &case, CONVERGED).expect("a comparison");
        for (k, found) in comparison.rows.iter().enumerate() {
            let cells = row(&page, &[case.name, SCHEMES[k].1]);
            for i in 0..COMPARED {
                let what = format!("{} {} {} steps a sample", case.name, SCHEMES[k].1, STEPS[i]);
                match found.errors[i] {
                    Some(_) if i >= TOLD => (),
                    Some(error) => close(100.0 * error, number(&cells[2 + i]), TWO_DIGITS, &what),
                    None => assert_eq!(cells[2 + i], "explodes", "{what}"),
                }
                worst[k][i] = worst[k][i].max(found.errors[i].unwrap_or(f64::INFINITY));
            }
        }
        // The train that the choice was asked for is content with 5 ms.
        let exact = comparison.rows.last().expect("the exact scheme").errors;
        assert!(case != CASES[0] || exact[0].expect("an error") < 0.01);
    }
    let [newmark, fox_goodwin, exact] = worst;
    let default = STEPS
        .iter()
        .position(|&steps| (accuracy::step_s(steps) - LONGEST_STEP_S).abs() < 1e-12);
    assert_eq!(default, Some(1));
    assert!(exact[0] > 0.01 && exact[1] < 0.001, "{exact:?}");
    assert!(newmark[4] > 0.01 && newmark[5] < 0.01, "{newmark:?}");
    assert!(fox_goodwin[1].is_infinite(), "{fox_goodwin:?}");
}

#[test]
fn single_precision_differs_by_less_than_a_ten_thousandth_or_the_noise_of_rounding() {
    let page = page("accuracy.md");
    for found in precision::rows().expect("all cases") {
        row(&page, &[found.bridge, found.train, &found.cars.to_string()]);
        for difference in found.differences.iter().flatten() {
            assert!(difference.is_small(), "{found:?}");
        }
    }
}

#[test]
fn table_4_of_the_page_is_what_the_model_gives() {
    let page = page("table4.md");
    let found = node_maxima::solve().expect("all passages");
    close(found.first_hz[0], 3.500, 1e-4, "before");
    close(found.first_hz[1], 3.363, 1e-4, "after");
    let shown = &found.rough[(node_maxima::SEED - 1) as usize];
    for node in 0..11 {
        let cells = row(&page, &[&(node + 1).to_string()]);
        for (maxima, cell) in [(shown, &cells[2]), (&found.smooth, &cells[3])] {
            let on_page: Vec<f64> = cell.split(" > ").map(number).collect();
            for (state, &on_page) in on_page.iter().enumerate() {
                // Written with one decimal.
                assert!(
                    (maxima[state][node] - on_page).abs() < 0.06,
                    "node {}: {cell}",
                    node + 1
                );
            }
        }
    }
}

/// Deflection of L4, m, of a plane truss of pin-jointed bars with the areas of rdso45m, half of each axle on it; wheels
/// between two joints load both as on a simple beam.
fn pin_jointed(truss: &rdso45m::Truss, front_m: f64) -> f64 {
    const PANEL_M: f64 = 5.905;
    const HEIGHT_M: f64 = 7.315;
    // Joints L0 to L8, then U1 to U7.
    let place = |joint: usize| match joint {
        0..=8 => (PANEL_M * joint as f64, 0.0),
        _ => (PANEL_M * (joint - 8) as f64, HEIGHT_M),
    };
    let upper = |i: usize| 8 + i;
    let mut bars = Vec::new();
    for i in 0..8 {
        bars.push((i, i + 1, if (2..6).contains(&i) { 0.0259569 } else { 0.0159569 }));
    }
    for i in 1..7 {
        bars.push((
            upper(i),
            upper(i + 1),
            if (3..5).contains(&i) { 0.0202769 } else { 0.0164833 },
        ));
    }
    for i in 1..8 {
        bars.push((i, upper(i), 0.0088));
    }
    for (lower, top, area) in [
        (0, 1, 0.0231169),
        (8, 7, 0.0231169),
        (2, 1, 0.0127569),
        (6, 7, 0.0127569),
        (2, 3, 0.0092583),
        (4, 3, 0.0092583),
        (4, 5, 0.0092583),
        (6, 5, 0.0092583),
    ] {
        bars.push((lower, upper(top), area));
    }
    let mut stiffness = DMatrix::<f64>::zeros(32, 32);
    for (a, b, area) in bars {
        let ((xa, za), (xb, zb)) = (place(a), place(b));
        let length = (xb - xa).hypot(zb - za);
        let (c, s) = ((xb - xa) / length, (zb - za) / length);
        let row = [(2 * a, -c), (2 * a + 1, -s), (2 * b, c), (2 * b + 1, s)];
        for (i, x) in row {
            for (j, y) in row {
                stiffness[(i, j)] += 2.0e11 * area / length * x * y;
            }
        }
    }
    let mut load = DVector::zeros(32);
    for (behind_m, load_n) in wheels(&truss.train) {
        let place = (front_m - behind_m) / PANEL_M;
        if (0.0..8.0).contains(&place) {
            let (panel, part) = (place.floor() as usize, place.fract());
            load[2 * panel + 1] -= 0.5 * load_n * (1.0 - part);
            load[2 * panel + 3] -= 0.5 * load_n * part;
        }
    }
    for held in [1, 2 * 8, 2 * 8 + 1] {
        stiffness[(held, held)] += 1e16;
    }
    let bent = stiffness.lu().solve(&load).expect("a truss that stands");
    bent[2 * 4 + 1]
}

#[test]
fn the_standing_train_bends_the_truss_as_pin_jointed_bars_and_the_method_of_sections_say() {
    let truss = rdso45m::Truss::new().expect("bridge and train");
    let line = InfluenceLine::exact(&truss.structure, &truss.sensors().expect("L4")[0].row).expect("a line");
    let standing = truss.standing(&line);
    let pinned_mm = 1e3 * pin_jointed(&truss, standing.at);
    println!("model {:.3} mm, pin-jointed {pinned_mm:.3} mm", standing.deflection_mm);
    // Riveted joints and the floor, which the chords take along, make it stiffer, by some per cent.
    let ratio = standing.deflection_mm / pinned_mm;
    assert!((0.85..1.0).contains(&ratio), "{ratio}");

    // The top chords' force times the height is the moment about L4, up to what bends in chords and stringers.
    let nodes = &truss.structure.bridge.frame.nodes;
    let rows = &truss.structure.matrices.rows;
    let along = |name: &str| &rows[nodes.iter().position(|node| node.name == name).expect("a joint")][0];
    let force_n: f64 = (["R", "L"].into_iter())
        .map(|side| {
            let (u3, u4) = (along(&format!("{side}.U3")), along(&format!("{side}.U4")));
            let longer = InfluenceLine::exact(&truss.structure, &combine([(1.0, u4), (-1.0, u3)])).expect("a line");
            2.0e11 * 0.0202769 / 5.905 * longer.under(&truss.train, standing.at + rdso45m::APPROACH_M)
        })
        .sum();
    let (span_m, middle_m) = (47.24, 23.62);
    let moment_nm: f64 = wheels(&truss.train)
        .map(|(behind_m, load_n)| (standing.at - behind_m, load_n))
        .filter(|(x, _)| (0.0..span_m).contains(x))
        .map(|(x, load_n)| load_n * (x * (1.0 - middle_m / span_m) - (x - middle_m).max(0.0)))
        .sum();
    println!(
        "top chords {:.0} kN, M / h {:.0} kN",
        1e-3 * force_n,
        1e-3 * moment_nm / 7.315
    );
    let carried = -force_n * 7.315 / moment_nm;
    assert!((0.90..1.0).contains(&carried), "{carried}");
}

#[test]
fn a_slow_train_bends_the_truss_as_a_standing_one() {
    let truss = rdso45m::Truss::new().expect("bridge and train");
    let model = truss.modes(20.0).expect("modes");
    let standing = truss.standing(&InfluenceLine::modal(&model, rdso45m::rows(&model).expect("L4")[0]));
    let slow = truss.pass(&model, 5.0).expect("a passage").joints[0].peak();
    // What the axles' entering still shakes.
    close(slow.deflection_mm, standing.deflection_mm, 1e-3, "5 km/h");
    let on_page = row(&page("rdso45m.md"), &["20"]);
    close(standing.deflection_mm, number(&on_page[2]), 1e-4, "standing");
    let passing = truss.pass(&model, 70.0).expect("a passage").joints[0].peak();
    close(passing.deflection_mm, number(&on_page[3]), 1e-4, "70 km/h");
}

#[test]
fn the_prediction_of_the_truss_that_ships_is_what_the_command_writes() {
    /// mm and m/s²; values are written with four decimals, and modes near each other may be mixed by rounding.
    const DECIMALS: f64 = 2e-3;
    let truss = rdso45m::Truss::new().expect("bridge and train");
    let model = truss.modes(rdso45m::UP_TO_HZ).expect("modes");
    let written = rdso45m::csv(&truss.pass(&model, 70.0).expect("a passage"));
    let shipped = page("predictions/rdso45m-70kmh.csv");
    assert_eq!(written.lines().count(), shipped.lines().count());
    assert_eq!(written.lines().next(), shipped.lines().next());
    for (found, shipped) in written.lines().zip(shipped.lines()).skip(1) {
        for (a, b) in found.split(',').zip(shipped.split(',')) {
            assert!((number(a) - number(b)).abs() < DECIMALS, "{found}\n{shipped}");
        }
    }
}

#[test]
fn the_viaduct_moves_as_the_page_says() {
    const LIMIT_HZ: f64 = 45.0;
    /// Longer steps than the page's, so that the test is short; they cost the band up to 40 Hz less than this.
    const STEP_S: f64 = 2.5e-3;
    const PART: f64 = 0.03;
    let viaduct = viaduct24::Viaduct::new().expect("bridge and train");
    let model = viaduct.modes(LIMIT_HZ).expect("modes");
    let track = viaduct.track(viaduct24::SEED).expect("a track");
    let found = viaduct.pass(&model, &track, STEP_S).expect("a passage");
    let on_page = row(&page("viaduct24.md"), &["45"]);
    for (k, signal) in found.iter().enumerate() {
        let below_40_hz = on_page[2 + k].split(" / ").next().expect("two bands");
        close(
            rms(&low_passed(signal, viaduct24::BANDS_HZ[0], STEP_S)),
            number(below_40_hz),
            PART,
            viaduct24::SENSORS[k].1,
        );
    }
}

#[test]
fn a_folder_that_is_not_there_is_refused_before_any_work_and_nothing_is_written() {
    let folder = tempfile::tempdir().expect("a folder");
    for arguments in [
        ["evaluate", "accuracy", "--out", "missing"],
        ["predict", "rdso45m", "--out", "missing"],
        ["predict", "viaduct24", "--out", "missing"],
    ] {
        let output = Command::new(env!("CARGO_BIN_EXE_host-sim"))
            .current_dir(&folder)
            .args(arguments)
            .output()
            .expect("host-sim runs");
        let error = String::from_utf8(output.stderr).expect("text");
        assert_eq!(output.status.code(), Some(2), "{error}");
        assert!(error.contains("folder does not exist"), "{error}");
        assert!(output.stdout.is_empty());
        assert_eq!(fs::read_dir(&folder).expect("a folder").count(), 0);
    }
}

#[test]
fn a_campaign_over_tracks_that_cannot_be_is_refused_in_one_sentence_that_names_the_flag() {
    for (arguments, flag) in [
        (["--class", "7"], "--class"),
        (["--sensors", "3,5"], "--sensors"),
        (["--tracks", "0"], "--tracks"),
        (["--passages", "0"], "--passages"),
        (["--healthy", "4"], "--healthy"),
        (["--temperature", "0.5"], "--temperature"),
        (["--wear", "0.5"], "--wear"),
    ] {
        let output = Command::new(env!("CARGO_BIN_EXE_host-sim"))
            .args(["evaluate", "track"])
            .args(arguments)
            .output()
            .expect("host-sim runs");
        let error = String::from_utf8(output.stderr).expect("text");
        assert_eq!(output.status.code(), Some(2), "{error}");
        assert!(error.contains(flag) && error.trim().lines().count() == 1, "{error}");
        assert!(output.stdout.is_empty());
    }
}
