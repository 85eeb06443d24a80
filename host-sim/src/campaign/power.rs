//! Power cuts: an outbox on a [`SimulatedFlash`] loses its power at every byte of every operation, and again while it recovers.
//!
//! A run does one random operation after the other. Each is first done whole, to count the bytes that it touches; then, from the same
//! state, it is cut at each of them. After every cut the outbox is opened (with chance 1/2 that is cut, too, at a byte by chance, and
//! so on), compared with a model, and made to take one message more. The run goes on from one of the states that a cut has left, so
//! that what cuts leave behind piles up.

use std::collections::BTreeMap;
use std::time::Instant;

use rand_core::{Rng, SeedableRng};
use rand_xoshiro::Xoshiro256PlusPlus;
use rayon::prelude::*;
use spanwatch::outbox::{Class, Ledger, Outbox, OutboxError};

use crate::flash::{SimulatedFlash, Tear};

/// Pages of the flash: few, so that they are used over and over.
const PAGES: usize = 5;
/// Operations of one run, after which the next begins on an erased flash.
const OPERATIONS: u32 = 60;
/// Most cuts in a row.
const CUTS_IN_A_ROW: u32 = 3;
/// Longest message and evidence: several, or one, in a page of 512 bytes.
const MESSAGE_BYTES: std::ops::Range<u64> = 8..120;
const EVIDENCE_BYTES: std::ops::Range<u64> = 100..300;

/// A store of messages on a flash, as the campaign sees it.
pub trait Store: Clone {
    /// What it lies on.
    type Flash: Clone + Send;
    /// It also keeps an evidence, never gives a number twice and counts what it drops.
    const COMPLETE: bool = true;
    /// Opens it. None: it does not open.
    fn open(flash: Self::Flash) -> Option<Self>;
    /// Puts a message on the flash.
    fn append(&mut self, class: Class, payload: &[u8]) -> Result<u32, Refused>;
    /// All up to this number may be forgotten. None: it failed.
    fn acknowledge(&mut self, sequence: u32) -> Option<()>;
    /// Keeps an evidence. None: it failed.
    fn keep_evidence(&mut self, evidence: &[u8]) -> Option<()>;
    /// The evidence that was kept.
    fn evidence(&mut self) -> Option<Vec<u8>>;
    /// All messages, in the order in which they are given. None: it failed.
    fn contents(&mut self) -> Option<Vec<(u32, Vec<u8>)>>;
    /// What was dropped.
    fn ledger(&self) -> Ledger;
    /// Opens it on a flash whose power goes while that is done; the flash.
    fn open_until_cut(flash: Self::Flash) -> Self::Flash;
    /// The flash under it.
    fn flash_mut(&mut self) -> &mut Self::Flash;
    /// The flash under it.
    fn into_flash(self) -> Self::Flash;
}

/// Why a message was not taken.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Refused {
    /// There is no room; it was counted.
    Full,
    /// The store failed.
    Failed,
}

/// What a store needs of its flash during the campaign.
pub trait Cut: Clone + Send {
    /// An erased flash.
    fn fresh(tear: Tear, seed: u64) -> Self;
    /// See [`SimulatedFlash`].
    fn cut_after(&mut self, bytes: u64, seed: u64);
    /// See [`SimulatedFlash`].
    fn restore(&mut self);
    /// See [`SimulatedFlash`].
    fn touched(&self) -> u64;
}

impl<const WORD: usize, const PAGE: usize> Cut for SimulatedFlash<WORD, PAGE> {
    fn fresh(tear: Tear, seed: u64) -> Self {
        Self::new(PAGES, tear, seed)
    }

    fn cut_after(&mut self, bytes: u64, seed: u64) {
        self.reseed(seed);
        self.cut_after(bytes);
    }

    fn restore(&mut self) {
        self.restore();
    }

    fn touched(&self) -> u64 {
        self.touched()
    }
}

impl<const WORD: usize, const PAGE: usize> Store for Outbox<SimulatedFlash<WORD, PAGE>> {
    type Flash = SimulatedFlash<WORD, PAGE>;

    fn open(flash: Self::Flash) -> Option<Self> {
        Self::open(flash).ok()
    }

    fn append(&mut self, class: Class, payload: &[u8]) -> Result<u32, Refused> {
        self.append(class, payload).map_err(|error| match error {
            OutboxError::Full => Refused::Full,
            _ => Refused::Failed,
        })
    }

