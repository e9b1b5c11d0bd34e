//! [`Processor`]: one of several processors in virtual time, with its doorbell, timer and sections.

use std::sync::Arc;

use condor_dev::Bus;
use condor_mbox::linux::LinuxWindow;
use condor_mbox::{self as mbox, Clock, Doorbell, Evidence, Exclusion, Instant, Region, Windows};
use condor_mos::{Armed, ConnectError, Loops, Platform, Rate, Timer};

use super::time::Core;
use crate::error::Error;
use crate::machine::Machine;
use crate::numbers::PROCESSORS;
use crate::servo::{ServoLoop, on_one_stack};

/// One processor of a [`System`](super::System) in virtual time: the [`Machine`] of its program.
///
/// `B` is the type of the bus.
pub struct Processor<B> {
    core: Arc<Core>,
    windows: [Windows<LinuxWindow>; PROCESSORS],
    shared_memory: Option<Region<LinuxWindow>>,
    bus: B,
    arguments: Vec<String>,
}

impl<B> Processor<B> {
    pub(super) fn new(
        core: Core,
        windows: [Windows<LinuxWindow>; PROCESSORS],
        shared_memory: Option<Region<LinuxWindow>>,
        bus: B,
        arguments: Vec<String>,
    ) -> Self {
        Self {
            core: Arc::new(core),
            windows,
            shared_memory,
            bus,
            arguments,
        }
    }

    /// Returns the processor's time, in nanoseconds. This reading takes no time.
    #[must_use]
    pub fn now(&self) -> u64 {
        self.core.now()
    }

    /// Lets `ns` nanoseconds pass, as if the background computed; other processors run meanwhile.
    pub fn work(&self, ns: u64) {
        self.core.pass(ns, 0);
    }

    /// Returns the timer, which is also the [`Platform`](condor_mos::Platform) of a scheduler.
    #[must_use]
    pub fn platform(&self) -> VirtualTimer {
        VirtualTimer(self.core.clone())
    }

    pub(super) fn core(&self) -> &Core {
        &self.core
    }
}

impl<B: Bus + Clone + Sync> Machine for Processor<B> {
    type Window = LinuxWindow;
    type Doorbell = Bell;
    type Exclusion = Uninterrupted;
    type Bus = B;

    fn number(&self) -> mbox::Processor {
        self.core.number
    }

    fn windows(&self) -> [Windows<LinuxWindow>; PROCESSORS] {
        self.windows.clone()
    }

    fn doorbell(&self) -> Bell {
        Bell(self.core.clone())
    }

    fn exclusion(&self) -> Uninterrupted {
        Uninterrupted(self.core.clone())
    }

    fn shared_memory(&self) -> Option<Region<LinuxWindow>> {
        self.shared_memory.clone()
    }

    fn bus(&self) -> B {
        self.bus.clone()
    }

    fn waiting(&self) -> mbox::Waiting {
        mbox::Waiting::Sleep
    }

    fn argument(&self, index: usize) -> Option<&str> {
        self.arguments.get(index).map(String::as_str)
    }

    fn is_stopping(&self) -> bool {
        self.core.is_stopping()
    }

    fn timer_frequency(&self) -> Rate {
        self.platform().frequency()
    }

    fn with_loops<R>(
        &self,
        loops: &mut [ServoLoop<'_>],
        background: impl FnOnce(&dyn Loops<Instant = u64>) -> R,
    ) -> Result<R, Error> {
        on_one_stack(self.platform(), loops, background)
    }
}

/// The doorbell of a processor in virtual time. All clones are the same doorbell.
#[derive(Clone)]
pub struct Bell(Arc<Core>);

impl Clock for Bell {
    fn now(&self) -> Instant {
        self.0.spend_reading();
        Instant::from_ns(self.0.now())
    }
}

impl Doorbell for Bell {
    type Seen = u64;

    fn ring(&self, processor: mbox::Processor) {
        self.0.baton.ring(processor, self.0.now());
    }

    fn prepare(&self) -> u64 {
        self.0.baton.rings(self.0.number)
    }

    fn wait(&self, seen: u64, until: Instant, _: Option<mbox::Processor>) {
        self.0.wait(seen, until.as_ns());
    }

    fn evidence(&self, processor: mbox::Processor) -> Evidence {
        self.0.baton.evidence(processor)
    }
}

/// Critical sections in which no time passes, so that nothing interrupts them. All clones are the
/// same.
#[derive(Clone)]
pub struct Uninterrupted(Arc<Core>);

impl Exclusion for Uninterrupted {
    fn with<R>(&self, body: impl FnOnce() -> R) -> R {
        self.0.standing_still(body)
    }
}

/// The timer of a processor in virtual time, in nanoseconds. All clones are the same timer.
#[derive(Clone)]
pub struct VirtualTimer(Arc<Core>);

impl Timer for VirtualTimer {
    type Instant = u64;

    fn frequency(&self) -> Rate {
        self.0.timer.frequency()
    }

    fn now(&self) -> u64 {
        self.0.spend_reading_timer();
        self.0.now()
    }

    fn arm(&self, at: u64) -> Armed {
        self.0.arm(at)
    }

    fn disarm(&self) {
        self.0.disarm();
    }
}

impl Platform for VirtualTimer {
    fn connect<R>(
        &self,
        handler: impl Fn() + Sync,
        program: impl FnOnce() -> R,
    ) -> Result<R, ConnectError> {
        self.0.with_handler(handler, program)
    }

    fn interruptible(&self, rank: u32, body: impl FnOnce()) {
        self.0.run_loop(rank, body);
    }
}
