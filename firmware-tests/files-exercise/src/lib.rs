//! Uses every call of `condor-fs` and `condor-tty` that runs without an operating system.
//!
//! The processor and its host are two mailboxes of one program. Whoever waits gives the other one the
//! turn ([`bell`]), so that every run is the same. The host's files are a [`disk`] in memory, behind
//! a server that knows nothing of open files but what the processor's table says; its terminals have a
//! [`Reader`](condor_tty::Reader) in front of them.
#![no_std]

mod bell;
mod boards;
mod buffered;
mod copying;
mod descriptors;
mod directories;
mod disk;
mod doubt;
mod files;
mod listing;
mod memory;
mod names;
mod nothing;
mod pair;
mod post;
mod server;
mod terminals;
mod text;
mod trouble;
mod typing;
mod viewer;
mod words;
mod writing;

pub use memory::Memory;
pub use pair::everything;
