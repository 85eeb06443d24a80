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
use nalgebra::SVectorViewMut;
use serde::{Deserialize, Serialize};

use super::ReducedBridge;
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
/// Longest believable path, and shortest distance between two of its nodes, m.
const MAX_LENGTH_M: f32 = 10_000.0;
const MIN_SPAN_M: f32 = 1e-3;

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
    /// The path's nodes do not ascend, by a millimetre at least.
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
            Self::PathOrder => "the nodes of the path do not ascend, by a millimetre at least",
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

/// The fields in the order in which they are written, and read one by one. Vectors have as many entries as the basis.
#[derive(Serialize)]
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
    let mut bridge = ReducedBridge::EMPTY;
    read_into(bytes, &mut bridge)?;
    Ok(bridge)
}

/// Reads a model straight into `bridge`, without a second one on the stack, and checks it. If bytes are missing or were changed,
/// `bridge` stays as it is; if the model itself is refused, `bridge` is empty.
pub fn read_into(bytes: &[u8], bridge: &mut ReducedBridge<f32>) -> Result<(), BlobError> {
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
    let read = unpack(body, bridge).and_then(|()| believe(bridge));
    if read.is_err() {
        bridge.clear();
    }
    read
}

/// The next field of a [`Layout`].
fn next<'b, T: Deserialize<'b>>(body: &mut &'b [u8]) -> Result<T, BlobError> {
    let (field, rest) = postcard::take_from_bytes(body).map_err(|_| BlobError::Malformed)?;
    *body = rest;
    Ok(field)
}

/// The number of a list's entries.
fn count(body: &mut &[u8], most: usize) -> Result<usize, BlobError> {
    let count = next::<u32>(body)? as usize;
    if count > most {
        Err(BlobError::Malformed)
    } else {
        Ok(count)
    }
}

/// A vector of the basis's length into a column.
fn column(body: &mut &[u8], basis: usize, mut target: SVectorViewMut<'_, f32, BASIS>) -> Result<(), BlobError> {
    let vector: Vector = next(body)?;
    if vector.len() != basis {
        return Err(BlobError::Malformed);
    }
    fill(target.as_mut_slice(), &vector);
    Ok(())
}

/// Reads the fields of a [`Layout`] one by one.
fn unpack(mut body: &[u8], bridge: &mut ReducedBridge<f32>) -> Result<(), BlobError> {
    let body = &mut body;
    bridge.clear();
    bridge.name = next(body)?;
    bridge.rayleigh = next(body)?;
    let lambda: Vector = next(body)?;
    let basis = lambda.len();
    bridge.basis = basis;
    fill(bridge.lambda.as_mut_slice(), &lambda);
    bridge.elements = usize::from(next::<u8>(body)?);
    bridge.factor_count = count(body, FACTORS)?;
    let factors = bridge.factor_element.iter_mut().zip(bridge.factors.column_iter_mut());
    for (element, factor) in factors.take(bridge.factor_count) {
        *element = next(body)?;
        column(body, basis, factor)?;
    }
    let path = &mut bridge.path;
    path.nodes = count(body, PATH_NODES)?;
    let shapes = path.displacement.column_iter_mut().zip(path.slope.column_iter_mut());
    for (position_m, (displacement, slope)) in path.position_m.iter_mut().zip(shapes).take(path.nodes) {
        *position_m = next(body)?;
        column(body, basis, displacement)?;
        column(body, basis, slope)?;
    }
    bridge.sensor_count = count(body, SENSOR_PLACES)?;
    let sensors = bridge.sensor_node.iter_mut().zip(bridge.sensors.column_iter_mut());
    for (node, shape) in sensors.take(bridge.sensor_count) {
        *node = next(body)?;
        column(body, basis, shape)?;
    }
    if body.is_empty() {
        Ok(())
    } else {
        Err(BlobError::Malformed)
    }
}

/// Refuses values that no bridge has.
fn believe(bridge: &ReducedBridge<f32>) -> Result<(), BlobError> {
    let absurd = |what| Err(BlobError::Absurd(what));
    let (n, path) = (bridge.basis.min(BASIS), &bridge.path);
    let lambda = &bridge.lambda.as_slice()[..n];
    let finite = |values: &[f32]| values.iter().all(|value| value.is_finite());
    let shapes = [
        bridge.factors.as_slice(),
        path.displacement.as_slice(),
        path.slope.as_slice(),
        bridge.sensors.as_slice(),
    ];
    if !shapes.into_iter().all(finite) {
        return absurd(Absurdity::Shape);
    }
    let [lowest, highest] = FREQUENCY_RANGE_HZ.map(|hz| (core::f32::consts::TAU * hz) * (core::f32::consts::TAU * hz));
    let Some(&first) = lambda.first() else {
        return absurd(Absurdity::Frequency);
    };
    if !lambda.iter().all(|&value| (lowest..=highest).contains(&value)) {
        return absurd(Absurdity::Frequency);
    }
    if !lambda.is_sorted() {
        return absurd(Absurdity::Order);
    }
    // 2 xi omega = p1 + p2 omega^2 of the lowest mode, the one that a bridge must swing in.
    let [p1, p2] = bridge.rayleigh;
    let critical = 2.0 * crate::math::sqrt(first);
    if !(p1 >= 0.0 && p2 >= 0.0 && p1 + p2 * first < critical) {
        return absurd(Absurdity::Damping);
    }
    let within = |values: &[f32], limit: f32| values.iter().all(|value| value.abs() <= limit);
    let [displacement, slope] = MAX_SHAPE;
    if !(within(path.displacement.as_slice(), displacement)
        && within(bridge.sensors.as_slice(), displacement)
        && within(path.slope.as_slice(), slope))
    {
        return absurd(Absurdity::Shape);
    }
    if bridge.elements == 0 || bridge.elements > ELEMENTS {
        return Err(BlobError::TooLarge);
    }
    let factor_element = &bridge.factor_element[..bridge.factor_count.min(FACTORS)];
    if factor_element
        .iter()
        .any(|&element| usize::from(element) >= bridge.elements)
    {
        return absurd(Absurdity::Element);
    }
    let positions = &path.position_m[..path.nodes.min(PATH_NODES)];
    let begins = positions.first() == Some(&0.0);
    if !begins || positions.len() < 2 || positions.iter().any(|x| !(0.0..=MAX_LENGTH_M).contains(x)) {
        return absurd(Absurdity::Path);
    }
    if !positions.is_sorted_by(|a, b| b - a >= MIN_SPAN_M) {
        return absurd(Absurdity::PathOrder);
    }
    if bridge.sensor_count == 0 {
        return absurd(Absurdity::Sensors);
    }
    for i in 0..n {
        for j in i..n {
            // Unused factors are zero.
            let sum: f32 = bridge.factors.column_iter().map(|b| b[i] * b[j]).sum();
            let expected = if i == j { 1.0 } else { 0.0 };
            if (sum - expected).abs() > COMPLETENESS_TOLERANCE {
                return absurd(Absurdity::Stiffness);
            }
        }
    }
    Ok(())
}

fn fill(target: &mut [f32], values: &[f32]) {
    for (slot, &value) in target.iter_mut().zip(values) {
        *slot = value;
    }
}
