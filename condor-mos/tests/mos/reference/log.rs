//! What both schedulers write down at every step.

use condor_mos::{Overrun, Rate};

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum What {
    Begins(usize),
    Ends(usize),
    Acted,
    /// A lock was not for the loop that asked for it.
    Refused,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Counts {
    pub(crate) rate: Rate,
    pub(crate) enabled: bool,
    pub(crate) faulted: bool,
    pub(crate) released: u64,
    pub(crate) run: u64,
    pub(crate) skipped: u64,
    pub(crate) running: u64,
    pub(crate) pending: u64,
    pub(crate) worst_run: u64,
    pub(crate) total_run: u64,
    pub(crate) worst_lateness: u64,
}

#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Entry {
    pub(crate) now: u64,
    pub(crate) what: What,
    pub(crate) loops: Vec<Counts>,
}

/// Leaves out what is not known: times that a narrow counter cannot hold, and the lateness of loops
/// for which several releases wait.
pub(crate) fn known(mut log: Vec<Entry>, bits: u32, overruns: &[Overrun]) -> Vec<Entry> {
    for entry in &mut log {
        for (one, overrun) in entry.loops.iter_mut().zip(overruns) {
            if bits < 32 {
                (one.worst_run, one.total_run) = (0, 0);
            }
            if bits < 32 || matches!(overrun, Overrun::CatchUp(2..)) {
                one.worst_lateness = 0;
            }
        }
    }
    log
}
