//! The messages between base station and logger, one type for both ends.
//!
//! Each is a postcard payload; the header of its [frame](super::frame) carries its kind and the version of all of them,
//! [`VERSION`]. A change of any layout here raises [`VERSION`], and an old peer then refuses the frame by its header.

use heapless::{String, Vec};
use serde::{Deserialize, Serialize};

use crate::bridge::BlobError;
use crate::capacity::{CHANNELS, ELEMENTS};
use crate::identify::evidence::{Change, EvidenceError};
use crate::interaction::SetupError;
use crate::logger::ConfigurationError;
use crate::session::seal::KEY_BYTES;
use crate::settings::{Part, SettingsError};
use crate::track::blob::TrackError;

/// Version of the message layouts of this module.
pub const VERSION: u8 = 9;

/// Raw counts in one block, over all channels.
pub const BLOCK_COUNTS: usize = 96;
/// Bytes of the bridge model in one chunk.
pub const CHUNK_BYTES: usize = 256;

/// What the base station says to a logger.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub enum Request {
    /// How to read the sensors, what to call a passage, which train comes.
    Configure(Configuration),
    /// A piece of the bridge model's blob.
    Model(Chunk),
    /// Raw sensor counts, as a sensor driver would deliver them.
    Samples(SampleBlock),
    /// The recording ends here: close an open passage, finish its identification.
    Finish,
    /// Send a [`Status`].
    Status,
    /// Send what all passages say of the bridge, from this byte on, to be kept and restored after a restart.
    Evidence {
        /// The byte; 0 for the first piece.
        offset: u32,
    },
    /// A piece of what an earlier logger sent: go on from there.
    Restore(Chunk),
    /// A piece of a learnt track's blob.
    Track(Chunk),
    /// Send samples of the last passage that a learnt track did not explain ([`PassagePiece`]), from this value on: the track can be
    /// learnt anew from such.
    Passage {
        /// The value; 0 for the first piece.
        offset: u32,
    },
    /// What is kept over a restart.
    Setup(SetupRequest),
    /// Forget what all passages say of the bridge, as after a repair.
    Clear,
    /// Use this key from the next session on.
    Key(NewKey),
    /// Start again, from what is kept.
    Restart,
}

/// Keeping what the logger watches with. Between [`Self::Begin`] and [`Self::Keep`] everything that it is given, and takes, is also written
/// to the flash.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum SetupRequest {
    /// Begin a setup.
    Begin,
    /// It is whole: from now on the logger starts with it.
    Keep,
    /// Go back to the one that is kept.
    Reload,
    /// Send a part of the one that is kept, from this byte on.
    Read {
        /// Which part.
        part: Part,
        /// The byte; 0 for the first piece.
        offset: u32,
    },
}

/// Another key for a logger.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct NewKey {
    /// The logger's number, which it may have had before or not.
    pub device: u32,
    /// The number of the key.
    pub number: u8,
    /// The key.
    pub key: [u8; KEY_BYTES],
}

/// What a logger has kept.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct SetupState {
    /// Setups that were kept so far, this one included; 0: it watches with none that would outlive a restart.
    pub generation: u32,
    /// The newest was refused at the start, and this is the one before.
    pub rolled_back: bool,
}

/// What a logger says to each request.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[allow(clippy::large_enum_variant, reason = "one at a time, on its way to the frame")]
pub enum Answer {
    /// What became of the request.
    Acknowledgement(Acknowledgement),
    /// The logger's health.
    Status(Status),
    /// A piece of what all passages say of the bridge, or of a setup.
    Piece(Chunk),
    /// Samples of a passage.
    Passage(PassagePiece),
}

/// What a logger says on its own, and when it did so first.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Notice {
    /// In which of its starts.
    pub start: u32,
    /// How long after it, ms.
    pub uptime_ms: u64,
    /// What.
    pub event: Event,
}

/// What a logger says on its own.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub enum Event {
    /// A train has passed.
    Passage(PassageReport),
    /// Damage, beyond doubt.
    Alert(Alert),
    /// The track is not the one that was learnt any more.
    Track(TrackReport),
}

