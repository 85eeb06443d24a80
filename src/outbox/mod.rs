//! What the logger has to say is on its flash before it is sent, and stays there until the base station has it on disk.
//!
//! ```text
//! append -> journal on NOR flash -> next_after, as often as the link needs -> acknowledge -> room for more
//! ```
//!
//! An outbox is a journal in `N` sectors ([`MAX_SECTORS`] at most, 3 at least): records are appended, and a sector is erased
//! once nothing in it is needed. One sector is always free. Where none would be, the sector with the least that is needed is copied
//! into the new one first (*collected*).
//!
//! **Promises**, each held through power cuts at any byte that is written or erased, also during recovery (`tests/outbox.rs`):
//!
//! - what [`Outbox::append`] has answered with a number is given by [`Outbox::next_after`] until it is acknowledged or, for lack of room,
//!   dropped and counted ([`Ledger`]); unchanged, once, and in the order of the numbers;
//! - no number is given twice: numbers are leased in steps of [`LEASE`], and a start goes on behind the lease;
//! - what was interrupted is there whole or not at all.
//!
//! **Full**: an alert takes the room of the oldest reports, then that of the oldest alerts; a report that of the oldest reports only.
//! They are dropped a sector's worth at a time, so that a full outbox is not copied for each alert.
//!
//! **Wear**: the free sector that was erased least is taken next, so all are erased alike. Sectors with records that stay for long keep
//! their place until they are collected.
//!
//! **Why not `sequential-storage`**, which this was meant to rest on: its queue (8.0.2) appends right behind what an interrupted write has
//! left, and then can lose items whose push it had confirmed ([its issue
//! 136](https://github.com/tweedegolf/sequential-storage/issues/136) is in what its map and its queue share). `docs/link.md` counts them,
//! `tests/outbox.rs` holds that it still is so. It also programs words twice, which a flash with check codes does not take.
//!
//! Cost: 12 bytes of RAM a sector and 80 more; a record has 16 bytes more than its payload. Finding the next record reads the head of
//! every record.

mod journal;
mod layout;

use core::fmt;

use embedded_storage::nor_flash::NorFlash;

use journal::{Journal, Place};
use layout::{Kind, RecordHead, STATE_BYTES, State};

pub use journal::MAX_SECTORS;

/// Numbers that are taken at a time: a start passes over those of its lease that were not used.
pub const LEASE: u32 = 64;
/// States that always find room in the open sector, so that an acknowledgement seldom begins a new one.
const STATES_KEPT_FREE: u32 = 2;

/// Why an outbox did not do what it was asked.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum OutboxError {
    /// The flash does not answer, or has fewer than three sectors. Open the outbox again.
    Flash,
    /// The flash does not hold what was written to it, in several sectors. It is worn out.
    Worn,
    /// There is no room: alerts that nobody has fetched fill it. The report was dropped and counted.
    Full,
    /// The payload is larger than a sector.
    TooLong,
    /// The acknowledgement is for numbers that were never given.
    NotSent,
}

impl fmt::Display for OutboxError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Flash => "the flash does not answer, or has fewer than three sectors",
            Self::Worn => "the flash does not hold what is written to it",
            Self::Full => "the outbox is full of alerts that nobody has fetched",
            Self::TooLong => "the message is larger than a sector of the flash",
            Self::NotSent => "an acknowledgement is for what was never sent",
        })
    }
}

impl core::error::Error for OutboxError {}

/// How much a message matters.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Class {
    /// It takes the room of others.
    Alert,
    /// It gives way to alerts.
    Report,
}

/// A message in the outbox.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Parcel {
    /// Its number.
    pub sequence: u32,
    /// The number before it: of the message that goes before it, or of the last that was acknowledged. Whoever has that one misses none.
    pub previous: u32,
    /// How much it matters.
    pub class: Class,
    /// Bytes of it.
    pub length: usize,
}

/// What was lost, and is told.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Ledger {
    /// Alerts dropped for lack of room.
    pub alerts_dropped: u32,
    /// Reports dropped for lack of room.
    pub reports_dropped: u32,
    /// Messages that the flash has not kept, since the start.
    pub unreadable: u32,
}

/// How full the outbox is.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Fill {
    /// Alerts that wait.
    pub alerts: u32,
    /// Reports that wait.
    pub reports: u32,
    /// Bytes of flash that they, and the evidence, take.
    pub bytes: u32,
    /// Bytes that there are.
    pub capacity: u32,
}

