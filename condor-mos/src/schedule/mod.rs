//! The instants at which loops are due: the event table, and the scan if no table fits.

mod grid;
mod print;
mod scan;
mod set;
mod table;

pub use table::{EventTable, Scan, entries};

pub(crate) use grid::Grid;

/// An instant of a schedule at which the timer interrupts: the loops that are due then, and the
/// time to the next one.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ScheduleEvent {
    /// The loops that are due: bit *n* stands for the loop of rank *n*, where rank 0 is the
    /// fastest. It is 0 if the instant only divides a time that is too long for the timer.
    pub ranks: u32,
    /// The ticks until the next event.
    pub gap: u32,
}
