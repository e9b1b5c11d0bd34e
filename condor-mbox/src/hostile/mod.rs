//! Two honest processors and one that writes whatever it can, driven by bytes.
//!
//! Processors 0 and 2 run the shipped mailbox in virtual time on one thread. Number 1 is hostile: it owns its
//! `mail`, may write the `data` of every processor, may truncate its own objects, and moves *before every
//! single access* of the others to shared memory, also within one operation. The first half of the bytes
//! decides the operations of the honest processors, the second the moves of the hostile one. The `Model` sees
//! each access and knows what must have happened.
#![allow(clippy::must_use_candidate, reason = "of use to tests alone")]

mod attack;
mod honest;
mod memory;
mod model;
mod regions;
mod script;
mod window;
mod world;

use core::fmt;

pub use honest::{run as mailbox, run_behind_caches as mailbox_behind_caches};
pub use regions::run as regions;
pub use window::bounds as window_bounds;

/// Counts of the events in a run of a fuzz target.
#[derive(Clone, Copy, Debug, Default)]
pub struct Tally {
    /// The number of moves of the hostile processor: each makes another state of shared memory.
    pub states: u64,
    /// The number of accesses of the honest processors, before each of which the hostile one could move.
    pub accesses: u64,
    /// The number of handlers that ran.
    pub handled: u64,
    /// The number of handlers that ran for messages of the hostile processor.
    pub handled_of_hostile: u64,
}

impl Tally {
    pub fn add(&mut self, run: Self) {
        self.states += run.states;
        self.accesses += run.accesses;
        self.handled += run.handled;
        self.handled_of_hostile += run.handled_of_hostile;
    }
}

impl fmt::Display for Tally {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "{} hostile states at {} steps; {} messages handled, {} of them hostile",
            self.states, self.accesses, self.handled, self.handled_of_hostile
        )
    }
}
