//! [`ProcessTimer`]: the timer of a process.

use std::sync::Arc;

use condor_mbox::Clock as _;
use condor_mbox::linux::LinuxDoorbell;
use condor_mos::linux::Signals;
use condor_mos::{Armed, ConnectError, Platform, Rate, Timer};

use super::spinner::Spinner;
use crate::numbers::PROCESSORS;

/// The timer of a [`Process`](super::Process): `CLOCK_MONOTONIC` in nanoseconds, with signals or with
/// polls for interrupts.
pub struct ProcessTimer(pub(super) Kind);

pub(super) enum Kind {
    Signals(Signals),
    Spin {
        spinner: Arc<Spinner>,
        clock: LinuxDoorbell<PROCESSORS>,
    },
}

impl Timer for ProcessTimer {
    type Instant = u64;

    fn frequency(&self) -> Rate {
        Rate::hz(1_000_000_000)
    }

    #[inline]
    fn now(&self) -> u64 {
        match &self.0 {
            Kind::Signals(signals) => signals.now(),
            Kind::Spin { clock, .. } => clock.now().as_ns(),
        }
    }

    #[inline]
    fn arm(&self, at: u64) -> Armed {
        match &self.0 {
            Kind::Signals(signals) => signals.arm(at),
            Kind::Spin { spinner, .. } => {
                spinner.arm(at);
                if at > self.now() {
                    Armed::Ahead
                } else {
                    Armed::Past
                }
            }
        }
    }

    fn disarm(&self) {
        match &self.0 {
            Kind::Signals(signals) => signals.disarm(),
            Kind::Spin { spinner, .. } => spinner.disarm(),
        }
    }
}

impl Platform for ProcessTimer {
    fn is_loops_stack(&self) -> bool {
        match &self.0 {
            Kind::Signals(signals) => signals.is_loops_stack(),
            Kind::Spin { spinner, .. } => spinner.is_loops_stack(),
        }
    }

    fn connect<R>(
        &self,
        handler: impl Fn() + Sync,
        program: impl FnOnce() -> R,
    ) -> Result<R, ConnectError> {
        match &self.0 {
            Kind::Signals(signals) => signals.connect(handler, program),
            Kind::Spin { spinner, .. } => spinner.with_handler(handler, program),
        }
    }

    #[inline]
    fn interruptible(&self, rank: u32, body: impl FnOnce()) {
        match &self.0 {
            Kind::Signals(signals) => signals.interruptible(rank, body),
            // Polls of a loop's body find the handler closed.
            Kind::Spin { .. } => body(),
        }
    }
}
