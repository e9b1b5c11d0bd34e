//! The scheduler with an interrupt at every point where it reaches shared state; and, in [`latest`],
//! values that loops hand over.
//!
//! The programs below add points of their own: the middle of every loop's body, and the background.
//! For each set of loops an interrupt comes at each point in turn, within it another one, and in that
//! a third. After every section the counts of all loops are compared with a model of what one section
//! may do.
//!
//! It fails if the release of loops and the arming of the timer, the start of a loop, or its end are
//! not one section each, if vectors are pended for ready loops only, if a nested lock lowers the
//! ceiling, and if the end of a lock does not dispatch.

mod latest;
mod oracle;
mod programs;
mod unwinding;
mod world;
