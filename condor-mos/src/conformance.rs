//! What every [`Timer`] must do, for the author of one to call from a test.
//!
//! A timer of one's own is connected by two closures: how many interrupts have come so far, and how
//! to let a little time pass in which they can come.
//!
//! ```
//! use condor_mos::conformance::timer_conforms;
//! use condor_mos::sim::Processor;
//! use condor_mos::{Rate, Timer};
//! use std::sync::atomic::{AtomicU32, Ordering};
//!
//! let processor = Processor::new(Rate::hz(1_000_000));
//! let interrupts = AtomicU32::new(0);
//! processor.with_handler(
//!     || {
//!         interrupts.fetch_add(1, Ordering::Relaxed);
//!     },
//!     || {
//!         timer_conforms(
//!             &processor,
//!             || interrupts.load(Ordering::Relaxed),
//!             || processor.run_until(processor.now() + 1),
//!         );
//!     },
//! );
//! ```
//!
//! The suite takes some hundred milliseconds of the timer's time, or three rounds of a counter that
//! begins anew within a few seconds. It does not assume that the program is undisturbed: an attempt
//! that came too late to tell is made again.

use crate::instant::Instant;
use crate::rate::Rate;
use crate::timer::{Armed, Timer};

/// How often an attempt that was disturbed is made again.
const ATTEMPTS: u32 = 100;

/// Asserts all that a [`Timer`] promises.
///
/// `interrupts` counts the timer's interrupts since any moment; `pass` lets some time pass, less
/// than a thousandth of a second if it can, with interrupts enabled.
///
/// # Panics
/// If the timer breaks a promise; the message says which.
pub fn timer_conforms<T: Timer>(timer: &T, interrupts: impl Fn() -> u32, pass: impl FnMut()) {
    let mut suite = Suite {
        timer,
        interrupts,
        pass,
        short: short_span(timer),
    };
    suite.is_monotonic();
    suite.interrupts_once();
    suite.interrupts_across_the_end_of_the_counter();
    suite.reports_the_past();
    suite.replaces_by_later();
    suite.replaces_by_earlier();
    suite.disarms();
}

/// Some milliseconds, or a small part of the counter's range.
fn short_span<T: Timer>(timer: &T) -> u32 {
    let bits = <T::Instant as Instant>::BITS.min(32);
    let range = 1_u64 << (bits - 1);
    let ticks = ticks_in(timer.frequency(), 5);
    let span = ticks.clamp(1, (range / 16).max(1));
    u32::try_from(span).unwrap_or(u32::MAX)
}

fn ticks_in(frequency: Rate, milliseconds: u64) -> u64 {
    let ticks = u64::from(frequency.numerator()) * milliseconds;
    ticks / (1000 * u64::from(frequency.denominator()))
}

struct Suite<'t, T, I, P> {
    timer: &'t T,
    interrupts: I,
    pass: P,
    short: u32,
}

