//! Uses every call of `condor-fs` and `condor-tty` that runs without an operating system.
//!
//! The processor and its host are two mailboxes of one program. Whoever waits gives the other one the
//! turn ([`bell`]), so that every run is the same. The host's file service answers from a script
//! ([`host`]); its terminals have a [`Reader`](condor_tty::Reader) in front of them.
#![no_std]

mod bell;
mod boards;
mod calls;
mod descriptors;
mod errors;
mod everything;
mod host;
mod memory;
mod nothing;
mod pair;
mod post;
mod terminals;
mod text;
mod trouble;
mod typing;
mod viewer;
mod writing;

pub use everything::everything;