/// A passage has shown that the track has changed.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct TrackReport {
    /// Number of the passage since the start, from 1.
    pub passage: u32,
    /// Index of the first sample of its motion.
    pub start_sample: u64,
    /// Number of the passage from which on it seems to have been another one; 0: before the start.
    pub since: u32,
    /// Deviations by which it leaves more unexplained than healthy passages did.
    pub misfit: f32,
    /// The same on a running mean of the last twenty.
    pub mean_misfit: f32,
}

/// What is known of the track.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum TrackState {
    /// Nothing was learnt: it is taken for smooth.
    #[default]
    Unknown,
    /// It was learnt.
    Learnt,
    /// It was, and has changed since.
    Changed,
}

/// How a logger reads its sensors and when it speaks of a passage.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Configuration {
    /// Samples a second of each channel, Hz.
    pub sample_rate_hz: f32,
    /// One entry a channel, in the order of the counts of a block.
    pub channels: Vec<Channel, CHANNELS>,
    /// When a passage begins and ends.
    pub trigger: Trigger,
    /// Cut-off of the recorder's anti-alias filter (4th-order Butterworth, causal), Hz; none: no filter.
    pub antialias_hz: Option<f32>,
    /// The train that is expected; none: passages are found, nothing is identified.
    pub traffic: Option<Traffic>,
    /// How long passages are remembered.
    pub memory: Memory,
    /// Seed of the search.
    pub seed: u64,
}

/// How many passages it takes to forget one (to a part `1/e`); 0: never. The recent memory shows a sudden loss, the long one makes
/// the answer sharp.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Memory {
    /// Of the long memory.
    pub long_passages: f32,
    /// Of the recent one, which must be the shorter.
    pub recent_passages: f32,
}

impl Default for Memory {
    /// Five days and a morning of a busy line.
    fn default() -> Self {
        Self {
            long_passages: 1000.0,
            recent_passages: 20.0,
        }
    }
}

/// What a sensor measures.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Quantity {
    /// Acceleration, m/s², positive up.
    #[default]
    Acceleration,
    /// Displacement, m, positive up.
    Displacement,
}

/// One sensor.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Channel {
    /// Bridge node it sits at, from 1; 0 where there is no bridge model.
    pub node: u16,
    /// What it measures.
    pub quantity: Quantity,
    /// What one count stands for, in the quantity's unit.
    pub lsb: f32,
    /// Counts at or beyond ± this are saturated.
    pub full_scale_counts: i32,
}

/// When a passage begins and when it ends. Levels are RMS values over [`Trigger::window_s`].
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Trigger {
    /// Length of the window of the running level, s.
    pub window_s: f32,
    /// A passage begins when the level stays above this multiple of the quiet level ...
    pub on_ratio: f32,
    /// ... for this time, s.
    pub on_duration_s: f32,
    /// It ends when the level stays below this multiple of the quiet level ...
    pub off_ratio: f32,
    /// ... for this time, s.
    pub off_duration_s: f32,
    /// The quiet level is never taken below this, m/s².
    pub floor_mps2: f32,
    /// Samples kept from before the beginning, s.
    pub lead_s: f32,
}

impl Default for Trigger {
    /// For bridges of some tens of metres. Bridges move at 2 to 10 Hz, so a quarter of a second is a period or two; three
    /// times the quiet level is ten of its own deviations in such a window; a train's free vibration beats, but not for
    /// two seconds; and half a millimetre per second squared is what a good recorder leaves on a quiet bridge.
    fn default() -> Self {
        Self {
            window_s: 0.25,
            on_ratio: 3.0,
            on_duration_s: 0.1,
            off_ratio: 2.0,
            off_duration_s: 2.0,
            floor_mps2: 5e-4,
            lead_s: 1.5,
        }
    }
}

