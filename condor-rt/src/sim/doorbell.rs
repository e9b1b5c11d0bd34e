//! [`Bell`]: the mailbox interrupt in virtual time.

use std::sync::Arc;

use condor_mbox::{Clock, Doorbell, Evidence, Instant, Processor};

use super::time::Core;

/// The doorbell of a processor in virtual time. All clones are the same doorbell.
#[derive(Clone)]
pub struct Bell(pub(super) Arc<Core>);

impl Clock for Bell {
    fn now(&self) -> Instant {
        self.0.spend_reading();
        Instant::from_ns(self.0.now())
    }
}

impl Doorbell for Bell {
    type Seen = u64;

    fn ring(&self, processor: Processor) {
        self.0.baton.ring(processor, self.0.now());
    }

    fn prepare(&self) -> u64 {
        self.0.baton.rings(self.0.number)
    }

    fn wait(&self, seen: u64, until: Instant, _: Option<Processor>) {
        self.0.wait(seen, until.as_ns());
    }

    fn evidence(&self, processor: Processor) -> Evidence {
        self.0.baton.evidence(processor)
    }
}
