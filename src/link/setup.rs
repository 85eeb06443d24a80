//! What a logger keeps over a restart: the setup that it watches with, what it knows of the bridge, its key.
//!
//! Between [`SetupRequest::Begin`] and [`SetupRequest::Keep`] what the logger is given, and takes, is also written to the flash. So only what
//! has been checked, and works, is kept. At its start the logger is given the same again, in the same pieces.

use embedded_storage::nor_flash::NorFlash;
use heapless::Vec;

use super::{Desk, Ends};
use crate::logger::Item;
use crate::outbox::OutboxError;
use crate::session::Key;
use crate::settings::{Identity, Part, Settings, SettingsError, Setup};
use crate::wire::message::{CHUNK_BYTES, Chunk, Configuration, NewKey, Outcome, SetupRequest, SetupState};

/// Longest configuration.
pub const CONFIGURATION_BYTES: usize = 256;

fn outcome(result: Result<(), SettingsError>) -> Outcome {
    result.map_or_else(Outcome::Settings, |()| Outcome::Done)
}

impl<F: NorFlash> Desk<F> {
    pub(super) fn setup_state(&self) -> SetupState {
        self.ends.as_ref().map_or(SetupState::default(), |ends| ends.setup)
    }

    pub(super) fn configure(&mut self, configuration: Configuration) -> Outcome {
        self.leave_setup();
        let mut bytes = [0; CONFIGURATION_BYTES];
        // Every configuration fits: tests/frames.rs writes the largest.
        let kept = postcard::to_slice(&configuration, &mut bytes);
        match self.logger.configure(configuration) {
            Ok(()) => self.effort = Default::default(),
            Err(error) => return self.refused(Outcome::Configuration(error)),
        }
        match kept {
            Ok(bytes) => outcome(stage(self.ends.as_mut(), Part::Configuration, bytes)),
            Err(_) => outcome(Err(SettingsError::Full)),
        }
    }

    pub(super) fn take_piece(&mut self, item: Item, chunk: &Chunk) -> Outcome {
        self.leave_setup();
        match self.logger.take_piece(item, chunk) {
            Outcome::Done => {}
            // It begins again.
            Outcome::Chunk => return Outcome::Chunk,
            other => return self.refused(other),
        }
        let whole = (chunk.offset as usize).saturating_add(chunk.bytes.len()) >= chunk.total as usize;
        let part = match item {
            Item::Model => Part::Model,
            Item::Track => Part::Track,
            Item::Evidence => return Outcome::Done,
        };
        match self.logger.delivered(item).filter(|_| whole) {
            Some(bytes) => outcome(stage(self.ends.as_mut(), part, bytes)),
            None => Outcome::Done,
        }
    }

    /// The logger is given something else than it keeps: until it goes back to that what it learns of the bridge is not kept either.
    fn leave_setup(&mut self) {
        if let Some(ends) = self.ends.as_mut() {
            ends.by_setup = false;
        }
    }

    /// A setup of which something was refused is none.
    fn refused(&mut self, outcome: Outcome) -> Outcome {
        if let Some(ends) = self.ends.as_mut() {
            ends.settings.abandon();
        }
        outcome
    }

    pub(super) fn set_up(&mut self, request: SetupRequest) -> Outcome {
        if request == SetupRequest::Reload {
            self.load_setup();
            self.restore_evidence();
            return match self.setup_state().generation {
                0 => Outcome::Settings(SettingsError::Refused),
                _ => Outcome::Done,
            };
        }
        let Some(ends) = self.ends.as_mut() else {
            return Outcome::Settings(SettingsError::Flash);
        };
        match request {
            SetupRequest::Begin => {
                // Without a track of its own the setup is one without a track.
                self.logger.forget_track();
                ends.by_setup = false;
                outcome(ends.settings.begin())
            }
            // It came again, its answer lost.
            SetupRequest::Keep if ends.by_setup => Outcome::Done,
            SetupRequest::Keep => {
                let kept = ends.settings.commit();
                if let Ok(generation) = kept {
                    ends.setup = SetupState {
                        generation,
                        rolled_back: false,
                    };
                    ends.by_setup = true;
                    // What was known of the same bridge, by another track too, is still known.
                    self.restore_evidence();
                    self.keep_evidence();
                }
                outcome(kept.map(|_| ()))
            }
            SetupRequest::Reload | SetupRequest::Read { .. } => Outcome::Done,
        }
    }

    /// A piece of a part of the setup that the logger watches with; of nothing where there is none.
    pub(super) fn give_setup(&mut self, part: Part, offset: u32) -> Chunk {
        let mut chunk = Chunk {
            offset,
            total: 0,
            bytes: Vec::new(),
        };
        let state = self.setup_state();
        let Some(Ends { settings, .. }) = self.ends.as_mut() else {
            return chunk;
        };
        let setups = settings.setups().unwrap_or_default();
        let kept = setups
            .into_iter()
            .flatten()
            .find(|setup| setup.generation() == state.generation);
        if let Some(setup) = kept {
            // What cannot be read is told as nothing.
            let _ = read_piece(settings, setup, part, &mut chunk);
        }
        chunk
    }

