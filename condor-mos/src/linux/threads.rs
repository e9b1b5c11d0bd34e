//! [`Threads`]: a thread for each loop, the safe default on Linux.

use core::cell::Cell;
use core::num::NonZeroU32;
use core::sync::atomic::{AtomicU32, Ordering};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::mpsc;
use std::thread;

use rustix::thread::futex;
use rustix::time::{ClockId, clock_gettime};

use condor_platform::linux::thread_number;

use super::error::ThreadError;
use super::pi_mutex::{PiGuard, PiMutex};
use super::real_time::{Privileges, RealTime, set_priority};
use super::threaded::Threaded;
use super::time;
use crate::error::{LoopError, RateError, StartError};
use crate::process::Overrun;
use crate::rate::Rate;
use crate::scheduler::LoopId;
use crate::statistics::Statistics;

/// Runs `L` servo loops at their rates, each in a thread of its own.
///
/// A loop sleeps until an absolute instant of its own exact grid, in nanoseconds of
/// `CLOCK_MONOTONIC`, so it never drifts, whatever it does. The kernel lets faster loops interrupt
/// slower ones if it grants `SCHED_FIFO`, see [`RealTime`]; otherwise they take turns as it likes.
/// The calls, the overrun policies and the counts are those of a
/// [`Scheduler`](crate::Scheduler), and may come from any thread, the loops' own included.
///
/// A loop that panics is disabled and [`faulted`](Statistics::faulted); the others go on.
///
/// ```
/// use condor_mos::linux::{RealTime, Threads};
/// use condor_mos::{LoopId, Overrun, Rate};
/// use std::sync::mpsc;
///
/// let threads = Threads::new([Rate::hz(400), Rate::hz(50)], RealTime::default())?;
/// let (done, background) = mpsc::channel();
/// let mut runs = 0;
/// let mut servo = |_| {
///     runs += 1;
///     if runs == 20 {
///         let _ = done.send(());
///     }
/// };
/// threads.scope(|scope| {
///     scope.assign(LoopId(0), Overrun::Skip, &mut servo)?;
///     threads.start()?;
///     background.recv()?;
///     Ok::<_, Box<dyn std::error::Error>>(())
/// })?;
/// assert!(runs >= 20);
/// println!("{}", threads.privileges());
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug)]
pub struct Threads<const L: usize> {
    wishes: RealTime,
    loops: [Slot; L],
    started: PiMutex<bool>,
    privileges: PiMutex<Privileges>,
}

#[derive(Debug)]
struct Slot {
    state: PiMutex<Threaded>,
    /// Counts changes for which the loop's thread must not sleep on.
    changes: AtomicU32,
}

impl Slot {
    /// Changes the state, and has the thread look at it.
    fn change<R>(&self, f: impl FnOnce(&mut Threaded) -> R) -> R {
        let result = {
            let mut state = self.state.lock();
            let result = f(&mut state);
            // Relaxed: the thread reads it under the same lock; if it has slept since, the kernel
            // orders this before the wake.
            self.changes.fetch_add(1, Ordering::Relaxed);
            result
        };
        let _ = futex::wake(&self.changes, futex::Flags::PRIVATE, 1);
        result
    }

    /// The loop's thread until [`Threaded::quit`].
    fn run(&self, body: &mut dyn FnMut(u64)) {
        let mut spent = cpu_time();
        let mut now = time::now();
        let mut state = self.state.lock();
        while !state.quit {
            state.advance(now);
            let Some(due) = state.start(now) else {
                state = self.sleep(state);
                now = time::now();
                continue;
            };
            drop(state);
            // A loop whose body unwound runs no more unless its user enables it.
            let result = catch_unwind(AssertUnwindSafe(|| body(due)));
            now = time::now();
            let spent_before = core::mem::replace(&mut spent, cpu_time());
            let ticks = spent.saturating_sub(spent_before);
            state = self.state.lock();
            state.finish(now, u32::try_from(ticks).unwrap_or(u32::MAX));
            if result.is_err() {
                state.fault();
            }
        }
        state.end();
    }

