//! Keys, and what they seal.
//!
//! ```text
//! session key   = HChaCha20(HChaCha20(HChaCha20(device key, who says hello), logger's nonce), station's nonce)
//! direction key = HChaCha20(session key, "spanwatch 2 l->s" or "spanwatch 2 s->l")
//! sealed frame  = ChaCha20-Poly1305(direction key, nonce = counter, associated data = kind and counter)      RFC 8439
//! ```
//!
//! HChaCha20 (the key derivation of XChaCha20, draft-irtf-cfrg-xchacha) is a pseudorandom function of 16 bytes under a key of 32, so a
//! cascade of it is one of all that both ends have said in the clear; it is already in the image. Counters begin at 0 in every session and never return: a session ends
//! before 2³² frames. The names of the directions carry the version: an end of another version derives other keys.

use chacha20::R20;

use super::aead::{self, TAG_BYTES};
use super::packet::{Hello, NONCE_BYTES};

/// Bytes of a key.
pub const KEY_BYTES: usize = 32;
/// Frames that may come later than one that was sent after them.
const WINDOW: u32 = 64;

/// A secret key. It has no `Debug` and is not compared.
#[derive(Clone)]
pub struct Key([u8; KEY_BYTES]);

impl core::fmt::Debug for Key {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.write_str("Key(..)")
    }
}

impl Key {
    /// The key that a logger has which nobody gave one, for demonstrations. Everybody knows it.
    pub const DEMO: Self = Self(*b"SPANWATCH DEMO KEY, NOT A SECRET");

    /// A key of these bytes.
    pub const fn new(bytes: [u8; KEY_BYTES]) -> Self {
        Self(bytes)
    }

    /// Its bytes, for whoever keeps it.
    pub const fn bytes(&self) -> &[u8; KEY_BYTES] {
        &self.0
    }

    /// It is the one that everybody knows.
    pub fn is_demo(&self) -> bool {
        self.0 == Self::DEMO.0
    }

    /// The key that this one and `input` make.
    pub fn derive(&self, input: &[u8; NONCE_BYTES]) -> Self {
        Self(chacha20::hchacha::<R20>(&self.0.into(), &(*input).into()).into())
    }
}

/// The two ends of a session.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum End {
    /// The logger.
    Logger,
    /// The base station.
    Station,
}

impl End {
    const fn direction(self) -> &'static [u8; NONCE_BYTES] {
        match self {
            Self::Logger => b"spanwatch 2 l->s",
            Self::Station => b"spanwatch 2 s->l",
        }
    }

    const fn other(self) -> Self {
        match self {
            Self::Logger => Self::Station,
            Self::Station => Self::Logger,
        }
    }
}

/// Why a sealed frame was not taken.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Refused {
    /// Another key made it, or it was changed.
    Forged,
    /// It came before, or is older than the window.
    Replayed,
}

/// The keys of one session at one of its ends.
#[derive(Debug, Clone)]
pub struct Channel {
    send: Key,
    receive: Key,
    /// Number of the next frame that is sent.
    next: u32,
    /// One more than the largest number received.
    seen: u32,
    /// Bit `k`: number `seen - 1 - k` was received.
    window: u64,
}

impl Channel {
    /// The channel of `end` that the device's key, the logger's hello and the station's nonce make: a hello that was changed on its way makes
    /// none.
    pub fn new(end: End, key: &Key, hello: &Hello, station: &[u8; NONCE_BYTES]) -> Self {
        let session = key.derive(&hello.name()).derive(&hello.nonce).derive(station);
        Self {
            send: session.derive(end.direction()),
            receive: session.derive(end.other().direction()),
            next: 0,
            seen: 0,
            window: 0,
        }
    }

    /// The number of the next frame; none once they are used up, which ends the session.
    pub fn next_counter(&mut self) -> Option<u32> {
        let counter = self.next;
        self.next = self.next.checked_add(1)?;
        Some(counter)
    }

    /// A number that was taken and not used is the next one again.
    pub(super) fn give_back(&mut self, counter: u32) {
        if self.next == counter.wrapping_add(1) {
            self.next = counter;
        }
    }

    /// Encrypts in its place what goes into frame number `counter`; its tag.
    pub fn seal(&self, kind: u8, counter: u32, bytes: &mut [u8]) -> Option<[u8; TAG_BYTES]> {
        aead::seal(&self.send.0, &nonce(counter), &associated(kind, counter), bytes)
    }

    /// Decrypts in its place what came in frame number `counter`, unless it is not what the other end has sealed, or came before.
    pub fn open(&mut self, kind: u8, counter: u32, bytes: &mut [u8], tag: &[u8; TAG_BYTES]) -> Result<(), Refused> {
        // A counter is only believed, and the window moved, once the tag fits.
        let age = self.seen.checked_sub(counter.saturating_add(1));
        if age.is_some_and(|age| age >= WINDOW || self.window >> age & 1 == 1) || counter == u32::MAX {
            return Err(Refused::Replayed);
        }
        if !aead::open(&self.receive.0, &nonce(counter), &associated(kind, counter), bytes, tag) {
            return Err(Refused::Forged);
        }
        match age {
            Some(age) => self.window |= 1 << age,
            None => {
                let moved = counter + 1 - self.seen;
                self.window = self.window.checked_shl(moved).unwrap_or(0) | 1;
                self.seen = counter + 1;
            }
        }
        Ok(())
    }
}

fn nonce(counter: u32) -> [u8; aead::NONCE_BYTES] {
    let [c0, c1, c2, c3] = counter.to_le_bytes();
    [c0, c1, c2, c3, 0, 0, 0, 0, 0, 0, 0, 0]
}

fn associated(kind: u8, counter: u32) -> [u8; 5] {
    let [c0, c1, c2, c3] = counter.to_le_bytes();
    [kind, c0, c1, c2, c3]
}
