//! When loops are due: the event table, and the scan where no table fits.

mod grid;
mod print;
mod scan;
mod table;

pub use scan::Scan;
pub use table::EventTable;

pub(crate) use grid::Grid;

use crate::clock::Clock;
use crate::error::RateError;
use crate::rate::Rate;

/// A point of the schedule: what is due there, and how long until the next one.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Event {
    /// A bit for every loop that is due, by rank; none at a point that only bridges a time too long
    /// for the timer.
    pub ranks: u32,
    /// Ticks until the next event.
    pub gap: u32,
}

/// Only this crate's schedules are used inside critical sections.
pub trait Sealed {}

impl<const L: usize> Sealed for Scan<L> {}
impl<const L: usize, const E: usize> Sealed for EventTable<L, E> {}

/// A source of events for a set of `L` loops: an [`EventTable`] or a [`Scan`].
///
/// Ranks number the loops from the fastest, 0, on; loops of one rate in their own order.
pub trait Schedule<const L: usize>: Sealed {
    /// The clock whose ticks the schedule counts.
    fn clock(&self) -> Clock;

    /// The number of the loop at each rank.
    fn ranks(&self) -> &[u8; L];

    /// The rate of each loop, by its number.
    fn rates(&self) -> &[Rate; L];

    /// Goes back to the beginning, where every loop is due.
    fn restart(&mut self);

    /// Whether [`turn`](Self::turn) must be called before the next event.
    fn is_at_turn(&self) -> bool;

    /// Goes to a place where changed rates may take effect.
    ///
    /// They do if `idle`, that is if no loop is unfinished: ranks are not changed under a loop that is in
    /// progress. Then the result has, for each new rank, the one that its loop had before.
    fn turn(&mut self, idle: bool) -> Option<[u8; L]>;

    /// The next event.
    fn next_event(&mut self) -> Event;

    /// Asks for another rate of a loop. It takes effect, together with all that were asked for
    /// since, after [`continue_change`](Self::continue_change) has said that everything is ready.
    ///
    /// # Errors
    /// [`RateError::TooFast`]; then nothing has changed.
    fn begin_change(&mut self, number: usize, rate: Rate) -> Result<(), RateError>;

    /// Does a short piece of what a change needs, and says whether everything is ready.
    ///
    /// # Errors
    /// [`RateError::TooManyEvents`]; then all that was asked for is forgotten.
    fn continue_change(&mut self) -> Result<bool, RateError>;

    /// Whether rates that were asked for have not taken effect yet.
    fn is_changing(&self) -> bool;
}

/// For each rank of `after`, the rank that its loop has in `before`.
fn former_ranks<const L: usize>(before: &[u8; L], after: &[u8; L]) -> [u8; L] {
    after.map(|number| {
        let same = |other: &u8| *other == number;
        before.iter().position(same).unwrap_or(0) as u8
    })
}
