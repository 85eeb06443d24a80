//! What all passages together say of the bridge, in constant memory.
//!
//! Independent passages add: the sum of their informations ([`Information`]) is the least-squares solution of all of
//! them at once. Two sums are kept, a *recent* and a *long* memory, and no passage is twice in them: what the recent one
//! forgets the long one learns.
//!
//! ```text
//! recent <- recent - q recent + passage        q = 1 - exp(-1 / N_recent)
//! long   <- long - p long + q recent           p = 1 - exp(-1 / N_long)
//! all    =  long + recent
//! ```
//!
//! In equilibrium `all` weighs `N_long + N_recent` passages. A slow loss is followed with the lag
//! `(N_recent^2 + N_long (N_long + N_recent)) / (N_long + N_recent)` passages, the mean age of what is remembered.
//!
//! **Sudden changes.** If the recent memory contradicts the long one beyond doubt, the bridge that the long one knows is
//! no more: it is emptied, the recent one stands alone ([`Change::Sudden`]), and the long one learns again once the recent one
//! has forgotten the old bridge (three `N_recent`, 5 % left). Until then the estimate still mixes a part of the old bridge in.
//! What counts as contradiction: with `R`, `L` the matrices of the two memories, `x` their joint estimate and
//! `r = b_R - R x = -(b_L - L x)`,
//!
//! ```text
//! chi^2 = (x_R - x_L)^T (R^-1 + L^-1)^-1 (x_R - x_L) = r^T R^-1 r + r^T L^-1 r
//! ```
//!
//! Without a change it is at most as large as a chi-square of as many degrees of freedom as there are elements: a passage
//! of covariance `A^-1` in the memories with the weights `u` and `v` adds, seen along any direction `c` with `y = R^-1 c`,
//! `z = L^-1 c`, the variance `(u y - v z)^T A (u y - v z) <= (u^2 + u v) y^T A y + (v^2 + u v) z^T A z`, and `u + v <= 1` makes this
//! at most its share of `c^T (R^-1 + L^-1) c`. Beyond `k + 2 (k t)^1/2 + 2 t` a chi-square of `k` degrees lies with a probability below
//! `exp(-t)` (Laurent and Massart, Annals of Statistics 28, 2000, Lemma 1). `t = ln(200 * 365 * 1000)`: at 200 passages a day, one
//! false alarm in more than a thousand years, provided that the passages' covariances are true. For ten elements the limit is 73.
//! The rounding of the sums is counted as noise: in a direction of which the passages say nothing, it would contradict itself.
//!
//! **Strangers.** A passage that contradicts all before it by the same measure (another train than was believed, a sensor
//! knocked) is told as [`Change::Outlier`] and kept aside. If the next one contradicts as well and agrees with it, the two are
//! the new beginning: [`Change::Sudden`]. Else it is forgotten. Two equal strangers in a row are therefore believed; and
//! if the passages' covariances are too small by far, none agrees with any other and nothing is learned any more. The caller
//! sees both, in the changes that are told.
//!
//! **References.** With another learnt track the memories begin anew, since an error of the old one is in all that they say. What was
//! known by it is kept beside them ([`Evidence::retire`]), as uncertain as that track was, until passages on the new one contradict it.
//! Where the rails have changed so little that passages were believed meanwhile, the recent memory is given up: these passages are in it.
//!
//! **Precision.** The sums are `f32`: each addition rounds by `6e-8` of the sum at most, so a memory of `N` passages is off by `3e-8 N`
//! at the very worst and `3e-8 N^1/2` as a rule. With some 1e7 passages nothing that never forgets still learns.
//!
//! **Bytes.** As the bridge's model ([`crate::bridge::blob`]):
//!
//! ```text
//! "SWEV" | format version u8 | fingerprint of the bridge's blob u32, of the track's u32 | postcard of Layout | CRC-32C of all before
//! ```
//!
//! all little endian. How uncertain the track was goes with them, so that a logger that goes on with another track keeps what was
//! known by this one as if it had been retired. So does the memory of the track's [`Watch`], by the same track only.
//!
//! Cost: 1.9 kB; 1312 bytes written; about 7 kB of stack and ten factors of the matrix a passage.

use core::fmt;

use heapless::Vec;
use serde::{Deserialize, Serialize};

use super::estimate::{Estimate, Information};
use crate::capacity::ELEMENTS;
use crate::math::{self, Real};
use crate::track::learnt::{self, LearntTrack, Spread, TRIANGLE, UNLEARNT};
use crate::track::watch::Watch;
use crate::wire::CRC32C;

