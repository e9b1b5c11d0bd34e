//! [`SimMachine`]: one of several processors in virtual time, with its doorbell, timer and sections.

use core::time::Duration;
use std::sync::Arc;
use std::sync::atomic::AtomicU32;

use condor_clock::linux::Futex;
use condor_clock::{ClockFault, Handover, LocalClock, Page};
use condor_dev::{Bus, InterruptEntry};
use condor_mbox::linux::LinuxWindow;
use condor_mbox::spin_lock::Bakery;
use condor_mbox::{self as mbox, AccessError, Region, Windows};
use condor_mos::{Loops, Rate, Timer as _};

use super::error::Cause;
use crate::error::ProgramError;
use crate::lines::{BoardLines, LineState};
use crate::machine::Machine;
use crate::numbers::PROCESSORS;
use crate::servo::{ServoLoop, on_one_stack};
use crate::simulated;

/// The clock of a processor.
type Clock = Arc<LocalClock<Arc<Page>, TurnHandover>>;
/// The doorbell of a processor in virtual time. All clones are the same doorbell.
pub type Bell = simulated::SimulatedBell<Clock>;
/// The critical sections of a processor in virtual time: no time passes in them, so nothing
/// interrupts them.
pub type SimCriticalSection = simulated::SimulatedSection<Clock>;
/// The timer that releases the loops of a processor in virtual time. It counts nanoseconds since
/// the beginning of the run.
pub type VirtualTimer = simulated::SimulatedTimer<Clock>;

/// The [`Handover`] between the processors of a [`VirtualSystem`](super::VirtualSystem), each of
/// which is a thread: it wakes the thread that gets the turn, the right to run.
#[derive(Debug)]
pub struct TurnHandover(Futex);

/// One processor of a [`VirtualSystem`](super::VirtualSystem) in virtual time: the [`Machine`] of its program.
///
/// `B` is the type of the bus.
pub struct SimMachine<B> {
    clock: Clock,
    windows: [Windows<LinuxWindow>; PROCESSORS],
    shared_memory: Option<Region<LinuxWindow>>,
    bus: B,
    lines: Arc<LineState>,
    arguments: Vec<String>,
}

impl TurnHandover {
    pub(super) fn new() -> Self {
        Self(Futex::new())
    }
}

impl Handover for TurnHandover {
    fn sleep(&self, word: &AtomicU32, seen: u32, most_ns: u64) {
        self.0.sleep(word, seen, most_ns);
    }

    fn wake(&self, number: u8, word: &AtomicU32) {
        self.0.wake(number, word);
    }

    fn is_closed(&self) -> bool {
        true
    }

    fn is_own_context(&self) -> bool {
        self.0.is_own_context()
    }

    fn fault(&self, fault: ClockFault) {
        Cause::from(fault).unwind();
    }
}

impl<B> SimMachine<B> {
    pub(super) fn new(
        clock: LocalClock<Arc<Page>, TurnHandover>,
        windows: [Windows<LinuxWindow>; PROCESSORS],
        shared_memory: Option<Region<LinuxWindow>>,
        bus: B,
        arguments: Vec<String>,
    ) -> Self {
        Self {
            clock: Arc::new(clock),
            windows,
            shared_memory,
            bus,
            lines: Arc::default(),
            arguments,
        }
    }

    /// Returns the present virtual time, in nanoseconds since the beginning of the run. This
    /// reading takes no virtual time.
    #[must_use]
    pub fn now(&self) -> u64 {
        self.clock.now()
    }

    /// Lets `ns` nanoseconds of virtual time pass, as if the background computed for so long; other
    /// processors run meanwhile.
    pub fn work(&self, ns: u64) {
        self.clock.pass(ns);
    }

    /// Returns the timer of the processor. It is a [`Platform`](condor_mos::Platform), on which a
    /// scheduler of loops can be made.
    #[must_use]
    pub fn platform(&self) -> VirtualTimer {
        simulated::SimulatedTimer(self.clock.clone())
    }

    pub(super) fn clock(&self) -> &LocalClock<Arc<Page>, TurnHandover> {
        &self.clock
    }
}

impl<B: Bus + Clone + Send + Sync> Machine for SimMachine<B> {
    type Window = LinuxWindow;
    type Doorbell = Bell;
    type Exclusion = SimCriticalSection;
    type Bus = B;
    /// The lock of processors without compare-and-swap, so that programs are tested with it, too.
    type TestAndSet = Bakery<Region<LinuxWindow>, SimCriticalSection>;
    type Controller = BoardLines<LinuxWindow, Bell, Arc<LineState>>;

    fn number(&self) -> mbox::Processor {
        mbox::Processor(self.clock.number())
    }

    fn windows(&self) -> [Windows<LinuxWindow>; PROCESSORS] {
        self.windows.clone()
    }

    fn doorbell(&self) -> Bell {
        simulated::SimulatedBell(self.clock.clone())
    }

    fn exclusion(&self) -> SimCriticalSection {
        simulated::SimulatedSection(self.clock.clone())
    }

    fn shared_memory(&self) -> Option<Region<LinuxWindow>> {
        self.shared_memory.clone()
    }

    fn test_and_set(
        &self,
        memory: Region<LinuxWindow>,
        offset: u32,
    ) -> Result<Self::TestAndSet, AccessError> {
        Bakery::new(memory, offset, PROCESSORS as u8, self.exclusion())
    }

    fn bus(&self) -> B {
        self.bus.clone()
    }

    fn interrupt_controller(&self) -> Self::Controller {
        let data = self.windows[self.number().index()].data.clone();
        BoardLines::new(self.number(), data, self.doorbell(), self.lines.clone())
    }

    fn with_interrupts<R>(
        &self,
        entry: &dyn InterruptEntry,
        background: impl FnOnce() -> R,
    ) -> Result<R, ProgramError> {
        let lines = self.interrupt_controller();
        simulated::with_interrupts(&self.clock, &lines, entry, background)
    }

    fn waiting(&self) -> mbox::Waiting {
        mbox::Waiting::Sleep
    }

    fn argument(&self, index: usize) -> Option<&str> {
        self.arguments.get(index).map(String::as_str)
    }

    fn is_stopping(&self) -> bool {
        self.clock.is_stopping()
    }

    fn timer_frequency(&self) -> Rate {
        self.platform().frequency()
    }

    fn with_loops<R>(
        &self,
        loops: &mut [ServoLoop<'_>],
        ahead: Duration,
        background: impl FnOnce(&dyn Loops<Instant = u64>) -> R,
    ) -> Result<R, ProgramError> {
        on_one_stack(self.platform(), loops, ahead, background)
    }
}
