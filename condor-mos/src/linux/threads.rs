//! [`Threads`]: a thread for each loop, the safe default on Linux.

use core::num::NonZeroU32;
use core::sync::atomic::{AtomicU32, Ordering};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::{Arc, mpsc};
use std::thread::{Builder, JoinHandle};

use rustix::thread::futex;
use rustix::time::{ClockId, clock_gettime};

use condor_platform::linux::thread_number;

use super::pi_mutex::{PiGuard, PiMutex};
use super::real_time::{Privileges, RealTime, Wish, set_priority};
use super::time::{self, CLOCK};
use crate::body::LoopBody;
use crate::error::{LoopError, LoopLockError, RateError, StartError};
use crate::loops::{Loops, Stop};
use crate::process::{LoopId, Overrun};
use crate::rate::Rate;
use crate::record::{Counts, Histograms, Keep};
use crate::runner::{Gate, Runner};
use crate::schedule::EventTable;
use crate::state::{Running, SchedulerState};
use crate::statistics::Statistics;

/// Servo loops on Linux, each in a thread of its own, at exact rates. It keeps statistics of the
/// type `K`.
///
/// A loop sleeps until the absolute instant of its next release, in nanoseconds of
/// `CLOCK_MONOTONIC`, so it never drifts. If the kernel grants `SCHED_FIFO` (see [`RealTime`]),
/// faster loops interrupt slower ones; otherwise the kernel schedules them as it likes. The
/// methods, the overrun policies and the statistics are those of a [`Scheduler`](crate::Scheduler);
/// every thread may call them, including those of the loops. Run times are the processor time that
/// the kernel charges to the loop's thread, including its waking.
///
/// A loop that panics is disabled and [`faulted`](Statistics::faulted); the others go on.
///
/// ```
/// use condor_mos::linux::{RealTime, Threads};
/// use condor_mos::{LoopId, Loops, Overrun, Rate};
/// use std::sync::mpsc;
///
/// let threads = Threads::new(&[Rate::hz(400), Rate::hz(50)], RealTime::default())?;
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
///     threads.run(|| background.recv())??;
///     Ok::<_, Box<dyn std::error::Error>>(())
/// })?;
/// assert!(runs >= 20);
/// println!("{}", threads.privileges());
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug)]
pub struct Threads<K: Keep = Counts>(Arc<Shared<K>>);

/// The state that the loops' threads and their callers share.
#[derive(Debug)]
struct Shared<K> {
    wishes: RealTime,
    loops: Vec<Slot<K>>,
    started: PiMutex<bool>,
    privileges: PiMutex<Privileges>,
}

#[derive(Debug)]
struct Slot<K> {
    thread: PiMutex<LoopThread<K>>,
    /// Counts changes for which the loop's thread must not sleep on.
    changes: AtomicU32,
}

/// One loop: a scheduler's memory with a single loop, and its thread.
struct LoopThread<K> {
    rate: Rate,
    state: SchedulerState<u64, 1, 0, K>,
    /// The thread is to end.
    quit: bool,
    /// Its number and priority, while it runs.
    number: Option<u32>,
    priority: Option<i32>,
    handle: Option<JoinHandle<()>>,
}

impl<K> core::fmt::Debug for LoopThread<K> {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        write!(f, "{} in thread {:?}", self.rate, self.number)
    }
}

impl<K: Keep> LoopThread<K> {
    /// The loop is released at all instants until `now`.
    fn advance(&mut self, now: u64) {
        while self.state.started_due().is_some_and(|due| due <= now) {
            self.state.pass_event();
        }
    }

    /// The run that was started has taken `ticks`.
    fn finish(&mut self, running: Running<u64>, now: u64, ticks: u64) {
        // An event that has become due meanwhile finds the loop unfinished.
        self.advance(now);
        let ended = running.since.saturating_add(ticks);
        self.state.end(0, running, ended);
    }
}

impl<K: Keep> Slot<K> {
    /// Changes the state as it is now, and has the thread look at it.
    fn change<R>(&self, f: impl FnOnce(&mut LoopThread<K>) -> R) -> R {
        let result = {
            let mut thread = self.thread.lock();
            thread.advance(time::now());
            let result = f(&mut thread);
            // Relaxed: the thread reads it under the same lock; if it has slept since, the kernel
            // orders this before the wake.
            self.changes.fetch_add(1, Ordering::Relaxed);
            result
        };
        let _ = futex::wake(&self.changes, futex::Flags::PRIVATE, 1);
        result
    }

