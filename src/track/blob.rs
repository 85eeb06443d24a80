//! A learnt track as bytes: how it travels from the base station to the logger.
//!
//! ```text
//! "SWTP" | format version u8 | fingerprint of the bridge's blob u32 | postcard of Layout | CRC-32C of all before     little endian
//! ```
//!
//! What the spline is learnt and written as are its coefficients; knots and stretches follow. It belongs to one model of one bridge, and
//! is refused with any other.

use core::fmt;

use heapless::Vec;
use serde::{Deserialize, Serialize};

use super::learnt::{self, LearntTrack, TRIANGLE, Unexplained};
use super::profile::{Knots, STRETCHES, Stretch};
use crate::capacity::{CHANNELS, PROFILE_COEFFICIENTS};
use crate::wire::CRC32C;

/// Version of the layout; a reader accepts its own only.
pub const FORMAT_VERSION: u8 = 1;
/// Bytes of a track at most.
pub const TRACK_BLOB_BYTES: usize = 1024;
const MAGIC: [u8; 4] = *b"SWTP";
const HEAD_BYTES: usize = MAGIC.len() + 1 + 4;
const CRC_BYTES: usize = 4;
/// Largest believable coefficient, m: no rail is laid so badly.
const HIGHEST_M: f32 = 0.1;
/// Farthest believable knot, m from node 1.
const FARTHEST_M: f32 = 10_000.0;
/// Closest believable knots, m: wheels feel nothing shorter, and farther out `f32` tells none closer apart.
const CLOSEST_M: f32 = 0.01;
/// Largest scatter of a logarithm by which anything can be told.
const WIDEST: f32 = 10.0;
/// Believable stiffness and damping, as parts of the model's; more is another bridge.
const STIFFNESS: core::ops::RangeInclusive<f32> = 0.5..=2.0;
const DAMPING: core::ops::RangeInclusive<f32> = 0.05..=20.0;

/// Why a learnt track was refused.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum TrackError {
    /// Cut off, or bytes too many.
    Length,
    /// The first bytes are not those of a learnt track.
    NotATrack,
    /// Another version of the format.
    Version {
        /// The version found.
        found: u8,
    },
    /// It was learnt with another bridge, or another model of it.
    Bridge,
    /// The checksum does not fit: the bytes were changed.
    Checksum,
    /// The numbers are none of a track.
    Contents,
    /// The buffer for the blob is too small.
    NoRoom,
}

impl fmt::Display for TrackError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Length => f.write_str("the track is cut off or too long; copy or learn it again (host-sim calibrate)"),
            Self::NotATrack => f.write_str("this is not a learnt track; expected a file from host-sim calibrate"),
            Self::Version { found } => write!(
                f,
                "the track has format version {found}, this program reads version {FORMAT_VERSION}; learn it again with this \
                 version's host-sim"
            ),
            Self::Bridge => f.write_str(
                "the track was learnt with another bridge or another model of it; load that model, or learn the track with this one",
            ),
            Self::Checksum => f.write_str("the track's checksum is wrong: bytes were changed; copy or learn it again"),
            Self::Contents => f.write_str("the track is not believable; learn it again"),
            Self::NoRoom => f.write_str("the buffer is too small for the track"),
        }
    }
}

impl core::error::Error for TrackError {}

/// The fields in the order in which they are written.
#[derive(Serialize, Deserialize)]
struct Layout {
    stretches: Vec<Stretch<f32>, STRETCHES>,
    coefficients: Vec<f32, PROFILE_COEFFICIENTS>,
    stiffness: f32,
    damping: f32,
    spread: Vec<f32, TRIANGLE>,
    unexplained: [(f32, f32); CHANNELS],
    scatter: f32,
    passages: u16,
    speeds: [u64; 2],
}

