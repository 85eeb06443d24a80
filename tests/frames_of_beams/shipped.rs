//! The bridges that ship: they build, and their first modes are those of the table.

use std::fmt::Write as _;
use std::time::Instant;

use host_sim::model::condensation::Condensed;
use host_sim::model::eigen::{frequency_hz, natural_modes};
use host_sim::model::{self, Structure, participation};

/// Modes in the table.
const MODES: usize = 12;

#[test]
fn first_modes_of_every_bridge_are_those_of_the_table() {
    let mut table = String::new();
    for name in ["girder50", "twospan", "viaduct24", "rdso45m"] {
        let start = Instant::now();
        let structure = Structure::new(model::shipped(name).expect("shipped")).expect("stands");
        let built = start.elapsed();
        let modes = natural_modes(&structure.stiffness(&[]), structure.mass()).expect("positive");
        println!(
            "{name}: {} degrees of freedom, {:.0} kg, built in {built:.2?}, modes in {:.2?}",
            structure.matrices.freedoms(),
            structure.matrices.node_kg.iter().sum::<f64>(),
            start.elapsed() - built
        );
        let errors = (!structure.bridge.masters.is_empty()).then(|| {
            Condensed::new(&structure)
                .and_then(|c| c.errors(&modes.omega_squared))
                .expect("condenses")
        });
        for (k, w2) in modes.omega_squared.iter().take(MODES).enumerate() {
            let [x, y, z] = participation::shares(&structure, modes.shapes.column(k)).map(|share| 100.0 * share);
            let _ = writeln!(
                table,
                "{name:<10} {:>2} {:>9.3} Hz  x {x:>3.0}  y {y:>3.0}  z {z:>3.0} %",
                k + 1,
                frequency_hz(*w2)
            );
            if let Some(errors) = &errors {
                println!("  condensed: mode {} {:+.2} %", k + 1, 100.0 * errors[k]);
            }
        }
    }
    print!("{table}");
}
