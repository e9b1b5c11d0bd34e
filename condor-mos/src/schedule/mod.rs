//! When loops are due: the event table, and the scan where no table fits.

mod grid;
mod print;
mod scan;
mod set;
mod table;

pub use table::{EventTable, Scan, entries};

pub(crate) use grid::Grid;

/// A point of the schedule: what is due there, and how long until the next one.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Event {
    /// A bit for every loop that is due, by rank; none at a point that only bridges a time too long
    /// for the timer.
    pub ranks: u32,
    /// Ticks until the next event.
    pub gap: u32,
}
