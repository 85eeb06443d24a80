//! A line in simulated time that does to frames whatever lines do.

use std::collections::BTreeMap;

use rand_core::{Rng, SeedableRng};
use rand_xoshiro::Xoshiro256PlusPlus;

/// Time that a frame takes, ms.
const DELAY_MS: u64 = 4;
/// Longest delay of one that others overtake, ms.
const LATE_MS: u64 = 40;
/// A direction that is dead stays so for this long, ms.
const DEAD_MS: u64 = 5_000;

/// What goes wrong on a line.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Fault {
    /// A frame does not arrive.
    Drop,
    /// A frame arrives twice.
    Duplicate,
    /// A frame is overtaken.
    Reorder,
    /// Bits are flipped, each frame up to eight.
    Flip,
    /// A byte is inserted, or one is missing.
    Slip,
    /// A burst of up to 600 random bytes comes between frames.
    Garbage,
    /// One direction is dead for five seconds, in the middle of a frame; twenty times more seldom than the others.
    HalfOpen,
    /// One end restarts, at any moment at which something arrives; ten times more seldom than the others. The line does not know of it.
    Reboot,
    /// All of them, each with a share of the rate.
    All,
}

impl Fault {
    /// Every single fault, and all together.
    pub const EACH: [Self; 9] = [
        Self::Drop,
        Self::Duplicate,
        Self::Reorder,
        Self::Flip,
        Self::Slip,
        Self::Garbage,
        Self::HalfOpen,
        Self::Reboot,
        Self::All,
    ];
}

/// Chance by seed.
#[derive(Debug, Clone)]
pub struct Chance(Xoshiro256PlusPlus);

impl Chance {
    /// The chances of a seed.
    pub fn new(seed: u64) -> Self {
        Self(Xoshiro256PlusPlus::seed_from_u64(seed))
    }

    /// A number below `limit`, which is at least 1.
    pub fn below(&mut self, limit: u64) -> u64 {
        self.0.next_u64() % limit.max(1)
    }

    /// True with this probability.
    pub fn happens(&mut self, probability: f64) -> bool {
        (self.0.next_u64() >> 11) as f64 * 2.0_f64.powi(-53) < probability
    }

    /// One of `all`, which are some.
    pub fn pick<T: Copy>(&mut self, all: &[T]) -> T {
        all[self.below(all.len() as u64) as usize]
    }

    /// True once in `times`.
    pub fn once_in(&mut self, times: u64) -> bool {
        self.below(times) == 0
    }

    /// Any number.
    pub fn any(&mut self) -> u64 {
        self.0.next_u64()
    }

    /// Random bytes.
    pub fn bytes(&mut self, count: usize) -> Vec<u8> {
        (0..count).map(|_| self.0.next_u64() as u8).collect()
    }
}

/// One direction of a line.
#[derive(Debug, Clone, Default)]
pub struct Line {
    /// What is under way, by arrival and order.
    under_way: BTreeMap<(u64, u64), Vec<u8>>,
    sent: u64,
    dead_until_ms: u64,
    /// Faults so far.
    pub faults: u64,
}

impl Line {
    /// Sends a frame into the line, which may do `fault` to it.
    pub fn send(&mut self, frame: &[u8], now_ms: u64, fault: Fault, rate: f64, chance: &mut Chance) {
        self.sent += 1;
        let mut bytes = frame.to_vec();
        if now_ms < self.dead_until_ms {
            return;
        }
        let single = [
            Fault::Drop,
            Fault::Duplicate,
            Fault::Reorder,
            Fault::Flip,
            Fault::Slip,
            Fault::Garbage,
        ];
        let fault = match fault {
            Fault::All => match chance.below(8) {
                6 | 7 => Fault::HalfOpen,
                n => single[n as usize],
            },
            other => other,
        };
        let rate = match fault {
            Fault::HalfOpen => rate / 20.0,
            Fault::Reboot => 0.0,
            _ => rate,
        };
        let mut delay_ms = DELAY_MS;
        if chance.happens(rate) {
            self.faults += 1;
            match fault {
                Fault::Drop => return,
                Fault::Duplicate => {
                    let again = now_ms + DELAY_MS + chance.below(LATE_MS);
                    self.under_way.insert((again, self.sent << 1 | 1), bytes.clone());
                }
                Fault::Reorder => delay_ms += chance.below(LATE_MS),
                Fault::Flip => {
                    for _ in 0..=chance.below(8) {
                        let bit = chance.below(8 * bytes.len() as u64) as usize;
                        bytes[bit / 8] ^= 1 << (bit % 8);
                    }
                }
                Fault::Slip => {
                    let place = chance.below(bytes.len() as u64) as usize;
                    if chance.below(2) == 0 {
                        bytes.insert(place, chance.below(256) as u8);
                    } else {
                        bytes.remove(place);
                    }
                }
                Fault::Garbage => {
                    let length = chance.below(600) as usize;
                    bytes.extend(chance.bytes(length));
                }
                Fault::HalfOpen => {
                    bytes.truncate(chance.below(bytes.len() as u64) as usize);
                    self.dead_until_ms = now_ms + DEAD_MS;
                }
                Fault::Reboot | Fault::All => {}
            }
        }
        self.under_way.insert((now_ms + delay_ms, self.sent << 1), bytes);
    }

    /// What has arrived by now, in order.
    pub fn arrived(&mut self, now_ms: u64) -> Option<Vec<u8>> {
        let first = self.under_way.first_entry()?;
        (first.key().0 <= now_ms).then(|| first.remove())
    }

    /// When the next arrives.
    pub fn next_ms(&self) -> Option<u64> {
        self.under_way.first_key_value().map(|(&(at, _), _)| at)
    }
}
