//! Every interleaving, as far as each model says, of what threads share.
#![cfg(condor_loom)]

mod latest;
mod lock;
