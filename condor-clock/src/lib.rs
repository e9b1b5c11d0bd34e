// The first definition of a link counts: here those of README.md lead to items instead of files.
//! [page]: Page
//! [local]: LocalClock
//! [handover]: Handover
//!
#![doc = include_str!("../README.md")]
#![cfg_attr(not(any(feature = "std", test, condor_loom)), no_std)]
// Instants have 64 bits, and every participant stores them in one piece.
#![cfg(target_has_atomic = "64")]

// The protocol.
mod handover;
mod page;
mod standing;
pub mod sync;

// The clock as one processor has it.
mod local;

// The turn between threads and processes of Linux.
#[cfg(all(feature = "linux", target_os = "linux", not(condor_loom)))]
pub mod linux;

pub use handover::{Fault, Handover};
pub use local::{LOOPS, LocalClock};
pub use page::{LINES, NEVER, Page, PageError, Until};
pub use standing::Standing;
