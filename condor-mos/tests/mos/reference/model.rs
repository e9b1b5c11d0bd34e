//! [`Model`]: a scheduler as one would explain it, one release after the other.

use std::collections::VecDeque;

use condor_mos::{Overrun, Rate};

use super::log::{Counts, Entry, What};
use super::program::{Action, BUSY_RUNS, LOOPS, Piece, Program};

/// Which schedule it imitates.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Kind {
    /// Instants are counted from the beginning of each hyperperiod, where changes take effect.
    Table,
    /// Instants of each loop are counted from its own beginning; changes take effect at any.
    Scan,
}

struct Loop {
    rate: Rate,
    overrun: Overrun,
    enabled: bool,
    faulted: bool,
    /// Instants of releases that wait.
    waiting: VecDeque<u64>,
    running: bool,
    released: u64,
    skipped: u64,
    run: u64,
    worst_run: u64,
    total_run: u64,
    worst_lateness: u64,
    /// The instant from which releases are counted, in ticks, and how many there have been.
    origin: u64,
    count: u64,
}

pub(crate) struct Model<'p> {
    program: &'p Program,
    kind: Kind,
    now: u64,
    held_until: u64,
    longest_gap: u64,
    latest_event: Option<u64>,
    started: bool,
    loops: Vec<Loop>,
    /// Rates that were asked for.
    wanted: Option<Vec<Rate>>,
    /// The beginning of the schedule, and how many hyperperiods have passed (tables only).
    origin: u64,
    hyperperiods: u64,
    /// Loops in progress, each with what others have taken of its time.
    stack: Vec<(usize, u64)>,
    /// The fastest user of each lock that is held.
    locks: Vec<Option<usize>>,
    runs: u32,
    log: Vec<Entry>,
}

/// `count` periods of `rate`, rounded to the nearest tick.
fn instant(frequency: Rate, rate: Rate, count: u64) -> u64 {
    let parts = u128::from(rate.numerator()) * u128::from(frequency.denominator());
    let ticks =
        u128::from(count) * u128::from(rate.denominator()) * u128::from(frequency.numerator());
    u64::try_from((2 * ticks + parts) / (2 * parts)).expect("a near future")
}

fn gcd(a: u64, b: u64) -> u64 {
    if b == 0 { a } else { gcd(b, a % b) }
}

/// The greatest rate of which all are multiples.
fn common_divisor(rates: impl Iterator<Item = Rate>) -> Rate {
    let (numerator, denominator) = rates.fold((0, 1), |(n, d), rate| {
        let (rate_n, rate_d) = (u64::from(rate.numerator()), u64::from(rate.denominator()));
        (gcd(n, rate_n), d * rate_d / gcd(d, rate_d))
    });
    Rate::fraction(numerator as u32, denominator as u32)
}

impl<'p> Model<'p> {
    pub(crate) fn new(program: &'p Program, kind: Kind, longest_gap: u64) -> Self {
        let new = |number: usize| Loop {
            rate: program.rates[number],
            overrun: program.overruns[number],
            enabled: true,
            faulted: false,
            waiting: VecDeque::new(),
            running: false,
            released: 0,
            skipped: 0,
            run: 0,
            worst_run: 0,
            total_run: 0,
            worst_lateness: 0,
            origin: 0,
            count: 0,
        };
        Self {
            program,
            kind,
            now: 0,
            held_until: 0,
            longest_gap,
            latest_event: None,
            started: false,
            loops: (0..LOOPS).map(new).collect(),
            wanted: None,
            origin: 0,
            hyperperiods: 0,
            stack: Vec::new(),
            locks: Vec::new(),
            runs: 0,
            log: Vec::new(),
        }
    }

    pub(crate) fn run(mut self) -> Vec<Entry> {
        self.act(&Action::Start);
        for piece in &self.program.background {
            self.wait(piece.before);
            self.act(&piece.action);
            self.wait(piece.after);
        }
        self.log
    }

    fn note(&mut self, what: What) {
        let loops = self.loops.iter().map(|one| Counts {
            rate: one.rate,
            enabled: one.enabled,
            faulted: one.faulted,
            released: one.released,
            run: one.run,
            skipped: one.skipped,
            running: u64::from(one.running),
            pending: one.waiting.len() as u64,
            worst_run: one.worst_run,
            total_run: one.total_run,
            worst_lateness: one.worst_lateness,
        });
        self.log.push(Entry {
            now: self.now,
            what,
            loops: loops.collect(),
        });
    }

