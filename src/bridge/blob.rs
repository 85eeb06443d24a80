//! The bridge model as bytes: how it travels from the PC to the logger.
//!
//! ```text
//! "SWBM" | format version u8 | postcard of Layout, f32 | CRC-32C of all before, little endian
//! ```
//!
//! A reader refuses what it cannot trust, with a reason: other bytes, another version, a flipped bit, a cut end, and
//! values that no bridge has.

use core::fmt;

use heapless::{String, Vec};
use nalgebra::{SMatrix, SVector};
use serde::{Deserialize, Serialize};

use super::{Path, ReducedBridge};
use crate::capacity::{BASIS, ELEMENTS, FACTORS, PATH_NODES, SENSOR_PLACES};
use crate::wire::CRC32C;

/// Version of the layout; a reader accepts its own only.
pub const FORMAT_VERSION: u8 = 1;
const MAGIC: &[u8; 4] = b"SWBM";
const CRC_BYTES: usize = 4;
/// `sum_e S_e` may differ from the identity by this much: rounding to `f32` leaves about 1e-6.
const COMPLETENESS_TOLERANCE: f32 = 1e-3;
/// Lowest and highest believable natural frequency of a basis vector, Hz.
const FREQUENCY_RANGE_HZ: [f32; 2] = [0.01, 1e6];
/// Largest believable displacement (kg^-1/2) and slope (kg^-1/2/m) of a mass-normalised shape: those of a point that moves
/// with a kilogram, and ten radians for each metre of it.
const MAX_SHAPE: [f32; 2] = [1.0, 10.0];
/// Longest believable path, m.
const MAX_LENGTH_M: f32 = 10_000.0;

/// A value that no bridge has.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Absurdity {
    /// A shape is not finite, or moves more than a kilogram could.
    Shape,
    /// A natural frequency lies outside 0.01 Hz to 1 MHz.
    Frequency,
    /// The natural frequencies do not ascend.
    Order,
    /// The damping is negative, or keeps the first mode from swinging.
    Damping,
    /// Stiffness of an element that does not exist.
    Element,
    /// The path is empty, longer than 10 km or does not begin at node 1.
    Path,
    /// The path's nodes do not ascend.
    PathOrder,
    /// There is no place for a sensor.
    Sensors,
    /// The elements' stiffnesses do not add up to the bridge's.
    Stiffness,
}

impl fmt::Display for Absurdity {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Shape => "a mode shape is not finite or moves more than a kilogram could",
            Self::Frequency => "a natural frequency lies outside 0.01 Hz to 1 MHz",
            Self::Order => "the natural frequencies do not ascend",
            Self::Damping => "the damping is negative or keeps the first mode from swinging",
            Self::Element => "it has stiffness for an element that does not exist",
            Self::Path => "the path is empty, longer than 10 km or does not begin at node 1",
            Self::PathOrder => "the nodes of the path do not ascend",
            Self::Sensors => "it has no place for a sensor",
            Self::Stiffness => "the elements' stiffnesses do not add up to the bridge's",
        })
    }
}

/// Why a blob was refused.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum BlobError {
    /// Too short, or cut off.
    Truncated,
    /// The first bytes are not those of a bridge model.
    NotAModel,
    /// Another version of the format.
    Version {
        /// The version found.
        found: u8,
    },
    /// The checksum does not fit: the bytes were changed.
    Checksum,
    /// The bytes do not hold the fields of a model.
    Malformed,
    /// The model is larger than this logger's memory for it (`capacity.rs`).
    TooLarge,
    /// A value that no bridge has.
    Absurd(Absurdity),
    /// The buffer for the blob is too small.
    NoRoom,
}

impl fmt::Display for BlobError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Truncated => f.write_str("the bridge model is cut off; build it again (host-sim model build)"),
            Self::NotAModel => f.write_str("this is not a bridge model; expected a file from host-sim model build"),
            Self::Version { found } => write!(
                f,
                "the bridge model has format version {found}, this program reads version {FORMAT_VERSION}; \
                 build the model again with this version's host-sim"
            ),
            Self::Checksum => {
                f.write_str("the bridge model's checksum is wrong: bytes were changed; copy or build it again")
            }
            Self::Malformed => f.write_str("the bridge model does not hold the fields it should; build it again"),
            Self::TooLarge => {
                f.write_str("the bridge model is larger than the logger's memory for it (src/capacity.rs)")
            }
            Self::Absurd(what) => write!(f, "the bridge model is not believable: {what}"),
            Self::NoRoom => f.write_str("the buffer is too small for the bridge model"),
        }
    }
}

