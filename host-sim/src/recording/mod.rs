//! A recorded passage, or a longer record with none or several: a CSV of samples and a TOML of the same stem beside it.
//!
//! ```text
//! case.csv     time_s,acc_node6_mps2           first column time_s, then one column a channel, header required
//!              0.000,1.23400000e-3
//! case.toml    bridge, train, cars, speed_kmh, entry_time_s, load_factor, antialias_hz, track, [range], [[channel]]
//! ```
//!
//! A speed, entry time or load that the TOML gives is held; one that it does not give is estimated from the passage, with the
//! damage. `[range]` makes of a given value a first guess ([`Margins`]). Accelerations and displacements are positive up. Times increase by one interval a row, or by a whole number of intervals where rows are
//! missing: such a gap is kept ([`Run`]), since the logger counts missing samples. [`description`] reads the TOML,
//! [`table`] the CSV, [`clock`] makes sample indices of the times.

pub mod clock;
pub mod description;
pub mod table;

use std::path::Path;

use anyhow::{Context, Result, bail};
use spanwatch::interaction::Direction;
use spanwatch::train::GRAVITY_MPS2;
use spanwatch::wire::message::Quantity;

use crate::output;
use crate::train::TrainName;
pub use clock::Run;

/// Counts of the converter that is assumed where a recording does not name its own: 24 bits, ± [`DEFAULT_RANGE_G`].
pub const DEFAULT_FULL_SCALE_COUNTS: i32 = (1 << 23) - 1;
/// Range of the converter that is assumed, in standard gravities to either side.
pub const DEFAULT_RANGE_G: f64 = 2.0;
/// Acceleration of one count of the converter that is assumed, m/s²: 2 x 2 g / 2^24 = 2.338 µm/s².
pub const DEFAULT_LSB_MPS2: f32 = (2.0 * DEFAULT_RANGE_G * GRAVITY_MPS2 / (1_u32 << 24) as f64) as f32;

/// Range of the converter that is assumed for a displacement, to either side, m.
pub const DEFAULT_RANGE_M: f64 = 0.1;
/// Displacement of one count of the converter that is assumed, m: 2 x 100 mm / 2^24 = 11.9 nm.
pub const DEFAULT_LSB_M: f32 = (2.0 * DEFAULT_RANGE_M / (1_u32 << 24) as f64) as f32;

/// The unit of a column.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Unit {
    /// m/s².
    MetrePerSecondSquared,
    /// Standard gravity, 9.80665 m/s².
    StandardGravity,
    /// Gal, 0.01 m/s².
    Gal,
    /// Millimetre of displacement.
    Millimetre,
}

impl Unit {
    /// The unit of that name in a TOML, if it is an acceleration's or a displacement's.
    pub fn named(name: &str) -> Option<Self> {
        [
            Self::MetrePerSecondSquared,
            Self::StandardGravity,
            Self::Gal,
            Self::Millimetre,
        ]
        .into_iter()
        .find(|unit| unit.name() == name)
    }

    /// Its name in a TOML.
    pub fn name(self) -> &'static str {
        match self {
            Self::MetrePerSecondSquared => "m/s2",
            Self::StandardGravity => "g",
            Self::Gal => "gal",
            Self::Millimetre => "mm",
        }
    }

    /// What is measured in it.
    pub fn quantity(self) -> Quantity {
        match self {
            Self::MetrePerSecondSquared | Self::StandardGravity | Self::Gal => Quantity::Acceleration,
            Self::Millimetre => Quantity::Displacement,
        }
    }

    /// What one count of the converter that is assumed stands for, m/s² (m).
    pub fn default_lsb(self) -> f32 {
        match self.quantity() {
            Quantity::Acceleration => DEFAULT_LSB_MPS2,
            Quantity::Displacement => DEFAULT_LSB_M,
        }
    }

    /// What one of it is in the unit of [`Channel::values`].
    pub fn factor(self) -> f64 {
        match self {
            Self::MetrePerSecondSquared => 1.0,
            Self::StandardGravity => GRAVITY_MPS2,
            Self::Gal => 0.01,
            Self::Millimetre => 1e-3,
        }
    }
}

/// One sensor's samples.
#[derive(Debug, Clone, PartialEq)]
pub struct Channel {
    /// Name of its column.
    pub column: String,
    /// Bridge node it sits at, from 1; none where the recording names no bridge.
    pub node: Option<u16>,
    /// Unit in the file.
    pub unit: Unit,
    /// What one count of the sensor's converter stands for, m/s² (m).
    pub lsb: f32,
    /// Counts at or beyond ± this are saturated.
    pub full_scale_counts: i32,
    /// One value a row, m/s² (m in a column of displacement).
    pub values: Vec<f64>,
}

impl Channel {
    /// A channel with the converter that is assumed where none is named.
    pub fn new(column: String, node: Option<u16>, unit: Unit, values: Vec<f64>) -> Self {
        Self {
            column,
            node,
            unit,
            lsb: unit.default_lsb(),
            full_scale_counts: DEFAULT_FULL_SCALE_COUNTS,
            values,
        }
    }

    /// The raw count of a value: rounded, and cut off at the end of the converter's range.
    pub fn count(&self, value: f64) -> i32 {
        let full = f64::from(self.full_scale_counts);
        (value / f64::from(self.lsb)).round().clamp(-full, full) as i32
    }
}

