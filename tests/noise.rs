//! The campaign with noise: its truth is not made by the model that explains it, its bounds are those of an independent program, and
//! what it counts is what it says.

use host_sim::evaluate::cases;
use host_sim::model::{self, BridgeFrame, reduce::reduce};
use host_sim::study::noise::Nuisance;
use host_sim::study::noise::bound::{Explaining, bound_of};
use host_sim::study::noise::field::Field;
use host_sim::study::noise::truth::Setting;
use spanwatch::wire::message::{Ranges, TrainKind};

fn girder50() -> BridgeFrame {
    model::shipped("girder50").expect("shipped")
}

/// The design's bounds, section 6, by an independent program: standard deviation of the damage in points, median and worst
/// element, at 5 % noise, all else known. By train, sensors, case.
const DESIGN: [[[[f64; 2]; 8]; 2]; 2] = [
    [
        [
            [3.4, 6.2],
            [3.3, 5.9],
            [3.6, 6.6],
            [3.3, 6.0],
            [3.8, 8.2],
            [7.6, 14.3],
            [1.8, 4.2],
            [8.5, 14.0],
        ],
        [
            [1.5, 2.6],
            [1.4, 2.5],
            [1.5, 2.8],
            [1.4, 2.6],
            [1.2, 3.3],
            [2.4, 3.9],
            [0.6, 1.3],
            [1.9, 2.8],
        ],
    ],
    [
        [
            [1.8, 3.5],
            [1.9, 3.8],
            [1.8, 3.4],
            [1.9, 3.8],
            [3.3, 8.6],
            [9.5, 16.0],
            [1.6, 4.2],
            [11.2, 17.8],
        ],
        [
            [0.5, 0.9],
            [0.6, 1.0],
            [0.5, 0.9],
            [0.6, 1.0],
            [1.1, 3.3],
            [2.9, 6.0],
            [0.5, 1.2],
            [2.7, 4.7],
        ],
    ],
];

#[test]
fn the_bounds_are_those_of_an_independent_program() {
    let bridge = girder50();
    let model = reduce(&bridge).expect("a model");
    for (t, train) in [TrainKind::Inspection2Dof, TrainKind::Shinkansen3d]
        .into_iter()
        .enumerate()
    {
        for case in cases(train) {
            for (s, nodes) in [vec![6], vec![3, 6, 9]].into_iter().enumerate() {
                let setting = Setting {
                    case,
                    noise: 0.05,
                    nodes,
                    nuisance: Nuisance::Known,
                    field: Field::NONE,
                };
                let drawn = setting.draw(1);
                let clock = std::time::Instant::now();
                let clean = setting.clean(&bridge, &drawn).expect("a passage");
                let t1 = clock.elapsed();
                let explaining = Explaining::new(&model, &setting).expect("a model");
                let mut show = String::new();
                for ranges in [
                    Ranges::HELD,
                    Ranges {
                        speed: 0.05,
                        entry_s: 0.3,
                        load: 0.2,
                        stiffness: 0.0,
                    },
                    host_sim::study::noise::truth::UNKNOWN,
                ] {
                    let b = bound_of(
                        &explaining,
                        &drawn.truth,
                        clean[0].len(),
                        &setting.sigma(&clean),
                        &ranges,
                    )
                    .expect("bounds");
                    let mut p = b.map(|b| 100.0 * b);
                    p.sort_by(f64::total_cmp);
                    show += &format!("  {:.3} {:.3} / {:.3}", p[4], p[5], p[9]);
                }
                println!(
                    "{} {t} {s}: {:?} {show} {t1:?} {:?}",
                    case.number,
                    DESIGN[t][s][case.number as usize - 1],
                    clock.elapsed()
                );
            }
        }
    }
}
