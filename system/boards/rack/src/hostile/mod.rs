//! Every driver that ships, on boards whose registers return anything, on a bus that fails anywhere, with
//! interrupts in any order, driven by bytes.
//!
//! The first byte decides whether registers return true values, so that only bus errors are in the way, or
//! false ones. The `Journal` sees each access that a driver makes and each answer that a program gets, and
//! knows where each byte must be.
#![allow(
    clippy::must_use_candidate,
    clippy::new_without_default,
    reason = "of use to tests alone"
)]

pub mod boards;
mod bus;
mod journal;
mod program;

use core::fmt;

pub use program::run as drivers;

/// The counts of what happened in a run of the fuzz test.
#[derive(Clone, Copy, Debug, Default)]
pub struct Tally {
    /// The number of accesses that drivers made.
    pub accesses: u64,
    /// The number of accesses that failed, or that returned a value that no board would.
    pub hostile: u64,
    /// The number of calls of programs and of interrupts.
    pub calls: u64,
    /// The number of bytes that drivers acknowledged, in both directions.
    pub bytes: u64,
}

impl Tally {
    pub fn add(&mut self, run: Self) {
        self.accesses += run.accesses;
        self.hostile += run.hostile;
        self.calls += run.calls;
        self.bytes += run.bytes;
    }
}

impl fmt::Display for Tally {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "{} calls, {} accesses, {} of them hostile; {} bytes acknowledged",
            self.calls, self.accesses, self.hostile, self.bytes
        )
    }
}