/// Writes a track, whose profile has these `coefficients`, into `buffer` and returns the part of it that is used; `bridge` is the
/// [`fingerprint`](crate::wire::fingerprint) of the bridge's blob.
pub fn write<'b>(
    track: &LearntTrack,
    coefficients: &[f32],
    bridge: u32,
    buffer: &'b mut [u8],
) -> Result<&'b [u8], TrackError> {
    let layout = Layout {
        stretches: Vec::from_slice(track.profile.knots().stretches()).map_err(|_| TrackError::Contents)?,
        coefficients: Vec::from_slice(coefficients).map_err(|_| TrackError::Contents)?,
        stiffness: track.stiffness,
        damping: track.damping,
        spread: learnt::pack(&track.spread),
        unexplained: track.unexplained.map(|of| (of.floor, of.part)),
        scatter: track.scatter,
        passages: track.passages,
        speeds: track.speeds,
    };
    let (head, rest) = buffer.split_first_chunk_mut::<HEAD_BYTES>().ok_or(TrackError::NoRoom)?;
    let [m0, m1, m2, m3] = MAGIC;
    let [b0, b1, b2, b3] = bridge.to_le_bytes();
    *head = [m0, m1, m2, m3, FORMAT_VERSION, b0, b1, b2, b3];
    let body = postcard::to_slice(&layout, rest).map_err(|_| TrackError::NoRoom)?.len();
    let end = HEAD_BYTES + body;
    let crc = CRC32C
        .checksum(buffer.get(..end).ok_or(TrackError::NoRoom)?)
        .to_le_bytes();
    let tail = buffer.get_mut(end..end + CRC_BYTES).ok_or(TrackError::NoRoom)?;
    tail.copy_from_slice(&crc);
    buffer.get(..end + CRC_BYTES).ok_or(TrackError::NoRoom)
}

/// The fingerprint of the bridge's blob that a track says it was learnt with; none if these bytes do not begin as a track does.
pub fn bridge_of(bytes: &[u8]) -> Option<u32> {
    let (head, _) = bytes.split_first_chunk::<HEAD_BYTES>()?;
    let bridge = head.last_chunk().copied().map(u32::from_le_bytes);
    bridge.filter(|_| head.starts_with(&MAGIC))
}

// Not inlined: what is read must leave the stack.
/// Reads and checks what [`write()`] wrote for the same `bridge`, into its place. A track that is refused changes nothing there.
#[inline(never)]
pub fn read_into(bytes: &[u8], bridge: u32, track: &mut LearntTrack) -> Result<(), TrackError> {
    let (head, _) = bytes.split_first_chunk::<HEAD_BYTES>().ok_or(TrackError::Length)?;
    let [m0, m1, m2, m3, version, b0, b1, b2, b3] = *head;
    if [m0, m1, m2, m3] != MAGIC {
        return Err(TrackError::NotATrack);
    }
    if version != FORMAT_VERSION {
        return Err(TrackError::Version { found: version });
    }
    let (checked, crc) = bytes.split_last_chunk::<CRC_BYTES>().ok_or(TrackError::Length)?;
    if CRC32C.checksum(checked).to_le_bytes() != *crc {
        return Err(TrackError::Checksum);
    }
    if u32::from_le_bytes([b0, b1, b2, b3]) != bridge {
        return Err(TrackError::Bridge);
    }
    let body = checked.get(HEAD_BYTES..).ok_or(TrackError::Length)?;
    let (layout, rest) = postcard::take_from_bytes::<Layout>(body).map_err(|_| TrackError::Contents)?;
    if !rest.is_empty() {
        return Err(TrackError::Length);
    }
    let knots = Knots::new(&layout.stretches)
        .filter(|knots| is_believable(&layout, knots))
        .ok_or(TrackError::Contents)?;
    track.spread = learnt::unpack(&layout.spread).ok_or(TrackError::Contents)?;
    track.profile.set(knots, layout.coefficients.iter().copied());
    track.stiffness = layout.stiffness;
    track.damping = layout.damping;
    track.unexplained = layout.unexplained.map(|(floor, part)| Unexplained { floor, part });
    track.scatter = layout.scatter;
    track.passages = layout.passages;
    track.speeds = layout.speeds;
    Ok(())
}

fn is_believable(layout: &Layout, knots: &Knots<f32>) -> bool {
    let near = |x_m: f32| x_m.abs() <= FARTHEST_M;
    let makes_sense = |&(floor, part): &(f32, f32)| floor >= 0.0 && floor.is_finite() && (0.0..1.0).contains(&part);
    let known = |&(floor, part): &(f32, f32)| floor > 0.0 || part > 0.0;
    layout.coefficients.len() == knots.coefficients()
        && knots.extent_m().is_some_and(|[first, last]| near(first) && near(last))
        && layout.stretches.iter().all(|stretch| stretch.spacing_m >= CLOSEST_M)
        && layout.coefficients.iter().all(|height| height.abs() <= HIGHEST_M)
        && STIFFNESS.contains(&layout.stiffness)
        && DAMPING.contains(&layout.damping)
        && layout.unexplained.iter().all(makes_sense)
        && layout.unexplained.iter().any(known)
        && layout.scatter > 0.0
        && layout.scatter <= WIDEST
        && layout.passages > 1
        && layout.speeds != [0; 2]
}
