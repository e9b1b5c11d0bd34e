//! Every timer of this crate keeps the promises of `Timer`.

use std::cell::Cell;
use std::sync::atomic::{AtomicU32, Ordering};

use condor_mos::conformance::TimerFailure;
use condor_mos::sim::{SimPlatform, WrappingProcessor};
use condor_mos::{Armed, Rate, Timer, conformance};

/// Connects `timer`, which counts the ticks of `processor`.
fn verdict<T: Timer>(processor: &SimPlatform, timer: &T) -> Result<(), TimerFailure> {
    let interrupts = AtomicU32::new(0);
    let count = || {
        interrupts.fetch_add(1, Ordering::Relaxed);
    };
    processor.with_handler(count, || {
        let step = || processor.work(1);
        conformance::timer(timer, || interrupts.load(Ordering::Relaxed), step)
    })
}

#[test]
fn simulated_timer_of_64_bits() {
    for frequency in [Rate::hz(1_000_000), Rate::hz(32_768), Rate::hz(10)] {
        let processor = SimPlatform::new(frequency);
        assert_eq!(verdict(&processor, &processor), Ok(()));
    }
}

#[test]
fn simulated_timers_that_begin_anew() {
    let processor = SimPlatform::new(Rate::hz(1_000_000));
    let timer = WrappingProcessor::<32>(processor.clone());
    assert_eq!(verdict(&processor, &timer), Ok(()));
    let timer = WrappingProcessor::<24>(processor.clone());
    assert_eq!(verdict(&processor, &timer), Ok(()));
    let timer = WrappingProcessor::<16>(processor.clone());
    assert_eq!(verdict(&processor, &timer), Ok(()));
    let timer = WrappingProcessor::<8>(processor.clone());
    assert_eq!(verdict(&processor, &timer), Ok(()));
    assert!(Timer::now(&processor) > 1 << 17, "16 bits began anew twice");
}

#[test]
fn simulated_timers_whose_accesses_take_time() {
    for ticks in [1, 2, 7] {
        let processor = SimPlatform::new(Rate::hz(1_000_000));
        processor.set_access_time(ticks);
        assert_eq!(verdict(&processor, &processor), Ok(()));
        let timer = WrappingProcessor::<16>(processor.clone());
        assert_eq!(verdict(&processor, &timer), Ok(()));
    }
}

#[cfg(all(feature = "linux", target_os = "linux"))]
#[test]
fn timer_of_signals() {
    use condor_mos::{Platform as _, linux::SignalPlatform};

    // SAFETY: the handler is one atomic addition.
    let signals = unsafe { SignalPlatform::new() };
    let interrupts = AtomicU32::new(0);
    let count = || {
        interrupts.fetch_add(1, Ordering::Relaxed);
    };
    let program = || {
        conformance::timer(
            &signals,
            || interrupts.load(Ordering::Relaxed),
            std::thread::yield_now,
        )
    };
    assert_eq!(signals.connect(count, program), Ok(Ok(())));
}

/// A timer that breaks one promise.
struct Faulty<'p> {
    processor: &'p SimPlatform,
    fault: Fault,
    armed: Cell<bool>,
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Fault {
    GoesBack,
    InterruptsEarly,
    NeverInterrupts,
    TakesAheadForPast,
    TakesPastForAhead,
    KeepsTheFirst,
    StaysArmed,
}

impl Timer for Faulty<'_> {
    type Instant = u64;

    fn frequency(&self) -> Rate {
        self.processor.frequency()
    }

    fn now(&self) -> u64 {
        let now = Timer::now(self.processor);
        if self.fault == Fault::GoesBack && self.armed.replace(true) {
            return now.saturating_sub(1);
        }
        now
    }

    fn arm(&self, at: u64) -> Armed {
        let replaces = self.armed.replace(true);
        match self.fault {
            // More than the step in which the suite looks.
            Fault::InterruptsEarly => self.processor.arm(at - 3),
            Fault::NeverInterrupts => Armed::Ahead,
            Fault::TakesAheadForPast => Armed::Past,
            Fault::TakesPastForAhead => {
                let _ = self.processor.arm(at);
                Armed::Ahead
            }
            Fault::KeepsTheFirst if replaces => Armed::Ahead,
            _ => self.processor.arm(at),
        }
    }

    fn disarm(&self) {
        self.armed.set(false);
        if self.fault != Fault::StaysArmed {
            self.processor.disarm();
        }
    }
}

#[test]
fn each_fault_is_found() {
    for (fault, found) in [
        (Fault::GoesBack, "went back"),
        (Fault::InterruptsEarly, "when its interrupt came"),
        (Fault::NeverInterrupts, "at the instant that was armed"),
        (Fault::TakesAheadForPast, "was reported as past"),
        (Fault::TakesPastForAhead, "that a passed instant has passed"),
        (Fault::KeepsTheFirst, "until the later instant"),
        (Fault::StaysArmed, "after disarming"),
    ] {
        let processor = SimPlatform::new(Rate::hz(1_000));
        // Past its beginning, so that it can go back.
        processor.run_until(10);
        let armed = Cell::new(false);
        let timer = Faulty {
            processor: &processor,
            fault,
            armed,
        };
        let error = verdict(&processor, &timer).expect_err("a fault");
        assert!(error.check.contains(found), "{fault:?}: {error}");
    }
}