    fn goes_before(&self, one: usize, other: usize) -> bool {
        let (rate, other_rate) = (self.loops[one].rate, self.loops[other].rate);
        rate > other_rate || rate == other_rate && one < other
    }

    /// When the loop is due next.
    fn due(&self, number: usize) -> u64 {
        let one = &self.loops[number];
        let frequency = self.program.frequency;
        if self.kind == Kind::Table && one.count > 0 && self.ends_hyperperiod(number) {
            return self.origin + instant(frequency, self.common_rate(), self.hyperperiods);
        }
        one.origin + instant(frequency, one.rate, one.count)
    }

    fn common_rate(&self) -> Rate {
        common_divisor(self.loops.iter().map(|one| one.rate))
    }

    /// When something is due, or the timer cannot count any further.
    fn next_event(&self) -> Option<u64> {
        let due = (0..LOOPS).map(|number| self.due(number));
        let due = due.chain(self.latest_event.map(|at| at + self.longest_gap));
        due.min().filter(|_| self.started)
    }

    /// Everything due at `at` is released, at once.
    fn event(&mut self, at: u64) {
        self.latest_event = Some(at);
        let idle = self.stack.is_empty()
            && self.locks.iter().all(Option::is_none)
            && self.loops.iter().all(|one| one.waiting.is_empty());
        let all_due =
            (0..LOOPS).all(|number| self.due(number) == at && self.ends_hyperperiod(number));
        match self.kind {
            Kind::Scan if idle => self.change_rates_of_scan(),
            Kind::Table if all_due => self.begin_hyperperiod(at, idle),
            _ => {}
        }
        for number in 0..LOOPS {
            if self.due(number) == at {
                self.loops[number].count += 1;
                self.release(number, at);
            }
        }
    }

    /// Whether what the loop is due for is the beginning of a hyperperiod.
    fn ends_hyperperiod(&self, number: usize) -> bool {
        let common = self.common_rate();
        let one = &self.loops[number];
        let product = |a: u32, b: u32| u64::from(a) * u64::from(b);
        let count = product(one.rate.numerator(), common.denominator())
            / product(common.numerator(), one.rate.denominator());
        one.count.is_multiple_of(count)
    }

    fn begin_hyperperiod(&mut self, at: u64, idle: bool) {
        if let Some(wanted) = self.wanted.take_if(|_| idle) {
            for (one, rate) in self.loops.iter_mut().zip(wanted) {
                one.rate = rate;
            }
            self.origin = at;
            self.hyperperiods = 0;
        }
        // The next one begins where the exact hyperperiods say, not where this one's releases do.
        for one in &mut self.loops {
            one.origin = at;
            one.count = 0;
        }
        self.hyperperiods += 1;
    }

    fn change_rates_of_scan(&mut self) {
        let Some(wanted) = self.wanted.take() else {
            return;
        };
        for (number, rate) in wanted.into_iter().enumerate() {
            if rate != self.loops[number].rate {
                self.loops[number].origin = self.due(number);
                self.loops[number].count = 0;
                self.loops[number].rate = rate;
            }
        }
    }

    fn release(&mut self, number: usize, at: u64) {
        let one = &mut self.loops[number];
        if !one.enabled {
            return;
        }
        one.released += 1;
        let allowed = match one.overrun {
            Overrun::Skip | Overrun::Fault => 0,
            Overrun::CatchUp(releases) => usize::from(releases),
        };
        if usize::from(one.running) + one.waiting.len() <= allowed {
            one.waiting.push_back(at);
            return;
        }
        one.skipped += 1;
        if one.overrun == Overrun::Fault {
            one.enabled = false;
            one.faulted = true;
        }
    }

    /// The handler: releases what is due, and runs what is faster than what was interrupted.
    fn interrupt(&mut self) {
        while let Some(due) = self.next_event().filter(|&due| due <= self.now) {
            self.event(due);
        }
        self.dispatch();
    }

    fn dispatch(&mut self) {
        while let Some(number) = self.may_start() {
            self.run_loop(number);
        }
    }