    /// The loop's thread until [`LoopThread::quit`].
    fn run(&self) {
        let mut spent = cpu_time();
        let mut now = time::now();
        let mut thread = self.thread.lock();
        while !thread.quit {
            thread.advance(now);
            let Some((_, start)) = thread.state.begin_fastest(now) else {
                thread = self.sleep(thread);
                now = time::now();
                continue;
            };
            drop(thread);
            // SAFETY: the context is there until `withdraw` has joined this thread, and no other
            // calls the body. A loop whose body unwound runs no more unless its user enables it.
            let call = AssertUnwindSafe(|| unsafe { start.body.call(start.due) });
            let result = catch_unwind(call);
            now = time::now();
            let before = core::mem::replace(&mut spent, cpu_time());
            thread = self.thread.lock();
            thread.finish(start.running, now, spent.saturating_sub(before));
            if result.is_err() {
                thread.state.fault(0);
            }
        }
        thread.number = None;
        // No run is in progress.
        let _ = thread.state.withdraw(1);
    }

    /// Lets the state go until the loop is due or the state has changed.
    fn sleep<'s>(&'s self, thread: PiGuard<'s, LoopThread<K>>) -> PiGuard<'s, LoopThread<K>> {
        let seen = self.changes.load(Ordering::Relaxed);
        let until = thread.state.next_release().map(time::timespec);
        drop(thread);
        // Due, changed, or interrupted: the caller looks again in each case.
        let _ = futex::wait_bitset(
            &self.changes,
            futex::Flags::PRIVATE,
            seen,
            until.as_ref(),
            NonZeroU32::MAX,
        );
        self.thread.lock()
    }
}

/// Returns the processor time that the calling thread has used, in nanoseconds.
fn cpu_time() -> u64 {
    time::nanoseconds(clock_gettime(ClockId::ThreadCPUTime))
}

impl Threads {
    /// Makes 1 to 32 loops: loop *n* has the rate `rates[n]`, and no body yet. `wishes` are the
    /// privileges that are asked of the kernel: those of the process by this call, and those of a
    /// loop's thread when the thread begins.
    ///
    /// # Errors
    /// [`RateError::TooFast`] if a period is shorter than a nanosecond, [`RateError::Loops`] if
    /// there are too many rates or none.
    pub fn new(rates: &[Rate], wishes: RealTime) -> Result<Self, RateError> {
        Self::keeping(rates, &[], wishes)
    }
}

impl<K: Keep> Threads<K> {
    /// Makes loops as [`new`](Threads::new) does, with statistics of the type `K`, and with phases:
    /// loop *n* is due first `phases[n]` nanoseconds after the start. A loop for which `phases` is
    /// too short is due at the start.
    ///
    /// # Errors
    /// [`RateError::TooFast`] if a period is shorter than a nanosecond, [`RateError::Loops`] if
    /// there are too many rates or none, [`RateError::Phase`] if a phase is not within the first
    /// period of its loop.
    pub fn keeping(rates: &[Rate], phases: &[u32], wishes: RealTime) -> Result<Self, RateError> {
        let (loops, capacity) = (rates.len(), 32);
        if !(1..=capacity).contains(&loops) {
            return Err(RateError::Loops { loops, capacity });
        }
        let phases = phases.iter().copied().chain(core::iter::repeat(0));
        let loops = rates.iter().zip(phases).map(|(&rate, phase)| {
            let thread = LoopThread {
                rate,
                state: SchedulerState::new(EventTable::phased(&[rate], &[phase], CLOCK)?),
                quit: false,
                number: None,
                priority: None,
                handle: None,
            };
            Ok(Slot {
                thread: PiMutex::new(thread),
                changes: AtomicU32::new(0),
            })
        });
        Ok(Self(Arc::new(Shared {
            wishes,
            loops: loops.collect::<Result<_, _>>()?,
            started: PiMutex::new(false),
            privileges: PiMutex::new(wishes.request_for_process()),
        })))
    }

