//! What a hart alone has counted of its own instructions: what releases and messages cost.
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
    /// What was counted of it.
    pub sequence_counted: u32,
    /// Length of a trap handler.
    pub handler: u32,
    /// How often it interrupted a background that counts its own instructions.
    pub handler_runs: u32,
    /// What all of that took from the background.
    pub handler_counted: u32,
    /// Periods of the slowest loop that were measured, and how many releases are due in each.
    pub hyperperiods: u32,
    /// The same.
    pub releases_each: u32,
    /// Releases that ran in that time.
    pub releases: u32,
    /// What they took from the background.
    pub releases_counted: u32,
    /// What the body of each is.
    pub body: u32,
    /// Messages of the hart to itself, and as many with reply.
    pub messages: u32,
    /// What sending and serving those without reply took.
    pub messages_counted: u32,
    /// The same, with reply.
    pub replies_counted: u32,
}