/// How worn the flash is, as far as the heads of its sectors can say: an erasure that was interrupted counts once, with the next.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Wear {
    /// Erasures of the sector that has most.
    pub most: u32,
    /// Erasures of the sector that has fewest.
    pub fewest: u32,
}

/// Messages that wait on the flash. See the [module](self).
#[derive(Debug, Clone)]
pub struct Outbox<F> {
    journal: Journal<F>,
    /// The last number given.
    last: u32,
    /// Number of the newest evidence; 0: there is none.
    evidence: u32,
    unreadable: u32,
    /// The last message that was found unreadable.
    last_unreadable: u32,
}

impl<F: NorFlash> Outbox<F> {
    /// Opens the outbox on the whole of `flash`, and counts the start. A flash without an outbox becomes an empty one; a recovery that
    /// was interrupted is taken up again.
    ///
    /// # Errors
    /// [`OutboxError::Flash`] and [`OutboxError::Worn`].
    pub fn open(flash: F) -> Result<Self, OutboxError> {
        let journal = Journal::mount(flash)?;
        if journal.sectors().len() < 3 {
            return Err(OutboxError::Flash);
        }
        let mut outbox = Self {
            journal,
            last: 0,
            evidence: 0,
            unreadable: 0,
            last_unreadable: 0,
        };
        outbox.evidence = outbox.newest_evidence()?;
        match outbox.journal.newest() {
            None => outbox.journal.begin(0, State::default())?,
            Some(newest) if outbox.spare(outbox.journal.state)?.is_none() => {
                let state = outbox.journal.state;
                let room = outbox.journal.room() >= Journal::<F>::record_bytes(STATE_BYTES);
                match outbox.copied_into(newest)?.filter(|_| room) {
                    // It was collected; only the word that it was is missing, or has rotted.
                    Some(collected) => outbox.journal.append_state(State { collected, ..state })?,
                    // One is being collected, and the newest has nothing but copies.
                    None => outbox.begin(newest, state)?,
                }
            }
            Some(_) => {}
        }
        let state = outbox.journal.state;
        // A flash that has lost a lease may still have what was written under it, or have lost that, too.
        let known = state.leased.max(outbox.highest()?);
        outbox.last = known.saturating_add(outbox.journal.forgotten_numbers());
        outbox.put_state(State {
            leased: outbox.last.saturating_add(LEASE),
            starts: state.starts.saturating_add(1),
            ..state
        })?;
        Ok(outbox)
    }

    /// Gives the flash back.
    pub fn into_flash(self) -> F {
        self.journal.into_flash()
    }

    /// The flash. Whoever writes to it through this breaks the promises.
    pub fn flash_mut(&mut self) -> &mut F {
        self.journal.flash_mut()
    }

    /// Starts so far, this one included: no two starts have the same.
    pub fn starts(&self) -> u32 {
        self.journal.state.starts
    }

    /// The name of this series of numbers, which the base station gives; 0: it has none yet.
    pub fn stream(&self) -> u32 {
        self.journal.state.stream
    }

    /// Names this series of numbers, once.
    pub fn name_stream(&mut self, stream: u32) -> Result<(), OutboxError> {
        let state = self.journal.state;
        if state.stream != 0 || stream == 0 {
            return Ok(());
        }
        self.put_state(State { stream, ..state })
    }

    /// Everything up to this number has been acknowledged.
    pub fn acknowledged(&self) -> u32 {
        self.journal.state.acknowledged
    }

    /// What was lost so far.
    pub fn ledger(&self) -> Ledger {
        let state = &self.journal.state;
        Ledger {
            alerts_dropped: state.alerts_dropped,
            reports_dropped: state.reports_dropped,
            unreadable: self.unreadable,
        }
    }

    /// How worn the flash is.
    pub fn wear(&self) -> Wear {
        let erases = || self.journal.sectors().iter().map(|sector| sector.erases);
        Wear {
            most: erases().max().unwrap_or(0),
            fewest: erases().min().unwrap_or(0),
        }
    }

    /// Puts a message on the flash; its number.
    ///
    /// # Errors
    /// None but [`OutboxError::Full`] and [`OutboxError::TooLong`] leave the outbox usable: open it again after any other.
    pub fn append(&mut self, class: Class, payload: &[u8]) -> Result<u32, OutboxError> {
        let kind = match class {
            Class::Alert => Kind::Alert,
            Class::Report => Kind::Report,
        };
        self.put(kind, payload)
    }

