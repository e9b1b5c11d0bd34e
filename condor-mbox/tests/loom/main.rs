//! Every interleaving, as far as each model says, of what threads share.
#![cfg(condor_loom)]

mod listen;
mod messages;
mod model;
mod published;
mod rejoin;
mod shared_log;
mod spin_lock;
