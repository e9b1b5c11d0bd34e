//! Every interleaving, as far as each model says, of those who pass the turn.
#![cfg(condor_loom)]

mod hosts;
mod kills;
mod processors;
mod world;
