//! [`ProcessBell`]: the doorbell of a process.

use core::hint;
use std::sync::Arc;

use condor_mbox::linux::LinuxDoorbell;
use condor_mbox::{Clock, Doorbell, Evidence, Instant, Processor};

use super::spinner::Spinner;
use crate::numbers::PROCESSORS;

/// The doorbell of a [`Process`](super::Process). If the loops of the process are
/// [spun](super::Loops::Spin), it polls their timer, too. All clones are the same doorbell.
#[derive(Clone, Debug)]
pub struct ProcessBell {
    pub(super) doorbell: LinuxDoorbell<PROCESSORS>,
    pub(super) spinner: Option<Arc<Spinner>>,
}

impl Clock for ProcessBell {
    #[inline]
    fn now(&self) -> Instant {
        let now = self.doorbell.now();
        if let Some(spinner) = &self.spinner {
            spinner.poll(now.as_ns());
        }
        now
    }
}

impl Doorbell for ProcessBell {
    type Seen = u32;

    fn ring(&self, processor: Processor) {
        self.doorbell.ring(processor);
    }

    fn prepare(&self) -> u32 {
        self.doorbell.prepare()
    }

    fn wait(&self, seen: u32, until: Instant, whom: Option<Processor>) {
        if self.spinner.is_none() {
            return self.doorbell.wait(seen, until, whom);
        }
        while self.doorbell.prepare() == seen && self.now() < until {
            hint::spin_loop();
        }
    }

    fn evidence(&self, processor: Processor) -> Evidence {
        self.doorbell.evidence(processor)
    }
}
