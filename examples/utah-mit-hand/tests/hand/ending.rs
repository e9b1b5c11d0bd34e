//! [`Ending`]: a machine in virtual time whose program ends when a test wants it.

use std::sync::atomic::{AtomicU64, Ordering::Relaxed};
use std::time::Duration;

use condor_dev::InterruptEntry;
use condor_dev::linux::LinuxBus;
use condor_mbox::linux::LinuxWindow;
use condor_mbox::{AccessError, Processor, Region, Waiting, Windows};
use condor_mos::{Loops, Rate};
use condor_rt::sim::{Bell, SimCriticalSection, SimMachine as Simulated};
use condor_rt::{Machine, PROCESSORS, ProgramError, ServoLoop};

/// A machine whose program can be ended.
pub(crate) struct Ending<'m> {
    pub(crate) machine: &'m Simulated<LinuxBus>,
    /// The instant at which it is to end, ns.
    pub(crate) end: &'m AtomicU64,
}

impl Machine for Ending<'_> {
    type Window = LinuxWindow;
    type Doorbell = Bell;
    type Exclusion = SimCriticalSection;
    type Bus = LinuxBus;
    type TestAndSet = <Simulated<LinuxBus> as Machine>::TestAndSet;
    type Controller = <Simulated<LinuxBus> as Machine>::Controller;

    fn number(&self) -> Processor {
        self.machine.number()
    }

    fn windows(&self) -> [Windows<LinuxWindow>; PROCESSORS] {
        self.machine.windows()
    }

    fn doorbell(&self) -> Bell {
        self.machine.doorbell()
    }

    fn test_and_set(
        &self,
        memory: Region<LinuxWindow>,
        offset: u32,
    ) -> Result<Self::TestAndSet, AccessError> {
        self.machine.test_and_set(memory, offset)
    }

    fn exclusion(&self) -> SimCriticalSection {
        self.machine.exclusion()
    }

    fn timer_frequency(&self) -> Rate {
        self.machine.timer_frequency()
    }

    fn with_loops<R>(
        &self,
        loops: &mut [ServoLoop<'_>],
        ahead: Duration,
        background: impl FnOnce(&dyn Loops<Instant = u64>) -> R,
    ) -> Result<R, ProgramError> {
        self.machine.with_loops(loops, ahead, background)
    }

    fn bus(&self) -> LinuxBus {
        self.machine.bus()
    }

    fn interrupt_controller(&self) -> Self::Controller {
        self.machine.interrupt_controller()
    }

    fn with_interrupts<R>(
        &self,
        entry: &dyn InterruptEntry,
        background: impl FnOnce() -> R,
    ) -> Result<R, ProgramError> {
        self.machine.with_interrupts(entry, background)
    }

    fn waiting(&self) -> Waiting {
        self.machine.waiting()
    }

    fn argument(&self, index: usize) -> Option<&str> {
        self.machine.argument(index)
    }

    fn is_stopping(&self) -> bool {
        self.machine.is_stopping() || self.machine.now() >= self.end.load(Relaxed)
    }
}
