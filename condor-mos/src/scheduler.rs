//! [`Scheduler`]: servo loops at exact rates, on one stack.

use critical_section::CriticalSection;

use crate::body::LoopBody;
use crate::clock::ClockSpec;
use crate::error::{LoopError, LoopLockError, RateError, StartError};
use crate::events::catch_up;
use crate::instant::CounterReading;
use crate::loops::{Loops, Stop};
use crate::masked::{Masked, masked, section};
use crate::platform::Platform;
use crate::process::{LoopId, Overrun};
use crate::rate::Rate;
use crate::record::{Counts, Histograms, Keep};
use crate::runner::{Gate, Runner};
use crate::schedule::EventTable;
use crate::state::{Running, SchedulerState, Start};
use crate::statistics::Statistics;
use crate::sync::{Ordering, const_unless_loom};
use crate::timer::Armed;

/// A scheduler that runs up to `L` servo loops at exact rates, on the stack of the background that they interrupt
/// (memo, section 3.2.2).
///
/// The fastest loop that is due runs; only faster loops interrupt it; when no loop is due, the
/// background continues. A loop must finish within its period; the exact moment of its start does
/// not matter.
///
/// `P` is the [`Platform`], and `K` selects the statistics that are kept. The [`EventTable`] has room for `L` loops and
/// `E` entries. A scheduler is usually a `static`, so that interrupt handlers can access it: all methods take `&self`,
/// may be called by the background, by loops and by handlers, and are short critical sections.
///
/// ```
/// use condor_mos::sim::SimPlatform;
/// use condor_mos::{LoopId, Loops, Overrun, Rate, Scheduler};
///
/// let processor = SimPlatform::new(Rate::hz(1_000_000));
/// let scheduler = Scheduler::<_, 1, 1>::with_rates(processor, &[Rate::hz(400)])?;
/// let mut ticks = 0;
/// let mut servo = |_due| ticks += 1;
/// scheduler.scope(|scope| {
///     scope.assign(LoopId(0), Overrun::Skip, &mut servo)?;
///     Ok::<_, Box<dyn std::error::Error>>(scheduler.run(|| scheduler.platform().run_until(1_000_000))?)
/// })?;
/// assert_eq!(ticks, 400);
/// # Ok::<_, Box<dyn std::error::Error>>(())
/// ```
pub struct Scheduler<P: Platform, const L: usize, const E: usize, K: Keep = Counts> {
    platform: P,
    state: Masked<SchedulerState<P::Instant, L, E, K>>,
}

impl<P: Platform, const L: usize, const E: usize> Scheduler<P, L, E> {
    const_unless_loom! {
        /// Makes a scheduler of the loops in `schedule`, which have no bodies yet. [`Loops::run`] or [`Loops::start`]
        /// starts it.
        #[must_use]
        pub const fn new(platform: P, schedule: EventTable<L, E>) -> Self {
            Self::keeping(platform, schedule)
        }
    }

    /// Makes a scheduler of loops with these rates, for the clock of `platform`. `rates[n]` is the rate of loop *n*.
    /// The schedule is a table with `E` entries, or a [`Scan`](crate::Scan) if that is too small for the rates.
    ///
    /// # Errors
    /// [`RateError::Loops`] unless there are 1 to `L` rates, [`RateError::TooFast`] if a period is
    /// shorter than a tick.
    pub fn with_rates(platform: P, rates: &[Rate]) -> Result<Self, RateError> {
        let clock = ClockSpec::of::<P::Instant>(platform.frequency());
        Ok(Self::new(platform, EventTable::or_scan(rates, &[], clock)?))
    }
}

impl<P: Platform, const L: usize, const E: usize, K: Keep> Scheduler<P, L, E, K> {
    const_unless_loom! {
        /// Makes a scheduler as [`new`](Scheduler::new) does, but with statistics of the type `K`: [`Counts`],
        /// [`Histograms`] or [`NoStatistics`](crate::NoStatistics).
        #[must_use]
        pub const fn keeping(platform: P, schedule: EventTable<L, E>) -> Self {
            Self {
                platform,
                state: Masked::new(SchedulerState::new(schedule)),
            }
        }
    }