    fn acknowledge(&mut self, sequence: u32) -> Option<()> {
        self.acknowledge(sequence).ok()
    }

    fn keep_evidence(&mut self, evidence: &[u8]) -> Option<()> {
        self.keep_evidence(evidence).ok()
    }

    fn evidence(&mut self) -> Option<Vec<u8>> {
        let mut buffer = [0; EVIDENCE_BYTES.end as usize];
        self.evidence(&mut buffer).ok()?.map(<[u8]>::to_vec)
    }

    fn contents(&mut self) -> Option<Vec<(u32, Vec<u8>)>> {
        let mut contents: Vec<(u32, Vec<u8>)> = vec![];
        let mut buffer = [0; MESSAGE_BYTES.end as usize];
        let mut last = 0;
        while let Some(parcel) = self.next_after(last, &mut buffer).ok()? {
            last = parcel.sequence;
            contents.push((last, buffer[..parcel.length].to_vec()));
        }
        Some(contents)
    }

    fn ledger(&self) -> Ledger {
        self.ledger()
    }

    fn open_until_cut(mut flash: Self::Flash) -> Self::Flash {
        let _ = Outbox::open(&mut flash);
        flash
    }

    fn flash_mut(&mut self) -> &mut Self::Flash {
        self.flash_mut()
    }

    fn into_flash(self) -> Self::Flash {
        self.into_flash()
    }
}

/// What a campaign has counted.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Counts {
    /// Operations, each cut at every byte.
    pub operations: u64,
    /// Power cuts.
    pub cuts: u64,
    /// Of these, cuts of a recovery.
    pub cuts_in_recovery: u64,
    /// Messages that were confirmed, not acknowledged, not dropped, and not there.
    pub lost: u64,
    /// Messages that were there twice, or again after they were acknowledged.
    pub duplicated: u64,
    /// Messages that were there with other bytes, or that nobody wrote.
    pub altered: u64,
    /// Numbers that were given to two messages.
    pub reused: u64,
    /// Evidences that were confirmed and not there.
    pub evidence_lost: u64,
    /// Times that the store would not open or work any more.
    pub dead: u64,
    /// Messages dropped for lack of room, all of them counted by the store.
    pub dropped: u64,
}

impl Counts {
    /// Nothing went wrong.
    pub fn is_clean(&self) -> bool {
        [
            self.lost,
            self.duplicated,
            self.altered,
            self.reused,
            self.evidence_lost,
            self.dead,
        ] == [0; 6]
    }

    /// Both together.
    #[must_use]
    pub fn plus(self, other: Self) -> Self {
        Self {
            operations: self.operations + other.operations,
            cuts: self.cuts + other.cuts,
            cuts_in_recovery: self.cuts_in_recovery + other.cuts_in_recovery,
            lost: self.lost + other.lost,
            duplicated: self.duplicated + other.duplicated,
            altered: self.altered + other.altered,
            reused: self.reused + other.reused,
            evidence_lost: self.evidence_lost + other.evidence_lost,
            dead: self.dead + other.dead,
            dropped: self.dropped + other.dropped,
        }
    }
}

/// A row of the campaign's table.
#[derive(Debug, Clone)]
pub struct Row {
    /// Bytes of the flash's word and page.
    pub word: usize,
    /// How operations were torn.
    pub tear: Tear,
    /// What was counted.
    pub counts: Counts,
    /// Seed of the first run; the next have the next.
    pub seed: u64,
    /// Time that it took, s.
    pub seconds: f64,
}

/// Every way to tear.
pub const TEARS: [Tear; 3] = [
    Tear {
        words: false,
        shuffled: false,
    },
    Tear {
        words: true,
        shuffled: false,
    },
    Tear {
        words: true,
        shuffled: true,
    },
];