/// How far off a passage may be what its recording says of it: the table `[range]`. A value that is given is held where
/// nothing stands here.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Margins {
    /// Speed, as a part of `speed_kmh`.
    pub speed: Option<f64>,
    /// Entry time, s to either side of `entry_time_s`.
    pub entry_s: Option<f64>,
    /// Load factor, as a part of `load_factor`, or of 1 where that is not given.
    pub load: Option<f64>,
    /// Stiffness of the whole bridge, as a part of its model's. None: held, since a warm bridge, softer everywhere by a little, is
    /// damaged a little everywhere: only what is expected of each, its prior, tells the two apart, and that must be wanted.
    pub stiffness: Option<f64>,
}

/// A recording: its samples and what is known of the passage.
#[derive(Debug, Clone, PartialEq)]
pub struct Recording {
    /// File time of the first row, s. Sample index 0 of the stream is this row.
    pub start_s: f64,
    /// Time from one sample to the next, s.
    pub interval_s: f64,
    /// Rows without a gap between them, in order; at least one.
    pub runs: Vec<Run>,
    /// The channels, 1 to 3, all of the same length.
    pub channels: Vec<Channel>,
    /// Name of the bridge; none: passages are found, nothing is identified.
    pub bridge: Option<String>,
    /// What rolled.
    pub train: Option<TrainName>,
    /// Number of its cars; there if [`Self::train`] is one that the logger knows.
    pub cars: Option<usize>,
    /// Speed, km/h; none: estimated from the passage.
    pub speed_kmh: Option<f64>,
    /// File time at which the first axle reaches node 1, s; none: estimated. [`Self::entry_in_stream_s`] is the
    /// same on the stream's clock.
    pub entry_time_s: Option<f64>,
    /// Scales the static wheel loads; none: estimated.
    pub load_factor: Option<f64>,
    /// How far off these may be.
    pub margins: Margins,
    /// Cut-off of the recorder's filter, Hz; none: no filter.
    pub antialias_hz: Option<f64>,
    /// Name of the file of the track's irregularity, from the recording's folder; none: smooth.
    pub track: Option<String>,
    /// Change of the speed, m/s².
    pub acceleration_mps2: f64,
    /// The end of the bridge that the train enters by.
    pub direction: Direction,
}

impl Recording {
    /// Reads `NAME.csv` and `NAME.toml` beside it.
    ///
    /// # Errors
    /// One sentence that names the file, and where it can the line and the column, if a file is missing or says
    /// something that cannot be so.
    pub fn read(csv_path: &Path) -> Result<Self> {
        let toml_path = description_path(csv_path)?;
        if !csv_path.exists() {
            bail!("there is no recording {}", csv_path.display());
        }
        if !toml_path.exists() {
            bail!(
                "{}: there is no {} beside it, which must name bridge, train and channels",
                csv_path.display(),
                toml_path.file_name().unwrap_or_default().display()
            );
        }
        let text =
            std::fs::read_to_string(&toml_path).with_context(|| format!("cannot read {}", toml_path.display()))?;
        let description = description::parse(&text).with_context(|| toml_path.display().to_string())?;
        table::read(csv_path, description)
    }

    /// Writes `NAME.csv` and `NAME.toml` beside it, both or none; each of `remarks` becomes a comment line of the TOML.
    pub fn write(&self, csv_path: &Path, remarks: &[String]) -> Result<()> {
        let toml_path = description_path(csv_path)?;
        let (csv, toml) = (table::text(self), description::text(self, remarks));
        output::write(&[(&toml_path, toml.as_bytes()), (csv_path, csv.as_bytes())])
    }

    /// Rows.
    pub fn rows(&self) -> usize {
        self.channels.first().map_or(0, |channel| channel.values.len())
    }

    /// Time from the first row to the last, gaps included, s.
    pub fn duration_s(&self) -> f64 {
        let last = self.runs.last().map_or(0, |run| run.first_sample + run.rows as u64 - 1);
        last as f64 * self.interval_s
    }

    /// Samples a second, Hz.
    pub fn rate_hz(&self) -> f64 {
        self.interval_s.recip()
    }

    /// Samples that are missing between the first row and the last.
    pub fn missing(&self) -> u64 {
        let samples = self.runs.last().map_or(0, |run| run.first_sample + run.rows as u64);
        samples - self.rows() as u64
    }

    /// Stream time (sample index times interval) at which the first axle reaches node 1, s, where it is known.
    pub fn entry_in_stream_s(&self) -> Option<f64> {
        self.entry_time_s.map(|entry| entry - self.start_s)
    }

    /// The raw counts of all rows as a sensor's driver delivers them: channel after channel within a sample, sample after
    /// sample; `rows x channels` of them. Row `r` of [`Run`] begins at `r x channels`.
    pub fn to_counts(&self) -> Vec<i32> {
        (0..self.rows())
            .flat_map(|row| {
                self.channels
                    .iter()
                    .map(move |channel| channel.count(channel.values[row]))
            })
            .collect()
    }
}

/// Path of the TOML beside a recording's CSV.
pub fn description_path(csv_path: &Path) -> Result<std::path::PathBuf> {
    if !csv_path
        .extension()
        .is_some_and(|extension| extension.eq_ignore_ascii_case("csv"))
    {
        bail!("{}: a recording is named by its file .csv", csv_path.display());
    }
    Ok(csv_path.with_extension("toml"))
}