    /// Lets the state go until the loop is due or the state has changed.
    fn sleep<'s>(&'s self, state: PiGuard<'s, Threaded>) -> PiGuard<'s, Threaded> {
        let seen = self.changes.load(Ordering::Relaxed);
        let until = state.next_due().map(time::timespec);
        drop(state);
        // Due, changed, or interrupted: the caller looks again in each case.
        let _ = futex::wait_bitset(
            &self.changes,
            futex::Flags::PRIVATE,
            seen,
            until.as_ref(),
            NonZeroU32::MAX,
        );
        self.state.lock()
    }
}

/// What the calling thread has used of processors, in nanoseconds.
fn cpu_time() -> u64 {
    time::nanoseconds(clock_gettime(ClockId::ThreadCPUTime))
}

impl<const L: usize> Threads<L> {
    /// Loops with these rates, none of which has anything to run. Asks for `wishes` when they
    /// begin.
    ///
    /// # Errors
    /// [`RateError::TooFast`] if a period is shorter than a nanosecond.
    pub fn new(rates: [Rate; L], wishes: RealTime) -> Result<Self, RateError> {
        const { assert!(L >= 1 && L <= 32, "there are 1 to 32 loops") };
        for rate in rates {
            Threaded::grid(rate)?;
        }
        let slot = |rate| Slot {
            state: PiMutex::new(Threaded::new(rate)),
            changes: AtomicU32::new(0),
        };
        Ok(Self {
            wishes,
            loops: rates.map(slot),
            started: PiMutex::new(false),
            privileges: PiMutex::new(wishes.request_for_process()),
        })
    }

    /// Runs `f`, in which closures that borrow can become loops; when it returns or unwinds, they
    /// finish their last run and their threads end.
    pub fn scope<'env, R>(
        &'env self,
        f: impl for<'scope> FnOnce(&ThreadScope<'scope, 'env, L>) -> R,
    ) -> R {
        thread::scope(|scope| {
            f(&ThreadScope {
                threads: self,
                scope,
                assigned: Cell::new(0),
            })
        })
    }

    /// Begins: all enabled loops are due now.
    ///
    /// # Errors
    /// [`StartError::Started`].
    pub fn start(&self) -> Result<(), StartError> {
        self.start_at(time::now())
    }

    /// Begins at an instant of `CLOCK_MONOTONIC`, in nanoseconds: all enabled loops are due then.
    ///
    /// # Errors
    /// As [`start`](Self::start).
    pub fn start_at(&self, instant: u64) -> Result<(), StartError> {
        let mut started = self.started.lock();
        if core::mem::replace(&mut *started, true) {
            return Err(StartError::Started);
        }
        self.each(|state| state.begin(instant));
        Ok(())
    }

    /// Ends: what is in progress finishes, what has not started is skipped.
    pub fn stop(&self) {
        let mut started = self.started.lock();
        *started = false;
        self.each(Threaded::stop);
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

    /// Gives a loop another rate, while all run on: it is due when it was due anyway, and then at
    /// the new rate. Priorities follow.
    ///
    /// # Errors
    /// [`LoopError::NoSuchLoop`], or [`LoopError::Rate`] if the period is shorter than a nanosecond.
    pub fn set_rate(&self, id: LoopId, rate: Rate) -> Result<(), LoopError> {
        let grid = Threaded::grid(rate)?;
        self.slot(id)?
            .change(|state| state.set_rate(rate, grid, time::now()));
        self.set_priorities();
        Ok(())
    }

    /// The counts of a loop at this moment. Run times are what the kernel charges the loop's
    /// thread, its waking included.
    ///
    /// # Errors
    /// [`LoopError::NoSuchLoop`].
    pub fn statistics(&self, id: LoopId) -> Result<Statistics, LoopError> {
        let mut state = self.slot(id)?.state.lock();
        state.advance(time::now());
        Ok(state.statistics())
    }

    /// Sets the counts and times of a loop to 0.
    ///
    /// # Errors
    /// [`LoopError::NoSuchLoop`].
    pub fn reset_statistics(&self, id: LoopId) -> Result<(), LoopError> {
        self.slot(id)?.state.lock().reset();
        Ok(())
    }

    /// What was asked of the kernel so far, and what it said.
    #[must_use]
    pub fn privileges(&self) -> Privileges {
        self.privileges.lock().clone()
    }

    fn each(&self, f: impl Fn(&mut Threaded)) {
        self.loops.iter().for_each(|slot| slot.change(&f));
    }

    fn slot(&self, id: LoopId) -> Result<&Slot, LoopError> {
        let slot = self.loops.get(usize::from(id.0));
        slot.ok_or(LoopError::NoSuchLoop { id, loops: L as u8 })
    }

    fn set_enabled(&self, id: LoopId, enabled: bool) -> Result<(), LoopError> {
        self.slot(id)?
            .change(|state| state.set_enabled(enabled, time::now()))
            .ok_or(LoopError::Unassigned { id })
    }

    fn rates(&self) -> [Rate; L] {
        core::array::from_fn(|number| self.loops[number].state.lock().rate)
    }

    /// How many loops are faster.
    fn rank(rates: &[Rate; L], number: usize) -> usize {
        let is_before = |&other: &usize| {
            rates[other] > rates[number] || rates[other] == rates[number] && other < number
        };
        (0..L).filter(is_before).count()
    }

    /// Puts the priorities of all threads in the order of their rates.
    fn set_priorities(&self) {
        let rates = self.rates();
        for (number, slot) in self.loops.iter().enumerate() {
            let Some(priority) = self.wishes.priority_of(Self::rank(&rates, number)) else {
                return;
            };
            // Under the lock of its state, a thread does not end and leave its number to another.
            let state = slot.state.lock();
            let Some(thread) = state.thread else { continue };
            if state.priority == Some(priority) {
                continue;
            }
            let result = set_priority(thread.cast_signed(), priority);
            let mut state = state;
            state.priority = Some(priority);
            drop(state);
            let what = format!("SCHED_FIFO {priority} for loop {number}");
            self.privileges.lock().note_priority(what, result);
        }
    }

    /// What a loop's thread does: asks for its privileges, tells of that, and runs.
    fn run(&self, number: usize, body: &mut dyn FnMut(u64), ready: &mpsc::Sender<()>) {
        let rates = self.rates();
        let rank = Self::rank(&rates, number);
        let who = format!("loop {number} ({})", rates[number]);
        let answers = self.wishes.request_for_thread(rank, &who);
        self.privileges.lock().add(answers);
        let slot = &self.loops[number];
        {
            let mut state = slot.state.lock();
            state.thread = Some(thread_number());
            state.priority = self.wishes.priority_of(rank);
        }
        let _ = ready.send(());
        slot.run(body);
    }
}