/// Cuts the outbox at least `cuts` times in all, evenly over words of 1, 4, 8 and 32 bytes and over [`TEARS`]; `done` hears of each row.
pub fn run(cuts: u64, seed: u64, mut done: impl FnMut(&Row)) -> Vec<Row> {
    let share = cuts.div_ceil(4 * TEARS.len() as u64);
    let mut rows = vec![];
    for tear in TEARS {
        for word in [1, 4, 8, 32] {
            let row = match word {
                1 => row::<Outbox<SimulatedFlash<1, 512>>>(word, tear, share, seed),
                4 => row::<Outbox<SimulatedFlash<4, 512>>>(word, tear, share, seed),
                8 => row::<Outbox<SimulatedFlash<8, 512>>>(word, tear, share, seed),
                _ => row::<Outbox<SimulatedFlash<32, 1024>>>(word, tear, share, seed),
            };
            done(&row);
            rows.push(row);
        }
    }
    rows
}

/// The rows as text, and their sum.
pub fn table(rows: &[Row]) -> String {
    use std::fmt::Write as _;
    let mut text = String::from(
        "| word, bytes | torn | operations | cuts | of them in recovery | lost | twice | altered | numbers reused | evidence lost | dead | dropped, \
         counted | s |\n|---|---|---|---|---|---|---|---|---|---|---|---|---|\n",
    );
    let mut line = |word: &str, torn: &str, counts: &Counts, seconds: f64| {
        // Writing to a string cannot fail.
        let _ = writeln!(
            text,
            "| {word} | {torn} | {} | {} | {} | {} | {} | {} | {} | {} | {} | {} | {seconds:.1} |",
            counts.operations,
            counts.cuts,
            counts.cuts_in_recovery,
            counts.lost,
            counts.duplicated,
            counts.altered,
            counts.reused,
            counts.evidence_lost,
            counts.dead,
            counts.dropped
        );
    };
    for row in rows {
        let torn = match row.tear {
            Tear { shuffled: true, .. } => "words, bytes in any order",
            Tear { words: true, .. } => "words",
            _ => "bytes",
        };
        line(&row.word.to_string(), torn, &row.counts, row.seconds);
    }
    let all = rows.iter().map(|row| row.counts).fold(Counts::default(), Counts::plus);
    line("all", "", &all, rows.iter().map(|row| row.seconds).sum());
    text
}

/// Cuts one kind of store on one kind of flash at least `cuts` times.
pub fn row<S: Store + Send>(word: usize, tear: Tear, cuts: u64, seed: u64) -> Row
where
    S::Flash: Cut,
{
    let start = Instant::now();
    let mut counts = Counts::default();
    let mut first = seed;
    let batch = rayon::current_num_threads().max(1) as u64;
    while counts.cuts < cuts {
        let left = cuts - counts.cuts;
        counts = (first..first + batch)
            .into_par_iter()
            .map(|seed| Campaign::<S>::run(tear, seed, left.div_ceil(batch)))
            .reduce(Counts::default, Counts::plus)
            .plus(counts);
        first += batch;
    }
    Row {
        word,
        tear,
        counts,
        seed,
        seconds: start.elapsed().as_secs_f64(),
    }
}

/// Something that is asked of the store.
#[derive(Debug, Clone)]
enum Operation {
    Append(Class, Vec<u8>),
    Acknowledge(u32),
    Evidence(Vec<u8>),
    /// Power goes without anything being written, and comes again.
    Restart,
}

/// What must be in the store.
#[derive(Debug, Clone, Default)]
struct Model {
    /// Confirmed and not acknowledged.
    waiting: BTreeMap<u32, (Class, Vec<u8>)>,
    acknowledged: u32,
    evidence: Option<Vec<u8>>,
    /// Largest number ever seen.
    highest: u32,
    ledger: Ledger,
    /// Numbers that were given again.
    reused: u64,
}

struct Campaign<S> {
    chance: Xoshiro256PlusPlus,
    counts: Counts,
    store: S,
    model: Model,
    /// Makes every payload a new one.
    written: u32,
}

