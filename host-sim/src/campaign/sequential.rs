//! The queue of the crate `sequential-storage` under the same power cuts, to show why the outbox does not rest on it.
//!
//! Each item is a message with its number before it. Its flash may program words twice, which that queue needs and the outbox does not.

use std::pin::pin;
use std::task::{Context, Poll, Waker};

use embedded_storage::nor_flash::{ErrorType, NorFlash as Blocking, ReadNorFlash as BlockingRead};
use embedded_storage_async::nor_flash::{MultiwriteNorFlash, NorFlash, ReadNorFlash};
use sequential_storage::Error;
use sequential_storage::cache::{Cache, Uncached};
use sequential_storage::queue::{QueueConfig, QueueStorage};
use spanwatch::outbox::{Class, Ledger};

use super::power::{self, Cut, Refused, Row, Store, TEARS};
use crate::flash::{FlashFault, SimulatedFlash, Tear};

/// Longest item: a number and the longest message or evidence.
const ITEM_BYTES: usize = 512;

/// The simulated flash behind the asynchronous traits; no operation ever waits.
#[derive(Clone)]
pub struct NeverWaits<const WORD: usize>(SimulatedFlash<WORD, 512>);

impl<const WORD: usize> ErrorType for NeverWaits<WORD> {
    type Error = FlashFault;
}

impl<const WORD: usize> ReadNorFlash for NeverWaits<WORD> {
    const READ_SIZE: usize = 1;

    async fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), FlashFault> {
        self.0.read(offset, bytes)
    }

    fn capacity(&self) -> usize {
        self.0.capacity()
    }
}

impl<const WORD: usize> NorFlash for NeverWaits<WORD> {
    const WRITE_SIZE: usize = WORD;
    const ERASE_SIZE: usize = 512;

    async fn erase(&mut self, from: u32, to: u32) -> Result<(), FlashFault> {
        self.0.erase(from, to)
    }

    async fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), FlashFault> {
        self.0.write(offset, bytes)
    }
}

impl<const WORD: usize> MultiwriteNorFlash for NeverWaits<WORD> {}

impl<const WORD: usize> Cut for NeverWaits<WORD> {
    fn fresh(tear: Tear, seed: u64) -> Self {
        let mut flash = SimulatedFlash::fresh(tear, seed);
        flash.allow_second_write();
        Self(flash)
    }

    fn cut_after(&mut self, bytes: u64, seed: u64) {
        Cut::cut_after(&mut self.0, bytes, seed);
    }

    fn restore(&mut self) {
        self.0.restore();
    }

    fn touched(&self) -> u64 {
        self.0.touched()
    }
}

/// A queue of `sequential-storage`, and what the outbox would keep beside it.
#[derive(Clone)]
pub struct Queue<const WORD: usize> {
    flash: NeverWaits<WORD>,
    last: u32,
}

/// Cuts the queue at least `cuts` times in all, evenly over words of 1 and 4 bytes and over [`TEARS`]; `done` hears of each row.
pub fn run(cuts: u64, seed: u64, mut done: impl FnMut(&Row)) -> Vec<Row> {
    let share = cuts.div_ceil(2 * TEARS.len() as u64);
    let mut rows = vec![];
    for tear in TEARS {
        for row in [
            power::row::<Queue<1>>(1, tear, share, seed),
            power::row::<Queue<4>>(4, tear, share, seed),
        ] {
            done(&row);
            rows.push(row);
        }
    }
    rows
}

/// The result of a future that never waits.
fn now<T>(future: impl Future<Output = T>) -> T {
    match pin!(future).poll(&mut Context::from_waker(Waker::noop())) {
        Poll::Ready(result) => result,
        Poll::Pending => unreachable!("no operation of the simulated flash waits"),
    }
}

impl<const WORD: usize> Queue<WORD> {
    fn queue(&mut self) -> QueueStorage<&mut NeverWaits<WORD>, Cache<Uncached, Uncached, Uncached>> {
        let range = 0..self.flash.capacity() as u32;
        QueueStorage::new(&mut self.flash, QueueConfig::new(range), Cache::new_uncached())
    }

    /// All items; those up to `forget` are popped.
    fn walk(&mut self, forget: u32) -> Option<Vec<(u32, Vec<u8>)>> {
        now(async {
            let mut items = vec![];
            let mut buffer = [0; ITEM_BYTES];
            let mut queue = self.queue();
            let mut iterator = queue.iter().await.ok()?;
            while let Some(entry) = iterator.next(&mut buffer).await.ok()? {
                let (number, payload) = entry.split_first_chunk::<4>()?;
                let number = u32::from_le_bytes(*number);
                items.push((number, payload.to_vec()));
                if number <= forget {
                    entry.pop().await.ok()?;
                }
            }
            Some(items)
        })
    }
}

impl<const WORD: usize> Store for Queue<WORD> {
    type Flash = NeverWaits<WORD>;
    const COMPLETE: bool = false;

    fn open(flash: Self::Flash) -> Option<Self> {
        let mut queue = Self { flash, last: 0 };
        let items = queue.walk(0)?;
        queue.last = items.iter().map(|(number, _)| *number).max().unwrap_or(0);
        Some(queue)
    }

    fn append(&mut self, _class: Class, payload: &[u8]) -> Result<u32, Refused> {
        let number = self.last + 1;
        let item = [&number.to_le_bytes(), payload].concat();
        match now(async { self.queue().push(&item, false).await }) {
            Ok(()) => {
                self.last = number;
                Ok(number)
            }
            Err(Error::FullStorage) => Err(Refused::Full),
            Err(_) => Err(Refused::Failed),
        }
    }

    fn acknowledge(&mut self, sequence: u32) -> Option<()> {
        self.walk(sequence).map(|_| ())
    }

    fn keep_evidence(&mut self, _evidence: &[u8]) -> Option<()> {
        Some(())
    }

    fn evidence(&mut self) -> Option<Vec<u8>> {
        None
    }

    fn contents(&mut self) -> Option<Vec<(u32, Vec<u8>)>> {
        self.walk(0)
    }

    fn ledger(&self) -> Ledger {
        Ledger::default()
    }

    fn open_until_cut(flash: Self::Flash) -> Self::Flash {
        let mut queue = Self { flash, last: 0 };
        let _ = queue.walk(0);
        queue.flash
    }

    fn flash_mut(&mut self) -> &mut Self::Flash {
        &mut self.flash
    }

    fn into_flash(self) -> Self::Flash {
        self.flash
    }
}
