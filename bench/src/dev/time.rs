//! The time of a write by descriptor beside the system call that does the same on Linux.

use std::fs::OpenOptions;
use std::hint::black_box;

use super::paths;
use crate::Result;
use crate::clock::{Calibration, ticks};
use crate::options::Options;

/// Time of one call in one round, in nanoseconds.
pub(super) struct Round {
    pub(super) fd_ns: f64,
    pub(super) write2_ns: f64,
}

const ROUNDS: usize = 31;
const QUICK_ROUNDS: usize = 9;
/// Both take turns within a round, so that what else the machine does meets both.
const TURNS: usize = 16;
const FD_CALLS: usize = 100_000;
const WRITE2_CALLS: usize = 10_000;

/// Plays the rounds.
///
/// # Errors
/// `/dev/null` cannot be opened, or a write fails.
pub(super) fn rounds(options: &Options) -> Result<Vec<Round>> {
    let (switch, fd) = paths::open()?;
    let null = OpenOptions::new().write(true).open("/dev/null")?;
    let usual = if options.quick { QUICK_ROUNDS } else { ROUNDS };
    let calibration = Calibration::begin();
    let mut played = Vec::new();
    for _ in 0..options.rounds.unwrap_or(usual) {
        let (mut fd_ticks, mut write2_ticks) = (0, 0);
        for _ in 0..TURNS {
            fd_ticks += time(FD_CALLS, |bytes| {
                matches!(black_box(switch).write(black_box(fd), bytes), Ok(2))
            })?;
            write2_ticks += time(WRITE2_CALLS, |bytes| {
                matches!(rustix::io::write(&null, bytes), Ok(2))
            })?;
        }
        played.push((fd_ticks, write2_ticks));
    }
    let ns_per_tick = calibration.ns_per_tick();
    let each = |ticks: u64, calls: usize| ticks as f64 * ns_per_tick / (calls * TURNS) as f64;
    let rounds = played.into_iter().map(|(fd, write2)| Round {
        fd_ns: each(fd, FD_CALLS),
        write2_ns: each(write2, WRITE2_CALLS),
    });
    Ok(rounds.collect())
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