    /// Sets the body of the loop `id`, which cannot be changed afterwards, and enables the loop.
    /// Each run calls `body` with `context` and the instant, in nanoseconds, at which the loop was
    /// due.
    ///
    /// # Errors
    /// [`LoopError::NoSuchLoop`] if there is no such loop, [`LoopError::Taken`] if it has a body,
    /// [`LoopError::NoThread`] if a thread cannot be started.
    pub fn assign<C: Send>(
        &self,
        id: LoopId,
        overrun: Overrun,
        body: fn(&mut C, u64),
        context: &'static mut C,
    ) -> Result<(), LoopError> {
        self.assign_body(id, overrun, LoopBody::of_function(body, context))
    }

    /// Returns the kernel's answers to the requests for privileges so far.
    #[must_use]
    pub fn privileges(&self) -> Privileges {
        self.0.privileges.lock().clone()
    }

    fn set_enabled(&self, id: LoopId, enabled: bool) -> Result<(), LoopError> {
        let slot = self.0.slot(id)?;
        let done = slot.change(|thread| thread.state.enable(0, enabled));
        done.then_some(()).ok_or(LoopError::Unassigned { id })
    }
}

impl<K: Keep> Shared<K> {
    fn slot(&self, id: LoopId) -> Result<&Slot<K>, LoopError> {
        let loops = self.loops.len() as u8;
        let slot = self.loops.get(usize::from(id.0));
        slot.ok_or(LoopError::NoSuchLoop { id, loops })
    }

    fn rates(&self) -> Vec<Rate> {
        let rate = |slot: &Slot<K>| slot.thread.lock().rate;
        self.loops.iter().map(rate).collect()
    }

    /// Puts the priorities of all threads in the order of their rates.
    fn set_priorities(&self) {
        let rates = self.rates();
        for (number, slot) in self.loops.iter().enumerate() {
            let Some(priority) = self.wishes.priority_of(rank(&rates, number)) else {
                return;
            };
            // Under the lock of its state, a thread does not end and leave its number to another.
            let mut thread = slot.thread.lock();
            let Some(number_of_thread) = thread.number else {
                continue;
            };
            if thread.priority == Some(priority) {
                continue;
            }
            let result = set_priority(number_of_thread.cast_signed(), priority);
            thread.priority = Some(priority);
            drop(thread);
            let what = format!("SCHED_FIFO {priority} for loop {number}");
            self.privileges.lock().note(Wish::Priority, what, result);
        }
    }

    /// Runs as a loop's thread: asks for its privileges, reports the answer, and runs the loop.
    fn run(&self, number: usize, ready: &mpsc::Sender<()>) {
        let rates = self.rates();
        let rank = rank(&rates, number);
        let (Some(slot), Some(rate)) = (self.loops.get(number), rates.get(number)) else {
            return;
        };
        let who = format!("loop {number} ({rate})");
        let answers = self.wishes.request_for_thread(rank, &who);
        self.privileges.lock().add(answers);
        {
            let mut thread = slot.thread.lock();
            thread.number = Some(thread_number());
            thread.priority = self.wishes.priority_of(rank);
        }
        let _ = ready.send(());
        slot.run();
    }
}

/// Returns the number of loops that are faster.
fn rank(rates: &[Rate], number: usize) -> usize {
    let before = |(other, rate): &(usize, &Rate)| {
        rates
            .get(number)
            .is_some_and(|own| *rate > own || *rate == own && *other < number)
    };
    rates.iter().enumerate().filter(before).count()
}

impl<K: Keep> Loops for Threads<K> {
    fn run<R>(&self, background: impl FnOnce() -> R) -> Result<R, StartError> {
        self.run_from(time::now(), background)
    }

    fn run_from<R>(&self, instant: u64, background: impl FnOnce() -> R) -> Result<R, StartError> {
        self.start_at(instant)?;
        let _stop = Stop(self);
        Ok(background())
    }

    fn start(&self) -> Result<(), StartError> {
        self.start_at(time::now())
    }

    /// `instant` is of `CLOCK_MONOTONIC`, in nanoseconds.
    fn start_at(&self, instant: u64) -> Result<(), StartError> {
        let mut started = self.0.started.lock();
        if core::mem::replace(&mut *started, true) {
            return Err(StartError::Started);
        }
        for slot in &self.0.loops {
            slot.change(|thread| thread.state.start(instant));
        }
        Ok(())
    }

