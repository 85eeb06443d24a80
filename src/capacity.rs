//! Sizes of everything that is fixed in memory, in one place, because they share one budget (`memory.x`).

/// Elements (or groups of elements) of a bridge that can be damaged.
pub const ELEMENTS: usize = 10;
/// Vectors of the reduced basis: 8 modes and 9 static vectors for `girder50`.
pub const BASIS: usize = 17;
/// Modes of the damaged bridge that are stepped in time.
pub const MODES: usize = 8;
/// Nodes along the path of the wheels.
pub const PATH_NODES: usize = ELEMENTS + 1;
/// Places of the bridge at which a sensor can sit.
pub const SENSOR_PLACES: usize = PATH_NODES;
/// Channels of a logger.
pub const CHANNELS: usize = 3;
/// Cars of a train.
pub const CARS: usize = 16;
/// Samples, counted over all channels, that a passage can hold: 92 s of one channel at 200 Hz, 30 s of three.
pub const PASSAGE_SAMPLES: usize = 18_432;
/// Bytes of an encoded bridge model.
pub const MODEL_BLOB_BYTES: usize = 12 * 1024;
/// Bytes of one message's payload in a frame.
pub const PAYLOAD_BYTES: usize = 512;
