//! The real scheduler in virtual time, on counters of any width.

use std::marker::PhantomData;
use std::sync::Mutex;
use std::sync::atomic::{AtomicU32, AtomicU64, Ordering::Relaxed};

use condor_mos::sim::SimPlatform;
use condor_mos::{
    Armed, CounterReading, EventTable, LoopId, LoopLock, LoopLockError, Loops, Platform, Rate,
    Scheduler, StartError, Timer, Wrapping,
};

use super::log::{Counts, Entry, What};
use super::program::{Action, BUSY_RUNS, LOOPS, Piece, Program};

/// What a counter reads.
pub(crate) trait Reading: CounterReading {
    fn at(ticks: u64) -> Self;
}

impl Reading for u64 {
    fn at(ticks: u64) -> Self {
        ticks
    }
}

impl<const BITS: u32> Reading for Wrapping<BITS> {
    fn at(ticks: u64) -> Self {
        Self::new(ticks as u32)
    }
}

/// A processor whose counter is narrower than virtual time.
pub(crate) struct Narrow<I> {
    processor: SimPlatform,
    reading: PhantomData<I>,
}

impl<I: Reading> Timer for Narrow<I> {
    type Instant = I;

    fn frequency(&self) -> Rate {
        self.processor.frequency()
    }

    fn now(&self) -> I {
        I::at(Timer::now(&self.processor))
    }

    fn arm(&self, at: I) -> Armed {
        let now = Timer::now(&self.processor);
        let ahead = if I::at(now).has_reached(at) {
            0
        } else {
            at.since(I::at(now))
        };
        self.processor.arm(now + u64::from(ahead))
    }

    fn disarm(&self) {
        self.processor.disarm();
    }
}

impl<I: Reading> Platform for Narrow<I> {
    fn interruptible(&self, rank: u32, body: impl FnOnce()) {
        self.processor.interruptible(rank, body);
    }
}

pub(crate) struct Machine<'p, I: Reading, const E: usize> {
    program: &'p Program,
    processor: SimPlatform,
    scheduler: Scheduler<Narrow<I>, LOOPS, E>,
    held_until: AtomicU64,
    runs: AtomicU32,
    log: Mutex<Vec<Entry>>,
}

impl<'p, I: Reading, const E: usize> Machine<'p, I, E> {
    pub(crate) fn run(
        program: &'p Program,
        processor: SimPlatform,
        schedule: EventTable<LOOPS, E>,
    ) -> Vec<Entry> {
        let platform = Narrow {
            processor: processor.clone(),
            reading: PhantomData,
        };
        let this = Self {
            program,
            processor,
            scheduler: Scheduler::new(platform, schedule),
            held_until: AtomicU64::new(0),
            runs: AtomicU32::new(0),
            log: Mutex::new(Vec::new()),
        };
        let mut bodies: [_; LOOPS] = std::array::from_fn(|number| {
            let this = &this;
            let mut pieces = program.bodies[number].iter().cycle();
            move |_| {
                this.note(What::Begins(number));
                let piece = pieces.next().expect("again and again");
                if this.runs.fetch_add(1, Relaxed) < BUSY_RUNS {
                    this.piece(piece);
                }
                this.note(What::Ends(number));
            }
        });
        let (processor, scheduler) = (&this.processor, &this.scheduler);
        scheduler.scope(|scope| {
            for (number, body) in bodies.iter_mut().enumerate() {
                let assigned = scope.assign(id(number), program.overruns[number], body);
                assigned.expect("a loop that is free");
            }
            processor.with_handler(|| scheduler.on_timer(), || this.background());
        });
        this.log.into_inner().expect("no panic")
    }

    fn background(&self) {
        self.act(&Action::Start);
        for piece in &self.program.background {
            self.processor.run_until(self.now() + piece.before);
            self.act(&piece.action);
            self.processor.run_until(self.now() + piece.after);
        }
    }

    fn piece(&self, piece: &Piece) {
        self.processor.work(piece.before);
        self.act(&piece.action);
        self.processor.work(piece.after);
    }

    fn now(&self) -> u64 {
        Timer::now(&self.processor)
    }

    fn act(&self, action: &Action) {
        match *action {
            Action::Nothing => {}
            Action::Enable(number) => self.scheduler.enable(id(number)).expect("it has a body"),
            Action::Disable(number) => self.scheduler.disable(id(number)).expect("it has a body"),
            Action::SetRate(number, rate) => {
                self.scheduler.set_rate(id(number), rate).expect("it fits");
            }
            Action::Stop => self.scheduler.stop(),
            Action::Start => match self.scheduler.start() {
                Ok(()) | Err(StartError::Started) => {}
                Err(error) => panic!("{error}"),
            },
            Action::Interrupt => self.processor.interrupt(),
            Action::Hold(ticks) => {
                if self.now() > self.held_until.load(Relaxed) {
                    self.held_until.store(self.now() + ticks, Relaxed);
                    self.processor.hold_interrupts(ticks);
                }
            }
            Action::Lock(users, ticks) => self.lock(users, ticks),
        }
        self.note(What::Acted);
    }

    fn lock(&self, users: u32, ticks: u64) {
        let users = (0..LOOPS).filter(|number| users & (1 << number) != 0);
        let lock = LoopLock::new(&users.map(id).collect::<Vec<_>>(), ());
        match lock.lock(&self.scheduler, |()| self.processor.work(ticks)) {
            Ok(()) => {}
            Err(LoopLockError::Undeclared) => self.note(What::Refused),
            Err(LoopLockError::Taken) => panic!("taken by nobody"),
        }
    }

    fn note(&self, what: What) {
        let loops = (0..LOOPS).map(|number| {
            let seen = self.scheduler.statistics(id(number)).expect("a loop");
            let parts = seen.run + seen.skipped + seen.running + seen.pending;
            assert_eq!(seen.released, parts, "{seen:?}");
            Counts {
                rate: seen.rate,
                enabled: seen.enabled,
                faulted: seen.faulted,
                released: seen.released,
                run: seen.run,
                skipped: seen.skipped,
                running: seen.running,
                pending: seen.pending,
                worst_run: u64::from(seen.worst_run),
                total_run: seen.total_run,
                worst_lateness: u64::from(seen.worst_lateness),
            }
        });
        let entry = Entry {
            now: self.now(),
            what,
            loops: loops.collect(),
        };
        self.log.lock().expect("no panic").push(entry);
    }
}

fn id(number: usize) -> LoopId {
    LoopId(number as u8)
}