/// Version of the layout; a reader accepts its own only.
pub const FORMAT_VERSION: u8 = 3;
/// Bytes of an [`Evidence`] as written by [`Evidence::to_bytes`].
pub const EVIDENCE_BYTES: usize =
    HEAD_BYTES + 4 * (1 + 4 * PACKED) + 5 * 4 + (1 + 4 * TRIANGLE) + WATCH_BYTES + CRC_BYTES;
const MAGIC: [u8; 4] = *b"SWEV";
const HEAD_BYTES: usize = MAGIC.len() + 1 + 4 + 4;
const CRC_BYTES: usize = 4;
/// Two numbers, a count and whether.
const WATCH_BYTES: usize = 4 + 4 + 1 + 1;
/// Numbers of an information: a triangle and a vector.
const PACKED: usize = ELEMENTS * (ELEMENTS + 1) / 2 + ELEMENTS;
/// `ln(200 * 365 * 1000)`: passages in a thousand years, of which one may be a false alarm.
const FALSE_ALARM: f32 = 18.106;
/// The long memory learns again when the recent one is so many times its own length away from the change.
const SETTLING: f32 = 3.0;
/// Part of its terms by which a passage's vector is off because it is a sum of thousands of samples in `f32`, ...
const PASSAGE_ROUNDING: f32 = 1e-6;
/// ... and by which one addition of a memory is; these add up like chance.
const SUM_ROUNDING: f32 = 6e-8;
/// Shortest memory, passages.
const SHORTEST: f32 = 1.0;

/// Why an evidence was refused.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum EvidenceError {
    /// A memory is shorter than a passage, or the recent one not shorter than the long one.
    Forgetting,
    /// Cut off, or bytes too many.
    Length,
    /// The first bytes are not those of an evidence.
    NotEvidence,
    /// Another version of the format.
    Version {
        /// The version found.
        found: u8,
    },
    /// It is about another bridge, or another model of it.
    Bridge,
    /// The checksum does not fit: the bytes were changed.
    Checksum,
    /// The numbers are no sum of passages.
    Contents,
}

impl fmt::Display for EvidenceError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Forgetting => f.write_str(
                "a memory must be one passage at least (0: never forget), the recent one shorter than the long one",
            ),
            Self::Length => f.write_str("the evidence is cut off or too long; begin anew"),
            Self::NotEvidence => f.write_str("these bytes are not an evidence; begin anew"),
            Self::Version { found } => write!(
                f,
                "the evidence has format version {found}, this program reads version {FORMAT_VERSION}; begin anew"
            ),
            Self::Bridge => f.write_str(
                "the evidence is about another bridge or another model of it; load that model or begin anew",
            ),
            Self::Checksum => {
                f.write_str("the evidence's checksum is wrong: bytes were changed; use an older copy or begin anew")
            }
            Self::Contents => f.write_str("the evidence is not believable; use an older copy or begin anew"),
        }
    }
}

impl core::error::Error for EvidenceError {}

/// How fast the memories fade.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Forgetting {
    long: f32,
    recent: f32,
}

impl Forgetting {
    /// Nothing is forgotten, and no change noticed but one that two passages in a row show.
    pub const NEVER: Self = Self { long: 0.0, recent: 0.0 };

    /// Memories that fade by `exp(-1)` in so many passages; 0 or infinity: never. The recent one must be the shorter.
    pub const fn new(long: f32, recent: f32) -> Result<Self, EvidenceError> {
        let long_never = long == 0.0 || long == f32::INFINITY;
        let recent_never = recent == 0.0 || recent == f32::INFINITY;
        let sound = match (long_never, recent_never) {
            (true, true) => true,
            (true, false) => recent >= SHORTEST,
            (false, true) => false,
            (false, false) => recent >= SHORTEST && recent < long,
        };
        if sound {
            Ok(Self { long, recent })
        } else {
            Err(EvidenceError::Forgetting)
        }
    }

    /// Passages in which the long memory fades.
    pub const fn long(&self) -> f32 {
        self.long
    }

    /// Passages in which the recent memory fades.
    pub const fn recent(&self) -> f32 {
        self.recent
    }
}

/// Part of a memory of so many passages that goes with each.
fn share(passages: f32) -> f32 {
    if passages > 0.0 {
        -(-1.0 / passages).exp_m1_exact()
    } else {
        0.0
    }
}

/// What a passage changed in what is believed of the bridge.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Change {
    /// It agrees with those before.
    None,
    /// It contradicts those before, and is kept aside until a second one agrees.
    Outlier,
    /// The bridge has changed: what was known before is given up.
    Sudden,
    /// It is no information (not finite, not positive semidefinite, or empty), and was left out.
    Unusable,
}

