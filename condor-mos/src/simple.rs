//! [`SimpleServo`]: one loop, and a background.

use critical_section::CriticalSection;

use crate::body::Body;
use crate::clock::Clock;
use crate::error::{LoopError, RateError, StartError};
use crate::events::catch_up;
use crate::instant::Instant;
use crate::masked::{Masked, masked, section};
use crate::platform::Platform;
use crate::process::Overrun;
use crate::rate::Rate;
use crate::schedule::Grid;
use crate::scheduler::LoopId;
use crate::single::Single;
use crate::statistics::Statistics;
use crate::sync::const_unless_loom;
use crate::timer::Armed;

/// Runs one servo loop at its rate, and otherwise the background, which commands it (memo, section
/// 3.2.1): a [`Scheduler`](crate::Scheduler) for those who need no more than one loop.
///
/// The grid is as exact, overruns and counts are the same, on the same [`Platform`]s. But there
/// is no table, no rank and no choice: a release takes half of the instructions.
///
/// Like a scheduler it usually is a `static`, and all calls may come from the background, from the
/// loop and from handlers.
///
/// ```
/// use condor_mos::sim::Processor;
/// use condor_mos::{Clock, Overrun, Rate, SimpleServo, StartError};
///
/// const MICROSECONDS: Rate = Rate::hz(1_000_000);
/// let processor = Processor::new(MICROSECONDS);
/// let clock = Clock::of::<u64>(MICROSECONDS);
/// let servo = SimpleServo::new(processor.clone(), Rate::hz(400), clock);
///
/// let mut runs = 0;
/// let mut servo_loop = |_| { processor.work(300); runs += 1; };
/// servo.scope(Overrun::Skip, &mut servo_loop, || {
///     processor.with_handler(|| servo.on_timer(), || {
///         servo.start()?;
///         processor.run_until(1_000_000); // a command loop, for a second
///         servo.set_rate(Rate::hz(100)).expect("slower than the clock");
///         processor.run_until(2_000_000);
///         Ok::<_, StartError>(())
///     })
/// })??;
/// assert_eq!(servo.statistics().worst_run, 300);
/// // The release at 1 s is the last one of the old rate's grid, and the first of the new one's.
/// assert_eq!(runs, 400 + 100);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub struct SimpleServo<P: Platform> {
    platform: P,
    state: Masked<State<P::Instant>>,
}

struct State<I> {
    clock: Clock,
    rate: Rate,
    grid: Grid,
    servo_loop: Single<I>,
    started: bool,
    /// When the timer's interrupt is due, and how long after it the loop is: more than 0 if that is
    /// too far for the timer.
    due: I,
    beyond: u64,
}

/// The loop, once it has started.
#[must_use]
struct Running<I> {
    body: Body<I>,
    due: I,
    since: I,
}

/// The loop's name in errors.
const ID: LoopId = LoopId(0);

impl<P: Platform> SimpleServo<P> {
    const_unless_loom! {
        /// A servo that is not started and has nothing to run.
        ///
        /// # Panics
        /// If the rate's period is less than one tick of the clock; in a constant, that is an error of
        /// compilation. For rates from outside there is [`try_new`](Self::try_new).
        #[must_use]
        pub const fn new(platform: P, rate: Rate, clock: Clock) -> Self {
            match Grid::new(rate, clock.frequency()) {
                Some(grid) => Self::with_grid(platform, rate, clock, grid),
                None => panic!("{}", too_fast(rate, clock).message()),
            }
        }
    }

    /// A servo that is not started and has nothing to run.
    ///
    /// # Errors
    /// [`RateError::TooFast`].
    pub fn try_new(platform: P, rate: Rate, clock: Clock) -> Result<Self, RateError> {
        let grid = Grid::new(rate, clock.frequency()).ok_or(too_fast(rate, clock))?;
        Ok(Self::with_grid(platform, rate, clock, grid))
    }

    const_unless_loom! {
    const fn with_grid(platform: P, rate: Rate, clock: Clock, grid: Grid) -> Self {
        Self {
            platform,
            state: Masked::new(State {
                clock,
                rate,
                grid,
                servo_loop: Single::NEW,
                started: false,
                due: P::Instant::ZERO,
                beyond: 0,
            }),
        }
    }
    }

    /// The platform that was given at the beginning.
    #[must_use]
    pub const fn platform(&self) -> &P {
        &self.platform
    }

