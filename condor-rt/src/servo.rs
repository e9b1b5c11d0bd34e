//! [`ServoLoop`], and how a machine runs loops.

use condor_mos::{LoopId, Loops, Overrun, Platform, Rate, RateError, Scheduler};
use heapless::Vec;

use crate::error::Error;
use crate::list::fitting;

/// The most loops of a program.
pub const LOOPS: usize = 8;
/// Entries of the event table that a program's loops have; rates that take more are computed.
const ENTRIES: usize = 32;

/// A loop, for [`Machine::with_loops`](crate::Machine::with_loops).
pub struct ServoLoop<'b> {
    /// How often it is due.
    pub rate: Rate,
    /// What happens if it is due before it has finished.
    pub overrun: Overrun,
    /// What it does; it is given the instant, in ticks of the machine's timer, at which it was due.
    pub body: &'b mut (dyn FnMut(u64) + Send),
}

/// Runs loops on the stack of the background, which they interrupt: the
/// [`with_loops`](crate::Machine::with_loops) of most machines.
///
/// # Errors
/// Those of [`with_loops`](crate::Machine::with_loops).
pub fn on_one_stack<P, R>(
    platform: P,
    loops: &mut [ServoLoop<'_>],
    background: impl FnOnce(&dyn Loops<Instant = u64>) -> R,
) -> Result<R, Error>
where
    P: Platform<Instant = u64> + Sync,
{
    let rates = rates(loops)?;
    let scheduler = Scheduler::<_, LOOPS, ENTRIES>::with_rates(platform, &rates)?;
    run(&scheduler, loops, || background(&scheduler))
}

/// The rates of loops, in their order.
pub(crate) fn rates(loops: &[ServoLoop<'_>]) -> Result<Vec<Rate, LOOPS>, RateError> {
    let too_many = RateError::Loops {
        loops: loops.len(),
        capacity: LOOPS,
    };
    let rates = loops.iter().map(|one| one.rate);
    (loops.len() <= LOOPS)
        .then(|| fitting(rates))
        .ok_or(too_many)
}

/// Runs loops by whatever runs them, with a background.
pub(crate) fn run<R>(
    by: &impl Loops<Instant = u64>,
    loops: &mut [ServoLoop<'_>],
    background: impl FnOnce() -> R,
) -> Result<R, Error> {
    by.scope(|scope| {
        for (id, one) in (0..).map(LoopId).zip(loops) {
            scope.assign(id, one.overrun, &mut one.body)?;
        }
        Ok(by.run(background)?)
    })
}
