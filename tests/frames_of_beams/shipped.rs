//! The bridges that ship: they build, and their first modes are those of the table.

use std::fmt::Write as _;
use std::time::Instant;

use host_sim::model::eigen::{frequency_hz, natural_modes};
use host_sim::model::{self, Structure, participation};

/// Modes in the table, those left out in which only members turn about their axes, %.
const MODES: usize = 10;
const MEMBERS_ONLY: f64 = 50.0;

/// Frequency and shares of kinetic energy along the track, across it, vertically and in turning members.
const TABLE: &str = "\
girder50    1     3.50 Hz  x   0  y   0  z 100  turning   0 %
girder50    2    14.00 Hz  x   0  y   0  z 100  turning   0 %
girder50    3    31.52 Hz  x   0  y   0  z 100  turning   0 %
girder50    4    56.09 Hz  x   0  y   0  z 100  turning   0 %
girder50    5    87.85 Hz  x   0  y   0  z 100  turning   0 %
girder50    6   127.00 Hz  x   0  y   0  z 100  turning   0 %
girder50    7   173.93 Hz  x   0  y   0  z 100  turning   0 %
girder50    8   229.16 Hz  x   0  y   0  z 100  turning   0 %
girder50    9   293.09 Hz  x   0  y   0  z 100  turning   0 %
girder50   10   388.47 Hz  x   0  y   0  z 100  turning   0 %
twospan     1     6.00 Hz  x   0  y   0  z 100  turning   0 %
twospan     2     9.37 Hz  x   0  y   0  z 100  turning   0 %
twospan     3    24.03 Hz  x   0  y   0  z 100  turning   0 %
twospan     4    30.44 Hz  x   0  y   0  z 100  turning   0 %
twospan     5    54.40 Hz  x   0  y   0  z 100  turning   0 %
twospan     6    64.02 Hz  x   0  y   0  z 100  turning   0 %
twospan     7    98.15 Hz  x   0  y   0  z 100  turning   0 %
twospan     8   111.09 Hz  x   0  y   0  z 100  turning   0 %
twospan     9   166.39 Hz  x   0  y   0  z 100  turning   0 %
twospan    10   184.39 Hz  x   0  y   0  z 100  turning   0 %
viaduct24   1     2.95 Hz  x   1  y  98  z   0  turning   0 %
viaduct24   2     2.98 Hz  x   6  y  93  z   0  turning   0 %
viaduct24   3     3.05 Hz  x   0  y  99  z   0  turning   0 %
viaduct24   4     3.11 Hz  x  13  y  86  z   0  turning   0 %
viaduct24   5     3.20 Hz  x  19  y  81  z   0  turning   0 %
viaduct24   6     3.24 Hz  x  25  y  74  z   0  turning   0 %
viaduct24   7     3.76 Hz  x  87  y  13  z   0  turning   0 %
viaduct24   8     4.87 Hz  x  92  y   8  z   0  turning   0 %
viaduct24   9     5.53 Hz  x  93  y   7  z   0  turning   0 %
viaduct24  10    14.24 Hz  x  22  y   1  z  74  turning   2 %
rdso45m     1     3.42 Hz  x   0  y  97  z   3  turning   0 %
rdso45m     2     5.47 Hz  x   7  y   0  z  93  turning   0 %
rdso45m     3     6.15 Hz  x   1  y  83  z  16  turning   0 %
rdso45m     4     7.77 Hz  x   2  y  95  z   2  turning   0 %
rdso45m    13    10.64 Hz  x  74  y   0  z  15  turning  10 %
rdso45m    28    12.11 Hz  x   2  y  95  z   2  turning   1 %
rdso45m    45    14.55 Hz  x  18  y   0  z  81  turning   0 %
rdso45m    46    14.72 Hz  x  17  y  43  z  38  turning   1 %
rdso45m    47    15.23 Hz  x  97  y   0  z   2  turning   1 %
rdso45m    48    15.27 Hz  x  97  y   0  z   2  turning   0 %";

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
        let mut listed = 0;
        for (k, &w2) in modes.omega_squared.iter().enumerate() {
            let shares = participation::shares(&structure, modes.shapes.column(k));
            let [x, y, z, turning] = shares.map(|share| 100.0 * share);
            if turning > MEMBERS_ONLY || listed == MODES {
                continue;
            }
            listed += 1;
            let _ = writeln!(
                table,
                "{name:<10} {:>2} {:>8.2} Hz  x {x:>3.0}  y {y:>3.0}  z {z:>3.0}  turning {turning:>3.0} %",
                k + 1,
                frequency_hz(w2)
            );
        }
    }
    println!("{table}");
    assert_eq!(table.trim(), TABLE.trim());
}