    /// Keeps what all passages say of the bridge, in place of what was kept before.
    ///
    /// # Errors
    /// As [`Self::append`].
    pub fn keep_evidence(&mut self, evidence: &[u8]) -> Result<(), OutboxError> {
        self.evidence = self.put(Kind::Evidence, evidence)?;
        Ok(())
    }

    /// Reads the evidence that was kept last into `buffer`; none if there is none, or no room for it.
    pub fn evidence<'b>(&mut self, buffer: &'b mut [u8]) -> Result<Option<&'b [u8]>, OutboxError> {
        let mut found = None;
        let newest = self.evidence;
        self.each(self.journal.state, |place| {
            if place.head.kind == Kind::Evidence && place.head.sequence == newest {
                found = Some(*place);
            }
        })?;
        let Some(place) = found else { return Ok(None) };
        let whole = self.journal.read_payload(&place, buffer)?;
        Ok(buffer.get(..place.head.length.into()).filter(|_| whole))
    }

    /// The first message behind number `sequence`, read into `buffer`; none if there is none. Messages longer than `buffer` are cut.
    pub fn next_after(&mut self, sequence: u32, buffer: &mut [u8]) -> Result<Option<Parcel>, OutboxError> {
        let first = sequence.max(self.journal.state.acknowledged);
        let mut sequence = first;
        let mut previous = self.journal.state.acknowledged;
        loop {
            let mut found: Option<Place> = None;
            self.each(self.journal.state, |place| {
                let number = place.head.sequence;
                if place.head.kind == Kind::Evidence {
                } else if number <= first {
                    previous = previous.max(number);
                } else if number > sequence && found.is_none_or(|found| number < found.head.sequence) {
                    found = Some(*place);
                }
            })?;
            let Some(place) = found else { return Ok(None) };
            let RecordHead {
                sequence: number,
                kind,
                length,
                ..
            } = place.head;
            if self.journal.read_payload(&place, buffer)? {
                return Ok(Some(Parcel {
                    sequence: number,
                    previous,
                    class: if kind == Kind::Alert {
                        Class::Alert
                    } else {
                        Class::Report
                    },
                    length: usize::from(length).min(buffer.len()),
                }));
            }
            if number > self.last_unreadable {
                self.last_unreadable = number;
                self.unreadable = self.unreadable.saturating_add(1);
            }
            sequence = number;
        }
    }

    /// Everything up to this number is on the base station's disk: it may be forgotten. An old acknowledgement does no harm.
    ///
    /// # Errors
    /// [`OutboxError::NotSent`], and those of the flash.
    pub fn acknowledge(&mut self, sequence: u32) -> Result<(), OutboxError> {
        let state = self.journal.state;
        if sequence > self.last {
            return Err(OutboxError::NotSent);
        }
        if sequence <= state.acknowledged {
            return Ok(());
        }
        self.put_state(State {
            acknowledged: sequence,
            ..state
        })
    }

    /// What waits.
    pub fn fill(&mut self) -> Result<Fill, OutboxError> {
        let mut fill = Fill {
            capacity: (self.journal.sectors().len() as u32).saturating_mul(Journal::<F>::CAPACITY),
            ..Fill::default()
        };
        self.each(self.journal.state, |place| {
            match place.head.kind {
                Kind::Alert => fill.alerts += 1,
                Kind::Report => fill.reports += 1,
                Kind::Evidence | Kind::State => {}
            }
            fill.bytes += Journal::<F>::record_bytes(place.head.length.into());
        })?;
        Ok(fill)
    }

    /// Appends a record with the next number.
    fn put(&mut self, kind: Kind, payload: &[u8]) -> Result<u32, OutboxError> {
        let bytes = Journal::<F>::record_bytes(payload.len());
        if bytes.saturating_add(states_kept_free::<F>()) > Journal::<F>::CAPACITY {
            return Err(OutboxError::TooLong);
        }
        if self.last >= self.journal.state.leased {
            let state = self.journal.state;
            self.put_state(State {
                leased: self.last.saturating_add(LEASE),
                ..state
            })?;
        }
        // Also if it comes to nothing: parts of it may be on the flash.
        self.last = self.last.saturating_add(1);
        let sequence = self.last;
        for _ in 0..Journal::<F>::tries() {
            if bytes.saturating_add(states_kept_free::<F>()) > self.journal.room() {
                let state = self.journal.state;
                self.advance(state, bytes, kind)?;
            }
            match self.journal.append(kind, sequence, payload) {
                Err(OutboxError::Worn) => {}
                Err(error) => return Err(error),
                Ok(()) => return Ok(sequence),
            }
        }
        Err(OutboxError::Worn)
    }

    /// Appends a state, or begins a sector with it.
    fn put_state(&mut self, state: State) -> Result<(), OutboxError> {
        if Journal::<F>::record_bytes(STATE_BYTES) <= self.journal.room() {
            match self.journal.append_state(state) {
                Err(OutboxError::Worn) => {}
                other => return other,
            }
        }
        self.advance(state, 0, Kind::State)
    }

    /// Begins the spare sector so that afterwards `bytes` fit into it and another is spare.
    fn advance(&mut self, mut state: State, bytes: u32, kind: Kind) -> Result<(), OutboxError> {
        // What only `state` lets go of must not be erased before `state` is on the flash.
        let Some(spare) = self.spare(self.journal.state)? else {
            return Err(OutboxError::Flash);
        };
        let needed = bytes.saturating_add(states_kept_free::<F>());
        while let Some((_, live)) = self.victim(state, spare)?
            && live.saturating_add(needed) > Journal::<F>::CAPACITY
            // A state always fits: no sector has more than leaves room for it.
            && kind != Kind::State
        {
            match self.drop_oldest(&mut state, kind)? {
                true => {}
                false => {
                    let state = self.journal.state;
                    self.put_state(State {
                        reports_dropped: state.reports_dropped.saturating_add(1),
                        ..state
                    })?;
                    return Err(OutboxError::Full);
                }
            }
        }
        self.begin(spare, state)
    }

    /// Begins a sector, and collects another if none is free then.
    fn begin(&mut self, sector: usize, state: State) -> Result<(), OutboxError> {
        self.journal.begin(sector, state)?;
        let Some((victim, _)) = self.victim(state, sector)? else {
            return Ok(());
        };
        let mut place = None;
        while let Some(next) = self.journal.next(victim, place.as_ref())? {
            if self.lives(&next.head, &state) {
                let kept = self.journal.copy(&next)?;
                self.unreadable = self.unreadable.saturating_add(u32::from(!kept));
            }
            place = Some(next);
        }
        let collected = self.journal.sectors().get(victim).map_or(0, |sector| sector.order);
        self.journal.append_state(State { collected, ..state })
    }

    /// The sector that has least to be copied, and how many bytes, if one must be emptied once `next` is begun; none if another is free.
    fn victim(&mut self, state: State, next: usize) -> Result<Option<(usize, u32)>, OutboxError> {
        let mut least: Option<(usize, u32)> = None;
        for index in 0..self.journal.sectors().len() {
            if index == next {
                continue;
            }
            let live = self.live_bytes(state, index)?;
            if live == 0 {
                return Ok(None);
            }
            if least.is_none_or(|(_, bytes)| live < bytes) {
                least = Some((index, live));
            }
        }
        Ok(least)
    }

    /// The free sector that was erased least; the open one is not free.
    fn spare(&mut self, state: State) -> Result<Option<usize>, OutboxError> {
        let mut spare: Option<(usize, u32)> = None;
        for index in 0..self.journal.sectors().len() {
            let erases = self.journal.sectors().get(index).map_or(0, |sector| sector.erases);
            let better = spare.is_none_or(|(_, fewest)| erases < fewest);
            if better && self.journal.newest() != Some(index) && self.live_bytes(state, index)? == 0 {
                spare = Some((index, erases));
            }
        }
        Ok(spare.map(|(index, _)| index))
    }

    /// Bytes of a sector that are still needed.
    fn live_bytes(&mut self, state: State, index: usize) -> Result<u32, OutboxError> {
        let mut bytes = 0;
        let collected = |order: u32| order == 0 || order == state.collected;
        if (self.journal.sectors().get(index)).is_none_or(|sector| collected(sector.order)) {
            return Ok(0);
        }
        let mut place = None;
        while let Some(next) = self.journal.next(index, place.as_ref())? {
            if self.lives(&next.head, &state) {
                bytes += Journal::<F>::record_bytes(next.head.length.into());
            }
            place = Some(next);
        }
        Ok(bytes)
    }

    /// Whether a record is still needed.
    fn lives(&self, head: &RecordHead, state: &State) -> bool {
        let behind = |number: u32| head.sequence > state.acknowledged && head.sequence > number;
        match head.kind {
            Kind::State => false,
            Kind::Alert => behind(state.alerts_upto),
            Kind::Report => behind(state.reports_upto),
            Kind::Evidence => head.sequence == self.evidence,
        }
    }

    /// Shows every record that is needed.
    fn each(&mut self, state: State, mut show: impl FnMut(&Place)) -> Result<(), OutboxError> {
        for index in 0..self.journal.sectors().len() {
            let order = self.journal.sectors().get(index).map_or(0, |sector| sector.order);
            if order == 0 || order == state.collected {
                continue;
            }
            let mut place = None;
            while let Some(next) = self.journal.next(index, place.as_ref())? {
                if self.lives(&next.head, &state) {
                    show(&next);
                }
                place = Some(next);
            }
        }
        Ok(())
    }

    /// The order of a sector all of whose records that are needed are in the sector `newest` as well.
    fn copied_into(&mut self, newest: usize) -> Result<Option<u32>, OutboxError> {
        let state = self.journal.state;
        for index in (0..self.journal.sectors().len()).filter(|&index| index != newest) {
            let mut place = None;
            let mut copied = true;
            while let Some(next) = self.journal.next(index, place.as_ref())? {
                copied = copied && (!self.lives(&next.head, &state) || self.holds(newest, &next.head)?);
                place = Some(next);
            }
            if copied {
                return Ok(self.journal.sectors().get(index).map(|sector| sector.order));
            }
        }
        Ok(None)
    }

    /// Whether a sector has a record of this kind and number, whole.
    fn holds(&mut self, sector: usize, head: &RecordHead) -> Result<bool, OutboxError> {
        let mut place = None;
        while let Some(next) = self.journal.next(sector, place.as_ref())? {
            let same = next.head.kind == head.kind && next.head.sequence == head.sequence;
            if same && self.journal.read_payload(&next, &mut [])? {
                return Ok(true);
            }
            place = Some(next);
        }
        Ok(false)
    }

    /// Number of the newest evidence that can be read, where it will not be erased: one that is needed until it is gone would bring the one
    /// before it back, and there might be no free sector then.
    fn newest_evidence(&mut self) -> Result<u32, OutboxError> {
        let mut newest = 0;
        for index in 0..self.journal.sectors().len() {
            let order = self.journal.sectors().get(index).map_or(0, |sector| sector.order);
            if order == self.journal.state.collected {
                continue;
            }
            let mut place = None;
            while let Some(next) = self.journal.next(index, place.as_ref())? {
                let newer = next.head.kind == Kind::Evidence && next.head.sequence > newest;
                if newer && self.journal.read_payload(&next, &mut [])? {
                    newest = next.head.sequence;
                }
                place = Some(next);
            }
        }
        Ok(newest)
    }

    /// Largest number of any record, also of those that are not needed any more.
    fn highest(&mut self) -> Result<u32, OutboxError> {
        let mut highest = 0;
        for index in 0..self.journal.sectors().len() {
            let mut place = None;
            while let Some(next) = self.journal.next(index, place.as_ref())? {
                highest = highest.max(next.head.sequence);
                place = Some(next);
            }
        }
        Ok(highest)
    }

    /// Drops the oldest messages that have to make room for one of `kind`: those in the sector of the oldest; whether there were any.
    fn drop_oldest(&mut self, state: &mut State, kind: Kind) -> Result<bool, OutboxError> {
        for dropped in [Kind::Report, Kind::Alert] {
            if dropped == Kind::Alert && kind == Kind::Report {
                return Ok(false);
            }
            let mut oldest: Option<Place> = None;
            self.each(*state, |place| {
                let older = oldest.is_none_or(|oldest| place.head.sequence < oldest.head.sequence);
                if place.head.kind == dropped && older {
                    oldest = Some(*place);
                }
            })?;
            let Some(oldest) = oldest else { continue };
            let (mut upto, mut count) = (0, 0_u32);
            self.each(*state, |place| {
                if place.head.kind == dropped && place.sector == oldest.sector {
                    upto = upto.max(place.head.sequence);
                }
            })?;
            self.each(*state, |place| {
                count += u32::from(place.head.kind == dropped && place.head.sequence <= upto);
            })?;
            let (watermark, total) = match dropped {
                Kind::Alert => (&mut state.alerts_upto, &mut state.alerts_dropped),
                _ => (&mut state.reports_upto, &mut state.reports_dropped),
            };
            *watermark = upto;
            *total = total.saturating_add(count);
            return Ok(true);
        }
        Ok(false)
    }
}

const fn states_kept_free<F: NorFlash>() -> u32 {
    STATES_KEPT_FREE * Journal::<F>::record_bytes(STATE_BYTES)
}