/// What an evidence rests on.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Basis<'a> {
    /// [`fingerprint`](crate::wire::fingerprint) of the blob of the bridge's model.
    pub bridge: u32,
    /// That of the blob of the learnt track; 0 where none was learnt.
    pub track: u32,
    /// How uncertain that track is.
    pub spread: &'a Spread,
}

/// A sum of passages.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Memory {
    information: Information,
    /// Effective number of passages.
    passages: f32,
}

impl Memory {
    const EMPTY: Self = Self {
        information: Information::ZERO,
        passages: 0.0,
    };

    /// `to += share from; from -= share from`.
    fn pass(&mut self, share: f32, to: Option<&mut Self>) {
        let Some(to) = to else {
            return self.each(|value| *value -= share * *value);
        };
        let matrices = (self.information.matrix.iter_mut()).zip(to.information.matrix.iter_mut());
        let vectors = (self.information.vector.iter_mut()).zip(to.information.vector.iter_mut());
        let counts = core::iter::once((&mut self.passages, &mut to.passages));
        for (from, to) in matrices.chain(vectors).chain(counts) {
            let moved = share * *from;
            *from -= moved;
            *to += moved;
        }
    }

    fn each(&mut self, mut change: impl FnMut(&mut f32)) {
        self.information.matrix.iter_mut().for_each(&mut change);
        self.information.vector.iter_mut().for_each(&mut change);
        change(&mut self.passages);
    }

    fn plus(&self, other: &Self) -> Self {
        Self {
            information: self.information.plus(&other.information),
            passages: self.passages + other.passages,
        }
    }
}

/// What all passages say of a bridge.
#[derive(Debug, Clone, PartialEq)]
pub struct Evidence {
    forgetting: Forgetting,
    long: Memory,
    recent: Memory,
    /// Passages until the long memory learns again.
    settling: f32,
    /// The last passage, if it contradicted all before it.
    stranger: Option<Memory>,
    /// What is known by earlier references of the track.
    earlier: Memory,
}

/// What is kept of an evidence by a track that is no more.
#[derive(Debug, Clone)]
pub struct Retired(Memory);

impl Retired {
    /// Nothing is kept.
    pub const NOTHING: Self = Self(Memory::EMPTY);
}

impl Evidence {
    /// No passage yet.
    pub const fn new(forgetting: Forgetting) -> Self {
        Self {
            forgetting,
            long: Memory::EMPTY,
            recent: Memory::EMPTY,
            settling: 0.0,
            stranger: None,
            earlier: Memory::EMPTY,
        }
    }

    /// How fast it forgets.
    pub fn forgetting(&self) -> Forgetting {
        self.forgetting
    }

    /// Takes what one passage says. It must be independent of those before, and its covariance true.
    pub fn add(&mut self, passage: &Information) -> Change {
        let passage = Memory {
            information: passage.mirrored(),
            passages: 1.0,
        };
        if !passage.information.is_information() || !passage.information.known().contains(&true) {
            return Change::Unusable;
        }
        if contradict(&passage, &self.long.plus(&self.recent)) {
            let again = self.stranger.filter(|stranger| !contradict(&passage, stranger));
            let Some(first) = again else {
                self.stranger = Some(passage);
                return Change::Outlier;
            };
            self.recent = first.plus(&passage);
            self.long = Memory::EMPTY;
            self.settling = 0.0;
            self.stranger = None;
            self.earlier = Memory::EMPTY;
            return Change::Sudden;
        }
        self.stranger = None;
        self.long.pass(share(self.forgetting.long), None);
        let learns = self.settling <= 0.0;
        self.recent
            .pass(share(self.forgetting.recent), learns.then_some(&mut self.long));
        self.recent = self.recent.plus(&passage);
        self.settling = (self.settling - 1.0).max(0.0);
        for memory in [&mut self.long, &mut self.recent] {
            memory.information.forget_faded();
        }
        if contradict(&self.recent, &self.long) {
            self.long = Memory::EMPTY;
            self.earlier = Memory::EMPTY;
            self.settling = SETTLING * self.forgetting.recent;
            return Change::Sudden;
        }
        Change::None
    }

    /// All that is remembered.
    pub fn information(&self) -> Information {
        self.long.information.plus(&self.recent.information)
    }

    /// All that is known of the bridge: what is remembered, by the track as it was learnt, and what was known by earlier ones.
    pub fn against(&self, track: &LearntTrack) -> Information {
        self.earlier.information.plus(&track.relative(&self.information()))
    }

