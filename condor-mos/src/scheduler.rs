//! [`Scheduler`]: servo loops at exact rates, on one stack.

use critical_section::CriticalSection;

use crate::body::Body;
use crate::clock::Clock;
use crate::error::{LoopError, StartError};
use crate::instant::Instant;
use crate::masked::Masked;
use crate::platform::Platform;
use crate::process::Overrun;
use crate::rate::Rate;
use crate::schedule::Schedule;
use crate::scope::Scope;
use crate::state::{Running, State};
use crate::statistics::Statistics;
use crate::timer::Armed;

/// Events that one interrupt catches up with before the background gets a chance.
const MOST_EVENTS: u32 = 1024;

/// A loop of a scheduler: the place of its rate in the schedule that the scheduler was given.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct LoopId(pub u8);

/// Runs `L` servo loops at their rates, on the stack of the background that they interrupt
/// (memo, section 3.2.2).
///
/// The fastest loop that is due runs; a loop is interrupted by faster ones only; when none is
/// left, the background goes on. A loop has its period to finish in, and no exact moment to
/// start at.
///
/// `P` is the [`Platform`], `S` the [`Schedule`](crate::Schedule). A scheduler usually is a
/// `static`, so that interrupt handlers reach it: all calls take `&self`, may come from the
/// background, from loops and from handlers, and are short critical sections.
pub struct Scheduler<P: Platform, S, const L: usize> {
    platform: P,
    state: Masked<State<S, P::Instant, L>>,
}

impl<P: Platform, S: Schedule<L>, const L: usize> Scheduler<P, S, L> {
    /// A scheduler that is not started, none of whose loops has anything to run.
    #[must_use]
    pub const fn new(platform: P, schedule: S) -> Self {
        Self {
            platform,
            state: Masked::new(State::new(schedule)),
        }
    }

    /// The platform that was given at the beginning.
    #[must_use]
    pub const fn platform(&self) -> &P {
        &self.platform
    }

    /// Gives a loop what it runs, for good, and enables it.
    ///
    /// # Errors
    /// [`LoopError::NoSuchLoop`], [`LoopError::Taken`].
    pub fn assign<C: Send>(
        &self,
        id: LoopId,
        overrun: Overrun,
        body: fn(&mut C),
        context: &'static mut C,
    ) -> Result<(), LoopError> {
        self.assign_body(id, overrun, Body::of_function(body, context))
    }

