//! [`ProcessBell`]: the doorbell of a process.

use core::hint;
use std::sync::Arc;

use condor_mbox::linux::LinuxDoorbell;
use condor_mbox::{Clock, Doorbell, Evidence, Instant, Processor};

use super::clock::ProcessClock;
use super::spinner::Spinner;
use crate::numbers::PROCESSORS;
use crate::simulated::SimulatedBell;

/// The doorbell of a [`LinuxProcess`](super::LinuxProcess), with which it rings other processors and waits until they
/// ring it. If the loops of the process are [spun](super::LoopContext::Spin), each wait and each reading of the
/// doorbell's clock also runs the loops that are due. In a system with a simulated clock, its waits and its clock are
/// in simulated time. All clones are the same doorbell.
#[derive(Clone, Debug)]
pub struct ProcessBell {
    pub(super) doorbell: LinuxDoorbell<PROCESSORS>,
    pub(super) ringing: Ringing,
}

/// The way in which a process waits.
#[derive(Clone, Debug)]
pub(super) enum Ringing {
    Real,
    Spun(Arc<Spinner>),
    Simulated(SimulatedBell<ProcessClock>),
}

impl Clock for ProcessBell {
    #[inline]
    fn now(&self) -> Instant {
        if let Ringing::Simulated(bell) = &self.ringing {
            return bell.now();
        }
        let now = self.doorbell.now();
        if let Ringing::Spun(spinner) = &self.ringing {
            spinner.poll(now.as_ns());
        }
        now
    }
}

impl Doorbell for ProcessBell {
    type Seen = u32;

    fn ring(&self, processor: Processor) {
        if let Ringing::Simulated(bell) = &self.ringing {
            bell.ring(processor);
            if bell.0.page().is_processor(processor.0) {
                return;
            }
        }
        self.doorbell.ring(processor);
    }

    fn prepare(&self) -> u32 {
        match &self.ringing {
            Ringing::Simulated(bell) => bell.prepare(),
            Ringing::Real | Ringing::Spun(_) => self.doorbell.prepare(),
        }
    }

    fn wait(&self, seen: u32, until: Instant, whom: Option<Processor>) {
        match &self.ringing {
            Ringing::Real => self.doorbell.wait(seen, until, whom),
            Ringing::Simulated(bell) => bell.wait(seen, until, whom),
            Ringing::Spun(_) => {
                while self.doorbell.prepare() == seen && self.now() < until {
                    hint::spin_loop();
                }
            }
        }
    }

    fn rings_always(&self) -> bool {
        matches!(self.ringing, Ringing::Simulated(_))
    }

    fn ends_serving(&self, sender: Processor) -> bool {
        match &self.ringing {
            Ringing::Simulated(bell) => bell.ends_serving(sender),
            Ringing::Real | Ringing::Spun(_) => true,
        }
    }

    fn waits_for_listener(&self, listener: Processor) -> bool {
        match &self.ringing {
            Ringing::Simulated(bell) => bell.waits_for_listener(listener),
            Ringing::Real | Ringing::Spun(_) => true,
        }
    }

    fn evidence(&self, processor: Processor) -> Evidence {
        match &self.ringing {
            Ringing::Simulated(bell) if bell.evidence(processor) == Evidence::Alive => {
                Evidence::Alive
            }
            _ => self.doorbell.evidence(processor),
        }
    }
}