    /// Another track is learnt: what is remembered by this one is kept with the weight that it has by it, and the memories begin anew.
    pub fn retire(&mut self, track: &LearntTrack) {
        let known = self.retired(track);
        self.begin_anew(known);
    }

    /// What [`Self::retire`] keeps, before it is known whether there is another track.
    pub fn retired(&self, track: &LearntTrack) -> Retired {
        self.retired_by(&track.spread)
    }

    // Not inlined: what weighs it must leave the stack.
    #[inline(never)]
    fn retired_by(&self, spread: &Spread) -> Retired {
        let by_this = learnt::relative(spread, &self.information());
        let information = self.earlier.information.plus(&by_this);
        // Of a track that is uncertain beyond numbers nothing is known.
        if !information.is_information() || !information.known().contains(&true) {
            return Retired::NOTHING;
        }
        Retired(Memory {
            information,
            passages: self.passages(),
        })
    }

    /// The memories begin anew; `known` is kept beside them.
    pub fn begin_anew(&mut self, known: Retired) {
        self.long = Memory::EMPTY;
        self.recent = Memory::EMPTY;
        self.settling = 0.0;
        self.stranger = None;
        self.earlier = known.0;
    }

    /// The rails have been changing for some passages that were believed: forgets what the recent memory holds.
    pub fn forget_recent(&mut self) {
        self.recent = Memory::EMPTY;
        self.stranger = None;
    }

    /// Gives up what was known by earlier tracks, if what is remembered by this one contradicts it; tells whether it did.
    pub fn outlive(&mut self, track: &LearntTrack) -> bool {
        let now = Memory {
            information: track.relative(&self.information()),
            passages: self.long.passages + self.recent.passages,
        };
        let outlived = contradict(&now, &self.earlier);
        if outlived {
            self.earlier = Memory::EMPTY;
        }
        outlived
    }

    /// The losses of a bridge of so many elements that explain all that is remembered best, the track being known.
    pub fn estimate(&self, elements: usize) -> Estimate {
        self.against(&UNLEARNT).estimate(elements)
    }

    /// Effective number of passages that are remembered.
    pub fn passages(&self) -> f32 {
        self.long.passages + self.recent.passages + self.earlier.passages
    }

    /// Writes it and the `watch` of its track into `buffer` and returns the part of it that is used, [`EVIDENCE_BYTES`]; none if there is no
    /// room.
    pub fn to_bytes<'b>(&self, basis: &Basis<'_>, watch: Watch, buffer: &'b mut [u8]) -> Option<&'b [u8]> {
        let layout = Layout {
            long: pack(&self.long.information),
            recent: pack(&self.recent.information),
            stranger: pack(&self.stranger.unwrap_or(Memory::EMPTY).information),
            earlier: pack(&self.earlier.information),
            passages: [
                self.long.passages,
                self.recent.passages,
                self.stranger.map_or(0.0, |stranger| stranger.passages),
                self.earlier.passages,
            ],
            settling: self.settling,
            spread: learnt::pack(basis.spread),
            watch,
        };
        let (head, rest) = buffer.split_first_chunk_mut::<HEAD_BYTES>()?;
        let [m0, m1, m2, m3] = MAGIC;
        let [b0, b1, b2, b3] = basis.bridge.to_le_bytes();
        let [t0, t1, t2, t3] = basis.track.to_le_bytes();
        *head = [m0, m1, m2, m3, FORMAT_VERSION, b0, b1, b2, b3, t0, t1, t2, t3];
        let body = postcard::to_slice(&layout, rest).ok()?.len();
        let end = HEAD_BYTES + body;
        let crc = CRC32C.checksum(buffer.get(..end)?).to_le_bytes();
        buffer.get_mut(end..end + CRC_BYTES)?.copy_from_slice(&crc);
        buffer.get(..end + CRC_BYTES)
    }

