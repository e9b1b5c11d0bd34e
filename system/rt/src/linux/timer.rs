//! [`ProcessTimer`]: the timer of a process.

use std::sync::Arc;

use condor_mbox::Clock as _;
use condor_mbox::linux::LinuxDoorbell;
use condor_mos::linux::SignalPlatform;
use condor_mos::{Armed, ConnectError, Platform, Rate, Timer};

use super::spinner::Spinner;
use crate::numbers::PROCESSORS;

pub(super) const NANOSECONDS: Rate = Rate::hz(1_000_000_000);

/// The timer of a [`LinuxProcess`](super::LinuxProcess) whose loops run on the stack of the background:
/// `CLOCK_MONOTONIC` in nanoseconds, with signals or with polls for interrupts.
pub(super) enum ProcessTimer {
    Signals(SignalPlatform),
    Spin {
        spinner: Arc<Spinner>,
        clock: LinuxDoorbell<PROCESSORS>,
    },
}

impl Timer for ProcessTimer {
    type Instant = u64;

    fn frequency(&self) -> Rate {
        NANOSECONDS
    }

    #[inline]
    fn now(&self) -> u64 {
        match self {
            Self::Signals(signals) => signals.now(),
            Self::Spin { clock, .. } => clock.now().as_ns(),
        }
    }

    #[inline]
    fn arm(&self, at: u64) -> Armed {
        match self {
            Self::Signals(signals) => signals.arm(at),
            Self::Spin { spinner, .. } => {
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
        match self {
            Self::Signals(signals) => signals.disarm(),
            Self::Spin { spinner, .. } => spinner.disarm(),
        }
    }
}

impl Platform for ProcessTimer {
    fn is_loops_stack(&self) -> bool {
        match self {
            Self::Signals(signals) => signals.is_loops_stack(),
            Self::Spin { spinner, .. } => spinner.is_loops_stack(),
        }
    }

    fn connect<R>(
        &self,
        handler: impl Fn() + Sync,
        program: impl FnOnce() -> R,
    ) -> Result<R, ConnectError> {
        match self {
            Self::Signals(signals) => signals.connect(handler, program),
            Self::Spin { spinner, .. } => spinner.with_handler(handler, program),
        }
    }

    #[inline]
    fn interruptible(&self, rank: u32, body: impl FnOnce()) {
        match self {
            Self::Signals(signals) => signals.interruptible(rank, body),
            // Polls of a loop's body find the handler closed.
            Self::Spin { .. } => body(),
        }
    }
}

#[cfg(test)]
mod tests {
    use core::sync::atomic::{AtomicU32, Ordering};

    use condor_mbox::linux::LinuxSystem;
    use condor_mbox::{Doorbell as _, Instant, Processor};

    use super::*;
    use crate::linux::ProcessBell;
    use crate::linux::bell::Ringing;

    fn with_timer(test: impl FnOnce(&ProcessTimer, &ProcessBell)) {
        let directory = tempfile::tempdir().unwrap();
        let system = LinuxSystem::<PROCESSORS>::at(directory.path().join("mailbox"), 4096).unwrap();
        let doorbell = system.claim(Processor(3)).unwrap().doorbell().clone();
        let spinner = Arc::new(Spinner::new());
        let timer = ProcessTimer::Spin {
            spinner: spinner.clone(),
            clock: doorbell.clone(),
        };
        let ringing = Ringing::Spun(spinner);
        test(&timer, &ProcessBell { doorbell, ringing });
    }

    #[test]
    fn the_timer() {
        with_timer(|timer, bell| {
            let interrupts = AtomicU32::new(0);
            let count = || {
                interrupts.fetch_add(1, Ordering::Relaxed);
            };
            let verdict = timer.connect(count, || {
                condor_mos::conformance::timer(
                    timer,
                    || interrupts.load(Ordering::Relaxed),
                    || {
                        bell.now();
                    },
                )
            });
            assert_eq!(verdict.unwrap(), Ok(()));
        });
    }

    #[test]
    fn a_wait_calls_the_handler_and_goes_on() {
        with_timer(|timer, bell| {
            let interrupts = AtomicU32::new(0);
            let handler = || {
                let count = interrupts.fetch_add(1, Ordering::Relaxed);
                // A poll in the handler is none.
                bell.now();
                if count < 4 {
                    let _ = timer.arm(timer.now() + 1_000_000);
                }
            };
            let begun = timer.now();
            assert_eq!(timer.arm(begun), Armed::Past);
            let background =
                || bell.wait(bell.prepare(), Instant::from_ns(begun + 50_000_000), None);
            timer.connect(handler, background).unwrap();
            assert_eq!(interrupts.load(Ordering::Relaxed), 5);
            assert!(timer.now() >= begun + 50_000_000);
            // What was connected is gone.
            assert_eq!(timer.arm(begun), Armed::Past);
            bell.now();
            assert_eq!(interrupts.load(Ordering::Relaxed), 5);
        });
    }

    #[test]
    fn one_scheduler_at_a_time() {
        with_timer(|timer, _| {
            let inner = || timer.connect(|| (), || ());
            let outer = timer.connect(|| (), inner);
            assert_eq!(outer, Ok(Err(ConnectError::Connected)));
            assert_eq!(timer.connect(|| (), || ()), Ok(()));
        });
    }
}
