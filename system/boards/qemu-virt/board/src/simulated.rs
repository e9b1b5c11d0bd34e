//! [`SimulatedHart`]: a hart in the simulated time of its system.
//!
//! It takes part by the page of the clock in the machine's memory. It sleeps until its own software
//! interrupt, wakes harts by theirs, and wakes processes of the host by the serial line: at its other end
//! a byte wakes whoever has that number.

use core::sync::atomic::{AtomicU32, Ordering};
use core::time::Duration;

use condor_clock::{Handover, LOOPS, LocalClock, Page};
use condor_dev::{InterruptEntry, Mmio};
use condor_mbox::{
    AccessError, Clock, Doorbell, Evidence, Instant, Processor, Region, StaticWindow, Waiting,
    Windows,
};
use condor_mos::{Loops, Rate, Timer as _};
use condor_rt::numbers::SUPERVISOR;
use condor_rt::simulated::{self, SimulatedBell, SimulatedSection, SimulatedTimer};
use condor_rt::{Machine, PROCESSORS, Program, ProgramError, ServoLoop, on_one_stack};

use crate::bell::HartBell;
use crate::boards::{self, HartLines};
use crate::hart::Hart;
use crate::program::status;

type HartClock = LocalClock<&'static Page, Rings>;

/// Runs a program whose loops take these times, in nanoseconds. If it fails, it keeps the turn, so that
/// time stands until the host has decided what follows.
#[inline(never)]
pub(crate) fn run(program: &impl Program, hart: &Hart, work: [u64; LOOPS]) -> u32 {
    let page = hart.clock_page();
    if let Err(error) = page.check() {
        return status(&Err(ProgramError::program(&error)), hart);
    }
    let number = hart.number().0;
    let clock = LocalClock::new(number, page, Rings(hart.doorbell()), work);
    page.set_far(number, true);
    clock.announce(0);
    // Nobody goes on before it has seen that all are there.
    hart.doorbell().ring(SUPERVISOR);
    clock.begin();
    let outcome = program.run(&SimulatedHart {
        hart,
        clock: &clock,
    });
    let status = status(&outcome, hart);
    if outcome.is_ok() {
        clock.leave();
    }
    status
}

/// The hart that runs a program in simulated time.
struct SimulatedHart<'h> {
    hart: &'h Hart,
    clock: &'h HartClock,
}

/// Hands the turn over by rings.
#[derive(Debug)]
struct Rings(HartBell);

impl Handover for Rings {
    fn sleep(&self, word: &AtomicU32, seen: u32, most_ns: u64) {
        let rings = self.0.prepare();
        // Acquire: pairs with the Release additions to `grants` and `rings` of the page. Whoever adds
        // after this rings later than `prepare`, so that the wait ends.
        if word.load(Ordering::Acquire) == seen {
            let until = self.0.now().after(Duration::from_nanos(most_ns));
            self.0.wait(rings, until, None);
        }
    }

    fn wake(&self, number: u8, _: &AtomicU32) {
        self.0.ring(Processor(number));
    }
}

/// The doorbell of a hart in simulated time. All clones are the same doorbell.
#[derive(Clone, Debug)]
struct Bell<'h>(SimulatedBell<&'h HartClock>);

impl Clock for Bell<'_> {
    fn now(&self) -> Instant {
        self.0.now()
    }
}

impl Doorbell for Bell<'_> {
    type Seen = u32;

    fn ring(&self, processor: Processor) {
        self.0.ring(processor);
        let Bell(SimulatedBell(clock)) = self;
        // A processor goes on when it has the turn.
        if !clock.page().is_processor(processor.0) {
            clock.handover().0.ring(processor);
        }
    }

    fn prepare(&self) -> u32 {
        self.0.prepare()
    }

    fn wait(&self, seen: u32, until: Instant, whom: Option<Processor>) {
        self.0.wait(seen, until, whom);
    }

    fn rings_always(&self) -> bool {
        self.0.rings_always()
    }

    fn ends_serving(&self, sender: Processor) -> bool {
        self.0.ends_serving(sender)
    }

    fn waits_for_listener(&self, listener: Processor) -> bool {
        self.0.waits_for_listener(listener)
    }

    fn evidence(&self, processor: Processor) -> Evidence {
        let Bell(SimulatedBell(clock)) = self;
        if clock.page().takes_part(processor.0) {
            Evidence::Alive
        } else {
            Evidence::Dead
        }
    }
}

impl<'h> Machine for SimulatedHart<'h> {
    type Window = StaticWindow<'static>;
    type Doorbell = Bell<'h>;
    type Exclusion = SimulatedSection<&'h HartClock>;
    type Bus = Mmio;
    type TestAndSet = <Hart as Machine>::TestAndSet;
    type Controller = HartLines<Bell<'h>>;

    fn number(&self) -> Processor {
        self.hart.number()
    }

    fn windows(&self) -> [Windows<StaticWindow<'static>>; PROCESSORS] {
        self.hart.windows()
    }

    fn doorbell(&self) -> Bell<'h> {
        Bell(SimulatedBell(self.clock))
    }

    fn exclusion(&self) -> SimulatedSection<&'h HartClock> {
        SimulatedSection(self.clock)
    }

    fn shared_memory(&self) -> Option<Region<StaticWindow<'static>>> {
        self.hart.shared_memory()
    }

    fn test_and_set(
        &self,
        memory: Region<StaticWindow<'static>>,
        offset: u32,
    ) -> Result<Self::TestAndSet, AccessError> {
        self.hart.test_and_set(memory, offset)
    }

    /// Devices have no simulated time: neither does the serial port answer, nor does the PLIC interrupt.
    fn bus(&self) -> Mmio {
        let (memory, _) = self.hart.bus();
        memory
    }

    fn waiting(&self) -> Waiting {
        Waiting::Sleep
    }

    fn argument(&self, index: usize) -> Option<&str> {
        self.hart.argument(index)
    }

    fn is_stopping(&self) -> bool {
        self.hart.is_stopping() || self.clock.is_stopping()
    }

    fn is_float_exception_fatal(&self) -> bool {
        self.hart.is_float_exception_fatal()
    }

    fn fail(&self, error: &ProgramError) {
        self.hart.fail(error);
    }

    fn interrupt_controller(&self) -> HartLines<Bell<'h>> {
        let number = self.number();
        let data = self.hart.own_data();
        boards::lines(number, data, self.doorbell())
    }

    fn with_interrupts<R>(
        &self,
        entry: &dyn InterruptEntry,
        background: impl FnOnce() -> R,
    ) -> Result<R, ProgramError> {
        simulated::with_interrupts(self.clock, &self.interrupt_controller(), entry, background)
    }

    fn unhandled_causes(&self) -> u32 {
        self.hart.unhandled_causes()
    }

    fn timer_frequency(&self) -> Rate {
        SimulatedTimer(self.clock).frequency()
    }

    fn with_loops<R>(
        &self,
        loops: &mut [ServoLoop<'_>],
        ahead: Duration,
        background: impl FnOnce(&dyn Loops<Instant = u64>) -> R,
    ) -> Result<R, ProgramError> {
        on_one_stack(SimulatedTimer(self.clock), loops, ahead, background)
    }
}
