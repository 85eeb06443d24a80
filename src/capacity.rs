//! Sizes of everything that is fixed in memory, in one place, because they share one budget (`memory.x`).

/// Elements (or groups of elements) of a bridge that can be damaged.
pub const ELEMENTS: usize = 10;
/// Vectors of the reduced basis: modes, and static vectors that represent damage.
pub const BASIS: usize = 20;
/// Vectors that the elements' shares of the stiffness are made of: two for a beam element.
pub const FACTORS: usize = 2 * ELEMENTS;
/// Modes of the damaged bridge that are stepped in time.
pub const MODES: usize = 8;
/// Nodes along the path of the wheels.
pub const PATH_NODES: usize = ELEMENTS + 1;
/// Places of the bridge at which a sensor can sit.
pub const SENSOR_PLACES: usize = PATH_NODES;
/// Unknowns of an identification: the elements' losses, stiffness of the whole bridge, speed, entry time, load.
pub const UNKNOWNS: usize = ELEMENTS + 4;
/// Channels of a logger.
pub const CHANNELS: usize = 3;
/// Cars of a train.
pub const CARS: usize = 16;
/// Kinds of car in a train on the logger.
pub const CAR_KINDS: usize = 1;
/// Cars that touch a bridge at the same time, on the logger.
pub const CARS_ON_BRIDGE: usize = 4;
/// Degrees of freedom of a car on the logger: bounce and pitch of a body and two bogies.
pub const CAR_DOFS: usize = 6;
/// Contacts of a car on the logger: four wheelsets in vertical motion.
pub const CONTACTS: usize = 4;
/// Springs inside a car: ten of a bogie car in space.
pub const CAR_SPRINGS: usize = 10;
/// Samples, counted over all channels, that a passage can hold: 92 s of one channel at 200 Hz, 30 s of three.
pub const PASSAGE_SAMPLES: usize = 18_432;
/// Samples from before a passage, counted over all channels: 1.6 s of three at 200 Hz.
pub const LEAD_VALUES: usize = 960;
/// Bytes of an encoded bridge model.
pub const MODEL_BLOB_BYTES: usize = 4608;
/// Bytes of one message's payload in a frame.
pub const PAYLOAD_BYTES: usize = 512;
/// Knots of the rail's profile.
pub const PROFILE_KNOTS: usize = 152;
/// B-splines that stand on them.
pub const PROFILE_COEFFICIENTS: usize = PROFILE_KNOTS - 4;
