//! [`Checks`]: a line for every check, and their count.
#![no_std]

use core::fmt::{self, Write as _};
use core::panic::Location;

/// Checks that were made, and how many held.
pub struct Checks<'p> {
    print: &'p dyn Fn(&str),
    passed: u32,
    failed: u32,
}

impl<'p> Checks<'p> {
    /// Creates checks of which none is made yet; `print` puts text on the console.
    pub fn new(print: &'p dyn Fn(&str)) -> Self {
        Self {
            print,
            passed: 0,
            failed: 0,
        }
    }

    /// Prints a line of its own that begins a group of checks.
    pub fn group(&self, name: &str) {
        (self.print)(name);
        (self.print)("\n");
    }

    /// Checks that a condition holds.
    #[track_caller]
    pub fn that(&mut self, holds: bool) {
        self.same(holds, true);
    }

    /// Notes whether what was `found` is as `expected`; feature `values` shows both if not.
    #[track_caller]
    #[allow(
        clippy::needless_pass_by_value,
        reason = "results of calls are what is compared; a borrow of each would only add noise"
    )]
    pub fn same<T: PartialEq + fmt::Debug>(&mut self, found: T, expected: T) {
        let holds = found == expected;
        let (count, verdict) = if holds {
            (&mut self.passed, "ok    ")
        } else {
            (&mut self.failed, "FAILED")
        };
        *count = count.saturating_add(1);
        let place = Location::caller();
        // The console takes everything.
        let _ = write!(self, "  {verdict}  {}:{}", place.file(), place.line());
        #[cfg(feature = "values")]
        if !holds {
            let _ = write!(self, ": {found:?}, not {expected:?}");
        }
        (self.print)("\n");
    }

    /// Prints the count as the last line; whether all held, and there were some.
    pub fn conclude(&mut self) -> bool {
        let (passed, failed) = (self.passed, self.failed);
        // The console takes everything.
        let _ = writeln!(self, "{passed} passed, {failed} failed");
        failed == 0 && passed > 0
    }
}

impl fmt::Write for Checks<'_> {
    fn write_str(&mut self, text: &str) -> fmt::Result {
        (self.print)(text);
        Ok(())
    }
}