/// The train that is expected, and when. Without an entry time it is every train that passes.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Traffic {
    /// What rolls.
    pub train: TrainKind,
    /// Number of cars.
    pub cars: u8,
    /// Speed as it enters, m/s; none: estimated from each passage.
    pub speed_mps: Option<f32>,
    /// Change of the speed, m/s².
    pub acceleration_mps2: f32,
    /// It enters by the bridge's last node.
    pub backward: bool,
    /// Stream time (sample index / rate) at which the first axle reaches the bridge, s: only the passage that contains it is
    /// identified. None: every passage is, and its entry time estimated.
    pub entry_time_s: Option<f64>,
    /// Scales the static wheel loads.
    pub load_factor: f32,
    /// How far off these values may be.
    pub ranges: Ranges,
}

/// How far a passage may be off what is expected of it. Each is half the width of the range in which the search begins, and then
/// the standard deviation of a Gaussian prior; 0: the expected value is known and held. Where nothing is expected, as of a speed
/// that is not given, the range comes with the [first guess](crate::guess) and what is said here does not count.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct Ranges {
    /// Speed, as a part of the expected one.
    pub speed: f32,
    /// Entry time, s.
    pub entry_s: f32,
    /// Load factor, as a part of the expected one.
    pub load: f32,
    /// Stiffness of the whole bridge, as a part of the model's.
    pub stiffness: f32,
}

impl Ranges {
    /// All is known.
    pub const HELD: Self = Self {
        speed: 0.0,
        entry_s: 0.0,
        load: 0.0,
        stiffness: 0.0,
    };
    /// Wider makes no sense: beyond it it is another train, or another bridge.
    pub const WIDEST: Self = Self {
        speed: 0.5,
        entry_s: 10.0,
        load: 0.9,
        stiffness: 0.3,
    };
}

/// The trains a logger knows.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum TrainKind {
    /// The paper's two-degree-of-freedom inspection car.
    Inspection2Dof,
    /// The paper's 15-degree-of-freedom car.
    Shinkansen3d,
}

/// A piece of a bridge model's blob or of an evidence; the pieces come in order.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Chunk {
    /// Place of the first byte in the whole.
    pub offset: u32,
    /// Bytes of the whole.
    pub total: u32,
    /// The bytes.
    pub bytes: Vec<u8, CHUNK_BYTES>,
}

/// Samples of a passage that a learnt track did not explain. They are there until the next passage begins: pieces of different passages
/// do not belong together.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct PassagePiece {
    /// Number of the passage since the start, from 1; 0: there is none.
    pub passage: u32,
    /// Index of its first sample in the stream.
    pub first_sample: u64,
    /// Channels in each sample.
    pub channels: u8,
    /// Values of the whole.
    pub total: u32,
    /// Place of the first value in the whole.
    pub offset: u32,
    /// The values without offset, m/s² (m), channel after channel within a sample; not-a-number where there is none.
    pub values: Vec<f32, BLOCK_COUNTS>,
}

/// Raw counts of consecutive samples, channel after channel within a sample.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SampleBlock {
    /// Index of the first sample in the stream; a jump is a gap.
    pub first_sample: u64,
    /// `samples x channels` counts, at most [`BLOCK_COUNTS`].
    pub counts: Vec<i32, BLOCK_COUNTS>,
}

/// What became of the request with the frame's sequence number.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct Acknowledgement {
    /// What became of it.
    pub outcome: Outcome,
    /// An identification is running: a sender of recorded samples waits (it asks for the status until this clears).
    pub busy: bool,
}

/// What became of a request.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Outcome {
    /// Done.
    Done,
    /// The configuration was refused.
    Configuration(ConfigurationError),
    /// The model was refused.
    Model(BlobError),
    /// Samples before a configuration, or counts that do not fit the channels.
    Samples,
    /// A piece of a model or an evidence out of order, or too many bytes; or a passage has taken the room of those before it. Begin
    /// again at the first.
    Chunk,
    /// The evidence cannot be gone on from.
    Evidence(EvidenceError),
    /// The track was refused.
    Track(TrackError),
    /// The setup or the key was not kept.
    Settings(SettingsError),
}