    /// Returns the platform with which the scheduler was made, for example to read its timer.
    #[must_use]
    pub const fn platform(&self) -> &P {
        &self.platform
    }

    /// Sets the body of the loop `id`, which cannot be changed afterwards, and enables the loop. Each run calls `body`
    /// with `context` and the instant at which the loop was due. `overrun` says what happens if the loop is due again
    /// before a run has finished.
    ///
    /// # Errors
    /// [`LoopError::NoSuchLoop`] if there is no such loop, [`LoopError::Taken`] if it has a body.
    pub fn assign<C: Send>(
        &self,
        id: LoopId,
        overrun: Overrun,
        body: fn(&mut C, P::Instant),
        context: &'static mut C,
    ) -> Result<(), LoopError> {
        self.assign_body(id, overrun, LoopBody::of_function(body, context))
    }

    fn begin_schedule(&self, at: Option<P::Instant>) -> Result<(), StartError> {
        let timer = ClockSpec::of::<P::Instant>(self.platform.frequency());
        section(|section| {
            let at = at.unwrap_or_else(|| self.platform.now());
            self.state.with(section, |state| {
                let schedule = state.schedule.clock();
                if schedule != timer {
                    return Err(StartError::Clock { timer, schedule });
                }
                if !self.platform.has_handler() {
                    return Err(StartError::NoHandler);
                }
                if state.started_due().is_some() {
                    return Err(StartError::Started);
                }
                state.start(at);
                Ok(())
            })
        })?;
        if P::VECTORS {
            self.platform.pend(1);
        } else {
            self.look_again();
        }
        Ok(())
    }

    /// Returns true if a rate that [`Loops::set_rate`] changed has not taken effect yet.
    #[must_use]
    pub fn is_changing(&self) -> bool {
        self.with_state(|state| state.schedule.is_changing())
    }

    /// Releases the loops that are due, and runs them or pends their vectors. The handler of the timer's interrupt must
    /// call this, unless [`Loops::run`] connects the handler itself (see [`Platform::connect`]).
    ///
    /// An interrupt that comes early or without cause does no harm.
    #[inline(always)]
    pub fn on_timer(&self) {
        if P::VECTORS {
            match masked(&self.platform, |section| self.release_and_pend(section)) {
                Some(start) => self.run_in_vector::<true, true>(0, start),
                None => self.look_again(),
            }
        } else {
            self.release_and_run::<true>();
        }
    }

    /// Runs the loop of rank `rank` if it has been released. On a platform with vectors, the interrupt handler of that
    /// rank must call this. Rank 0 is the fastest loop.
    #[inline(always)]
    pub fn on_vector(&self, rank: u32) {
        let begun = masked(&self.platform, |section| {
            let now = self.measured_now();
            self.state
                .with(section, |state| state.begin_unlocked(rank, now))
        });
        if let Some(start) = begun {
            self.run_in_vector::<false, true>(rank, start);
        }
    }

    /// Releases what is due, pends the vectors of loops that can start, and begins the fastest; what
    /// happens less often than that is left to [`look_again`](Self::look_again).
    #[inline(always)]
    fn release_and_pend(&self, section: CriticalSection<'_>) -> Option<Start<P::Instant>> {
        let now = self.platform.now();
        let (due, event, index) = self.state.with(section, |state| state.peek_event(now))?;
        if event.ranks != 1 {
            let others = event.ranks & !1;
            if others == event.ranks {
                return None;
            }
            self.state
                .with(section, |state| state.make_runnable(others, due));
            self.platform.pend(others);
        }
        // Nothing interrupts it: the timer can wait until it has run.
        self.state.with(section, |state| {
            state.take_event(due, event, index);
            state.begin_released(0, due, now)
        })
    }

    /// The timer's interrupt came early, without cause or late, or not for the fastest loop, or nothing
    /// is started.
    #[cold]
    #[inline(never)]
    fn look_again(&self) {
        if !P::VECTORS {
            return self.release_and_run::<false>();
        }
        let begun = masked(&self.platform, |section| {
            let now = self.release(section);
            self.pend_others(section);
            self.state
                .with(section, |state| state.begin_unlocked(0, now))
        });
        if let Some(start) = begun {
            self.run_in_vector::<true, false>(0, start);
        }
    }