impl<T: Timer, I: Fn() -> u32, P: FnMut()> Suite<'_, T, I, P> {
    /// An instant `spans` short spans ahead.
    fn ahead(&self, spans: u32) -> T::Instant {
        self.timer
            .now()
            .after(self.short.saturating_mul(spans).max(1))
    }

    fn has_reached(&self, instant: T::Instant) -> bool {
        self.timer.now().has_reached(instant)
    }

    /// Lets time pass until `instant` has come.
    fn pass_until(&mut self, instant: T::Instant) {
        while !self.has_reached(instant) {
            (self.pass)();
        }
    }

    /// Lets time pass until the next interrupt; says whether it came before a generous deadline.
    fn interrupt_comes(&mut self, count: u32) -> bool {
        // In steps, as the counter may begin anew before the deadline.
        let steps = 10 * ticks_in(self.timer.frequency(), 1000) / u64::from(self.short) + 16;
        for _ in 0..steps {
            let step = self.ahead(1);
            while !self.has_reached(step) {
                if (self.interrupts)() != count {
                    return true;
                }
                (self.pass)();
            }
        }
        (self.interrupts)() != count
    }

    /// Nothing is armed and nothing pending when this returns.
    fn quiet(&mut self) {
        self.timer.disarm();
        let later = self.ahead(2);
        self.pass_until(later);
    }

    /// Makes attempts until one was in time to tell.
    fn attempt(&mut self, what: &str, mut attempt: impl FnMut(&mut Self) -> Option<()>) {
        for _ in 0..ATTEMPTS {
            self.quiet();
            if attempt(self).is_some() {
                return;
            }
        }
        panic!("{what}: the program was never fast enough to tell in {ATTEMPTS} attempts");
    }

    fn is_monotonic(&mut self) {
        let mut before = self.timer.now();
        for _ in 0..1000 {
            let now = self.timer.now();
            assert!(now.has_reached(before), "the counter went back");
            before = now;
        }
        let later = self.ahead(1);
        // Hangs on a counter that stands still.
        self.pass_until(later);
    }

    fn interrupts_once(&mut self) {
        self.attempt("an interrupt ahead", Self::one_interrupt_comes);
    }

    fn one_interrupt_comes(&mut self) -> Option<()> {
        let count = (self.interrupts)();
        let at = self.ahead(2);
        if self.timer.arm(at) == Armed::Past {
            assert!(
                self.has_reached(at),
                "an instant ahead was reported as past"
            );
            return None;
        }
        assert!(
            self.interrupt_comes(count),
            "no interrupt came at the instant that was armed"
        );
        assert!(
            self.has_reached(at),
            "the interrupt came before its instant"
        );
        let later = self.ahead(4);
        self.pass_until(later);
        let came = (self.interrupts)().wrapping_sub(count);
        assert_eq!(came, 1, "one instant was armed, {came} interrupts came");
        Some(())
    }

    /// Arms instants all around a counter that begins anew soon.
    fn interrupts_across_the_end_of_the_counter(&mut self) {
        let bits = <T::Instant as Instant>::BITS;
        let soon = 3 * ticks_in(self.timer.frequency(), 1000);
        if bits > 32 || 1_u64 << bits > soon.max(1 << 16) {
            return;
        }
        let rounds = 3 * (1_u64 << bits) / (6 * u64::from(self.short)) + 1;
        for _ in 0..rounds {
            self.attempt("around the counter", Self::one_interrupt_comes);
        }
    }

    fn reports_the_past(&mut self) {
        self.quiet();
        let now = self.timer.now();
        let later = self.ahead(1);
        self.pass_until(later);
        assert_eq!(
            self.timer.arm(now),
            Armed::Past,
            "an instant that has passed was not reported"
        );
    }

    fn replaces_by_later(&mut self) {
        self.attempt("a later instant in place of another", |suite| {
            let count = (suite.interrupts)();
            let (first, second) = (suite.ahead(2), suite.ahead(6));
            if suite.timer.arm(first) == Armed::Past || suite.timer.arm(second) == Armed::Past {
                return None;
            }
            if suite.has_reached(first) {
                return None;
            }
            assert!(
                suite.interrupt_comes(count),
                "no interrupt came after the timer was armed again"
            );
            assert!(
                suite.has_reached(second),
                "an interrupt came at an instant that had been replaced"
            );
            Some(())
        });
    }

    fn replaces_by_earlier(&mut self) {
        self.attempt("an earlier instant in place of another", |suite| {
            let count = (suite.interrupts)();
            let (far, near) = (suite.ahead(7), suite.ahead(2));
            if suite.timer.arm(far) == Armed::Past || suite.timer.arm(near) == Armed::Past {
                return None;
            }
            assert!(
                suite.interrupt_comes(count),
                "no interrupt came after the timer was armed again"
            );
            if suite.has_reached(far) {
                // Late, or not replaced: there is no telling.
                return None;
            }
            let later = suite.ahead(8);
            suite.pass_until(later);
            let came = (suite.interrupts)().wrapping_sub(count);
            assert_eq!(came, 1, "the instant that had been replaced came, too");
            Some(())
        });
    }

    fn disarms(&mut self) {
        self.attempt("disarming", |suite| {
            let count = (suite.interrupts)();
            let at = suite.ahead(2);
            if suite.timer.arm(at) == Armed::Past {
                return None;
            }
            suite.timer.disarm();
            if suite.has_reached(at) {
                return None;
            }
            let later = suite.ahead(6);
            suite.pass_until(later);
            let came = (suite.interrupts)().wrapping_sub(count);
            assert_eq!(came, 0, "an interrupt came after disarming");
            Some(())
        });
    }
}
