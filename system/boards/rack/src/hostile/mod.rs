//! Every driver that ships, on boards whose registers say anything, on a bus that fails anywhere,
//! with interrupts in any order, driven by bytes.
//!
//! The first byte says whether registers are true, so that only bus errors are in the way, or
//! lie. The `Journal` sees each access that a driver makes and each answer that
//! a program gets, and knows what each byte has become.
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

/// What a run went through.
#[derive(Clone, Copy, Debug, Default)]
pub struct Tally {
    /// Accesses that drivers made.
    pub accesses: u64,
    /// Those that failed, and those that gave what no board would.
    pub hostile: u64,
    /// Calls of programs and interrupts.
    pub calls: u64,
    /// Bytes that drivers acknowledged, either way.
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