    /// Pends the vectors of all loops that can start but the fastest, whose vector is the caller's.
    fn pend_others(&self, section: CriticalSection<'_>) {
        let others = self.state.with(section, |state| state.unlocked()) & !1;
        if others != 0 {
            self.platform.pend(others);
        }
    }

    /// Runs a loop in its own vector.
    ///
    /// That of the fastest loop is the timer's. The copy that runs often is compiled by itself, so that
    /// all of it is inlined.
    #[inline(always)]
    fn run_in_vector<const FASTEST: bool, const OFTEN: bool>(
        &self,
        rank: u32,
        start: Start<P::Instant>,
    ) {
        let running = start.running;
        self.call(rank, start);
        let ended = masked(&self.platform, |section| {
            let now = self.measured_now();
            let next = self.state.with(section, |state| state.plain_next(rank));
            if next.is_none_or(|next| FASTEST && self.platform.arm(next) == Armed::Past) {
                return false;
            }
            self.state.with(section, |state| {
                state.end_plainly::<FASTEST>(rank, running, now);
            });
            true
        });
        if !ended {
            self.end_unusually(rank, running);
        }
    }

    /// Ends a loop at whose end there is more to do, or that has unwound.
    #[cold]
    #[inline(never)]
    fn end_unusually(&self, rank: u32, running: Running<P::Instant>) {
        let again = masked(&self.platform, |section| {
            if P::VECTORS && rank == 0 {
                return self.end_overdue(section, running);
            }
            // In the section: loops that interrupt before it are no part of this one's time.
            let now = self.platform.now();
            self.state
                .with(section, |state| state.end(rank, running, now))
        });
        if again {
            self.platform.pend(1_u32.unbounded_shl(rank));
        }
    }

    /// Ends the fastest loop, which the timer could not interrupt: what was due before came before the
    /// end. Says whether the vector is to run again.
    fn end_overdue(&self, section: CriticalSection<'_>, mut running: Running<P::Instant>) -> bool {
        let next = self.state.with(section, |state| state.started_due());
        let late = next.is_some_and(|next| self.platform.arm(next) == Armed::Past);
        let mut now = self.platform.now();
        let overdue = late && self.state.with(section, |state| state.is_overdue(now));
        if overdue {
            now = self.catch_up_and_pend(section);
        }
        let waits = self.state.with(section, |state| {
            running.busy = state.busy;
            state.end(0, running, now)
        });
        // An event that is due just now comes after it, and its interrupt may not come by itself.
        waits || late && !overdue
    }

    /// Now, if anybody wants to know.
    #[inline(always)]
    fn measured_now(&self) -> P::Instant {
        if K::MEASURES {
            self.platform.now()
        } else {
            P::Instant::ZERO
        }
    }

    /// Starts the fastest loop that may start, if this is the stack for it.
    #[inline(always)]
    fn begin_fastest(
        &self,
        section: CriticalSection<'_>,
        now: P::Instant,
    ) -> Option<(u32, Start<P::Instant>)> {
        if self.state.with(section, |state| state.ready()) == 0 || !self.platform.is_loops_stack() {
            return None;
        }
        self.state.with(section, |state| state.begin_fastest(now))
    }

    /// Releases what is due, and runs what can start. What runs `OFTEN` is compiled by itself, so that all
    /// of it is inlined.
    #[inline(always)]
    fn release_and_run<const OFTEN: bool>(&self) {
        let begun = masked(&self.platform, |section| {
            let now = self.release(section);
            self.begin_fastest(section, now)
        });
        self.run_nested::<OFTEN>(begun);
    }

    /// Runs loops, the fastest first, on the interrupted stack.
    #[inline(always)]
    fn run_nested<const OFTEN: bool>(&self, begun: Option<(u32, Start<P::Instant>)>) {
        let mut next = begun;
        while let Some((rank, start)) = next {
            let running = start.running;
            self.call(rank, start);
            next = masked(&self.platform, |section| {
                let now = self.measured_now();
                self.state.with(section, |state| {
                    state.end(rank, running, now);
                    state.begin_fastest(now)
                })
            });
        }
    }

