//! [`SchedulerState`]: what is due, what runs next, what was interrupted. All decisions, and no platform.

use crate::body::LoopBody;
use crate::error::LoopError;
use crate::instant::CounterReading;
use crate::process::{LoopId, Overrun, Process};
use crate::record::{Histograms, Record};
use crate::schedule::{EventTable, ScheduleEvent};
use crate::statistics::Statistics;

/// The scheduler's memory: the process table, and where it is in the schedule.
///
/// Sets of loops are words with a bit for each rank. Every method is one step that nothing may
/// interrupt.
pub(crate) struct SchedulerState<I, const L: usize, const E: usize, K> {
    pub(crate) schedule: EventTable<L, E>,
    /// When the next event is due.
    due: I,
    started: bool,
    enabled: u32,
    /// May start, as far as locks are concerned.
    unlocked: u32,
    /// Cannot just start when they are released: those that are disabled or locked out.
    held: u32,
    /// Released, and not finished.
    unfinished: u32,
    /// Released, and not started.
    runnable: u32,
    /// At whose end there is more to do: those for which releases wait, and all while nothing is
    /// started.
    unusual: u32,
    /// Ticks that loops have taken, each without those that interrupted it; wraps.
    pub(crate) busy: u32,
    /// By rank.
    processes: [Process<I, K>; L],
}

/// A loop that has started, and what it runs.
#[derive(Clone, Copy)]
#[must_use]
pub(crate) struct Start<I> {
    pub(crate) due: I,
    pub(crate) body: LoopBody<I>,
    pub(crate) running: Running<I>,
}

/// The data that are needed at the end of a loop that has started.
#[derive(Clone, Copy)]
pub(crate) struct Running<I> {
    pub(crate) since: I,
    /// The time that loops had taken then, unless none can interrupt this one.
    pub(crate) busy: u32,
}

impl<I: CounterReading, const L: usize, const E: usize, K: Record> SchedulerState<I, L, E, K> {
    pub(crate) const fn new(schedule: EventTable<L, E>) -> Self {
        Self {
            schedule,
            due: I::ZERO,
            started: false,
            enabled: 0,
            unfinished: 0,
            runnable: 0,
            unlocked: u32::MAX,
            held: u32::MAX,
            unusual: u32::MAX,
            busy: 0,
            processes: [Process::NEW; L],
        }
    }

    /// Begins the schedule now: all loops are due.
    pub(crate) fn start(&mut self, now: I) {
        self.schedule.restart();
        self.due = now;
        self.started = true;
        self.unusual = 0;
    }

    /// Ends it; what is in progress finishes.
    pub(crate) fn stop(&mut self) {
        self.started = false;
        self.schedule.park();
        self.forget(u32::MAX);
        self.unusual = u32::MAX;
    }

    /// When the next event is due; `None` while stopped.
    pub(crate) fn started_due(&self) -> Option<I> {
        self.started.then_some(self.due)
    }

    /// As [`started_due`](Self::started_due); `None` also if no loop is released then.
    #[cfg(all(feature = "linux", target_os = "linux", not(condor_loom)))]
    pub(crate) fn next_release(&self) -> Option<I> {
        self.started_due().filter(|_| self.enabled != 0)
    }

    /// When the next event is due, unless there is more to do at the end of the loop of a rank.
    #[inline(always)]
    pub(crate) fn plain_next(&self, rank: u32) -> Option<I> {
        (self.unusual & 1 << rank == 0).then_some(self.due)
    }

    /// The event that is due by `now`, if it is in the table and all of its loops may start: when it
    /// was due, and its index. All else is left to [`pass_event`](Self::pass_event).
    #[inline(always)]
    pub(crate) fn peek_event(&self, now: I) -> Option<(I, ScheduleEvent, usize)> {
        // If nothing is started, the schedule is at a turn.
        let (event, index) = self.schedule.peek()?;
        let may_start = event.ranks & (self.unfinished | self.held) == 0;
        (now.has_reached(self.due) && may_start).then_some((self.due, event, index))
    }

    /// Takes the event at that index, and returns the instant at which the next one is due. Its loops are
    /// unfinished from here on; the context that takes them begins them or makes them runnable.
    #[inline(always)]
    pub(crate) fn take_event(&mut self, due: I, event: ScheduleEvent, index: usize) -> I {
        self.schedule.pass(index);
        self.due = due.after(event.gap);
        self.unfinished |= event.ranks;
        self.due
    }

