//! Trains: the cars have the natural frequencies and weights that they should, and train files say what rolls or are refused
//! with a sentence that says what to mend.

use std::f64::consts::TAU;

use host_sim::train::{SpatialTrain, TrainName, file};
use nalgebra::{DMatrix, SymmetricEigen};
use spanwatch::train::{Car, stock};

/// Natural frequencies with the wheelsets held, Hz, ascending.
fn frequencies<const D: usize, const C: usize>(car: &Car<f64, D, C>) -> Vec<f64> {
    let matrix = DMatrix::from_fn(D, D, |r, c| {
        let stiffness: f64 = (car.all_springs()).map(|s| s.stiffness * s.lever[r] * s.lever[c]).sum();
        stiffness / (car.inertia[r] * car.inertia[c]).sqrt()
    });
    let mut hz: Vec<f64> = (SymmetricEigen::new(matrix).eigenvalues.iter())
        .map(|w2| w2.max(0.0).sqrt() / TAU)
        .collect();
    hz.sort_by(f64::total_cmp);
    hz
}

#[test]
fn the_car_in_space_has_the_natural_frequencies_of_an_independent_derivation() {
    const EXPECTED_HZ: [f64; 15] = [
        0.6634, 0.9305, 1.0731, 1.0735, 1.1363, 6.8354, 6.8354, 7.3537, 7.3715, 7.4252, 7.4252, 13.6321, 13.6323,
        27.1787, 27.1799,
    ];
    let found = frequencies(&stock::shinkansen::<f64>());
    println!("{found:.4?}");
    for (found, expected) in found.iter().zip(EXPECTED_HZ) {
        assert!((found - expected).abs() < 5e-5, "{found} {expected}");
    }
}

#[test]
fn on_straight_equal_rails_six_of_them_are_left() {
    let all = frequencies(&stock::shinkansen::<f64>());
    for hz in frequencies(&stock::shinkansen_vertical::<f64>()) {
        assert!(all.iter().any(|other| (other - hz).abs() < 1e-9), "{hz}");
    }
}

#[test]
fn the_inspection_car_has_its_declared_frequencies() {
    let found = frequencies(&stock::inspection::<f64, 2, 2>());
    for (found, expected) in found.iter().zip([1.1695, 1.1699]) {
        assert!((found - expected).abs() < 5e-5, "{found}");
    }
}

#[test]
fn rigid_motion_stretches_no_spring_inside_the_car() {
    // Body and bogies moved as one solid: shifted, or turned about the height of the lateral upper springs, which tells
    // every lever's sign. (The bogies' yaw is held by wheelsets that do not yaw.)
    let car = stock::shinkansen::<f64>();
    let [lx1, _] = stock::SHINKANSEN.half_base_m;
    let [lz1, lz2, _] = stock::SHINKANSEN.height_m;
    let shifted = |axis: usize| std::array::from_fn(|d| if d % 5 == axis { 1.0 } else { 0.0 });
    let rolled: [f64; 15] = std::array::from_fn(|d| [if d < 5 { -lz1 } else { lz2 }, 0.0, 1.0, 0.0, 0.0][d % 5]);
    let pitched: [f64; 15] = std::array::from_fn(|d| match d {
        3 | 8 | 13 => 1.0,
        6 => -lx1,
        11 => lx1,
        _ => 0.0,
    });
    for motion in [shifted(0), shifted(1), rolled, pitched] {
        for spring in &car.springs {
            let stretch: f64 = spring.lever.iter().zip(&motion).map(|(s, y)| s * y).sum();
            assert!(stretch.abs() < 1e-12, "{motion:?} {spring:?}");
        }
    }
}

#[test]
fn the_trains_that_ship_as_files_are_read() {
    let train: SpatialTrain = TrainName::parse("rdso-test")
        .expect("known")
        .train(None)
        .expect("a train");
    let axles: usize = train.cars.iter().map(|car| train.kinds[car.kind].contacts.len()).sum();
    let weight_n: f64 = train.cars.iter().map(|car| train.kinds[car.kind].weight_n()).sum();
    assert_eq!((train.cars.len(), axles), (7, 30));
    // Six axles of 191.295 kN and four of each wagon's load.
    let expected_kn = 6.0 * 191.295 + 4.0 * (199.192 + 199.388 + 199.339 + 199.388 + 199.315 + 199.168);
    assert!((weight_n / 1e3 - expected_kn).abs() < 1e-6);
    assert!((train.length_m() - (77.923 + 9.47)).abs() < 1e-9);
}

