//! [`State`]: what is due, what runs next, what was interrupted. All decisions, and no platform.

use crate::body::Body;
use crate::instant::Instant;
use crate::process::Process;
use crate::schedule::Schedule;

/// The scheduler's memory: the process table, and where it is in the schedule.
///
/// Every method is one step that nothing may interrupt.
pub(crate) struct State<S, I, const L: usize> {
    pub(crate) schedule: S,
    /// By number.
    pub(crate) processes: [Process<I>; L],
    /// When the next event is due.
    due: I,
    started: bool,
    /// Loops that are released and have not started, by rank.
    runnable: u32,
    /// Only faster loops may start: the rank of what is in progress, a lock's ceiling, or `L` in the
    /// background.
    level: u32,
    /// Ticks that loops have taken since the one in progress started.
    nested: u32,
}

/// A loop that has started.
#[derive(Clone, Copy)]
#[must_use]
pub(crate) struct Running<I> {
    number: usize,
    pub(crate) body: Option<Body>,
    since: I,
    /// The level, and the ticks of nested loops, of what it interrupted.
    outer_level: u32,
    outer_nested: u32,
}

impl<S: Schedule<L>, I: Instant, const L: usize> State<S, I, L> {
    pub(crate) const fn new(schedule: S) -> Self {
        Self {
            schedule,
            processes: [Process::NEW; L],
            due: I::ZERO,
            started: false,
            runnable: 0,
            level: L as u32,
            nested: 0,
        }
    }

    /// Begins the schedule now: all loops are due.
    pub(crate) fn start(&mut self, now: I) {
        self.schedule.restart();
        self.due = now;
        self.started = true;
    }

    /// Ends it; what is in progress finishes.
    pub(crate) fn stop(&mut self) {
        self.started = false;
        self.runnable = 0;
        self.processes.iter_mut().for_each(Process::forget);
    }

    /// When the next event is due; `None` while stopped.
    #[inline]
    pub(crate) fn due(&self) -> Option<I> {
        self.started.then_some(self.due)
    }

    /// Marks the loops of the event that is due as runnable, and gives when the next one is due.
    #[inline]
    pub(crate) fn pass_event(&mut self) -> I {
        let idle = self.runnable == 0 && self.level == L as u32;
        let event = self.schedule.next_event(|| idle);
        let due = self.due;
        let mut ranks = event.ranks;
        while ranks != 0 {
            let rank = ranks.trailing_zeros();
            ranks &= ranks - 1;
            if let Some(process) = self.at_rank(rank)
                && process.release(due)
            {
                self.runnable |= 1 << rank;
            }
        }
        self.due = due.after(event.gap);
        self.due
    }

    #[inline]
    fn number(&self, rank: u32) -> Option<usize> {
        let number = self.schedule.ranks().get(rank as usize)?;
        Some(usize::from(*number))
    }

    #[inline]
    fn at_rank(&mut self, rank: u32) -> Option<&mut Process<I>> {
        let number = self.number(rank)?;
        self.processes.get_mut(number)
    }

    /// The ranks that are released and have not started.
    #[inline]
    pub(crate) fn runnable(&self) -> u32 {
        self.runnable
    }

    /// The ranks that may start now.
    #[inline]
    pub(crate) fn ready(&self) -> u32 {
        self.runnable & !(u32::MAX.unbounded_shl(self.level))
    }

    /// Starts the fastest loop that may start.
    #[inline]
    pub(crate) fn begin_fastest(&mut self, now: I) -> Option<Running<I>> {
        match self.ready() {
            0 => None,
            ready => self.begin(ready.trailing_zeros(), now),
        }
    }

    /// Starts the loop of a rank, if it may start.
    #[inline]
    pub(crate) fn begin(&mut self, rank: u32, now: I) -> Option<Running<I>> {
        if rank >= self.level || self.runnable & 1_u32.unbounded_shl(rank) == 0 {
            return None;
        }
        let number = self.number(rank)?;
        let process = self.processes.get_mut(number)?;
        let body = process.body;
        if !process.start(now) {
            self.runnable &= !(1 << rank);
        }
        let running = Running {
            number,
            body,
            since: now,
            outer_level: self.level,
            outer_nested: self.nested,
        };
        self.level = rank;
        self.nested = 0;
        Some(running)
    }

    /// Ends a loop, which is the last one that was started and has not ended, and gives the ranks
    /// that may start then.
    #[inline]
    pub(crate) fn end(&mut self, running: Running<I>, now: I) -> u32 {
        let ticks = now.since(running.since);
        if let Some(process) = self.processes.get_mut(running.number) {
            process.finish(ticks.saturating_sub(self.nested));
        }
        self.level = running.outer_level;
        self.nested = running.outer_nested.saturating_add(ticks);
        self.ready()
    }

    /// Lets only loops start that are faster than all in `users`, a bit for each number; gives the
    /// former level, or `None` if a faster one is in progress.
    pub(crate) fn raise(&mut self, users: u32) -> Option<u32> {
        let ceiling = self
            .schedule
            .ranks()
            .iter()
            .position(|&number| users & 1_u32.unbounded_shl(u32::from(number)) != 0)
            .map_or(L as u32, |rank| rank as u32);
        if self.level < ceiling {
            return None;
        }
        Some(core::mem::replace(&mut self.level, ceiling))
    }

    /// Undoes [`raise`](Self::raise), and gives the ranks that may start then.
    pub(crate) fn lower(&mut self, former: u32) -> u32 {
        self.level = former;
        self.ready()
    }

    /// Disables the loops of `numbers`, a bit for each, and takes away their bodies, unless one is in
    /// progress; says whether none is.
    pub(crate) fn withdraw(&mut self, numbers: u32) -> bool {
        let mine = move |number: usize| numbers & 1_u32.unbounded_shl(number as u32) != 0;
        (0..L)
            .filter(|&number| mine(number))
            .for_each(|number| self.enable(number, false));
        let in_progress =
            |(number, process): (usize, &Process<I>)| mine(number) && process.is_running();
        if self.processes.iter().enumerate().any(in_progress) {
            return false;
        }
        for (number, process) in self.processes.iter_mut().enumerate() {
            if mine(number) {
                process.body = None;
            }
        }
        true
    }

    /// The loop is released from its next instant on, or not any more.
    pub(crate) fn enable(&mut self, number: usize, enabled: bool) {
        let ranks = self.schedule.ranks();
        let rank = ranks.iter().position(|&other| usize::from(other) == number);
        if let (Some(process), Some(rank)) = (self.processes.get_mut(number), rank) {
            process.enabled = enabled;
            if enabled {
                process.faulted = false;
            } else {
                process.forget();
                self.runnable &= !(1 << rank);
            }
        }
    }
}