    /// Gives the loop what it runs, for good, and enables it.
    ///
    /// # Errors
    /// [`LoopError::Taken`].
    pub fn assign<C: Send>(
        &self,
        overrun: Overrun,
        body: fn(&mut C, P::Instant),
        context: &'static mut C,
    ) -> Result<(), LoopError> {
        self.assign_body(overrun, Body::of_function(body, context))
    }

    /// Runs `program`, while `closure`, which may borrow, is the loop; it is enabled at the beginning,
    /// and disarmed when `program` returns or unwinds.
    ///
    /// # Errors
    /// [`LoopError::Taken`]; then `program` is not run.
    pub fn scope<F: FnMut(P::Instant) + Send, R>(
        &self,
        overrun: Overrun,
        closure: &mut F,
        program: impl FnOnce() -> R,
    ) -> Result<R, LoopError> {
        self.assign_body(overrun, Body::of_closure(closure))?;
        let _withdraw = Withdraw(self);
        Ok(program())
    }

    /// Begins now: the loop is due.
    ///
    /// # Errors
    /// [`StartError::Clock`] if the servo was made for another clock than the platform's,
    /// [`StartError::NoHandler`] if the platform knows that its interrupts call nothing,
    /// [`StartError::Started`].
    pub fn start(&self) -> Result<(), StartError> {
        let timer = Clock::of::<P::Instant>(self.platform.frequency());
        section(|section| {
            let now = self.platform.now();
            let has_handler = self.platform.has_handler();
            self.state
                .with(section, |state| state.start(timer, has_handler, now))
        })?;
        if P::VECTORS {
            self.platform.pend(1);
        } else {
            self.on_timer();
        }
        Ok(())
    }

    /// Ends it: what is in progress finishes, what has not started is skipped.
    pub fn stop(&self) {
        section(|section| {
            self.state.with(section, |state| {
                state.started = false;
                state.servo_loop.forget();
            });
            self.platform.disarm();
        });
    }

    /// Has the loop run from its next instant on.
    ///
    /// # Errors
    /// [`LoopError::Unassigned`].
    pub fn enable(&self) -> Result<(), LoopError> {
        self.set_enabled(true)
    }

    /// Has the loop run no more; if it is in progress, it finishes. Its instants go by.
    ///
    /// # Errors
    /// [`LoopError::Unassigned`].
    pub fn disable(&self) -> Result<(), LoopError> {
        self.set_enabled(false)
    }

    /// Gives the loop another rate. Its next release stays where it is; the new grid begins there.
    ///
    /// # Errors
    /// [`RateError::TooFast`]; then the rate stays as it is.
    pub fn set_rate(&self, rate: Rate) -> Result<(), RateError> {
        let clock = self.with_state(|state| state.clock);
        let grid = Grid::new(rate, clock.frequency()).ok_or(too_fast(rate, clock))?;
        self.with_state(|state| {
            state.servo_loop.change();
            state.rate = rate;
            state.grid = grid;
        });
        Ok(())
    }

    /// The loop's counts at this moment.
    #[must_use]
    pub fn statistics(&self) -> Statistics {
        let (snapshot, rate, clock) =
            self.with_state(|state| (state.servo_loop.snapshot(), state.rate, state.clock));
        Statistics::of(&snapshot, rate, clock.frequency())
    }

    /// Sets the counts and times of the loop to 0.
    pub fn reset_statistics(&self) {
        self.with_state(|state| state.servo_loop.reset());
    }

    /// The timer's interrupt: runs the loop if it is due.
    ///
    /// One that comes early or without cause does no harm, nor does one that interrupts the loop,
    /// which has overrun then.
    #[inline]
    pub fn on_timer(&self) {
        let mut begun = masked(&self.platform, |section| {
            let now = self.platform.now();
            let now = self.release(section, now);
            self.begin(section, now)
        });
        while let Some(running) = begun {
            begun = self.run(&running);
        }
    }

    /// Releases the loop if it is due, and arms the timer for what comes next. Returns `now`, or a
    /// later instant if the loop became due after it.
    #[inline]
    fn release(&self, section: CriticalSection<'_>, now: P::Instant) -> P::Instant {
        let Some(due) = self.state.with(section, |state| state.due()) else {
            return now;
        };
        let early = !now.has_reached(due);
        if early && self.platform.arm(due) == Armed::Ahead {
            return now;
        }
        let next = self.state.with(section, State::pass_event);
        if self.platform.arm(next) == Armed::Past {
            return catch_up(&self.platform, || {
                self.state.with(section, State::pass_event)
            });
        }
        if early { self.platform.now() } else { now }
    }

