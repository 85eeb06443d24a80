//! Campaigns against the way from decision to disk: many faults by seed, each counted, and what was lost by them.
//!
//! | campaign | what goes wrong | what must not |
//! |---|---|---|
//! | [`power`] | power, at every byte that the outbox writes or erases, also while it recovers | a message lost, given twice or changed, a number used again |

pub mod power;
pub mod sequential;