    /// Lets loops that were released start when it is their turn.
    #[inline(always)]
    pub(crate) fn make_runnable(&mut self, released: u32, due: I) {
        self.runnable |= released;
        let mut rest = released;
        for process in &mut self.processes {
            if rest & 1 != 0 {
                process.due = due;
            }
            rest >>= 1;
            if rest == 0 {
                break;
            }
        }
    }

    /// Passes the event that is due, and returns the instant at which the next one is due.
    #[cold]
    pub(crate) fn pass_event(&mut self) -> I {
        if self.schedule.is_at_turn() {
            self.turn();
        }
        let due = self.due;
        let event = self.schedule.next_event();
        self.due = due.after(event.gap);
        let released = self.without_overruns(event.ranks, due);
        self.unfinished |= released;
        self.make_runnable(released, due);
        self.due
    }

    /// Returns true if an event was due before `now`, which is when the fastest loop ends, and could not come.
    #[inline(always)]
    pub(crate) fn is_overdue(&self, now: I) -> bool {
        now.has_reached(self.due.after(1)) && self.started
    }

    /// Returns true if the loop runs that nothing interrupts where ranks have vectors.
    pub(crate) fn runs_fastest(&self) -> bool {
        self.unfinished & !self.runnable & 1 != 0
    }

    /// Lets changed rates take effect if they can.
    fn turn(&mut self) {
        if self.schedule.is_changing() {
            self.change();
        } else {
            self.schedule.turn(false);
        }
    }

    #[cold]
    #[inline(never)]
    fn change(&mut self) {
        // One loop keeps its rank.
        let idle = L == 1 || self.unfinished == 0 && self.unlocked == u32::MAX;
        let rates = *self.schedule.set();
        let Some(former_ranks) = self.schedule.turn(idle) else {
            return;
        };
        for (rank, former) in (0..).zip(former_ranks) {
            if let (Some(after), Some(before)) = (
                self.schedule.set().at_rank(rank),
                rates.at_rank(usize::from(former)),
            ) && after != before
                && let Some(process) = self.processes.get_mut(usize::from(former))
            {
                let released = process.record.counts();
                process.record.change(released.run() + released.skipped);
            }
        }
        let (before, were_enabled) = (self.processes, self.enabled);
        self.enabled = 0;
        for (rank, (process, former)) in (0..).zip(self.processes.iter_mut().zip(former_ranks)) {
            if let Some(moved) = before.get(usize::from(former)) {
                *process = *moved;
            }
            self.enabled |= (were_enabled >> former & 1) << rank;
        }
        self.hold();
    }

    /// Those of `ranks` that may just start; the others overrun, are disabled, or wait for a lock.
    #[cold]
    fn without_overruns(&mut self, ranks: u32, due: I) -> u32 {
        for rank in bits(ranks & self.unfinished & self.enabled) {
            let Some(process) = self.processes.get_mut(rank as usize) else {
                continue;
            };
            if !process.overrun(due) {
                self.enabled &= !(1 << rank);
            }
            if process.queued > 0 {
                self.unusual |= 1 << rank;
            }
        }
        self.hold();
        let released = ranks & !self.unfinished & self.enabled;
        let locked_out = released & !self.unlocked;
        self.unfinished |= locked_out;
        self.make_runnable(locked_out, due);
        released & !locked_out
    }

    /// To be called when what `held` depends on has changed.
    fn hold(&mut self) {
        self.held = !(self.enabled & self.unlocked);
    }

    /// The ranks that may start now.
    #[inline(always)]
    pub(crate) fn ready(&self) -> u32 {
        let running = self.unfinished & !self.runnable;
        // Those faster than the fastest that runs; all, if none does.
        let faster = (running & running.wrapping_neg()).wrapping_sub(1);
        self.runnable & self.unlocked & faster
    }

    /// The ranks that may start now where hardware decides who interrupts whom.
    #[inline(always)]
    pub(crate) fn unlocked(&self) -> u32 {
        self.runnable & self.unlocked
    }

    /// Starts the fastest loop that may start, and returns its rank.
    #[inline(always)]
    pub(crate) fn begin_fastest(&mut self, now: I) -> Option<(u32, Start<I>)> {
        match self.ready() {
            0 => None,
            ready => {
                let rank = ready.trailing_zeros();
                Some((rank, self.begin(rank, now)?))
            }
        }
    }

