//! The checks of [`Timer`], which the author of a timer calls from a test or from firmware.
//!
//! Two closures connect a timer: the first returns how many interrupts have come so far, and the
//! second lets a little time pass in which they can come.
//!
//! ```
//! use condor_mos::sim::SimPlatform;
//! use condor_mos::{Rate, Timer, conformance};
//! use std::sync::atomic::{AtomicU32, Ordering};
//!
//! let processor = SimPlatform::new(Rate::hz(1_000_000));
//! let interrupts = AtomicU32::new(0);
//! let verdict = processor.with_handler(
//!     || {
//!         interrupts.fetch_add(1, Ordering::Relaxed);
//!     },
//!     || {
//!         conformance::timer(
//!             &processor,
//!             || interrupts.load(Ordering::Relaxed),
//!             || processor.run_until(processor.now() + 1),
//!         )
//!     },
//! );
//! assert_eq!(verdict, Ok(()));
//! ```
//!
//! The suite takes some hundred milliseconds of the timer's time, or three rounds of a counter that
//! wraps within a few seconds. The program may be disturbed meanwhile: an attempt that came too
//! late to give a result is repeated. If the counter stands still, the suite never ends.

use crate::instant::CounterReading;
use crate::rate::Rate;
use crate::timer::{Armed, Timer};

/// The number of times that a disturbed attempt is made again.
const ATTEMPTS: u32 = 100;

/// The first check of [`timer()`] that failed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{check}: found {found}, expected {expected}")]
pub struct TimerFailure {
    /// The rule that is broken, and the quantity that is counted.
    pub check: &'static str,
    /// The number that was found.
    pub found: u32,
    /// The number that is required.
    pub expected: u32,
}

/// The result of a check, which ends at its first failure.
type Verdict<T = ()> = Result<T, TimerFailure>;

/// Whether an attempt was fast enough to tell.
#[derive(Clone, Copy, PartialEq, Eq)]
enum TimingOutcome {
    Yes,
    TooLate,
}

/// Checks that `timer` follows the rules for implementers of [`Timer`].
///
/// `interrupts` returns how many interrupts of the timer the program's handler has counted so far;
/// the count may start at any number. If an interrupt lasts until the timer is armed anew, as with
/// a level-triggered compare, that handler must end it by [`disarm`](Timer::disarm). `pass` lets
/// some time pass with interrupts enabled, less than a thousandth of a second if it can.
///
/// # Errors
/// [`TimerFailure`] for the first check that fails.
pub fn timer<T: Timer>(
    timer: &T,
    interrupts: impl Fn() -> u32,
    pass: impl FnMut(),
) -> Result<(), TimerFailure> {
    let mut suite = Suite {
        timer,
        interrupts,
        pass,
        short: short_span(timer),
    };
    suite.is_monotonic()?;
    suite.attempt(
        "disturbed attempts to see an interrupt at an armed instant",
        Suite::one_interrupt_comes,
    )?;
    suite.interrupts_across_the_end_of_the_counter()?;
    suite.reports_the_past()?;
    suite.attempt(
        "disturbed attempts to replace an armed instant by a later one",
        Suite::replaces_by_later,
    )?;
    suite.attempt(
        "disturbed attempts to replace an armed instant by an earlier one",
        Suite::replaces_by_earlier,
    )?;
    suite.attempt("disturbed attempts to disarm a timer", Suite::disarms)
}

fn same(check: &'static str, found: u32, expected: u32) -> Verdict {
    if found == expected {
        return Ok(());
    }
    Err(TimerFailure {
        check,
        found,
        expected,
    })
}

