//! [`lock_file`] and [`while_held`]: waiting for a lock on a file.

use core::time::Duration;
use std::os::fd::AsFd;
use std::time::Instant;

use rustix::fs::{FlockOperation, flock};
use rustix::io::Errno;

/// The time for which the crates of Condor wait for a file lock that another program holds: 1 s.
///
/// A lock may outlive the program that took it by some milliseconds: the kernel frees the program's memory first, and
/// a child process that any thread has started keeps the lock until it executes another program.
pub const LOCK_PATIENCE: Duration = Duration::from_secs(1);

/// The time between two attempts.
const AGAIN: Duration = Duration::from_millis(5);

/// Calls `attempt`, and repeats the call as long as `is_held` returns true for its result and `patience` is not
/// over. Returns the last result.
///
/// Use it for a lock: the kernel cannot wait for the lock of a file with a deadline, so this function sleeps for 5 ms
/// between two attempts. [`LOCK_PATIENCE`] is enough for the locks of a program that has ended.
pub fn while_held<R>(
    patience: Duration,
    is_held: impl Fn(&R) -> bool,
    mut attempt: impl FnMut() -> R,
) -> R {
    let begun = Instant::now();
    loop {
        let result = attempt();
        if !is_held(&result) || begun.elapsed() >= patience {
            return result;
        }
        std::thread::sleep(AGAIN);
    }
}

/// Takes the exclusive lock of `file` (`flock`), which lasts as long as the file is open. Waits for at most `patience`
/// while another open file has the lock. Returns true if the lock was taken, false if the other file still has it.
///
/// # Errors
/// Returns the operating system's error if the file cannot be locked.
pub fn lock_file(file: impl AsFd, patience: Duration) -> rustix::io::Result<bool> {
    let is_held = |result: &_| matches!(result, Ok(false));
    while_held(patience, is_held, || {
        match flock(&file, FlockOperation::NonBlockingLockExclusive) {
            Ok(()) => Ok(true),
            Err(Errno::WOULDBLOCK) => Ok(false),
            Err(error) => Err(error),
        }
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_lock_is_waited_for_until_it_is_free_or_patience_is_over() {
        let mut attempts = 0;
        let taken = while_held(Duration::MAX, Result::is_err, || {
            attempts += 1;
            if attempts < 3 { Err(()) } else { Ok(attempts) }
        });
        assert_eq!(taken, Ok(3));
        let mut attempts = 0;
        let held = while_held(
            Duration::ZERO,
            |it| *it,
            || {
                attempts += 1;
                true
            },
        );
        assert!(held, "it is held for good");
        assert_eq!(attempts, 1);
    }
}
