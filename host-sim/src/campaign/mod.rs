//! Campaigns against the way from decision to disk: many faults by seed, each counted, and what was lost by them.
//!
//! | campaign | what goes wrong | what must not |
//! |---|---|---|
//! | [`power`] | power, at every byte that the outbox writes or erases, also while it recovers | a message lost, given twice or changed, a number used again |
//! | [`link`] | the line, at every frame, and restarts of both ends | an alert lost, stored twice or wrong |
//! | [`attack`] | someone replays, splices, forges, floods | anything accepted, or answered at length |
//! | [`kill`] | image and base station are killed, the line between them is faulty | an alert lost, stored twice or invented |
//! | [`fuzz`] | whatever is read: frames, sealed messages, models, files, flash | a panic, a loop without end, an answer that is none |

pub mod attack;
pub mod forgery;
pub mod fuzz;
pub mod kill;
pub mod line;
pub mod link;
pub mod power;
pub mod sequential;