    // Not inlined: a piece of the setup must not stand on the stack under the logger's work.
    /// Goes on with the newest setup on the flash that the logger takes.
    #[inline(never)]
    pub(super) fn load_setup(&mut self) {
        let Some(ends) = self.ends.as_mut() else { return };
        ends.settings.abandon();
        ends.setup = SetupState::default();
        let Ok(setups) = ends.settings.setups() else {
            ends.failed = true;
            return;
        };
        let mut rolled_back = false;
        for setup in setups.into_iter().flatten() {
            match self.load(setup) {
                Ok(()) => {
                    if let Some(ends) = self.ends.as_mut() {
                        ends.setup = SetupState {
                            generation: setup.generation(),
                            rolled_back,
                        };
                        ends.by_setup = true;
                    }
                    return;
                }
                Err(_) => rolled_back = true,
            }
        }
    }

    /// Gives the logger what a setup has.
    fn load(&mut self, setup: Setup) -> Result<(), SettingsError> {
        self.logger.forget_track();
        for (part, item) in [(Part::Model, Item::Model), (Part::Track, Item::Track)] {
            let mut offset = 0;
            loop {
                let ends = self.ends.as_mut().ok_or(SettingsError::Flash)?;
                let mut chunk = Chunk {
                    offset,
                    total: 0,
                    bytes: Vec::new(),
                };
                read_piece(&mut ends.settings, setup, part, &mut chunk)?;
                if chunk.bytes.is_empty() {
                    break;
                }
                offset = offset.saturating_add(chunk.bytes.len() as u32);
                if self.logger.take_piece(item, &chunk) != Outcome::Done {
                    return Err(SettingsError::Refused);
                }
            }
        }
        let ends = self.ends.as_mut().ok_or(SettingsError::Flash)?;
        let Some(extent) = ends.settings.find(setup, Part::Configuration)? else {
            return Ok(());
        };
        let mut bytes = [0; CONFIGURATION_BYTES];
        let bytes = ends.settings.read(extent, 0, &mut bytes)?;
        let configuration = postcard::from_bytes(bytes).map_err(|_| SettingsError::Refused)?;
        self.logger.configure(configuration).map_err(|_| SettingsError::Refused)
    }

    // Not inlined: what turns an evidence into bytes must not stand on the stack under the logger's work.
    /// Keeps what all passages say of the bridge, if the logger watches with the setup that it would go on with after a restart.
    #[inline(never)]
    pub(super) fn keep_evidence(&mut self) {
        let Some(ends) = self.ends.as_mut().filter(|ends| ends.by_setup) else {
            return;
        };
        let kept = ends.outbox.keep_evidence(self.logger.evidence_bytes());
        // Without room for it the one before stays.
        ends.failed |= !matches!(kept, Ok(()) | Err(OutboxError::Full | OutboxError::TooLong));
    }

    // Not inlined, as before.
    /// Goes on from the evidence that was kept, if it is of the bridge and track that the logger watches.
    #[inline(never)]
    pub(super) fn restore_evidence(&mut self) {
        let Some(ends) = self.ends.as_mut().filter(|ends| ends.setup.generation > 0) else {
            return;
        };
        // Of another bridge: the logger begins anew.
        self.logger
            .restore_from(|buffer| ends.outbox.evidence(buffer).ok().flatten().map_or(0, <[u8]>::len));
    }

    /// Keeps another key; [`Self::use_key`] begins a session by it.
    pub(super) fn take_key(&mut self, new: &NewKey) -> Outcome {
        match self.ends.as_mut() {
            // A slip of the pen must not make one logger another.
            Some(ends) if !ends.session.may_become(new.device) => Outcome::Settings(SettingsError::Refused),
            Some(ends) => outcome(ends.settings.set_identity(&identity(new))),
            None => Outcome::Settings(SettingsError::Flash),
        }
    }

    /// The answer was the last that was said by the old key.
    pub(super) fn use_key(&mut self, new: &NewKey) {
        if let Some(ends) = self.ends.as_mut() {
            ends.session.replace_identity(identity(new));
        }
    }
}

fn identity(new: &NewKey) -> Identity {
    Identity {
        device: new.device,
        key_number: new.number,
        key: Key::new(new.key),
    }
}

/// Writes a part to the setup that was begun, if one was.
fn stage<F: NorFlash>(ends: Option<&mut Ends<F>>, part: Part, bytes: &[u8]) -> Result<(), SettingsError> {
    match ends.filter(|ends| ends.settings.is_begun()) {
        Some(ends) => ends.settings.stage(part, bytes),
        None => Ok(()),
    }
}

/// Fills `chunk` from its offset on.
fn read_piece<F: NorFlash>(
    settings: &mut Settings<F>,
    setup: Setup,
    part: Part,
    chunk: &mut Chunk,
) -> Result<(), SettingsError> {
    let Some(extent) = settings.find(setup, part)? else {
        return Ok(());
    };
    chunk.total = extent.length;
    let mut bytes = [0; CHUNK_BYTES];
    let read = settings.read(extent, chunk.offset, &mut bytes)?;
    // A piece is as long as a chunk.
    let _ = chunk.bytes.extend_from_slice(read);
    Ok(())
}