    /// Starts the loop of a rank, if it is runnable and not locked out.
    #[inline(always)]
    pub(crate) fn begin_unlocked(&mut self, rank: u32, now: I) -> Option<Start<I>> {
        if self.unlocked() & 1_u32.unbounded_shl(rank) == 0 {
            return None;
        }
        self.begin(rank, now)
    }

    #[inline(always)]
    fn begin(&mut self, rank: u32, now: I) -> Option<Start<I>> {
        self.runnable &= !(1 << rank);
        self.start_loop::<false>(rank, now)
    }

    /// Starts the loop of a rank that was just released, and not made runnable; none will interrupt it.
    #[inline(always)]
    pub(crate) fn begin_released(&mut self, rank: u32, due: I, now: I) -> Option<Start<I>> {
        self.processes.get_mut(rank as usize)?.due = due;
        self.start_loop::<true>(rank, now)
    }

    /// The loop of a rank is in progress from `now` on.
    #[inline(always)]
    fn start_loop<const ALONE: bool>(&mut self, rank: u32, now: I) -> Option<Start<I>> {
        let process = self.processes.get_mut(rank as usize)?;
        process.start(now);
        Some(Start {
            due: process.due,
            body: process.body,
            running: Running {
                since: if K::MEASURES { now } else { I::ZERO },
                busy: if K::MEASURES && !ALONE { self.busy } else { 0 },
            },
        })
    }

    /// Ends the loop of a rank, which is the last one that was started and has not ended; says whether
    /// it may start again at once.
    #[inline(always)]
    pub(crate) fn end(&mut self, rank: u32, running: Running<I>, now: I) -> bool {
        self.end_plainly::<false>(rank, running, now);
        let waits = self.unusual & 1 << rank != 0 && self.end_with_others(rank);
        if waits {
            self.unfinished |= 1 << rank;
        }
        waits
    }

    /// As [`end`](Self::end), if there is no more to do at its end. No loop has interrupted it if it was
    /// `ALONE`.
    #[inline(always)]
    pub(crate) fn end_plainly<const ALONE: bool>(
        &mut self,
        rank: u32,
        running: Running<I>,
        now: I,
    ) {
        if K::MEASURES {
            let nested = if ALONE {
                0
            } else {
                self.busy.wrapping_sub(running.busy)
            };
            let ticks = now.since(running.since).wrapping_sub(nested);
            self.busy = self.busy.wrapping_add(ticks);
            if let Some(process) = self.processes.get_mut(rank as usize) {
                process.record.finish(ticks);
            }
        }
        self.unfinished &= !(1 << rank);
    }

    /// The loop of a rank has finished: the next of the releases that wait takes its place, if any does.
    #[cold]
    fn end_with_others(&mut self, rank: u32) -> bool {
        let Some(process) = self.processes.get_mut(rank as usize) else {
            return false;
        };
        let waits = process.queued > 0;
        if waits {
            process.take_queued();
            self.runnable |= 1 << rank;
        }
        if self.started && process.queued == 0 {
            self.unusual &= !(1 << rank);
        }
        waits
    }

    /// Lets only loops start that are faster than all in `users`, a bit for each number; returns the ranks that
    /// might start before, or `None` if a faster one is in progress.
    pub(crate) fn lock(&mut self, users: u32) -> Option<u32> {
        let is_user = |number: &u8| users & 1_u32.unbounded_shl(u32::from(*number)) != 0;
        let fastest = self.schedule.set().ranks().iter().position(is_user);
        // A lock that no loop uses keeps none from starting.
        let faster = fastest.map_or(u32::MAX, |rank| !u32::MAX.unbounded_shl(rank as u32));
        if self.unfinished & !self.runnable & faster != 0 {
            return None;
        }
        let former = self.unlocked;
        self.unlocked &= faster;
        self.hold();
        Some(former)
    }

    /// Undoes [`lock`](Self::lock).
    pub(crate) fn unlock(&mut self, former: u32) {
        self.unlocked = former;
        self.hold();
    }

    /// Sets the body of a loop that has none, and enables the loop; returns true if it had none.
    pub(crate) fn assign(&mut self, number: usize, overrun: Overrun, body: LoopBody<I>) -> bool {
        let Some(rank) = self.rank(number) else {
            return false;
        };
        match self.processes.get_mut(rank as usize) {
            Some(process) if process.body.is_nothing() => {
                process.body = body;
                process.overrun = overrun;
            }
            _ => return false,
        }
        self.enable(number, true)
    }

