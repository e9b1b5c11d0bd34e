//! Two honest processors and one that writes whatever it can, driven by bytes.
//!
//! Processors 0 and 2 run the shipped mailbox in virtual time on one thread. Number 1 is hostile:
//! it owns its `mail`, may write the `data` of everybody, may truncate its own objects, and moves
//! *before every single access* of the others to shared memory, also within one operation. The
//! first half of the bytes says what the honest processors do, the second what the hostile one
//! does. The [`Model`](model::Model) sees each access and knows what must have happened.
//!
//! Both the property tests and the fuzz targets include this module, hence no names of either.

mod attack;
mod honest;
mod memory;
mod model;
mod script;
mod world;

pub(crate) use honest::run;

/// What a run went through.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Tally {
    /// Moves of the hostile processor: each makes another state of shared memory.
    pub(crate) states: u64,
    /// Accesses of the honest processors, each a step at which it could move.
    pub(crate) accesses: u64,
    /// Handlers that ran.
    pub(crate) handled: u64,
    /// Handlers that ran for messages of the hostile processor.
    pub(crate) handled_of_hostile: u64,
}