/// Where closures become loops until the end of [`Threads::scope`].
#[derive(Debug)]
pub struct ThreadScope<'scope, 'env: 'scope, const L: usize> {
    threads: &'env Threads<L>,
    scope: &'scope thread::Scope<'scope, 'env>,
    /// A bit for each loop that was assigned here.
    assigned: Cell<u32>,
}

impl<'scope, const L: usize> ThreadScope<'scope, '_, L> {
    /// Has a loop run `closure`, which is given the instant at which it was due, and enables it.
    ///
    /// # Errors
    /// [`LoopError::NoSuchLoop`], [`LoopError::Taken`], [`ThreadError::Spawn`].
    pub fn assign<F: FnMut(u64) + Send>(
        &self,
        id: LoopId,
        overrun: Overrun,
        closure: &'scope mut F,
    ) -> Result<(), ThreadError> {
        let threads = self.threads;
        let slot = threads.slot(id)?;
        let rate = {
            let mut state = slot.state.lock();
            state.assign(overrun).ok_or(LoopError::Taken { id })?;
            state.rate
        };
        let (ready, is_ready) = mpsc::channel();
        let number = usize::from(id.0);
        let spawned = thread::Builder::new()
            .name(rate.to_string())
            .spawn_scoped(self.scope, move || threads.run(number, closure, &ready));
        if let Err(error) = spawned {
            slot.state.lock().end();
            return Err(ThreadError::Spawn(error));
        }
        self.assigned.set(self.assigned.get() | 1 << number);
        // The report is complete, and the loop ready, when this returns.
        let _ = is_ready.recv();
        Ok(())
    }
}

/// Has the threads end; the scope of std then waits for them.
impl<const L: usize> Drop for ThreadScope<'_, '_, L> {
    fn drop(&mut self) {
        for (number, slot) in self.threads.loops.iter().enumerate() {
            if self.assigned.get() & (1 << number) != 0 {
                slot.change(|state| state.quit = true);
            }
        }
    }
}
