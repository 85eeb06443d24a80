//! A session between logger and base station: who the other is, what is fresh, and what has arrived.
//!
//! ```text
//! base station                                       logger
//!   | knock (clear) ----------------------------------> |   "who are you?", whenever it knows of no session
//!   | <---------------------------------- hello (clear) |   device, key, nonce of the logger
//!   | welcome (nonce; sealed) ------------------------> |   proves the base station: only it can seal by both nonces
//!   | <----------------------------- heartbeat (sealed) |   proves the logger: now both are sure
//!   | <-------------------- parcels, answers (sealed)   |
//!   | receipts, requests, time (sealed) --------------> |
//! ```
//!
//! Two state machines that know no line, clock or memory but what they are given: [`LoggerEnd`] and [`StationEnd`]. Frames go in, frames
//! come out, time is a number.
//!
//! - **Keys** ([`seal`]): one a device, by a number, so that it can be replaced; from it, all that the hello says and a fresh nonce of the
//!   station's, one for each direction: a hello that was changed on its way makes no session.
//! - **Freshness**: frames are counted; one that came before, or is 64 behind the newest, is refused. Nothing in the clear changes
//!   anything but that a knock is answered by a hello (two a second at most, and never longer than the knock), and a hello by a welcome.
//!   The old session stays until a frame has come that only the true other end can have sealed for the new one.
//! - **Delivery**: parcels go in the order of their numbers, [`WINDOW`] at most without a receipt. If nothing is confirmed in time, all go
//!   again, each time after twice as long. The base station takes only the one that follows what it has
//!   ([`StationEnd::on_frame`]), and confirms after it is on disk.
//! - **Life**: a heartbeat every [`HEARTBEAT_MS`], answered by the time; if three are not, the logger says hello again.
//!
//! No forward secrecy: who learns a device's key can read what was recorded before.

pub mod packet;
pub mod seal;

mod aead;
mod logger_end;
mod station_end;

pub use logger_end::{LoggerEnd, Parcels, ToLogger};
pub use packet::{Device, Hello};
pub use seal::{Channel, End, Key};
pub use station_end::{StationEnd, ToStation};

/// Parcels that are sent without a receipt.
pub const WINDOW: usize = 8;
/// Time between heartbeats, ms.
pub const HEARTBEAT_MS: u64 = 10_000;
/// Heartbeats without an answer, or any other frame, after which a session is over.
const LOST_HEARTBEATS: u64 = 3;
/// Time within which a receipt is expected at first, ms.
const FIRST_RESEND_MS: u64 = 1000;
/// Time between two hellos at first, ms.
const FIRST_HELLO_MS: u64 = 1000;
/// Longest such time, ms: while there is a session, heartbeats go as often.
const LONGEST_RESEND_MS: u64 = 8_000;
/// Longest time between two hellos, ms.
const LONGEST_HELLO_MS: u64 = 60_000;
/// Knocks are answered, and made, no more often than this, ms.
const KNOCK_MS: u64 = 500;

/// A time that grows with each try.
#[derive(Debug, Clone, Copy)]
struct BackOff {
    at_ms: u64,
    step_ms: u64,
    first_ms: u64,
    longest_ms: u64,
}

impl BackOff {
    /// Due at once, then after so long.
    const fn due(first_ms: u64, longest_ms: u64) -> Self {
        Self {
            at_ms: 0,
            step_ms: first_ms,
            first_ms,
            longest_ms,
        }
    }

    const HELLO: Self = Self::due(FIRST_HELLO_MS, LONGEST_HELLO_MS);
    const RESEND: Self = Self::due(FIRST_RESEND_MS, LONGEST_RESEND_MS);

    fn is_due(&self, now_ms: u64) -> bool {
        now_ms >= self.at_ms
    }

    /// A try was made: the next comes after twice as long as the last.
    fn tried(&mut self, now_ms: u64) {
        self.at_ms = now_ms.saturating_add(self.step_ms);
        self.step_ms = self.step_ms.saturating_mul(2).min(self.longest_ms);
    }

    /// It went well: begin again.
    fn reset(&mut self, now_ms: u64) {
        self.step_ms = self.first_ms;
        self.at_ms = now_ms.saturating_add(self.first_ms);
    }
}
