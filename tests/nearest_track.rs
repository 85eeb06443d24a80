//! What learning a track without an error would give: the profile nearest to the true one. For the tests that need a learnt track and not
//! how it is learnt.

use host_sim::calibrate::knots;
use host_sim::model::{self, reduce::reduce};
use host_sim::track::{Profile, prior::fit};
use spanwatch::track::blob::{TRACK_BLOB_BYTES, write};
use spanwatch::track::learnt::LearntTrack;
use spanwatch::track::profile;
use spanwatch::wire::fingerprint;

/// `track` over girder50 as a logger takes it; all but its profile is as `learnt` says.
pub fn blob(track: &Profile, learnt: LearntTrack) -> Vec<u8> {
    let bridge = reduce(&model::shipped("girder50").expect("ships")).expect("reduces");
    let knots = knots(bridge.path.length_m()).expect("knots");
    let coefficients: Vec<f32> = fit(track, &knots).into_iter().map(|c| c as f32).collect();
    let learnt = LearntTrack {
        profile: profile::Profile::new(knots.cast().expect("the same"), &coefficients),
        ..learnt
    };
    let crc = fingerprint(&model::to_blob(&bridge).expect("room"));
    let mut buffer = [0; TRACK_BLOB_BYTES];
    write(&learnt, &coefficients, crc, &mut buffer).expect("room").to_vec()
}
