// The first definition of a link counts: here those of README.md lead to items instead of files.
//! [page]: Page
//! [local]: LocalClock
//! [handover]: Handover
//!
#![doc = include_str!("../README.md")]
#![cfg_attr(not(any(feature = "std", test, condor_loom)), no_std)]

// Sizes, which any program can name.
mod sizes;
pub use sizes::{LINES, LOOPS, PAGE_BYTES};

// The rest is for processors that store an instant, which has 64 bits, in one piece.

// The protocol.
#[cfg(target_has_atomic = "64")]
mod handover;
#[cfg(target_has_atomic = "64")]
mod obstacle;
#[cfg(target_has_atomic = "64")]
mod page;
#[cfg(target_has_atomic = "64")]
pub mod sync;

// The clock as one processor has it.
#[cfg(target_has_atomic = "64")]
mod local;

// The turn between threads and processes of Linux.
#[cfg(all(feature = "linux", target_os = "linux", not(condor_loom)))]
pub mod linux;

#[cfg(target_has_atomic = "64")]
pub use handover::{ClockFault, Handover};
#[cfg(target_has_atomic = "64")]
pub use local::LocalClock;
#[cfg(target_has_atomic = "64")]
pub use obstacle::Obstacle;
#[cfg(target_has_atomic = "64")]
pub use page::{NEVER, Page, PageError, Until};
