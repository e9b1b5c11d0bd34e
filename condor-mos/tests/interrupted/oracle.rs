//! [`Oracle`]: what may be seen at a point, given what was seen at the one before.

use crate::process::Overrun;
use crate::record::Counts as Kept;
use crate::state::SchedulerState;

/// Ticks per second: a multiple of all rates, so that every instant is exact.
pub(super) const FREQUENCY: u32 = 12;

/// What is seen from outside.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Snapshot<const L: usize> {
    /// When the next event is due; `None` while stopped.
    due: Option<u64>,
    loops: [Counts; L],
}

/// What is seen of a loop.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Counts {
    rate: u32,
    enabled: bool,
    faulted: bool,
    released: u32,
    run: u32,
    skipped: u32,
    running: u32,
    pending: u32,
}

impl<const L: usize> Snapshot<L> {
    pub(super) fn of<const E: usize>(state: &SchedulerState<u64, L, E, Kept>) -> Self {
        let loops = std::array::from_fn(|number| {
            let loops = state.statistics(number).expect("a loop");
            Counts {
                rate: loops.rate.numerator(),
                enabled: loops.enabled,
                faulted: loops.faulted,
                released: loops.released as u32,
                run: loops.run as u32,
                skipped: loops.skipped as u32,
                running: loops.running as u32,
                pending: loops.pending as u32,
            }
        });
        Self {
            due: state.started_due(),
            loops,
        }
    }
}

/// What the program itself has just asked for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Asked {
    Nothing,
    Start,
    Stop,
    Enable(usize),
    Disable(usize),
}

pub(super) struct Oracle<const L: usize> {
    rates: [u32; L],
    overrun: Overrun,
    vectors: bool,
    /// When the schedule began.
    began: u64,
    seen: Option<Snapshot<L>>,
    pub(super) asked: Asked,
    /// Loops in progress, the last one on top.
    stack: Vec<usize>,
    /// How often each body has been called.
    called: [u32; L],
    /// The ceilings of the locks that are held.
    ceilings: Vec<usize>,
}

impl<const L: usize> Oracle<L> {
    pub(super) fn new(rates: [u32; L], overrun: Overrun, vectors: bool) -> Self {
        Self {
            rates,
            overrun,
            vectors,
            began: 0,
            seen: None,
            asked: Asked::Nothing,
            stack: Vec::new(),
            called: [0; L],
            ceilings: Vec::new(),
        }
    }

    /// How many loops go before this one.
    pub(super) fn rank(&self, number: usize) -> usize {
        let before = |other: &usize| (self.rates[*other], number) > (self.rates[number], *other);
        (0..L).filter(before).count()
    }

    fn is_due(&self, number: usize, at: u64) -> bool {
        (at - self.began).is_multiple_of(u64::from(FREQUENCY / self.rates[number]))
    }

    /// The first event after `at`.
    // Every loop has a rate, so one is due some time.
    #[allow(clippy::maybe_infinite_iter)]
    pub(super) fn next_event(&self, at: u64) -> u64 {
        (at + 1..=at + u64::from(FREQUENCY))
            .find(|&at| (0..L).any(|number| self.is_due(number, at)))
            .expect("a period is a second at most")
    }

    /// At most one section has been left since the last snapshot: what it did is allowed.
    pub(super) fn look(&mut self, now: u64, snapshot: &Snapshot<L>) {
        if self.seen.as_ref() == Some(snapshot) {
            return;
        }
        for one in &snapshot.loops {
            let parts = one.run + one.skipped + one.running + one.pending;
            assert_eq!(one.released, parts, "{one:?}");
            assert!(one.running <= 1);
        }
        let Some(seen) = self.seen.replace(*snapshot) else {
            return;
        };
        let expected = match (seen.due, snapshot.due) {
            (None, Some(due)) => {
                assert_eq!((self.asked, due), (Asked::Start, now));
                self.asked = Asked::Nothing;
                self.began = now;
                seen.loops
            }
            (Some(_), None) => {
                assert_eq!(self.asked, Asked::Stop);
                self.asked = Asked::Nothing;
                seen.loops.map(without_pending)
            }
            (Some(before), Some(due)) if before != due => {
                let all = due > now || self.vectors && Self::runs_fastest(snapshot);
                assert!(all, "all that is due has been released");
                self.rates_change(&seen.loops, &snapshot.loops, before);
                let released = self.after_events(seen.loops, before, due);
                self.after_end_and_start(released, &snapshot.loops)
            }
            _ => match self.after_what_was_asked(&seen.loops, &snapshot.loops) {
                Some(expected) => expected,
                None => self.after_end_and_start(seen.loops, &snapshot.loops),
            },
        };
        assert_eq!(expected, snapshot.loops, "from {seen:?}");
    }

    /// Whether a loop is in progress than which none is faster: what is due meanwhile is released at
    /// its end where ranks have vectors.
    fn runs_fastest(snapshot: &Snapshot<L>) -> bool {
        let fastest = snapshot.loops.iter().map(|one| one.rate).max();
        let mut running = snapshot.loops.iter().filter(|one| one.running == 1);
        running.any(|one| Some(one.rate) == fastest)
    }

