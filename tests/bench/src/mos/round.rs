//! A round: every contestant once, each in a process of its own.

use std::time::Duration;

use fastrand::Rng;

use super::system::{Rank, be_fifo};
use super::turn::Turn;
use crate::Result;
use crate::clock::Calibration;
use crate::measure::Estimate;
use crate::process::{Child, pin};

/// A contestant.
pub(super) struct Entry {
    /// The name of the contestant in the table.
    pub(super) name: &'static str,
    /// Starts the loops of the turn, each of which calls [`Loop::run`](super::turn::Loop::run)
    /// once a release, and calls [`Turn::background`] on the thread that called.
    ///
    /// That thread is bound to the measuring core, and what it starts inherits that. When the
    /// background has ended this may return while loops still run: the process ends then.
    pub(super) run: fn(&'static Turn) -> Result<()>,
}

/// The length of a round, and the core on which it runs.
#[derive(Clone, Copy, Debug)]
pub(super) struct Plan {
    /// The number of turns that every contestant has in a round.
    pub(super) turns: u32,
    /// The length of a turn.
    pub(super) length: Duration,
    /// The core on which everything runs.
    pub(super) core: usize,
}

/// A contestant that takes so much longer has gone wrong.
const GRACE: Duration = Duration::from_secs(10);

/// Plays a round; returns the figures of every entry, one after the other.
///
/// # Safety
/// The calling process must have one thread only, since it is forked.
pub(super) unsafe fn play(entries: &[Entry], plan: &Plan, order: &mut Rng) -> Result<Vec<f64>> {
    let mut indices: Vec<usize> = (0..entries.len()).collect();
    let mut turns = vec![Vec::new(); entries.len()];
    for _ in 0..plan.turns {
        order.shuffle(&mut indices);
        for &index in &indices {
            // SAFETY: one thread only, by this function's contract.
            let figures = unsafe { play_one(&entries[index], plan) }
                .map_err(|error| format!("{}: {error}", entries[index].name))?;
            turns[index].push(figures);
        }
    }
    let medians = turns.iter().flat_map(|turns: &Vec<Vec<f64>>| {
        let figures = turns.first().map_or(0, Vec::len);
        (0..figures).map(|figure| Estimate::of(turns.iter().map(|turn| turn[figure])).value)
    });
    Ok(medians.collect())
}

/// Runs one contestant in a child process, and returns its figures.
///
/// # Safety
/// As for [`play`].
unsafe fn play_one(entry: &Entry, plan: &Plan) -> Result<Vec<f64>> {
    // SAFETY: one thread only, by this function's contract.
    let child = unsafe {
        Child::fork("contestant", plan.length + GRACE, || {
            pin(plan.core)?;
            // If that is not permitted, the report says so.
            let _ = be_fifo(Rank::Background);
            let calibration = Calibration::begin();
            let turn: &'static Turn = Box::leak(Box::new(Turn::new(plan.length)));
            (entry.run)(turn)?;
            Ok(turn.figures(calibration.ns_per_tick())?.into())
        })
    }?;
    child.figures()
}