impl<S: Store> Campaign<S>
where
    S::Flash: Cut,
{
    fn run(tear: Tear, seed: u64, cuts: u64) -> Counts {
        let flash = S::Flash::fresh(tear, seed);
        let mut counts = Counts::default();
        let Some(store) = S::open(flash) else {
            counts.dead += 1;
            return counts;
        };
        let mut campaign = Self {
            chance: Xoshiro256PlusPlus::seed_from_u64(seed),
            counts,
            store,
            model: Model::default(),
            written: 0,
        };
        for _ in 0..OPERATIONS {
            if campaign.counts.cuts >= cuts || !campaign.step() {
                break;
            }
        }
        campaign.counts
    }

    fn below(&mut self, limit: u64) -> u64 {
        self.chance.next_u64() % limit.max(1)
    }

    fn payload(&mut self, bytes: std::ops::Range<u64>) -> Vec<u8> {
        self.written += 1;
        let length = bytes.start + self.below(bytes.end - bytes.start);
        let mut payload = self.written.to_le_bytes().to_vec();
        // Long runs of ones and zeros are what a flash confuses most easily.
        let fill = self.below(4);
        payload.resize_with(length as usize, || match fill {
            0 => 0xFF,
            1 => 0,
            _ => self.chance.next_u64() as u8,
        });
        payload
    }

    fn operation(&mut self) -> Operation {
        match self.below(16) {
            0..6 => Operation::Append(Class::Alert, self.payload(MESSAGE_BYTES)),
            6..11 => Operation::Append(Class::Report, self.payload(MESSAGE_BYTES)),
            11..13 if !self.model.waiting.is_empty() => {
                let some = self.below(self.model.waiting.len() as u64) as usize;
                Operation::Acknowledge(self.model.waiting.keys().nth(some).copied().unwrap_or(0))
            }
            13..15 if S::COMPLETE => Operation::Evidence(self.payload(EVIDENCE_BYTES)),
            _ => Operation::Restart,
        }
    }

    /// One operation, cut everywhere; whether the store still works.
    fn step(&mut self) -> bool {
        let operation = self.operation();
        let mut before = self.store.clone();
        let start = before.flash_mut().touched();
        self.counts.operations += 1;
        if matches!(operation, Operation::Restart) {
            let Some(store) = self.recover(before.into_flash()) else {
                return false;
            };
            self.store = store;
            return self.check_own(None);
        }
        let mut whole = before.clone();
        let mut model = self.model.clone();
        if !apply(&mut whole, &operation, &mut model) {
            self.counts.dead += 1;
            return false;
        }
        let bytes = whole.flash_mut().touched() - start;
        let mut next = (whole, model);
        if !self.check(&mut next.0, &mut next.1, None) {
            return false;
        }
        let chosen = self.below(bytes + bytes / 2);
        for byte in 0..bytes {
            let mut cut = before.clone();
            cut.flash_mut().cut_after(byte, self.chance.next_u64());
            let _ = apply(&mut cut, &operation, &mut Model::default());
            self.counts.cuts += 1;
            let mut flash = cut.into_flash();
            flash.restore();
            let Some(mut store) = self.recover(flash) else {
                return false;
            };
            let mut model = self.model.clone();
            if !self.check(&mut store, &mut model, Some(&operation)) {
                return false;
            }
            if byte == chosen {
                next = (store.clone(), model.clone());
            }
            // It must not only be right, but work.
            let extra = Operation::Append(Class::Alert, self.payload(MESSAGE_BYTES));
            if !apply(&mut store, &extra, &mut model) {
                self.counts.dead += 1;
                return false;
            }
            if !self.check(&mut store, &mut model, None) {
                return false;
            }
        }
        let dropped = |ledger: &Ledger| u64::from(ledger.alerts_dropped + ledger.reports_dropped);
        self.counts.dropped += dropped(&next.1.ledger) - dropped(&self.model.ledger);
        (self.store, self.model) = next;
        true
    }

    fn check_own(&mut self, under_way: Option<&Operation>) -> bool {
        let mut store = self.store.clone();
        let mut model = self.model.clone();
        let good = self.check(&mut store, &mut model, under_way);
        self.model = model;
        good
    }

    /// Opens the store, its power cut a few times by chance while it recovers.
    fn recover(&mut self, mut flash: S::Flash) -> Option<S> {
        for _ in 1..CUTS_IN_A_ROW {
            if self.below(2) == 0 {
                break;
            }
            let start = flash.touched();
            let Some(mut whole) = S::open(flash.clone()) else { break };
            let bytes = whole.flash_mut().touched() - start;
            if bytes == 0 {
                break;
            }
            let (byte, seed) = (self.below(bytes), self.chance.next_u64());
            flash.cut_after(byte, seed);
            flash = S::open_until_cut(flash);
            flash.restore();
            self.counts.cuts += 1;
            self.counts.cuts_in_recovery += 1;
        }
        let store = S::open(flash);
        if store.is_none() {
            self.counts.dead += 1;
        }
        store
    }

    /// Compares the store with the model, in which what was `under_way` may have happened or not, and makes the model what the store is.
    /// Whether all is well.
    fn check(&mut self, store: &mut S, model: &mut Model, under_way: Option<&Operation>) -> bool {
        let counts = &mut self.counts;
        let (Some(contents), evidence) = (store.contents(), store.evidence()) else {
            counts.dead += 1;
            return false;
        };
        let before = *counts;
        counts.reused += std::mem::take(&mut model.reused);
        let mut last = 0;
        let mut found = BTreeMap::new();
        for (sequence, payload) in contents {
            counts.duplicated += u64::from(sequence <= last);
            last = last.max(sequence);
            match model.waiting.get(&sequence) {
                Some((_, expected)) => counts.altered += u64::from(*expected != payload),
                None => match under_way {
                    Some(Operation::Append(class, expected)) if *expected == payload => {
                        counts.reused += u64::from(S::COMPLETE && sequence <= model.highest);
                        model.waiting.insert(sequence, (*class, payload.clone()));
                        model.highest = model.highest.max(sequence);
                    }
                    _ if S::COMPLETE && sequence <= model.acknowledged => counts.duplicated += 1,
                    _ => counts.altered += 1,
                },
            }
            found.insert(sequence, payload);
        }
        // What is missing was acknowledged just now, or dropped and counted: the oldest of its kind.
        let (upto, class) = match under_way {
            Some(Operation::Acknowledge(upto)) => (*upto, None),
            Some(Operation::Append(class, _)) => (0, Some(*class)),
            _ => (0, None),
        };
        if let Some((&number, _)) = model
            .waiting
            .range(..=upto)
            .rfind(|(number, _)| !found.contains_key(number))
        {
            model.acknowledged = number;
            model
                .waiting
                .retain(|number, _| *number > upto || found.contains_key(number));
        }
        let ledger = store.ledger();
        for (of, dropped) in [
            (Class::Alert, ledger.alerts_dropped - model.ledger.alerts_dropped),
            (Class::Report, ledger.reports_dropped - model.ledger.reports_dropped),
        ] {
            let numbers: Vec<u32> = (model.waiting.iter())
                .filter_map(|(&number, (class, _))| (*class == of).then_some(number))
                .collect();
            // A report that was refused is counted and was never there.
            let refused = u32::from(of == Class::Report && class == Some(Class::Report));
            let missing = numbers.iter().filter(|number| !found.contains_key(number)).count() as u32;
            let oldest = numbers.iter().take_while(|number| !found.contains_key(number)).count() as u32;
            counts.lost += u64::from(missing - oldest);
            if missing > dropped || missing + refused < dropped {
                counts.lost += u64::from(missing.abs_diff(dropped));
            }
            for number in numbers {
                if !found.contains_key(&number) {
                    model.waiting.remove(&number);
                }
            }
        }
        model.ledger = ledger;
        if evidence != model.evidence {
            match under_way {
                Some(Operation::Evidence(newer)) if evidence.as_ref() == Some(newer) => model.evidence = evidence,
                _ => counts.evidence_lost += 1,
            }
        }
        *counts == before
    }
}

/// Does the operation; whether the store has. The model is what it must be then.
fn apply<S: Store>(store: &mut S, operation: &Operation, model: &mut Model) -> bool {
    match operation {
        Operation::Append(class, payload) => match store.append(*class, payload) {
            Ok(sequence) => {
                model.reused += u64::from(S::COMPLETE && sequence <= model.highest);
                model.highest = model.highest.max(sequence);
                model.waiting.insert(sequence, (*class, payload.clone()));
                true
            }
            Err(Refused::Full) if S::COMPLETE => {
                model.ledger.reports_dropped += 1;
                *class == Class::Report
            }
            Err(Refused::Full) => true,
            Err(Refused::Failed) => false,
        },
        Operation::Acknowledge(upto) => {
            model.acknowledged = model.acknowledged.max(*upto);
            model.waiting.retain(|number, _| number > upto);
            store.acknowledge(*upto).is_some()
        }
        Operation::Evidence(evidence) => {
            model.evidence = Some(evidence.clone());
            store.keep_evidence(evidence).is_some()
        }
        Operation::Restart => true,
    }
}