    #[inline]
    fn begin(&self, section: CriticalSection<'_>, now: P::Instant) -> Option<Running<P::Instant>> {
        if !self.platform.is_loops_stack() {
            return None;
        }
        let (body, due) = self
            .state
            .with(section, |state| state.servo_loop.begin(now))?;
        let since = now;
        Some(Running { body, due, since })
    }

    /// Runs the loop once; gives its next run, if that has waited.
    #[inline]
    fn run(&self, running: &Running<P::Instant>) -> Option<Running<P::Instant>> {
        let unwound = End {
            servo: self,
            since: running.since,
        };
        // SAFETY: the context is there until `Withdraw` has seen that the loop is not in progress,
        // as it is since `begin`; and a loop in progress is not begun again.
        self.platform
            .interruptible(0, || unsafe { running.body.call(running.due) });
        core::mem::forget(unwound);
        masked(&self.platform, |section| {
            let mut now = self.platform.now();
            if P::VECTORS {
                // The timer could not interrupt: what was due meanwhile came before the end.
                now = self.release(section, now);
            }
            self.state
                .with(section, |state| state.end(running.since, now));
            self.begin(section, now)
        })
    }

    fn assign_body(&self, overrun: Overrun, body: Body<P::Instant>) -> Result<(), LoopError> {
        if self.with_state(|state| state.servo_loop.assign(overrun, body)) {
            Ok(())
        } else {
            Err(LoopError::Taken { id: ID })
        }
    }

    fn set_enabled(&self, enabled: bool) -> Result<(), LoopError> {
        let assigned = self.with_state(|state| {
            if state.servo_loop.is_assigned() {
                state.servo_loop.enable(enabled);
            }
            state.servo_loop.is_assigned()
        });
        if assigned {
            Ok(())
        } else {
            Err(LoopError::Unassigned { id: ID })
        }
    }

    fn with_state<R>(&self, f: impl FnOnce(&mut State<P::Instant>) -> R) -> R {
        section(|section| self.state.with(section, f))
    }
}

impl<I: Instant> State<I> {
    fn start(&mut self, timer: Clock, has_handler: bool, now: I) -> Result<(), StartError> {
        let schedule = self.clock;
        if schedule != timer {
            return Err(StartError::Clock { timer, schedule });
        }
        if !has_handler {
            return Err(StartError::NoHandler);
        }
        if self.started {
            return Err(StartError::Started);
        }
        self.grid.restart();
        self.started = true;
        self.due = now;
        self.beyond = 0;
        Ok(())
    }

    #[inline]
    fn due(&self) -> Option<I> {
        self.started.then_some(self.due)
    }

    #[inline]
    fn pass_event(&mut self) -> I {
        if self.beyond == 0 {
            self.servo_loop.release(self.due);
            self.beyond = self.grid.step();
        }
        let longest = self.clock.longest_gap();
        let gap = u32::try_from(self.beyond).map_or(longest, |beyond| beyond.min(longest));
        self.beyond -= u64::from(gap);
        self.due = self.due.after(gap);
        self.due
    }

    #[inline]
    fn end(&mut self, since: I, now: I) {
        self.servo_loop.end(now.since(since));
    }
}

/// Ends a loop that unwinds.
struct End<'s, P: Platform> {
    servo: &'s SimpleServo<P>,
    since: P::Instant,
}

impl<P: Platform> Drop for End<'_, P> {
    fn drop(&mut self) {
        section(|section| {
            let now = self.servo.platform.now();
            self.servo
                .state
                .with(section, |state| state.end(self.since, now));
        });
    }
}

/// Disarms the closure of [`SimpleServo::scope`].
struct Withdraw<'s, P: Platform>(&'s SimpleServo<P>);

impl<P: Platform> Drop for Withdraw<'_, P> {
    fn drop(&mut self) {
        // On the loop's own stack it is not in progress here: it would have finished first.
        while !self.0.with_state(|state| state.servo_loop.withdraw()) {
            core::hint::spin_loop();
        }
    }
}

const fn too_fast(rate: Rate, clock: Clock) -> RateError {
    RateError::TooFast {
        rate,
        frequency: clock.frequency(),
    }
}
