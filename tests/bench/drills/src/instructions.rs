//! The counts of instructions that releases, messages and interrupts cost a hart, as the hart alone has counted them.
//!
//! The program is in `tests/bench/drills/hart`, since it counts with registers of RISC-V.

use zerocopy::{FromBytes, Immutable, IntoBytes};

/// The name under which [`Counts`] are published.
pub const NAME: &str = "instructions";

/// Whole numbers of instructions, and of what they were counted for.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, FromBytes, IntoBytes, Immutable)]
#[repr(C)]
pub struct Counts {
    /// Length of a sequence between two reads of the counter, the second of them included.
    pub sequence: u32,
    /// Instructions that were counted for the sequence.
    pub sequence_counted: u32,
    /// Length of a trap handler.
    pub handler: u32,
    /// Runs of the handler, which interrupted a background that counts its own instructions.
    pub handler_runs: u32,
    /// Instructions that all these runs took from the background.
    pub handler_counted: u32,
    /// Periods of the slowest loop that were measured, and how many releases are due in each.
    pub hyperperiods: u32,
    /// Releases that are due in each of these periods.
    pub releases_each: u32,
    /// Releases that ran in that time.
    pub releases: u32,
    /// Instructions that these releases took from the background.
    pub releases_counted: u32,
    /// Instructions of the body of each loop.
    pub body: u32,
    /// Messages of the hart to itself, and as many with reply.
    pub messages: u32,
    /// Instructions that sending and serving those without reply took.
    pub messages_counted: u32,
    /// Instructions that sending and serving those with reply took.
    pub replies_counted: u32,
    /// Interrupts of a board that is memory.
    pub interrupts: u32,
    /// Instructions from the one that was interrupted to the first one of the board's driver.
    pub interrupts_counted: u32,
}
