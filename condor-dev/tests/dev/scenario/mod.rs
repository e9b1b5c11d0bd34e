//! Every driver that ships, on boards whose registers say anything, on a bus that fails anywhere,
//! with interrupts in any order, driven by bytes.
//!
//! The first byte says whether registers are true, so that only bus errors are in the way, or
//! lie. The [`Journal`](journal::Journal) sees each access that a driver makes and each answer that
//! a program gets, and knows what each byte has become.
//!
//! Both the property tests and the fuzz target include this module, hence no names of either.

#[path = "../boards/mod.rs"]
pub(crate) mod boards;
mod bus;
mod journal;
mod program;

use core::fmt;

/// What a run went through.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Tally {
    /// Accesses that drivers made.
    pub(crate) accesses: u64,
    /// Those that failed, and those that gave what no board would.
    pub(crate) hostile: u64,
    /// Calls of programs and interrupts.
    pub(crate) calls: u64,
    /// Bytes that drivers acknowledged, either way.
    pub(crate) bytes: u64,
}

impl Tally {
    // Not every program that includes this adds runs up.
    #[allow(dead_code)]
    pub(crate) fn add(&mut self, run: Self) {
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

/// Drives a program by `bytes`.
///
/// # Panics
/// If a driver broke a promise.
pub(crate) fn run(bytes: &[u8]) -> Tally {
    program::run(bytes)
}