#[test]
fn a_mixed_train_keeps_what_each_car_says() {
    let train = file::parse(
        "name = \"mixed\"\n[kinds.loco]\naxles_m = [0.0, 2.0]\naxle_load_kn = [180.0, 190.0]\n\
         [kinds.coach]\nbody_weight_kn = 350.0\nbogie_distance_m = 15.0\nupper_spring_kn_per_m = [5000.0, 176.4, 500.0]\n\
         [[cars]]\nkind = \"loco\"\n[[cars]]\nkind = \"coach\"\nbehind_m = 10.0\n",
    )
    .expect("a train");
    let [loco, coach] = [0, 1].map(|i| &train.kinds[train.cars[i].kind]);
    assert_eq!(
        loco.contacts.iter().map(|c| c.load_n).collect::<Vec<_>>(),
        [180e3, 190e3]
    );
    assert_eq!(coach.length_m(), 17.5);
    assert!((coach.weight_n() - (350e3 + 2.0 * 25.9e3 + 4.0 * 8.8e3)).abs() < 1e-6);
    assert_eq!(train.length_m(), 27.5);
}

#[test]
fn train_files_with_mistakes_are_refused() {
    let axles = "[kinds.a]\naxles_m = [0.0, 2.0]\naxle_load_kn = 200.0\n";
    let one = "[[cars]]\nkind = \"a\"\n";
    for (text, sentence) in [
        (
            format!("name = \"x\"\ncars = []\n{axles}"),
            "a train has 1 to 16 [[cars]], not 0",
        ),
        (
            format!(
                "name = \"x\"\n{axles}{one}{}",
                "[[cars]]\nkind = \"a\"\nbehind_m = 9.0\n".repeat(16)
            ),
            "a train has 1 to 16 [[cars]], not 17",
        ),
        (
            format!("name = \"x\"\n{axles}[[cars]]\nkind = \"b\"\n"),
            "car 1 is of kind \"b\"; the kinds are: a",
        ),
        (
            format!("name = \"x\"\n{axles}{one}[[cars]]\nkind = \"a\"\nbehind_m = 1.5\n"),
            "car 2 begins 1.5 m behind the train's first axle, but the car before it ends at 2 m",
        ),
        (
            format!("name = \"x\"\n{axles}[[cars]]\nkind = \"a\"\nbehind_m = 3.0\n"),
            "its behind_m must be 0",
        ),
        (
            format!("name = \"x\"\n{}{one}", axles.replace("200.0", "-200.0")),
            "kind \"a\": axle_load_kn must be positive and at most 3000, not -200",
        ),
        (
            format!("name = \"x\"\n{}{one}", axles.replace("200.0", "[200.0]")),
            "1 to 12 axles_m and a load for each, not 2 and 1",
        ),
        (
            format!("name = \"x\"\n{}{one}", axles.replace("[0.0, 2.0]", "[2.0, 0.0]")),
            "axles_m must begin with 0 and ascend",
        ),
        (
            format!("name = \"x\"\n{axles}body_weight_kn = 3.0\n{one}"),
            "it is a row of forces: leave weights, springs and distances out",
        ),
        (
            format!("name = \"x\"\n[kinds.a]\nbogie_inertia_t_m2 = [1.0, 0.0, 1.0]\n{one}"),
            "kind \"a\": bogie_inertia_t_m2 must be three positive numbers, not 0",
        ),
        (
            format!("name = \"x\"\n{axles}wheels = 4\n{one}"),
            "line 5, column 1: unknown field `wheels`",
        ),
    ] {
        let error = format!("{:#}", file::parse(&text).expect_err(&text));
        println!("{error}");
        assert!(error.contains(sentence), "\"{error}\" should say \"{sentence}\"");
    }
}
