//! The number of tests that a run of libtest has made.

use crate::Result;
use crate::command::{Line, side_by_side};

/// Runs a `cargo test` command and returns the number of tests that passed in it.
///
/// # Errors
/// Returns an error if a test fails, or if there was no test to run.
pub(crate) fn count(tests: &Line) -> Result<u32> {
    let mut passed = 0;
    tests.watch(|line| passed += passed_in(line).unwrap_or(0))?;
    some(passed, tests)
}

/// Counts the tests of lines that each keep one core busy, as [`count`] does.
///
/// # Errors
/// Returns the error of the first line that fails; all are run.
pub(crate) fn count_together(tests: &[Line]) -> Result<u32> {
    let passed = side_by_side(tests, |line| {
        some(line.collect()?.lines().filter_map(passed_in).sum(), line)
    })?;
    Ok(passed.iter().sum())
}

fn some(passed: u32, tests: &Line) -> Result<u32> {
    if passed == 0 {
        return Err(format!("`{tests}` ran no test").into());
    }
    Ok(passed)
}

/// Returns the number in libtest's `test result: ok. 12 passed; 0 failed; …`.
pub(crate) fn passed_in(line: &str) -> Option<u32> {
    let counts = line.trim_start().strip_prefix("test result: ok. ")?;
    counts.split_once(" passed;")?.0.parse().ok()
}

/// Returns the name in libtest's `test window::reads ... FAILED`.
pub(crate) fn failed_in(line: &str) -> Option<&str> {
    line.strip_prefix("test ")?.strip_suffix(" ... FAILED")
}

#[cfg(test)]
mod tests {
    use super::{failed_in, passed_in};

    #[test]
    fn tells_the_tests_that_failed() {
        assert_eq!(
            failed_in("test window::reads ... FAILED"),
            Some("window::reads")
        );
        assert_eq!(failed_in("test window::reads ... ok"), None);
        assert_eq!(failed_in("test result: FAILED. 3 passed; 1 failed;"), None);
    }

    #[test]
    fn counts_only_the_result_lines() {
        assert_eq!(
            passed_in("test result: ok. 12 passed; 0 failed; 1 ignored;"),
            Some(12)
        );
        assert_eq!(passed_in("test result: FAILED. 3 passed; 1 failed;"), None);
        assert_eq!(passed_in("test window::reads ... ok"), None);
    }
}
