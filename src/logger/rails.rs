//! What the logger knows of the rails: the track that was learnt, and whether it is still that.

use crate::bridge::ReducedBridge;
use crate::identify::evidence::{Basis, Evidence, EvidenceError, Retired};
use crate::slot::Slot;
use crate::track::blob::{self, TrackError};
use crate::track::learnt::{LearntTrack, UNLEARNT};
use crate::track::watch::Watch;
use crate::wire::fingerprint;
use crate::wire::message::TrackState;

/// The learnt track and its watch.
#[derive(Debug, Clone)]
pub(super) struct Rails {
    pub(super) learnt: Slot<LearntTrack>,
    /// The fingerprint of its blob, by which it is known again.
    crc: u32,
    /// Rayleigh's coefficients as the bridge's model has them.
    rayleigh: [f32; 2],
    pub(super) watch: Watch,
}

impl Rails {
    pub(super) const fn new() -> Self {
        Self {
            learnt: Slot::Empty,
            crc: 0,
            rayleigh: [0.0; 2],
            watch: Watch::NEW,
        }
    }

    /// The learnt track, or the smooth one of which nothing was learnt.
    pub(super) fn learnt(&self) -> &LearntTrack {
        self.learnt.as_ref().unwrap_or(&UNLEARNT)
    }

    pub(super) fn state(&self) -> TrackState {
        match (self.learnt().is_learnt(), self.watch.has_changed()) {
            (false, _) => TrackState::Unknown,
            (true, false) => TrackState::Learnt,
            (true, true) => TrackState::Changed,
        }
    }

    /// A bridge model has been loaded. If it is not the `same` as before, nothing is known of its track.
    pub(super) fn follow(&mut self, bridge: &mut ReducedBridge<f32>, same: bool) {
        if !same {
            *self = Self::new();
        }
        self.rayleigh = bridge.rayleigh;
        self.damp(bridge);
    }

    /// Nothing is known of the track any more.
    pub(super) fn forget(&mut self, bridge: &mut ReducedBridge<f32>) {
        bridge.rayleigh = self.rayleigh;
        self.follow(bridge, false);
    }

    fn damp(&self, bridge: &mut ReducedBridge<f32>) {
        let damping = self.learnt().damping;
        bridge.rayleigh = self.rayleigh.map(|coefficient| coefficient * damping);
    }

    /// What the evidence rests on.
    pub(super) fn basis(&self, bridge: u32) -> Basis<'_> {
        Basis {
            bridge,
            track: self.crc,
            spread: &self.learnt().spread,
        }
    }

    /// Goes on from what was known of bridge and track.
    pub(super) fn restore(&mut self, bytes: &[u8], bridge: u32, evidence: &mut Evidence) -> Result<(), EvidenceError> {
        let (restored, watch) = Evidence::from_bytes(bytes, &self.basis(bridge), evidence.forgetting())?;
        *evidence = restored;
        self.watch = watch.unwrap_or(self.watch);
        Ok(())
    }

    /// Takes a learnt track, as [`blob::write()`] makes it. What is known of the bridge by an earlier one is kept with its own weight; what was
    /// found before any was learnt is not, since it took the rails for smooth. A track that is refused changes nothing. The one that is
    /// known may come again, which takes back that it has changed.
    pub(super) fn adopt(
        &mut self,
        bytes: &[u8],
        bridge: &mut ReducedBridge<f32>,
        bridge_crc: u32,
        evidence: &mut Evidence,
    ) -> Result<(), TrackError> {
        let crc = fingerprint(bytes);
        if crc == self.crc && self.learnt.as_ref().is_some() {
            if self.watch.has_changed() {
                self.watch = Watch::NEW;
            }
            return Ok(());
        }
        let first = self.learnt.as_ref().is_none();
        // Weighed before it is known whether the new track is sound, for a second track has no room.
        let retired = if first {
            self.learnt = Slot::Full(UNLEARNT.clone());
            Retired::NOTHING
        } else {
            evidence.retired(self.learnt())
        };
        let read = match self.learnt.as_mut() {
            Some(learnt) => blob::read_into(bytes, bridge_crc, learnt),
            None => return Ok(()),
        };
        if let Err(error) = read {
            if first {
                self.learnt = Slot::Empty;
            }
            return Err(error);
        }
        evidence.begin_anew(retired);
        self.crc = crc;
        self.watch = Watch::NEW;
        self.damp(bridge);
        Ok(())
    }
}