    /// Reads and checks what [`Self::to_bytes`] wrote for the same bridge. What was gathered by another learnt track comes back
    /// [retired](Self::retire) and without its watch; what was gathered without one is dropped where there is one now, as it took the rails
    /// for smooth.
    pub fn from_bytes(
        bytes: &[u8],
        basis: &Basis<'_>,
        forgetting: Forgetting,
    ) -> Result<(Self, Option<Watch>), EvidenceError> {
        let (head, _) = bytes.split_first_chunk::<HEAD_BYTES>().ok_or(EvidenceError::Length)?;
        let [m0, m1, m2, m3, version, b0, b1, b2, b3, t0, t1, t2, t3] = *head;
        if [m0, m1, m2, m3] != MAGIC {
            return Err(EvidenceError::NotEvidence);
        }
        if version != FORMAT_VERSION {
            return Err(EvidenceError::Version { found: version });
        }
        if bytes.len() != EVIDENCE_BYTES {
            return Err(EvidenceError::Length);
        }
        let (checked, crc) = bytes.split_last_chunk::<CRC_BYTES>().ok_or(EvidenceError::Length)?;
        if CRC32C.checksum(checked).to_le_bytes() != *crc {
            return Err(EvidenceError::Checksum);
        }
        if u32::from_le_bytes([b0, b1, b2, b3]) != basis.bridge {
            return Err(EvidenceError::Bridge);
        }
        let body = checked.get(HEAD_BYTES..).ok_or(EvidenceError::Length)?;
        let (layout, rest) = postcard::take_from_bytes::<Layout>(body).map_err(|_| EvidenceError::Contents)?;
        let memory = |packed, passages: f32| {
            let information = unpack(packed).filter(Information::is_information);
            let sound = (0.0..=f32::MAX).contains(&passages);
            // No passages, no information.
            let empty = information.is_some_and(|information| information == Information::ZERO);
            let memory = information.map(|information| Memory { information, passages });
            memory
                .filter(|_| sound && empty == (passages == 0.0))
                .ok_or(EvidenceError::Contents)
        };
        let [long, recent, stranger, earlier] = layout.passages;
        let spread = learnt::unpack(&layout.spread).ok_or(EvidenceError::Contents)?;
        if !rest.is_empty() || !(0.0..=f32::MAX).contains(&layout.settling) || !layout.watch.is_sound() {
            return Err(EvidenceError::Contents);
        }
        let mut evidence = Self {
            forgetting,
            long: memory(&layout.long, long)?,
            recent: memory(&layout.recent, recent)?,
            settling: layout.settling,
            stranger: Some(memory(&layout.stranger, stranger)?).filter(|stranger| stranger.passages > 0.0),
            earlier: memory(&layout.earlier, earlier)?,
        };
        let mut watch = None;
        match u32::from_le_bytes([t0, t1, t2, t3]) {
            track if track == basis.track => watch = Some(layout.watch),
            0 => evidence = Self::new(forgetting),
            _ => {
                let known = evidence.retired_by(&spread);
                evidence.begin_anew(known);
            }
        }
        Ok((evidence, watch))
    }
}

/// Whether two memories contradict each other beyond doubt.
///
/// Never if one of them is empty, or the numbers are none.
fn contradict(a: &Memory, b: &Memory) -> bool {
    let known = a.information.known().into_iter().zip(b.information.known());
    let both = known.filter(|&(a, b)| a && b).count();
    let degrees = both as f32;
    let limit = degrees + 2.0 * math::sqrt(degrees * FALSE_ALARM) + 2.0 * FALSE_ALARM;
    both > 0 && contradiction(a, b).is_some_and(|chi_squared| chi_squared > limit)
}

/// The chi-square of the module's doc, with the rounding of the sums as a part of the noise.
fn contradiction(a: &Memory, b: &Memory) -> Option<f32> {
    let together = a.information.plus(&b.information).centre()?;
    let rounding = PASSAGE_ROUNDING * PASSAGE_ROUNDING + SUM_ROUNDING * SUM_ROUNDING * (a.passages + b.passages);
    let part = |information: &Information| {
        let ridge = rounding * information.size(&together);
        information.length_squared(&information.slope(&together), ridge)
    };
    Some(part(&a.information)? + part(&b.information)?)
}

/// The fields in the order in which they are written.
#[derive(Serialize, Deserialize)]
struct Layout {
    long: Vec<f32, PACKED>,
    recent: Vec<f32, PACKED>,
    stranger: Vec<f32, PACKED>,
    earlier: Vec<f32, PACKED>,
    passages: [f32; 4],
    settling: f32,
    /// Of the track.
    spread: Vec<f32, TRIANGLE>,
    watch: Watch,
}

/// The lower triangle, row by row, and the vector.
fn pack(information: &Information) -> Vec<f32, PACKED> {
    let rows = (0..ELEMENTS).flat_map(|i| (0..=i).map(move |j| information.matrix[(i, j)]));
    rows.chain(information.vector.iter().copied()).take(PACKED).collect()
}

/// None if there are too few numbers.
fn unpack(packed: &[f32]) -> Option<Information> {
    let mut information = Information::ZERO;
    let mut values = packed.iter().copied();
    for i in 0..ELEMENTS {
        for j in 0..=i {
            let value = values.next()?;
            information.matrix[(i, j)] = value;
            information.matrix[(j, i)] = value;
        }
    }
    for entry in information.vector.iter_mut() {
        *entry = values.next()?;
    }
    Some(information)
}