    /// Has a loop released from its next instant on, or not any more; says whether it has a body.
    pub(crate) fn enable(&mut self, number: usize, enabled: bool) -> bool {
        let Some(rank) = self.rank(number) else {
            return false;
        };
        let Some(process) = self.processes.get_mut(rank as usize) else {
            return false;
        };
        if process.body.is_nothing() {
            return false;
        }
        if enabled {
            process.faulted = false;
            self.enabled |= 1 << rank;
        } else {
            self.enabled &= !(1 << rank);
            self.forget(1 << rank);
        }
        self.hold();
        true
    }

    /// Disables the loops of `numbers`, a bit for each, and takes away their bodies, unless one is in
    /// progress; says whether none is.
    pub(crate) fn withdraw(&mut self, numbers: u32) -> bool {
        let mut ranks = 0;
        for number in bits(numbers) {
            if let Some(rank) = self.rank(number as usize) {
                ranks |= 1 << rank;
            }
        }
        self.enabled &= !ranks;
        self.hold();
        self.forget(ranks);
        if self.unfinished & ranks != 0 {
            return false;
        }
        for rank in bits(ranks) {
            if let Some(process) = self.processes.get_mut(rank as usize) {
                process.body = LoopBody::NOTHING;
            }
        }
        true
    }

    /// A loop's counts; `None` if none are kept.
    pub(crate) fn statistics(&self, number: usize) -> Option<Statistics> {
        let rate = *self.schedule.rates().get(number).filter(|_| K::MEASURES)?;
        let rank = self.rank(number)?;
        let process = self.processes.get(rank as usize)?;
        let counts = process.record.counts();
        let running = u64::from((self.unfinished & !self.runnable) >> rank & 1);
        let pending = u64::from((self.runnable >> rank & 1) + process.queued);
        Some(Statistics {
            rate,
            frequency: self.schedule.clock().frequency(),
            enabled: self.enabled >> rank & 1 != 0,
            faulted: process.faulted,
            computed: E > 0 && self.schedule.is_scan(),
            released: counts.run() + counts.skipped + running + pending,
            run: counts.run(),
            skipped: counts.skipped,
            running,
            pending,
            worst_lateness: counts.worst_lateness,
            worst_run: counts.worst_run,
            total_run: counts.total_run(),
            released_before: counts.released_before,
            total_before: counts.total_before,
        })
    }

    /// Disables a loop because of what it did.
    #[cfg(all(feature = "linux", target_os = "linux", not(condor_loom)))]
    pub(crate) fn fault(&mut self, number: usize) {
        self.enable(number, false);
        if let Some(rank) = self.rank(number)
            && let Some(process) = self.processes.get_mut(rank as usize)
        {
            process.faulted = true;
        }
    }

    /// A loop's distributions; `None` if none are kept.
    pub(crate) fn histograms(&self, number: usize) -> Option<Histograms> {
        let process = self.processes.get(self.rank(number)? as usize)?;
        process.record.histograms()
    }

    /// Counts begin anew.
    pub(crate) fn reset(&mut self, number: usize) {
        if let Some(rank) = self.rank(number)
            && let Some(process) = self.processes.get_mut(rank as usize)
        {
            process.record = K::NEW;
        }
    }

    /// Skips what has not started of `ranks`.
    fn forget(&mut self, ranks: u32) {
        for (rank, process) in (0..).zip(&mut self.processes) {
            if ranks >> rank & 1 != 0 {
                let forgotten = process.queued + (self.runnable >> rank & 1);
                process.record.skip(forgotten);
                process.queued = 0;
            }
        }
        self.unfinished &= !(self.runnable & ranks);
        self.runnable &= !ranks;
    }

    /// The number of a loop that there is.
    pub(crate) fn number(&self, id: LoopId) -> Result<usize, LoopError> {
        let number = usize::from(id.0);
        if number < self.schedule.rates().len() {
            Ok(number)
        } else {
            Err(self.no_such(id))
        }
    }

    pub(crate) fn no_such(&self, id: LoopId) -> LoopError {
        let loops = self.schedule.rates().len() as u8;
        LoopError::NoSuchLoop { id, loops }
    }

    fn rank(&self, number: usize) -> Option<u32> {
        self.schedule.set().rank(number).map(|rank| rank as u32)
    }
}

/// The numbers of the bits that are set.
#[inline(always)]
fn bits(mut word: u32) -> impl Iterator<Item = u32> {
    core::iter::from_fn(move || {
        if word == 0 {
            return None;
        }
        let bit = word.trailing_zeros();
        word &= word - 1;
        Some(bit)
    })
}
