//! A girder with rough rails, and what would have been learnt of them: the profile nearest to the true one. For the tests that need a
//! learnt track and not how it is learnt.

use std::path::{Path, PathBuf};
use std::process::Command;

use host_sim::calibrate::knots;
use host_sim::model;
use host_sim::model::reduce::reduce;
use host_sim::track;
use host_sim::track::prior::fit;
use nalgebra::SMatrix;
use spanwatch::capacity::CHANNELS;
use spanwatch::track::blob::{TRACK_BLOB_BYTES, write};
use spanwatch::track::learnt::{LearntTrack, UNLEARNT, Unexplained, speed_band};
use spanwatch::track::profile::{Knots, Profile, Stretch};
use spanwatch::wire::fingerprint;

/// Noise of a sensor, as a part of its RMS.
const NOISE: f32 = 0.05;

fn host_sim(arguments: &str, folder: &Path) {
    let run = Command::new(env!("CARGO_BIN_EXE_host-sim"))
        .current_dir(folder)
        .args(arguments.split_whitespace())
        .output()
        .expect("host-sim runs");
    assert!(run.status.success(), "{}", String::from_utf8_lossy(&run.stderr));
}

/// Makes rails by chance, of the best standard class.
pub fn lay(folder: &Path, name: &str, seed: u32) -> PathBuf {
    host_sim(
        &format!("track generate --spectrum fra6 --vertical-only --seed {seed} -o {name}.csv"),
        folder,
    );
    folder.join(format!("{name}.csv"))
}

/// Records an inspection car on rails of [`lay`], by three noisy sensors.
pub fn record(folder: &Path, name: &str, rails: &Path, flags: &str) -> PathBuf {
    host_sim(
        &format!(
            "simulate --bridge girder50 --train inspection-2dof --cars 1 --nodes 3,6,9 --rate-hz 200 --antialias-hz 40 \
             --noise {NOISE} --lead-s 4 --tail-s 8 --track {} {flags} -o {name}.csv",
            rails.display()
        ),
        folder,
    );
    folder.join(format!("{name}.csv"))
}

/// What would have been learnt of these rails from sixty passages at this speed, as the logger takes it.
pub fn learn(rails: &Path, speed_kmh: f32) -> Vec<u8> {
    let bridge = reduce(&model::shipped("girder50").expect("shipped")).expect("reduces");
    let rails = track::read(rails).expect("a track");
    let knots = knots(bridge.path.length_m()).expect("knots");
    let coefficients: Vec<f32> = fit(&rails, &knots).into_iter().map(|c| c as f32).collect();
    let stretches: Vec<Stretch<f32>> = (knots.stretches().iter())
        .map(|s| Stretch {
            from_m: s.from_m as f32,
            spacing_m: s.spacing_m as f32,
            spans: s.spans,
        })
        .collect();
    let knots = Knots::new(&stretches).expect("the same");
    let learnt = LearntTrack {
        profile: Profile::new(knots, &coefficients),
        spread: SMatrix::identity() * 0.005,
        unexplained: [Unexplained {
            floor: 0.0,
            part: NOISE * NOISE,
        }; CHANNELS],
        scatter: 0.1,
        passages: 60,
        speeds: [1 << speed_band(speed_kmh / 3.6), 0],
        ..UNLEARNT.clone()
    };
    let crc = fingerprint(&model::to_blob(&bridge).expect("room"));
    let mut buffer = [0; TRACK_BLOB_BYTES];
    write(&learnt, &coefficients, crc, &mut buffer).expect("room").to_vec()
}