/// What was wrong with the samples of a passage, counted over all channels.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Quality {
    /// Samples that never came.
    pub missing: u32,
    /// Samples at the end of the sensor's range.
    pub saturated: u32,
    /// Samples that repeat the one before for suspiciously long.
    pub stuck: u32,
}

impl Quality {
    /// Nothing wrong.
    pub const NONE: Self = Self {
        missing: 0,
        saturated: 0,
        stuck: 0,
    };

    /// All that is wrong.
    pub fn total(&self) -> u32 {
        self.missing.saturating_add(self.saturated).saturating_add(self.stuck)
    }

    /// Adds other samples' faults.
    pub fn add(&mut self, other: &Self) {
        self.missing = self.missing.saturating_add(other.missing);
        self.saturated = self.saturated.saturating_add(other.saturated);
        self.stuck = self.stuck.saturating_add(other.stuck);
    }
}

/// A train has passed.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct PassageReport {
    /// Number of the passage since the start, from 1.
    pub passage: u32,
    /// Index of the first sample of the motion.
    pub start_sample: u64,
    /// Index one past the last sample of the motion.
    pub end_sample: u64,
    /// Largest value of each channel without its offset, m/s², or m of a displacement.
    pub peak: Vec<f32, CHANNELS>,
    /// Level of the strongest acceleration, dB re 1 µm/s²; for the eye, ± 1 dB.
    pub level_db: f32,
    /// What was wrong with the samples.
    pub quality: Quality,
    /// What the search made of it.
    pub verdict: Verdict,
}

/// How well a passage is explained, and by what run of the train.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Fit {
    /// Misfit, (m/s²)² (m²).
    pub objective: f32,
    /// Part of the passage's power that is not explained.
    pub unexplained: f32,
    /// Speed as the train enters, m/s.
    pub speed_mps: f32,
    /// Stream time at which the first axle reaches the bridge, s.
    pub entry_time_s: f64,
    /// Load, as a part of the expected train's.
    pub load_factor: f32,
    /// Stiffness of the whole bridge, as a part of the model's.
    pub stiffness: f32,
    /// What the passage changed in what is believed of the bridge.
    pub change: Change,
}

/// What the search made of a passage.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Verdict {
    /// No damage beyond doubt.
    Healthy {
        /// How well the best pattern fits.
        fit: Fit,
        /// Loss of a single element, per mille, that the passage could have hidden.
        hidden_permille: u16,
    },
    /// No damage beyond doubt, but the passage could have hidden any.
    Undecided {
        /// How well the best pattern fits.
        fit: Fit,
        /// Loss of a single element, per mille, that the passage could have hidden.
        hidden_permille: u16,
    },
    /// Damage; an [`Alert`] says where.
    Damaged {
        /// How well the best pattern fits.
        fit: Fit,
    },
    /// Nothing was identified.
    NotIdentified(Reason),
}

impl Verdict {
    /// How well the passage is explained, if it was.
    pub fn fit(&self) -> Option<&Fit> {
        match self {
            Self::Healthy { fit, .. } | Self::Undecided { fit, .. } | Self::Damaged { fit } => Some(fit),
            Self::NotIdentified(_) => None,
        }
    }
}

/// Why nothing was identified.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Reason {
    /// No bridge model is loaded.
    NoModel,
    /// Nobody said which train comes.
    NoTraffic,
    /// The passage is longer than the memory for it.
    TooLong,
    /// An earlier passage was still being identified.
    Busy,
    /// Another bridge model came before the search was over.
    Interrupted,
    /// Too many missing, saturated or stuck samples.
    BadQuality,
    /// The expected train enters before or after this passage, or would take longer to cross the bridge.
    NotThisTrain,
    /// The expected train, bridge and sensors do not go together.
    Setup(SetupError),
    /// No pattern of damage explains the record.
    Unexplained,
    /// The search could not be ended within the time between trains.
    OutOfTime,
    /// It is explained only if elements gain stiffness: train, track or bridge are not those of the model.
    Implausible,
    /// The track is not the one that was learnt, or the train none of those.
    AnotherTrack,
    /// No train of this kind and speed was among those that the track was learnt from.
    Uncalibrated,
}

