//! The time of a write by descriptor beside the system call that does the same on Linux.

use std::fs::OpenOptions;
use std::hint::black_box;

use super::paths;
use crate::Result;
use crate::clock::{Calibration, ticks};
use crate::rounds;

/// Both take turns within a round, so that what else the machine does meets both.
const TURNS: usize = 16;
const FD_CALLS: usize = 100_000;
const WRITE2_CALLS: usize = 10_000;

/// Plays the rounds: nanoseconds of a write by descriptor, and of write(2).
///
/// # Errors
/// `/dev/null` cannot be opened, or a write fails.
pub(super) fn play(rounds: usize) -> Result<Vec<Vec<f64>>> {
    let (switch, fd) = paths::open()?;
    let null = OpenOptions::new().write(true).open("/dev/null")?;
    let calibration = Calibration::begin();
    rounds::play(rounds, |_| {
        let (mut fd_ticks, mut write2_ticks) = (0, 0);
        for _ in 0..TURNS {
            fd_ticks += time(FD_CALLS, |bytes| paths::condor_path_fd(switch, fd, bytes))?;
            write2_ticks += time(WRITE2_CALLS, |bytes| {
                matches!(rustix::io::write(&null, bytes), Ok(2))
            })?;
        }
        let all = [(fd_ticks, FD_CALLS), (write2_ticks, WRITE2_CALLS)];
        let ns = calibration.ns_per_tick();
        Ok(all
            .map(|(ticks, calls)| ticks as f64 * ns / (calls * TURNS) as f64)
            .into())
    })
}

/// Ticks of so many writes.
fn time(calls: usize, mut write: impl FnMut(&[u8]) -> bool) -> Result<u64> {
    let began = ticks();
    for call in 0..calls {
        if !write(black_box(&(call as u16).to_ne_bytes())) {
            return Err("a write failed".into());
        }
    }
    Ok(ticks() - began)
}