impl core::error::Error for BlobError {}

type Vector = Vec<f32, BASIS>;

/// The fields in the order in which they are written. Vectors have as many entries as the basis.
#[derive(Serialize, Deserialize)]
struct Layout {
    name: String<24>,
    rayleigh: [f32; 2],
    lambda: Vector,
    elements: u8,
    factors: Vec<(u8, Vector), FACTORS>,
    path: Vec<(f32, Vector, Vector), PATH_NODES>,
    sensors: Vec<(u16, Vector), SENSOR_PLACES>,
}

/// Writes `bridge` into `buffer` and returns the part of it that is used.
pub fn write<'b>(bridge: &ReducedBridge<f32>, buffer: &'b mut [u8]) -> Result<&'b [u8], BlobError> {
    let n = bridge.basis.min(BASIS);
    let vector = |values: &[f32]| values.iter().take(n).copied().collect::<Vector>();
    let path = &bridge.path;
    let layout = Layout {
        name: bridge.name.clone(),
        rayleigh: bridge.rayleigh,
        lambda: vector(bridge.lambda.as_slice()),
        elements: bridge.elements as u8,
        factors: bridge
            .factor_element
            .iter()
            .zip(bridge.factors.column_iter())
            .take(bridge.factor_count)
            .map(|(&element, column)| (element, vector(column.as_slice())))
            .collect(),
        path: path
            .position_m
            .iter()
            .zip(path.displacement.column_iter().zip(path.slope.column_iter()))
            .take(path.nodes)
            .map(|(&x, (displacement, slope))| (x, vector(displacement.as_slice()), vector(slope.as_slice())))
            .collect(),
        sensors: bridge
            .sensor_node
            .iter()
            .zip(bridge.sensors.column_iter())
            .take(bridge.sensor_count)
            .map(|(&node, column)| (node, vector(column.as_slice())))
            .collect(),
    };
    let head = MAGIC.len() + 1;
    let (start, rest) = buffer.split_at_mut_checked(head).ok_or(BlobError::NoRoom)?;
    start[..MAGIC.len()].copy_from_slice(MAGIC);
    start[MAGIC.len()] = FORMAT_VERSION;
    let body = postcard::to_slice(&layout, rest).map_err(|_| BlobError::NoRoom)?.len();
    let crc = CRC32C.checksum(&buffer[..head + body]).to_le_bytes();
    let end = head + body + CRC_BYTES;
    buffer
        .get_mut(head + body..end)
        .ok_or(BlobError::NoRoom)?
        .copy_from_slice(&crc);
    Ok(&buffer[..end])
}

/// Reads and checks a model.
pub fn read(bytes: &[u8]) -> Result<ReducedBridge<f32>, BlobError> {
    let magic = bytes.get(..MAGIC.len()).ok_or(BlobError::Truncated)?;
    if magic != MAGIC {
        return Err(BlobError::NotAModel);
    }
    let found = *bytes.get(MAGIC.len()).ok_or(BlobError::Truncated)?;
    if found != FORMAT_VERSION {
        return Err(BlobError::Version { found });
    }
    let (checked, crc) = bytes.split_last_chunk::<CRC_BYTES>().ok_or(BlobError::Truncated)?;
    if CRC32C.checksum(checked).to_le_bytes() != *crc {
        return Err(BlobError::Checksum);
    }
    let body = checked.get(MAGIC.len() + 1..).ok_or(BlobError::Truncated)?;
    let (layout, rest) = postcard::take_from_bytes::<Layout>(body).map_err(|_| BlobError::Malformed)?;
    if !rest.is_empty() {
        return Err(BlobError::Malformed);
    }
    believe(&layout)?;
    Ok(unpack(&layout))
}