    fn stop(&self) {
        let mut started = self.0.started.lock();
        *started = false;
        for slot in &self.0.loops {
            slot.change(|thread| thread.state.stop());
        }
    }

    fn enable(&self, id: LoopId) -> Result<(), LoopError> {
        self.set_enabled(id, true)
    }

    fn disable(&self, id: LoopId) -> Result<(), LoopError> {
        self.set_enabled(id, false)
    }

    fn set_rate(&self, id: LoopId, rate: Rate) -> Result<(), LoopError> {
        self.0.slot(id)?.change(|thread| {
            // A loop alone is ready at once.
            thread.state.schedule.begin_change(0, rate)?;
            thread.rate = rate;
            Ok::<_, LoopError>(())
        })?;
        self.0.set_priorities();
        Ok(())
    }

    fn statistics(&self, id: LoopId) -> Result<Statistics, LoopError> {
        let mut thread = self.0.slot(id)?.thread.lock();
        thread.advance(time::now());
        thread
            .state
            .statistics(0)
            .ok_or(LoopError::NoStatistics { id })
    }

    fn histograms(&self, id: LoopId) -> Result<Histograms, LoopError> {
        let histograms = self.0.slot(id)?.thread.lock().state.histograms(0);
        histograms.ok_or(LoopError::NoStatistics { id })
    }

    fn reset_statistics(&self, id: LoopId) -> Result<(), LoopError> {
        self.0.slot(id)?.thread.lock().state.reset(0);
        Ok(())
    }
}

impl<K: Keep> Runner for Threads<K> {
    type Instant = u64;

    fn assign_body(
        &self,
        id: LoopId,
        overrun: Overrun,
        body: LoopBody<u64>,
    ) -> Result<(), LoopError> {
        let slot = self.0.slot(id)?;
        let rate = {
            let mut thread = slot.thread.lock();
            if !thread.state.assign(0, overrun, body) {
                return Err(LoopError::Taken { id });
            }
            thread.quit = false;
            thread.rate
        };
        let (ready, is_ready) = mpsc::channel();
        let shared = Arc::clone(&self.0);
        let spawned = Builder::new()
            .name(rate.to_string())
            .spawn(move || shared.run(id.0.into(), &ready));
        let mut thread = slot.thread.lock();
        match spawned {
            Ok(handle) => thread.handle = Some(handle),
            Err(error) => {
                // No run is in progress.
                let _ = thread.state.withdraw(1);
                let os_error = error.raw_os_error().unwrap_or(0);
                return Err(LoopError::NoThread { id, os_error });
            }
        }
        drop(thread);
        // The report is complete, and the loop ready, when this returns.
        let _ = is_ready.recv();
        Ok(())
    }

    fn withdraw(&self, numbers: u32) {
        let ended = |number: &usize| numbers & 1_u32.unbounded_shl(*number as u32) != 0;
        let slots = || (0..self.0.loops.len()).filter(ended);
        let slots = || slots().filter_map(|number| self.0.loops.get(number));
        for slot in slots() {
            slot.change(|thread| thread.quit = true);
        }
        for slot in slots() {
            let handle = slot.thread.lock().handle.take();
            // The panic of a body was caught.
            let _ = handle.map(JoinHandle::join);
        }
    }

    fn enter(&self, gate: &Gate) -> Result<u32, LoopLockError> {
        if gate.threads.is_mine() {
            return Err(LoopLockError::Taken);
        }
        gate.threads.lock();
        // Taken by a scheduler on one stack, which does not wait. Pairs with the store in `leave`.
        if gate.taken.swap(true, Ordering::Acquire) {
            gate.threads.unlock();
            return Err(LoopLockError::Taken);
        }
        Ok(0)
    }

    fn leave(&self, gate: &Gate, _: u32) {
        // Pairs with the swap of a scheduler; threads are ordered by the lock.
        gate.taken.store(false, Ordering::Release);
        gate.threads.unlock();
    }
}

/// Ends the loops that were assigned for good.
impl<K: Keep> Drop for Threads<K> {
    fn drop(&mut self) {
        self.withdraw(u32::MAX);
    }
}