    #[inline(always)]
    fn call(&self, rank: u32, start: Start<P::Instant>) {
        let end = End {
            scheduler: self,
            rank,
            running: start.running,
        };
        // SAFETY: the context is there until `withdraw` has seen that the loop is not in progress,
        // as it is since `begin`; and a loop in progress is not begun again.
        self.platform
            .interruptible(rank, || unsafe { start.body.call(start.due) });
        core::mem::forget(end);
    }

    /// Releases what is due, and arms the timer for what comes next. Returns an instant at which all
    /// that was released was due: time passes here, too, and what has become due meanwhile is
    /// released with the rest.
    #[inline(always)]
    fn release(&self, section: CriticalSection<'_>) -> P::Instant {
        let now = self.platform.now();
        let next = self.state.with(section, |state| {
            let (due, event, index) = state.peek_event(now)?;
            let next = state.take_event(due, event, index);
            state.make_runnable(event.ranks, due);
            Some(next)
        });
        if next.is_some_and(|next| self.platform.arm(next) == Armed::Ahead) {
            return now;
        }
        self.rearm(section, now)
    }

    /// The interrupt came early, late or without cause, or there is more to do than to start loops.
    /// Returns as [`release`](Self::release) does.
    #[cold]
    #[inline(never)]
    fn rearm(&self, section: CriticalSection<'_>, now: P::Instant) -> P::Instant {
        match self.state.with(section, |state| state.started_due()) {
            Some(due) if now.has_reached(due) || self.platform.arm(due) == Armed::Past => {
                self.catch_up(section)
            }
            _ => now,
        }
    }

    /// As [`catch_up`](Self::catch_up), in the vector of the fastest loop.
    #[cold]
    fn catch_up_and_pend(&self, section: CriticalSection<'_>) -> P::Instant {
        let now = self.catch_up(section);
        self.pend_others(section);
        now
    }

    /// Passes events that are due already, until one is ahead. Returns when it has done so: the
    /// last of them may have become due only meanwhile.
    #[cold]
    fn catch_up(&self, section: CriticalSection<'_>) -> P::Instant {
        catch_up(&self.platform, || {
            self.state.with(section, SchedulerState::pass_event)
        })
    }

    fn set_enabled(&self, id: LoopId, enabled: bool) -> Result<(), LoopError> {
        self.with_state(|state| {
            let number = state.number(id)?;
            let done = state.enable(number, enabled);
            done.then_some(()).ok_or(LoopError::Unassigned { id })
        })
    }

    /// Looks on from outside, for tests.
    #[cfg(all(test, not(condor_loom)))]
    pub(crate) fn look<R>(&self, f: impl FnOnce(&SchedulerState<P::Instant, L, E, K>) -> R) -> R {
        section(|section| self.state.with(section, |state| f(state)))
    }

    fn with_state<R>(&self, f: impl FnOnce(&mut SchedulerState<P::Instant, L, E, K>) -> R) -> R {
        section(|section| {
            if P::VECTORS {
                self.settle(section);
            }
            self.state.with(section, f)
        })
    }

    /// Passes what was due while the fastest loop runs, where the timer cannot interrupt it.
    fn settle(&self, section: CriticalSection<'_>) {
        let now = self.platform.now();
        let overdue = |state: &mut SchedulerState<P::Instant, L, E, K>| {
            state.runs_fastest() && state.is_overdue(now)
        };
        if self.state.with(section, overdue) {
            self.catch_up_and_pend(section);
        }
    }
}

impl<P: Platform + Sync, const L: usize, const E: usize, K: Keep> Scheduler<P, L, E, K> {
    fn run_schedule<R>(
        &self,
        at: Option<P::Instant>,
        background: impl FnOnce() -> R,
    ) -> Result<R, StartError> {
        let program = || {
            self.begin_schedule(at)?;
            let _stop = Stop(self);
            Ok(background())
        };
        self.platform.connect(|| self.on_timer(), program)?
    }
}

impl<P: Platform + Sync, const L: usize, const E: usize, K: Keep> Loops for Scheduler<P, L, E, K> {
    fn run<R>(&self, background: impl FnOnce() -> R) -> Result<R, StartError> {
        self.run_schedule(None, background)
    }

    fn run_from<R>(
        &self,
        instant: P::Instant,
        background: impl FnOnce() -> R,
    ) -> Result<R, StartError> {
        self.run_schedule(Some(instant), background)
    }