    /// Other rates begin at the hyperperiod's beginning `at`, under nothing unfinished.
    fn rates_change(&mut self, seen: &[Counts; L], found: &[Counts; L], at: u64) {
        let rates = found.map(|one| one.rate);
        if rates == self.rates {
            return;
        }
        assert!((0..L).all(|number| self.is_due(number, at)));
        assert!(seen.iter().all(|one| one.running + one.pending == 0));
        assert!(self.stack.is_empty() && self.ceilings.is_empty());
        self.rates = rates;
        self.began = at;
    }

    /// The events from one instant to another, without that.
    fn after_events(&self, mut loops: [Counts; L], mut at: u64, end: u64) -> [Counts; L] {
        for (one, &rate) in loops.iter_mut().zip(&self.rates) {
            one.rate = rate;
        }
        while at < end {
            for (number, one) in loops.iter_mut().enumerate() {
                if one.enabled && self.is_due(number, at) {
                    self.release(one);
                }
            }
            at = self.next_event(at);
        }
        assert_eq!(at, end, "the next event");
        loops
    }

    fn release(&self, one: &mut Counts) {
        let allowed = match self.overrun {
            Overrun::Skip | Overrun::Fault => 0,
            Overrun::CatchUp(more) => u32::from(more),
        };
        one.released += 1;
        if one.running + one.pending <= allowed {
            one.pending += 1;
            return;
        }
        one.skipped += 1;
        if self.overrun == Overrun::Fault {
            one.enabled = false;
            one.faulted = true;
        }
    }

    /// What was asked for has been done to one loop, if that is what changed.
    fn after_what_was_asked(
        &mut self,
        seen: &[Counts; L],
        found: &[Counts; L],
    ) -> Option<[Counts; L]> {
        let mut expected = *seen;
        match self.asked {
            Asked::Enable(number) if !seen[number].enabled && found[number].enabled => {
                expected[number].enabled = true;
                expected[number].faulted = false;
            }
            Asked::Disable(number) if seen[number].enabled && !found[number].enabled => {
                expected[number] = without_pending(expected[number]);
                expected[number].enabled = false;
            }
            _ => return None,
        }
        self.asked = Asked::Nothing;
        Some(expected)
    }

    /// At most one loop has ended, and then at most one has started.
    fn after_end_and_start(&self, mut loops: [Counts; L], found: &[Counts; L]) -> [Counts; L] {
        let (mut ends, mut starts) = (0, 0);
        for (one, found) in loops.iter_mut().zip(found) {
            if found.run != one.run {
                assert_eq!(one.running, 1, "what ends was in progress");
                one.running = 0;
                one.run += 1;
                ends += 1;
            }
        }
        for number in 0..L {
            if found[number].running == 1 && loops[number].running == 0 {
                loops[number].running = 1;
                loops[number].pending -= 1;
                self.starts(number);
                starts += 1;
            }
        }
        assert!(ends <= 1 && starts <= 1, "one at a time: {loops:?}");
        loops
    }

    /// A loop starts: nothing as fast is in progress, and nothing faster waits.
    fn starts(&self, number: usize) {
        let rank = self.rank(number);
        if let Some(&interrupted) = self.stack.last() {
            assert!(rank < self.rank(interrupted), "{number} on {interrupted}");
        }
        assert!(
            self.ceilings.iter().all(|&ceiling| rank < ceiling),
            "{number} under a lock"
        );
    }

    /// The body of a loop begins.
    pub(super) fn enter(&mut self, number: usize) {
        self.starts(number);
        self.stack.push(number);
        self.called[number] += 1;
        self.nothing_faster_waits();
    }

    /// The body of a loop returns.
    pub(super) fn leave(&mut self, number: usize) {
        self.nothing_faster_waits();
        assert_eq!(
            self.stack.pop(),
            Some(number),
            "the last that began ends first"
        );
    }

    /// A program's own code runs: what could interrupt it has done so.
    pub(super) fn nothing_faster_waits(&self) {
        let level = self.stack.last().map_or(L, |&number| self.rank(number));
        let level = self
            .ceilings
            .iter()
            .fold(level, |level, &ceiling| level.min(ceiling));
        let Some(seen) = &self.seen else { return };
        for (number, one) in seen.loops.iter().enumerate() {
            assert!(
                one.pending == 0 || self.rank(number) >= level,
                "{number} waits for what is not faster: {seen:?} {:?}",
                self.stack
            );
        }
    }

    /// A lock of these users is taken.
    pub(super) fn lock(&mut self, users: &[usize]) {
        let ceiling = users.iter().map(|&user| self.rank(user)).min();
        self.ceilings.push(ceiling.unwrap_or(L));
    }

    /// It is about to be given back.
    pub(super) fn unlock(&mut self) {
        self.nothing_faster_waits();
        self.ceilings.pop();
    }

    /// Everything has finished: whatever was released was run or skipped, once.
    pub(super) fn all_is_done(&self, now: u64) {
        assert!(self.stack.is_empty() && self.ceilings.is_empty());
        let seen = self.seen.expect("something was seen");
        assert!(seen.due.is_none_or(|due| due > now), "no release is lost");
        for (one, &called) in seen.loops.iter().zip(&self.called) {
            assert_eq!((one.running, one.pending, one.run), (0, 0, called));
        }
    }
}

fn without_pending(mut one: Counts) -> Counts {
    one.skipped += one.pending;
    one.pending = 0;
    one
}
