//! Uses every call of `condor-fs` and `condor-tty` that runs without an operating system.
//!
//! The processor and its host are two mailboxes of one program. A processor that waits lets the other one
//! work ([`bell`]), so that every run is the same. The host's file service answers from a script
//! ([`host`]); its terminals have a [`TerminalReader`](condor_tty::TerminalReader) in front of them.
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
