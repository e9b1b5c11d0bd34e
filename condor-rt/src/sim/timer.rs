//! [`VirtualTimer`]: interrupts in virtual time.

use std::sync::Arc;

use condor_mos::{Armed, ConnectError, Platform, Rate, Timer};

use super::time::Core;

/// The timer of a processor in virtual time, in nanoseconds. All clones are the same timer.
#[derive(Clone)]
pub struct VirtualTimer(pub(super) Arc<Core>);

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
