//! [`Checks`]: a line for every check, and their count.

use core::fmt::{self, Write as _};
use core::panic::Location;

use crate::print;

/// Checks that were made, and how many held.
#[derive(Default)]
pub struct Checks {
    passed: u32,
    failed: u32,
}

impl Checks {
    /// Prints a line of its own that begins a group of checks.
    pub fn group(&self, name: &str) {
        print(name);
        print("\n");
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
        let _ = write!(Console, "  {verdict}  {}:{}", place.file(), place.line());
        #[cfg(feature = "values")]
        if !holds {
            let _ = write!(Console, ": {found:?}, not {expected:?}");
        }
        print("\n");
    }

    /// Prints the count as the last line; returns true if all held, and there were some.
    pub(crate) fn conclude(&self) -> bool {
        let Self { passed, failed } = *self;
        // The console takes everything.
        let _ = writeln!(Console, "{passed} passed, {failed} failed");
        failed == 0 && passed > 0
    }
}

/// The console, for formatted text. It takes everything.
pub struct Console;

impl fmt::Write for Console {
    fn write_str(&mut self, text: &str) -> fmt::Result {
        print(text);
        Ok(())
    }
}