impl Reason {
    /// Whether it may be that a learnt track is no longer that, or that it was not learnt from such a train.
    pub fn may_be_the_track(self) -> bool {
        matches!(
            self,
            Self::AnotherTrack | Self::Uncalibrated | Self::Unexplained | Self::Implausible
        )
    }
}

/// Damage: which elements, how much, how sure, on what evidence.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Alert {
    /// Name of the bridge model.
    pub bridge: String<24>,
    /// Number of the passage since the start, from 1.
    pub passage: u32,
    /// Index of the first sample of the motion.
    pub start_sample: u64,
    /// Loss of bending stiffness of each element, per mille.
    pub damage_permille: Vec<u16, ELEMENTS>,
    /// Standard deviation of each, per mille.
    pub std_permille: Vec<u16, ELEMENTS>,
    /// 95 % interval of each, per mille: its lower end ...
    pub low_permille: Vec<u16, ELEMENTS>,
    /// ... and its upper end.
    pub high_permille: Vec<u16, ELEMENTS>,
    /// Passages that this rests on; those long ago count in part.
    pub passages: f32,
    /// The best other explanation of this passage, if one was looked for.
    pub rival: Option<RivalReport>,
    /// Bit `e - 1` is set where element `e` is damaged beyond doubt.
    pub certain: u16,
    /// Misfit of this pattern, (m/s²)².
    pub objective: f32,
    /// Misfit of the undamaged bridge, (m/s²)².
    pub objective_healthy: f32,
    /// Train-bridge interaction analyses that it took.
    pub forward_solves: u32,
}

/// What else could explain a passage: one element is whole in it, and others have lost more.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RivalReport {
    /// The element, from 1, that is whole.
    pub whole: u8,
    /// Loss of bending stiffness of each element, per mille.
    pub damage_permille: Vec<u16, ELEMENTS>,
    /// Standard deviations by which it explains the passage worse.
    pub loses_by: f32,
}

/// Why a logger started.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Restart {
    /// Power came on.
    #[default]
    PowerOn,
    /// The program panicked.
    Panic,
    /// The processor faulted.
    Fault,
    /// The program hung.
    Watchdog,
    /// Somebody pressed the button.
    Request,
}

/// State that only the board under a logger knows.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Health {
    /// Received bytes lost, because the queue was full or nobody fetched them in time.
    pub overruns: u32,
    /// Deepest stack so far, bytes; 0 where it is not known.
    pub stack_peak_bytes: u32,
    /// Why the logger started.
    pub restart: Restart,
}

/// What the work has cost, in ticks of the board's clock; 0 where there is none.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Effort {
    /// Ticks spent on samples, from decoded block to answer.
    pub stream_ticks: u64,
    /// Ticks spent on identification.
    pub identification_ticks: u64,
    /// Longest slice of identification: so long no block of samples is looked at.
    pub longest_slice_ticks: u64,
    /// Steps of the interaction solver.
    pub solver_steps: u64,
}

/// The logger's health.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Status {
    /// Samples taken in, of each channel.
    pub samples: u64,
    /// Passages since the start.
    pub passages: u32,
    /// Alerts since the start.
    pub alerts: u32,
    /// Frames accepted.
    pub frames: u32,
    /// Frames refused, for whatever reason.
    pub rejected: u32,
    /// What was wrong with samples so far.
    pub quality: Quality,
    /// An identification is running.
    pub busy: bool,
    /// Messages that the base station has not yet confirmed.
    pub waiting: u32,
    /// What is known of the track.
    pub track: TrackState,
    /// What it has kept, and watches with.
    pub setup: SetupState,
    /// Starts so far.
    pub starts: u32,
    /// Number of the key that it has.
    pub key: u8,
    /// What the work has cost.
    pub effort: Effort,
    /// The board's own state.
    pub health: Health,
}