/// Some milliseconds, or a small part of the counter's range.
fn short_span<T: Timer>(timer: &T) -> u32 {
    let bits = <T::Instant as CounterReading>::BITS.min(32);
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

    /// An instant has come.
    fn has_come(&self, check: &'static str, instant: T::Instant) -> Verdict {
        let now = self.timer.now();
        let left = if now.has_reached(instant) {
            0
        } else {
            instant.since(now)
        };
        same(check, left, 0)
    }

    /// So many interrupts have come since there were `before`.
    fn have_come(&self, check: &'static str, before: u32, expected: u32) -> Verdict {
        same(check, (self.interrupts)().wrapping_sub(before), expected)
    }

    /// Lets time pass until `instant` has come.
    fn pass_until(&mut self, instant: T::Instant) {
        while !self.has_reached(instant) {
            (self.pass)();
        }
    }

    /// Lets time pass until the next interrupt, or a generous deadline.
    fn interrupt_comes(&mut self, check: &'static str, before: u32) -> Verdict {
        // In steps, as the counter may begin anew before the deadline.
        let steps = 10 * ticks_in(self.timer.frequency(), 1000) / u64::from(self.short.max(1)) + 16;
        for _ in 0..steps {
            let step = self.ahead(1);
            while !self.has_reached(step) {
                if (self.interrupts)() != before {
                    return Ok(());
                }
                (self.pass)();
            }
        }
        self.have_come(check, before, 1)
    }

    /// Nothing is armed and nothing pending when this returns.
    fn quiet(&mut self) {
        self.timer.disarm();
        let later = self.ahead(2);
        self.pass_until(later);
    }

    /// Makes attempts until one was in time to tell.
    fn attempt(
        &mut self,
        check: &'static str,
        attempt: impl Fn(&mut Self) -> Verdict<TimingOutcome>,
    ) -> Verdict {
        for _ in 0..ATTEMPTS {
            self.quiet();
            if attempt(self)? == TimingOutcome::Yes {
                return Ok(());
            }
        }
        same(check, ATTEMPTS, 1)
    }

    fn is_monotonic(&mut self) -> Verdict {
        let mut before = self.timer.now();
        for _ in 0..1000 {
            let now = self.timer.now();
            let back = if now.has_reached(before) {
                0
            } else {
                before.since(now)
            };
            same("ticks by which the counter went back", back, 0)?;
            before = now;
        }
        let later = self.ahead(1);
        self.pass_until(later);
        Ok(())
    }

    fn one_interrupt_comes(&mut self) -> Verdict<TimingOutcome> {
        let count = (self.interrupts)();
        let at = self.ahead(2);
        if self.timer.arm(at) == Armed::Past {
            self.has_come("ticks left until an instant that was reported as past", at)?;
            return Ok(TimingOutcome::TooLate);
        }
        self.interrupt_comes("interrupts at the instant that was armed", count)?;
        self.has_come("ticks left until the instant when its interrupt came", at)?;
        let later = self.ahead(4);
        self.pass_until(later);
        self.have_come("interrupts for one armed instant", count, 1)?;
        Ok(TimingOutcome::Yes)
    }

    /// Arms instants all around a counter that begins anew soon.
    fn interrupts_across_the_end_of_the_counter(&mut self) -> Verdict {
        let bits = <T::Instant as CounterReading>::BITS;
        let soon = 3 * ticks_in(self.timer.frequency(), 1000);
        if bits > 32 || 1_u64 << bits > soon.max(1 << 16) {
            return Ok(());
        }
        let rounds = 3 * (1_u64 << bits) / (6 * u64::from(self.short.max(1))) + 1;
        for _ in 0..rounds {
            self.attempt(
                "disturbed attempts to see an interrupt across the counter's wrap",
                Self::one_interrupt_comes,
            )?;
        }
        Ok(())
    }

    fn reports_the_past(&mut self) -> Verdict {
        self.quiet();
        let now = self.timer.now();
        let later = self.ahead(1);
        self.pass_until(later);
        let reports = u32::from(self.timer.arm(now) == Armed::Past);
        same("reports that a passed instant has passed", reports, 1)
    }

    fn replaces_by_later(&mut self) -> Verdict<TimingOutcome> {
        let count = (self.interrupts)();
        let (first, second) = (self.ahead(2), self.ahead(6));
        if self.timer.arm(first) == Armed::Past || self.timer.arm(second) == Armed::Past {
            return Ok(TimingOutcome::TooLate);
        }
        if self.has_reached(first) {
            return Ok(TimingOutcome::TooLate);
        }
        self.interrupt_comes("interrupts after the timer was armed again", count)?;
        self.has_come(
            "ticks left until the later instant when an interrupt came",
            second,
        )?;
        Ok(TimingOutcome::Yes)
    }

    fn replaces_by_earlier(&mut self) -> Verdict<TimingOutcome> {
        let count = (self.interrupts)();
        let (far, near) = (self.ahead(7), self.ahead(2));
        if self.timer.arm(far) == Armed::Past || self.timer.arm(near) == Armed::Past {
            return Ok(TimingOutcome::TooLate);
        }
        self.interrupt_comes("interrupts after the timer was armed again", count)?;
        if self.has_reached(far) {
            // Late, or not replaced: there is no telling.
            return Ok(TimingOutcome::TooLate);
        }
        let later = self.ahead(8);
        self.pass_until(later);
        self.have_come("interrupts after an instant was replaced", count, 1)?;
        Ok(TimingOutcome::Yes)
    }

    fn disarms(&mut self) -> Verdict<TimingOutcome> {
        let count = (self.interrupts)();
        let at = self.ahead(2);
        if self.timer.arm(at) == Armed::Past {
            return Ok(TimingOutcome::TooLate);
        }
        self.timer.disarm();
        if self.has_reached(at) {
            return Ok(TimingOutcome::TooLate);
        }
        let later = self.ahead(6);
        self.pass_until(later);
        self.have_come("interrupts after disarming", count, 0)?;
        Ok(TimingOutcome::Yes)
    }
}