/// Refuses values that no bridge has.
fn believe(layout: &Layout) -> Result<(), BlobError> {
    let absurd = |what| Err(BlobError::Absurd(what));
    let n = layout.lambda.len();
    let vectors = (layout.factors.iter().map(|(_, b)| b))
        .chain(
            layout
                .path
                .iter()
                .flat_map(|(_, displacement, slope)| [displacement, slope]),
        )
        .chain(layout.sensors.iter().map(|(_, row)| row));
    for vector in vectors {
        if vector.len() != n {
            return Err(BlobError::Malformed);
        }
        if !vector.iter().all(|value| value.is_finite()) {
            return absurd(Absurdity::Shape);
        }
    }
    let [lowest, highest] = FREQUENCY_RANGE_HZ.map(|hz| (core::f32::consts::TAU * hz) * (core::f32::consts::TAU * hz));
    if n == 0 || !layout.lambda.iter().all(|&value| (lowest..=highest).contains(&value)) {
        return absurd(Absurdity::Frequency);
    }
    if !layout.lambda.is_sorted() {
        return absurd(Absurdity::Order);
    }
    // 2 xi omega = p1 + p2 omega^2 of the lowest mode, the one that a bridge must swing in.
    let [p1, p2] = layout.rayleigh;
    let critical = 2.0 * crate::math::sqrt(layout.lambda[0]);
    if !(p1 >= 0.0 && p2 >= 0.0 && p1 + p2 * layout.lambda[0] < critical) {
        return absurd(Absurdity::Damping);
    }
    let displacements = layout
        .path
        .iter()
        .map(|(_, w, _)| w)
        .chain(layout.sensors.iter().map(|(_, row)| row));
    let slopes = layout.path.iter().map(|(.., slope)| slope);
    let shapes = displacements
        .map(|w| (w, MAX_SHAPE[0]))
        .chain(slopes.map(|slope| (slope, MAX_SHAPE[1])));
    if shapes
        .into_iter()
        .any(|(vector, limit)| vector.iter().any(|value| value.abs() > limit))
    {
        return absurd(Absurdity::Shape);
    }
    if layout.elements == 0 || usize::from(layout.elements) > ELEMENTS {
        return Err(BlobError::TooLarge);
    }
    if layout.factors.iter().any(|&(element, _)| element >= layout.elements) {
        return absurd(Absurdity::Element);
    }
    let positions = || layout.path.iter().map(|&(x, ..)| x);
    let begins = positions().next().is_some_and(|x| x == 0.0);
    if !begins || layout.path.len() < 2 || positions().any(|x| !(0.0..=MAX_LENGTH_M).contains(&x)) {
        return absurd(Absurdity::Path);
    }
    if positions().zip(positions().skip(1)).any(|(a, b)| b <= a) {
        return absurd(Absurdity::PathOrder);
    }
    if layout.sensors.is_empty() {
        return absurd(Absurdity::Sensors);
    }
    for i in 0..n {
        for j in i..n {
            let sum: f32 = layout.factors.iter().map(|(_, b)| b[i] * b[j]).sum();
            let expected = if i == j { 1.0 } else { 0.0 };
            if (sum - expected).abs() > COMPLETENESS_TOLERANCE {
                return absurd(Absurdity::Stiffness);
            }
        }
    }
    Ok(())
}

fn unpack(layout: &Layout) -> ReducedBridge<f32> {
    let mut bridge = ReducedBridge {
        name: layout.name.clone(),
        basis: layout.lambda.len(),
        elements: usize::from(layout.elements),
        lambda: SVector::zeros(),
        factors: SMatrix::zeros(),
        factor_element: [0; FACTORS],
        factor_count: layout.factors.len(),
        path: Path {
            nodes: layout.path.len(),
            position_m: [0.0; PATH_NODES],
            displacement: SMatrix::zeros(),
            slope: SMatrix::zeros(),
        },
        sensor_node: [0; SENSOR_PLACES],
        sensors: SMatrix::zeros(),
        sensor_count: layout.sensors.len(),
        rayleigh: layout.rayleigh,
    };
    fill(bridge.lambda.as_mut_slice(), &layout.lambda);
    for (f, (element, column)) in layout.factors.iter().enumerate() {
        bridge.factor_element[f] = *element;
        fill(bridge.factors.column_mut(f).as_mut_slice(), column);
    }
    for (i, (x, displacement, slope)) in layout.path.iter().enumerate() {
        bridge.path.position_m[i] = *x;
        fill(bridge.path.displacement.column_mut(i).as_mut_slice(), displacement);
        fill(bridge.path.slope.column_mut(i).as_mut_slice(), slope);
    }
    for (s, (node, row)) in layout.sensors.iter().enumerate() {
        bridge.sensor_node[s] = *node;
        fill(bridge.sensors.column_mut(s).as_mut_slice(), row);
    }
    bridge
}

fn fill(target: &mut [f32], values: &[f32]) {
    for (slot, &value) in target.iter_mut().zip(values) {
        *slot = value;
    }
}
