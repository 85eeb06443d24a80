//! What the two ends of a session say to each other about the session itself.

use heapless::Vec;
use serde::{Deserialize, Serialize};

use crate::wire::message::{Health, Restart, SetupState};

/// Bytes of a nonce.
pub const NONCE_BYTES: usize = 16;
/// Number by which a logger's device is known.
pub type Device = u32;

/// The first frames are as long as the longest of them, so that nobody gets more bytes out of an end than it has put in.
pub(super) const BRING_UP_BYTES: usize = 64;

/// The base station to a logger, in the clear: say who you are. Proves nothing, and changes nothing that exists.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Knock;

/// The logger to the base station, in the clear.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Hello {
    /// Which logger.
    pub device: Device,
    /// By which of its keys.
    pub key: u8,
    /// The name of its series of numbers; 0: it has none yet.
    pub stream: u32,
    /// Never the same twice: starts, sessions since the start, and what else the board can give.
    pub nonce: [u8; NONCE_BYTES],
}

/// The base station's answer: its nonce in the clear, the rest sealed by the keys that the two nonces make.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct Welcome {
    /// The name of the logger's series of numbers, as it was, or a new one.
    pub stream: u32,
    /// Everything up to this number of that series is on disk.
    pub stored: u32,
    /// The base station's clock, ms since 1970.
    pub time_ms: u64,
}

/// Everything up to this number is on disk.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct Receipt {
    /// The number.
    pub stored: u32,
}

/// How the logger is.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Heartbeat {
    /// Time since its start, ms.
    pub uptime_ms: u64,
    /// Starts so far.
    pub starts: u32,
    /// What the base station has confirmed, as far as the logger knows.
    pub acknowledged: u32,
    /// The rest, which the link does not need.
    pub vitals: Vitals,
}

/// The logger's state of health.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Vitals {
    /// State of the board.
    pub health: Health,
    /// What it has kept, and watches with.
    pub setup: SetupState,
    /// Passages since the start.
    pub passages: u32,
    /// Alerts since the start.
    pub alerts: u32,
    /// Alerts that wait.
    pub alerts_waiting: u32,
    /// Reports that wait.
    pub reports_waiting: u32,
    /// Part of the outbox that they fill, per mille.
    pub fill_permille: u16,
    /// Alerts dropped for lack of room, ever.
    pub alerts_dropped: u32,
    /// Reports dropped for lack of room, ever.
    pub reports_dropped: u32,
    /// Messages that the flash has not kept, since the start.
    pub unreadable: u32,
    /// Erasures of the flash's most worn sector.
    pub wear: u32,
    /// Frames refused, in the order of [`crate::wire::Rejections`]: too long, too short, checksum, version, kind, length, payload.
    pub rejections: Vec<u32, 7>,
    /// Sealed frames that were refused: wrong key or changed.
    pub forged: u32,
    /// Sealed frames that came again, or too late.
    pub replayed: u32,
    /// Frames that only count sealed and came in the clear.
    pub unsealed: u32,
    /// The base station's clock less the logger's uptime, ms, as far as it is known.
    pub clock_offset_ms: Option<i64>,
}

impl Vitals {
    /// Why the logger started.
    pub fn restart(&self) -> Restart {
        self.health.restart
    }
}

/// The base station's answer to a heartbeat.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct Time {
    /// The heartbeat's uptime.
    pub uptime_ms: u64,
    /// The base station's clock when it came, ms since 1970.
    pub time_ms: u64,
}

impl Hello {
    /// Device, key and series, as they go into the session's keys.
    pub(super) fn name(&self) -> [u8; NONCE_BYTES] {
        let [d0, d1, d2, d3] = self.device.to_le_bytes();
        let [s0, s1, s2, s3] = self.stream.to_le_bytes();
        [d0, d1, d2, d3, self.key, s0, s1, s2, s3, 0, 0, 0, 0, 0, 0, 0]
    }

    pub(super) fn to_bytes(self) -> [u8; BRING_UP_BYTES] {
        let mut bytes = [0; BRING_UP_BYTES];
        let parts = (self.device.to_le_bytes().into_iter())
            .chain([self.key])
            .chain(self.stream.to_le_bytes())
            .chain(self.nonce);
        bytes.iter_mut().zip(parts).for_each(|(place, byte)| *place = byte);
        bytes
    }

    /// Reads what came in the clear.
    pub fn from_bytes(bytes: &[u8]) -> Option<Self> {
        let bytes: &[u8; BRING_UP_BYTES] = bytes.try_into().ok()?;
        let (device, rest) = bytes.split_first_chunk::<4>()?;
        let (&key, rest) = rest.split_first()?;
        let (stream, rest) = rest.split_first_chunk::<4>()?;
        let (nonce, _) = rest.split_first_chunk::<NONCE_BYTES>()?;
        Some(Self {
            device: u32::from_le_bytes(*device),
            key,
            stream: u32::from_le_bytes(*stream),
            nonce: *nonce,
        })
    }
}
