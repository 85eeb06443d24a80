//! A girder with rough rails, and what would have been learnt of them: the profile nearest to the true one. For the tests that need a
//! learnt track and not how it is learnt.

use std::path::{Path, PathBuf};

use host_sim::track;
use nalgebra::SMatrix;
use spanwatch::capacity::CHANNELS;
use spanwatch::track::learnt::{LearntTrack, UNLEARNT, Unexplained, speed_band};

use crate::{nearest_track, program};

/// Noise of a sensor, as a part of its RMS.
const NOISE: f32 = 0.05;

fn host_sim(arguments: &str, folder: &Path) {
    let words: Vec<&str> = arguments.split_whitespace().collect();
    let run = program::host_sim(folder, &words);
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
    let learnt = LearntTrack {
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
    nearest_track::blob(&track::read(rails).expect("a track"), learnt)
}
