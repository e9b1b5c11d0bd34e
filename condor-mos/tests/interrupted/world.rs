//! [`World`]: a set of loops, the processor that they run on, and who watches them.

use std::rc::Rc;
use std::sync::Mutex;

use interrupt_injector::{Plan, point, quietly, with_points};

use super::oracle::{Asked, FREQUENCY, Oracle, Snapshot};
use crate::clock::ClockSpec;
use crate::lock::LoopLock;
use crate::loops::Loops as _;
use crate::platform::Platform;
use crate::process::{LoopId, Overrun};
use crate::rate::Rate;
use crate::schedule::EventTable;
use crate::scheduler::Scheduler;
use crate::sim::{SimPlatform, Vectored};

/// Entries for rates of 1 to 4 Hz: a hyperperiod of 12 ticks.
const ENTRIES: usize = 12;
type Table<const L: usize> = EventTable<L, ENTRIES>;

/// Two of the hyperperiods.
pub(super) const END: u64 = 2 * FREQUENCY as u64;

/// What an interrupt finds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    /// One event is due.
    OnTime,
    /// Two are.
    Late,
    /// None is.
    WithoutCause,
}

/// A simulated processor, whatever its way to nest.
pub(super) trait Simulated: Platform<Instant = u64> + Clone + Send + Sync + 'static {
    /// What people call it.
    const NESTING: &str;

    fn new(frequency: Rate) -> Self;

    fn processor(&self) -> &SimPlatform;
}

impl Simulated for SimPlatform {
    const NESTING: &str = "by call";

    fn new(frequency: Rate) -> Self {
        Self::new(frequency)
    }

    fn processor(&self) -> &SimPlatform {
        self
    }
}

impl Simulated for Vectored {
    const NESTING: &str = "by vectors";

    fn new(frequency: Rate) -> Self {
        Self(SimPlatform::new(frequency))
    }

    fn processor(&self) -> &SimPlatform {
        self
    }
}

/// What is the same in all runs.
#[derive(Clone, Copy)]
pub(super) struct Set<const L: usize> {
    pub(super) rates: [u32; L],
    pub(super) overrun: Overrun,
    table: Table<L>,
}

impl<const L: usize> Set<L> {
    pub(super) fn new(rates: [u32; L], overrun: Overrun) -> Self {
        let clock = ClockSpec::of::<u64>(Rate::hz(FREQUENCY));
        Self {
            rates,
            overrun,
            table: Table::new(&rates.map(Rate::hz), clock),
        }
    }
}

pub(super) struct World<P: Simulated, const L: usize> {
    processor: P,
    pub(super) scheduler: Scheduler<P, L, ENTRIES>,
    oracle: Mutex<Oracle<L>>,
}

impl<P: Simulated, const L: usize> World<P, L> {
    /// Runs `background` of a fresh world, with `body` in each loop, and the interrupts of `plan`.
    pub(super) fn run(
        set: &Set<L>,
        kind: Kind,
        plan: &Rc<Plan>,
        body: impl Fn(&Self, usize) + Sync,
        background: impl FnOnce(&Self),
    ) {
        let frequency = Rate::hz(FREQUENCY);
        let processor = P::new(frequency);
        let world = Rc::new(Self {
            scheduler: Scheduler::new(processor.clone(), set.table),
            processor,
            oracle: Mutex::new(Oracle::new(set.rates, set.overrun, P::VECTORS)),
        });
        let scheduler = &world.scheduler;
        let this = &*world;
        let mut bodies: [_; L] = std::array::from_fn(|number| {
            let body = &body;
            move |_| {
                this.with_oracle(|oracle| oracle.enter(number));
                body(this, number);
                this.point();
                this.with_oracle(|oracle| oracle.leave(number));
            }
        });
        let on_point = {
            let (world, plan) = (Rc::clone(&world), Rc::clone(plan));
            Rc::new(move || world.on_point(&plan, kind))
        };
        scheduler.scope(|scope| {
            for (number, body) in bodies.iter_mut().enumerate() {
                scope
                    .assign(LoopId(number as u8), set.overrun, body)
                    .expect("a loop that is free");
            }
            with_points(on_point, || {
                world.processor.processor().with_vectors(
                    |rank| scheduler.on_vector(rank),
                    || {
                        world
                            .processor
                            .processor()
                            .with_handler(|| scheduler.on_timer(), || background(&world));
                    },
                );
            });
        });
    }

