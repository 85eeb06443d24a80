//! Streaming detection of structural damage in railway viaducts from train passages.
//!
//! The data go one way, and no stage works with the next; they share the words of [`wire::message`]:
//!
//! | stage | module | takes | gives |
//! |---|---|---|---|
//! | stream | [`passage`] | raw sensor counts | one train passage, in m/s², with its quality |
//! | model | [`bridge`], [`train`] | a blob from the PC, a train's name | the reduced bridge, the cars |
//! | physics | [`interaction`] | bridge, train, damage | the accelerations they cause |
//! | first guess | [`guess`] | a passage and the physics | speed and entry time, where nobody knows them |
//! | search | [`identify`] | a passage and the physics | the damage that explains it, and how surely |
//! | decision | [`logger`] | all of the above | passage reports and alerts |
//! | outbox | [`outbox`] | reports and alerts | the same, until the base station has them on disk |
//! | session | [`session`] | messages, and who may hear and say them | sealed frames |
//! | wire | [`wire`] | messages | frames on a serial line, and back |
//!
//! [`settings`] keeps over a restart what the logger watches with, and its key. The same [`logger::Logger`] runs in the firmware
//! (`src/bin/logger.rs`) and on a PC (`host-sim`).
//! No heap, no operating system, no `unsafe`; `f32` on the logger, `f64` from the same source on the PC.
#![no_std]
#![forbid(unsafe_code)]

pub mod bridge;
pub mod capacity;
pub mod guess;
pub mod identify;
pub mod interaction;
pub mod link;
pub mod logger;
pub mod math;
pub mod outbox;
pub mod passage;
pub mod recorder;
pub mod session;
pub mod settings;
pub mod slot;
pub mod track;
pub mod train;
pub mod wire;
