//! Every interleaving, as far as each model says, of what contexts and processors share.
#![cfg(condor_loom)]

mod memory;
mod param;
mod ring;
mod selection;