    /// The fastest loop that waits, if it is faster than all that keeps it from running.
    fn may_start(&self) -> Option<usize> {
        let waiting = (0..LOOPS).filter(|&number| !self.loops[number].waiting.is_empty());
        let first = waiting.reduce(|a, b| if self.goes_before(a, b) { a } else { b })?;
        let running = self.stack.iter().map(|&(number, _)| number);
        let mut above = running.chain(self.locks.iter().copied().flatten());
        above
            .all(|other| self.goes_before(first, other))
            .then_some(first)
    }

    fn run_loop(&mut self, number: usize) {
        let begun = self.now;
        let one = &mut self.loops[number];
        let due = one.waiting.pop_front().expect("it waits");
        one.worst_lateness = one.worst_lateness.max(begun - due);
        one.running = true;
        let pieces = &self.program.bodies[number];
        let piece = &pieces[one.run as usize % pieces.len()];
        self.stack.push((number, 0));
        self.note(What::Begins(number));
        self.runs += 1;
        if self.runs <= BUSY_RUNS {
            self.piece(piece);
        }
        self.note(What::Ends(number));
        let (_, others) = self.stack.pop().expect("it was pushed");
        let one = &mut self.loops[number];
        let ticks = self.now - begun;
        one.running = false;
        one.run += 1;
        one.worst_run = one.worst_run.max(ticks - others);
        one.total_run += ticks - others;
        if let Some((_, others)) = self.stack.last_mut() {
            *others += ticks;
        }
    }

    fn piece(&mut self, piece: &Piece) {
        self.work(piece.before);
        self.act(&piece.action);
        self.work(piece.after);
    }

    /// Own work; what interrupts it takes its time in addition.
    fn work(&mut self, mut ticks: u64) {
        loop {
            let interrupt = self
                .next_event()
                .map(|due| due.max(self.held_until).max(self.now));
            match interrupt {
                Some(at) if at < self.now + ticks => {
                    ticks -= at - self.now;
                    self.now = at;
                    self.interrupt();
                }
                _ => break self.now += ticks,
            }
        }
    }

    /// The background waits until an instant, whatever interrupts it.
    fn wait(&mut self, ticks: u64) {
        let end = self.now + ticks;
        while self.now < end {
            let interrupt = self
                .next_event()
                .map(|due| due.max(self.held_until).max(self.now));
            match interrupt {
                Some(at) if at < end => {
                    self.now = at;
                    self.interrupt();
                }
                _ => self.now = end,
            }
        }
    }

    fn act(&mut self, action: &Action) {
        match *action {
            Action::Enable(number) => {
                self.loops[number].enabled = true;
                self.loops[number].faulted = false;
            }
            Action::Disable(number) => {
                self.loops[number].enabled = false;
                self.forget(number);
            }
            Action::SetRate(number, rate) => {
                let current = self.loops.iter().map(|one| one.rate);
                let wanted = self.wanted.get_or_insert_with(|| current.collect());
                wanted[number] = rate;
            }
            Action::Stop => {
                self.started = false;
                (0..LOOPS).for_each(|number| self.forget(number));
            }
            Action::Start if self.started => {}
            Action::Start => {
                self.started = true;
                self.origin = self.now;
                self.hyperperiods = 0;
                self.latest_event = None;
                for one in &mut self.loops {
                    one.origin = self.now;
                    one.count = 0;
                }
                self.interrupt();
            }
            Action::Interrupt => self.interrupt(),
            Action::Hold(ticks) if self.now > self.held_until => self.held_until = self.now + ticks,
            // What is held back again would come later than the counter can tell.
            Action::Nothing | Action::Hold(_) => {}
            Action::Lock(users, ticks) => self.lock(users, ticks),
        }
        self.note(What::Acted);
    }

    fn forget(&mut self, number: usize) {
        let one = &mut self.loops[number];
        one.skipped += one.waiting.len() as u64;
        one.waiting.clear();
    }

    fn lock(&mut self, users: u32, ticks: u64) {
        let users = (0..LOOPS).filter(|number| users & (1 << number) != 0);
        let fastest = users.reduce(|a, b| if self.goes_before(a, b) { a } else { b });
        let running = self.stack.last().map(|&(number, _)| number);
        let undeclared = match (running, fastest) {
            (Some(running), Some(user)) => self.goes_before(running, user),
            (running, None) => running.is_some(),
            (None, _) => false,
        };
        if undeclared {
            self.note(What::Refused);
            return;
        }
        self.locks.push(fastest);
        self.work(ticks);
        self.locks.pop();
        self.dispatch();
    }
}