    fn start(&self) -> Result<(), StartError> {
        self.begin_schedule(None)
    }

    fn start_at(&self, instant: P::Instant) -> Result<(), StartError> {
        self.begin_schedule(Some(instant))
    }

    fn stop(&self) {
        section(|section| {
            if P::VECTORS {
                self.settle(section);
            }
            self.state.with(section, SchedulerState::stop);
            self.platform.disarm();
        });
    }

    fn enable(&self, id: LoopId) -> Result<(), LoopError> {
        self.set_enabled(id, true)
    }

    fn disable(&self, id: LoopId) -> Result<(), LoopError> {
        self.set_enabled(id, false)
    }

    fn set_rate(&self, id: LoopId, rate: Rate) -> Result<(), LoopError> {
        self.with_state(|state| {
            let number = state.number(id)?;
            Ok::<_, LoopError>(state.schedule.begin_change(number, rate)?)
        })?;
        while !self.with_state(|state| state.schedule.continue_change()) {}
        Ok(())
    }

    fn statistics(&self, id: LoopId) -> Result<Statistics, LoopError> {
        self.with_state(|state| {
            let number = state.number(id)?;
            let statistics = state.statistics(number);
            statistics.ok_or(LoopError::NoStatistics { id })
        })
    }

    fn histograms(&self, id: LoopId) -> Result<Histograms, LoopError> {
        self.with_state(|state| {
            let number = state.number(id)?;
            let histograms = state.histograms(number);
            histograms.ok_or(LoopError::NoStatistics { id })
        })
    }

    fn reset_statistics(&self, id: LoopId) -> Result<(), LoopError> {
        self.with_state(|state| {
            let number = state.number(id)?;
            state.reset(number);
            Ok(())
        })
    }
}

impl<P: Platform, const L: usize, const E: usize, K: Keep> Runner for Scheduler<P, L, E, K> {
    type Instant = P::Instant;

    fn assign_body(
        &self,
        id: LoopId,
        overrun: Overrun,
        body: LoopBody<P::Instant>,
    ) -> Result<(), LoopError> {
        self.with_state(|state| {
            let number = state.number(id)?;
            let done = state.assign(number, overrun, body);
            done.then_some(()).ok_or(LoopError::Taken { id })
        })
    }

    /// Once they have finished.
    fn withdraw(&self, numbers: u32) {
        // On the loops' own stack none of them can be in progress here: it would have finished
        // before what it interrupted went on.
        while !self.with_state(|state| state.withdraw(numbers)) {
            core::hint::spin_loop();
        }
    }

    fn enter(&self, gate: &Gate) -> Result<u32, LoopLockError> {
        section(|section| {
            // A lock that is taken is left alone. Pairs with the store of its last holder.
            if gate.taken.load(Ordering::Relaxed) || gate.taken.swap(true, Ordering::Acquire) {
                return Err(LoopLockError::Taken);
            }
            let former = self.state.with(section, |state| state.lock(gate.users));
            if former.is_none() {
                gate.taken.store(false, Ordering::Release);
            }
            former.ok_or(LoopLockError::Undeclared)
        })
    }

    /// Has those run that were kept waiting.
    fn leave(&self, gate: &Gate, former: u32) {
        // Pairs with the swap of whoever takes it next.
        gate.taken.store(false, Ordering::Release);
        if P::VECTORS {
            let ranks = self.with_state(|state| {
                state.unlock(former);
                state.unlocked()
            });
            if ranks != 0 {
                self.platform.pend(ranks);
            }
            return;
        }
        let begun = section(|section| {
            let now = self.platform.now();
            self.state.with(section, |state| state.unlock(former));
            self.begin_fastest(section, now)
        });
        self.run_nested::<false>(begun);
    }
}

/// Ends a loop whose body unwinds.
struct End<'s, P: Platform, const L: usize, const E: usize, K: Keep> {
    scheduler: &'s Scheduler<P, L, E, K>,
    rank: u32,
    running: Running<P::Instant>,
}

impl<P: Platform, const L: usize, const E: usize, K: Keep> Drop for End<'_, P, L, E, K> {
    fn drop(&mut self) {
        self.scheduler.end_unusually(self.rank, self.running);
    }
}
