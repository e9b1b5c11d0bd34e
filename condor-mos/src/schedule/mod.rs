//! The instants at which loops are due: the event table, and the scan if no table fits.

mod grid;
mod print;
mod scan;
mod set;
mod table;

pub use table::{EventTable, Scan, entries};

pub(crate) use grid::Grid;

/// A point of the schedule, with the loops that are due there.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Event {
    /// The ranks of the loops that are due, one bit each; 0 at a point that only divides a time too
    /// long for the timer.
    pub ranks: u32,
    /// The ticks until the next event.
    pub gap: u32,
}