    /// Runs `f`, in which closures that borrow can become loops; when it returns or unwinds, they
    /// are disarmed.
    pub fn scope<'env, R>(
        &self,
        f: impl for<'scope> FnOnce(&'scope Scope<'scope, 'env, P, S, L>) -> R,
    ) -> R {
        Scope::run(self, f)
    }

    /// Begins the schedule: all enabled loops are due now.
    ///
    /// # Errors
    /// [`StartError::Clock`] if the schedule was made for another clock than the platform's,
    /// [`StartError::Started`].
    pub fn start(&self) -> Result<(), StartError> {
        let timer = Clock::of::<P::Instant>(self.platform.frequency());
        critical_section::with(|section| {
            let now = self.platform.now();
            self.state.with(section, |state| {
                let schedule = state.schedule.clock();
                if schedule != timer {
                    return Err(StartError::Clock { timer, schedule });
                }
                if state.due().is_some() {
                    return Err(StartError::Started);
                }
                state.start(now);
                Ok(())
            })
        })?;
        self.on_timer();
        Ok(())
    }

    /// Ends the schedule: what is in progress finishes, what has not started is skipped.
    pub fn stop(&self) {
        critical_section::with(|section| {
            self.state.with(section, State::stop);
            self.platform.disarm();
        });
    }

    /// Has a loop run from its next instant on.
    ///
    /// # Errors
    /// [`LoopError::NoSuchLoop`], [`LoopError::Unassigned`].
    pub fn enable(&self, id: LoopId) -> Result<(), LoopError> {
        self.set_enabled(id, true)
    }

    /// Has a loop run no more; if it is in progress, it finishes.
    ///
    /// # Errors
    /// As [`enable`](Self::enable).
    pub fn disable(&self, id: LoopId) -> Result<(), LoopError> {
        self.set_enabled(id, false)
    }

    /// Gives a loop another rate, while all run on.
    ///
    /// The new schedule is prepared here, in short critical sections, and takes effect as a whole
    /// where its kind says: [`EventTable`](crate::EventTable), [`Scan`](crate::Scan).
    ///
    /// # Errors
    /// [`LoopError::NoSuchLoop`], or [`LoopError::Rate`] if there is no such schedule; then all
    /// rates stay as they are.
    pub fn set_rate(&self, id: LoopId, rate: Rate) -> Result<(), LoopError> {
        let number = Self::number(id)?;
        self.with_state(|state| state.schedule.begin_change(number, rate))?;
        while !self.with_state(|state| state.schedule.continue_change())? {}
        Ok(())
    }

    /// Whether rates that were asked for have not taken effect yet.
    #[must_use]
    pub fn is_changing(&self) -> bool {
        self.with_state(|state| state.schedule.is_changing())
    }

    /// The counts of a loop at this moment.
    ///
    /// # Errors
    /// [`LoopError::NoSuchLoop`].
    pub fn statistics(&self, id: LoopId) -> Result<Statistics, LoopError> {
        let number = Self::number(id)?;
        let (process, rate, clock) = self.with_state(|state| {
            (
                state.processes.get(number).copied(),
                state.schedule.rates().get(number).copied(),
                state.schedule.clock(),
            )
        });
        match (process, rate) {
            (Some(process), Some(rate)) => Ok(Statistics::of(&process, rate, clock.frequency())),
            _ => Err(Self::no_such(id)),
        }
    }

    /// The timer's interrupt: releases the loops that are due, and dispatches them.
    ///
    /// One that comes early or without cause does no harm.
    #[inline]
    pub fn on_timer(&self) {
        let ranks = critical_section::with(|section| self.release(section));
        if ranks != 0 {
            self.dispatch(ranks);
        }
    }

    /// The interrupt of a rank's own vector, on platforms that have those: runs its loop.
    // The rank is a constant of each vector: a call would have to look up all that depends on it.
    #[inline(always)]
    pub fn on_vector(&self, rank: u32) {
        while let Some(running) = self.begin(|state, now| state.begin(rank, now)) {
            if self.run(running) & 1_u32.unbounded_shl(rank) == 0 {
                break;
            }
        }
    }

    /// Releases what is due, arms the timer for what comes next, and gives the ranks that are
    /// runnable: vectors of slower ones than what is in progress wait in hardware for their turn.
    #[inline]
    fn release(&self, section: CriticalSection<'_>) -> u32 {
        let Some(due) = self.state.with(section, |state| state.due()) else {
            return 0;
        };
        let runnable = || self.state.with(section, |state| state.runnable());
        if !self.platform.now().has_reached(due) && self.platform.arm(due) == Armed::Ahead {
            return runnable();
        }
        for _ in 0..MOST_EVENTS {
            let due = self.state.with(section, State::pass_event);
            if self.platform.arm(due) == Armed::Ahead {
                return runnable();
            }
        }
        self.pause();
        runnable()
    }

    /// Events come faster than they can be counted: comes back to them after a while.
    #[cold]
    fn pause(&self) {
        let longest = 1 << (<P::Instant as Instant>::BITS.min(32) - 2);
        let mut ticks = 1;
        while self.platform.arm(self.platform.now().after(ticks)) == Armed::Past && ticks < longest
        {
            ticks <<= 1;
        }
    }

    #[inline]
    fn dispatch(&self, ranks: u32) {
        self.platform.dispatch(ranks, || {
            while let Some(running) = self.begin(State::begin_fastest) {
                if self.run(running) == 0 {
                    break;
                }
            }
        });
    }

    #[inline]
    fn begin(
        &self,
        begin: impl FnOnce(&mut State<S, P::Instant, L>, P::Instant) -> Option<Running<P::Instant>>,
    ) -> Option<Running<P::Instant>> {
        critical_section::with(|section| {
            let now = self.platform.now();
            self.state.with(section, |state| begin(state, now))
        })
    }

    /// Runs a loop that has begun, and gives the ranks that may start when it has ended.
    #[inline]
    fn run(&self, running: Running<P::Instant>) -> u32 {
        let body = running.body;
        let mut end = End {
            scheduler: self,
            running: Some(running),
        };
        if let Some(body) = body {
            // SAFETY: the context is there until `withdraw` has seen that the loop is not in
            // progress, as it is since `begin`; and a loop in progress is not begun again.
            self.platform.interruptible(|| unsafe { body.call() });
        }
        end.end()
    }

    /// Gives a loop that has none a body, and enables it.
    pub(crate) fn assign_body(
        &self,
        id: LoopId,
        overrun: Overrun,
        body: Body,
    ) -> Result<(), LoopError> {
        let number = Self::number(id)?;
        self.with_state(|state| {
            let process = state.processes.get_mut(number).ok_or(Self::no_such(id))?;
            if process.body.is_some() {
                return Err(LoopError::Taken { id });
            }
            process.body = Some(body);
            process.overrun = overrun;
            state.enable(number, true);
            Ok(())
        })
    }

    /// Disables the loops of `ids`, a bit for each, and takes away what they run, once they have
    /// finished.
    pub(crate) fn withdraw(&self, ids: u32) {
        // On the loops' own stack none of them can be in progress here: it would have finished
        // before what it interrupted went on.
        while !self.with_state(|state| state.withdraw(ids)) {
            core::hint::spin_loop();
        }
    }

    fn set_enabled(&self, id: LoopId, enabled: bool) -> Result<(), LoopError> {
        let number = Self::number(id)?;
        self.with_state(|state| {
            let process = state.processes.get(number);
            if process.is_none_or(|process| process.body.is_none()) {
                return Err(LoopError::Unassigned { id });
            }
            state.enable(number, enabled);
            Ok(())
        })
    }

    /// Lets only loops run that are faster than all of `users`; see [`State::raise`].
    pub(crate) fn raise(&self, section: CriticalSection<'_>, users: u32) -> Option<u32> {
        self.state.with(section, |state| state.raise(users))
    }

    /// Undoes it.
    pub(crate) fn lower(&self, former: u32) {
        let ranks = self.with_state(|state| state.lower(former));
        if ranks != 0 {
            self.dispatch(ranks);
        }
    }

    fn with_state<R>(&self, f: impl FnOnce(&mut State<S, P::Instant, L>) -> R) -> R {
        critical_section::with(|section| self.state.with(section, f))
    }

    fn number(id: LoopId) -> Result<usize, LoopError> {
        let number = usize::from(id.0);
        if number < L {
            Ok(number)
        } else {
            Err(Self::no_such(id))
        }
    }

    const fn no_such(id: LoopId) -> LoopError {
        LoopError::NoSuchLoop { id, loops: L as u8 }
    }
}

/// Ends a loop, also when its body unwinds.
struct End<'s, P: Platform, S: Schedule<L>, const L: usize> {
    scheduler: &'s Scheduler<P, S, L>,
    running: Option<Running<P::Instant>>,
}

impl<P: Platform, S: Schedule<L>, const L: usize> End<'_, P, S, L> {
    /// Ends it if it has not ended, and gives the ranks that may start then.
    #[inline]
    fn end(&mut self) -> u32 {
        let Some(running) = self.running.take() else {
            return 0;
        };
        critical_section::with(|section| {
            let now = self.scheduler.platform.now();
            self.scheduler
                .state
                .with(section, |state| state.end(running, now))
        })
    }
}

impl<P: Platform, S: Schedule<L>, const L: usize> Drop for End<'_, P, S, L> {
    #[inline]
    fn drop(&mut self) {
        self.end();
    }
}