    /// A point of a program's own.
    pub(super) fn point(&self) {
        point();
        self.with_oracle(|oracle| oracle.nothing_faster_waits());
    }

    /// The background goes on until all events before `end` are over.
    pub(super) fn wait_until(&self, end: u64) {
        self.point();
        while let Some(armed) = self.processor.processor().armed()
            && armed < end
        {
            self.processor.processor().skip_to(armed);
            self.processor.processor().interrupt();
            self.point();
        }
    }

    /// Lets time pass beyond the next events, none of which can come meanwhile.
    pub(super) fn outlast_events(&self, events: u32) {
        let processor = self.processor.processor();
        for _ in 0..events {
            if let Some(armed) = processor.armed().filter(|_| processor.now() < END) {
                let next = self.with_oracle(|oracle| oracle.next_event(armed));
                processor.skip_to(next);
            }
        }
    }

    /// Nothing is unfinished, and nothing was lost.
    pub(super) fn check_end(&self) {
        let now = self.processor.processor().now();
        self.with_oracle(|oracle| oracle.all_is_done(now));
    }

    /// Does what the counts will show.
    pub(super) fn ask(&self, asked: Asked) {
        self.with_oracle(|oracle| oracle.asked = asked);
        let scheduler = &self.scheduler;
        match asked {
            Asked::Nothing => {}
            Asked::Start => scheduler.start().expect("not started"),
            Asked::Stop => scheduler.stop(),
            Asked::Enable(number) => scheduler.enable(LoopId(number as u8)).expect("a loop"),
            Asked::Disable(number) => scheduler.disable(LoopId(number as u8)).expect("a loop"),
        }
        self.with_oracle(|oracle| oracle.asked = Asked::Nothing);
    }

    /// Increments what a lock of `users` holds, with a point before it is written.
    pub(super) fn increment(&self, lock: &LoopLock<u32>, users: &[usize], inside: impl FnOnce()) {
        let locked = lock.lock(&self.scheduler, |value| {
            self.with_oracle(|oracle| oracle.lock(users));
            let before = *value;
            self.point();
            inside();
            *value = before + 1;
            self.with_oracle(Oracle::unlock);
        });
        locked.expect("a user, and nobody else has it");
        self.point();
    }

    fn with_oracle<R>(&self, f: impl FnOnce(&mut Oracle<L>) -> R) -> R {
        self.look();
        f(&mut self.oracle.lock().expect("no check has failed"))
    }

    fn look(&self) {
        let snapshot = quietly(|| self.scheduler.look(Snapshot::of));
        let mut oracle = self.oracle.lock().expect("no check has failed");
        oracle.look(self.processor.processor().now(), &snapshot);
    }

    fn on_point(&self, plan: &Plan, kind: Kind) {
        self.look();
        if self.processor.processor().is_interruptible() {
            plan.point(|_| self.interrupt(kind));
        }
    }

    fn interrupt(&self, kind: Kind) {
        if let Some(armed) = self.processor.processor().armed() {
            match kind {
                Kind::OnTime => self.processor.processor().skip_to(armed),
                Kind::Late => {
                    let next = self.with_oracle(|oracle| oracle.next_event(armed));
                    self.processor.processor().skip_to(next);
                }
                Kind::WithoutCause => {}
            }
        }
        self.processor.processor().interrupt();
    }
}
