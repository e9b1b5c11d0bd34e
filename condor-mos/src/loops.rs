//! [`Loops`]: servo loops on any machine.

use crate::error::{LoopError, StartError};
use crate::process::LoopId;
use crate::rate::Rate;
use crate::record::Histograms;
use crate::runner::Runner;
use crate::scope::Scope;
use crate::statistics::Statistics;

/// Servo loops and a background, with the same methods whatever runs them: a
/// [`Scheduler`](crate::Scheduler) on one stack, over interrupts, signals or virtual time, or
#[cfg_attr(
    all(feature = "linux", target_os = "linux", not(condor_loom)),
    doc = "[`linux::Threads`](crate::linux::Threads)."
)]
#[cfg_attr(
    not(all(feature = "linux", target_os = "linux", not(condor_loom))),
    doc = "threads of Linux."
)]
///
/// Code that must run on any of them takes a `&impl Loops`, and shares data in a
/// [`LoopLock`](crate::LoopLock):
///
/// ```
/// use condor_mos::{LoopId, LoopLock, Loops, Overrun};
///
/// const SERVO: LoopId = LoopId(0);
///
/// fn control(
///     loops: &impl Loops,
///     background: impl FnOnce(),
/// ) -> Result<u32, Box<dyn std::error::Error>> {
///     let shared = LoopLock::new(&[SERVO], 0);
///     let mut servo = |_| {
///         let _ = shared.lock(loops, |runs| *runs += 1);
///     };
///     loops.scope(|scope| {
///         scope.assign(SERVO, Overrun::Skip, &mut servo)?;
///         loops.run(background)?;
///         Ok::<_, Box<dyn std::error::Error>>(())
///     })?;
///     Ok(shared.lock(loops, |runs| *runs)?)
/// }
/// # use condor_mos::{ClockSpec, EventTable, Rate, Scheduler, sim::SimPlatform};
/// # let hertz = Rate::hz(1000);
/// # let table = EventTable::<1, 1>::new(&[Rate::hz(100)], ClockSpec::of::<u64>(hertz));
/// # let scheduler = Scheduler::new(SimPlatform::new(hertz), table);
/// # assert_eq!(control(&scheduler, || scheduler.platform().run_until(50))?, 5);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
///
/// All methods may be called by the background, by loops and by interrupt handlers.
pub trait Loops: Runner + Sync {
    /// Calls `f` with a scope in which closures that borrow data can become loops. When `f` returns
    /// or unwinds, these loops finish the run that is in progress, and do not run again.
    fn scope<'env, R>(
        &self,
        f: impl for<'scope> FnOnce(&'scope Scope<'scope, 'env, Self::Instant>) -> R,
    ) -> R
    where
        Self: Sized,
    {
        Scope::run(self, f)
    }

    /// Starts the loops, and runs `background`; stops the loops when `background` returns or
    /// unwinds.
    ///
    /// # Errors
    /// [`StartError::Connect`] if no handler can be connected to the timer's interrupt;
    /// [`StartError::Clock`] or [`StartError::Started`] as in [`start`](Self::start). `background`
    /// has not run then.
    fn run<R>(&self, background: impl FnOnce() -> R) -> Result<R, StartError>
    where
        Self: Sized;

    /// Runs `background` as [`run`](Self::run) does, but starts the schedule at `instant`, as
    /// [`start_at`](Self::start_at) does.
    ///
    /// # Errors
    /// [`StartError::Connect`] if no handler can be connected to the timer's interrupt;
    /// [`StartError::Clock`] or [`StartError::Started`] as in [`start`](Self::start). `background`
    /// has not run then.
    fn run_from<R>(
        &self,
        instant: Self::Instant,
        background: impl FnOnce() -> R,
    ) -> Result<R, StartError>
    where
        Self: Sized;

    /// Starts the schedule: each enabled loop is due first now, or after its phase if it has one.
    ///
    /// # Errors
    /// [`StartError::Clock`] if the schedule was made for another clock than the platform's,
    /// [`StartError::NoHandler`] if the platform knows that its interrupts have no handler,
    /// [`StartError::Started`] if it has started already.
    fn start(&self) -> Result<(), StartError>;

    /// Starts the schedule at `instant`, which is less than half of the counter's range away. So
    /// several processors can begin together.
    ///
    /// # Errors
    /// [`StartError::Clock`], [`StartError::NoHandler`] or [`StartError::Started`], as in
    /// [`start`](Self::start).
    fn start_at(&self, instant: Self::Instant) -> Result<(), StartError>;

    /// Stops the schedule: runs in progress finish, and releases that have not started are skipped.
    fn stop(&self);

    /// Enables a loop: it is released at the next instant at which it is due, and from then on at
    /// its rate.
    ///
    /// # Errors
    /// [`LoopError::NoSuchLoop`] if there is no such loop, [`LoopError::Unassigned`] if it has no
    /// body.
    fn enable(&self, id: LoopId) -> Result<(), LoopError>;

    /// Disables a loop; a run in progress finishes.
    ///
    /// # Errors
    /// [`LoopError::NoSuchLoop`] if there is no such loop, [`LoopError::Unassigned`] if it has no
    /// body.
    fn disable(&self, id: LoopId) -> Result<(), LoopError>;

    /// Sets another rate for a loop, while all loops run on. The next release of the loop keeps its instant, and the
    /// new rate counts from there. Priorities follow the rates.
    ///
    /// # Errors
    /// [`LoopError::NoSuchLoop`] if there is no such loop, [`LoopError::Rate`] if the new rates
    /// have no schedule; all rates stay as they are then.
    fn set_rate(&self, id: LoopId, rate: Rate) -> Result<(), LoopError>;

    /// Returns the present counts and times of a loop.
    ///
    /// # Errors
    /// [`LoopError::NoSuchLoop`] if there is no such loop, [`LoopError::NoStatistics`] if none are
    /// kept.
    fn statistics(&self, id: LoopId) -> Result<Statistics, LoopError>;

    /// Returns the distributions of the lateness and the run times of a loop so far, in ticks.
    ///
    /// # Errors
    /// [`LoopError::NoSuchLoop`] if there is no such loop, [`LoopError::NoStatistics`] unless
    /// [`Histograms`] are kept.
    fn histograms(&self, id: LoopId) -> Result<Histograms, LoopError>;

    /// Sets the counts and times of a loop to 0, also in its distributions.
    ///
    /// # Errors
    /// [`LoopError::NoSuchLoop`] if there is no such loop.
    fn reset_statistics(&self, id: LoopId) -> Result<(), LoopError>;
}

/// Ends the schedule, also when the background unwinds.
pub(crate) struct Stop<'l, L: Loops>(pub(crate) &'l L);

impl<L: Loops> Drop for Stop<'_, L> {
    fn drop(&mut self) {
        self.0.stop();
    }
}
