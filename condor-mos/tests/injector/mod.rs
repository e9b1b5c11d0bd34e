//! The scheduler with an interrupt at every point where it reaches shared state; and, in [`latest`],
//! values that loops hand over.
//!
//! A point is an entry to a critical section, an exit from one, an access outside of any, and what
//! the programs below add: the middle of every loop's body, and the background. For each set of
//! loops a run is made with an interrupt at its first point, one with an interrupt at its second
//! point, and so on; within that interrupt another one comes at each of its points in turn, and in
//! that a third. After every section the counts of all loops are compared with a model of what one
//! section may do.
//!
//! It fails if the release of loops and the arming of the timer, the start of a loop, or its end are
//! not one section each, if vectors are pended for ready loops only, if a nested lock lowers the
//! ceiling, and if the end of a lock does not dispatch.

pub(crate) mod atomics;
pub(crate) mod hook;

mod latest;
mod oracle;
mod plan;
mod programs;
mod unwinding;
mod world;
