//! The calls of the kernel that contestants need.

use std::io;
use std::mem;

use rustix::io::Errno;
use rustix::thread::{ClockId, Timespec, clock_nanosleep_absolute};
use rustix::time::clock_gettime;

use crate::Result;

/// Returns the nanoseconds of `CLOCK_MONOTONIC`, with which every lateness is measured.
#[inline]
pub(super) fn now_ns() -> u64 {
    let now = clock_gettime(ClockId::Monotonic);
    // The clock counts from the start of the machine: neither part is negative.
    now.tv_sec.cast_unsigned() * 1_000_000_000 + now.tv_nsec.cast_unsigned()
}

/// Sleeps until `due_ns` of `CLOCK_MONOTONIC`.
pub(super) fn sleep_until(due_ns: u64) -> io::Result<()> {
    let due = timespec(due_ns);
    loop {
        match clock_nanosleep_absolute(ClockId::Monotonic, &due) {
            Err(Errno::INTR) => {}
            result => return Ok(result?),
        }
    }
}

fn timespec(ns: u64) -> Timespec {
    Timespec {
        tv_sec: (ns / 1_000_000_000).cast_signed(),
        tv_nsec: (ns % 1_000_000_000).cast_signed(),
    }
}

/// The rank of a thread under `SCHED_FIFO`: a faster loop runs before a slower one, and any loop before the
/// background.
#[derive(Clone, Copy, Debug)]
pub(super) enum Rank {
    /// The thread that runs when no loop does.
    Background,
    /// The loop of this index in a set whose fastest comes first.
    Loop(usize),
}

/// Puts the calling thread, and those that it will start, under `SCHED_FIFO`.
///
/// # Errors
/// Returns the system's error if it is not permitted.
pub(super) fn be_fifo(rank: Rank) -> Result<()> {
    let priority = match rank {
        Rank::Background => 1,
        Rank::Loop(index) => 80 - i32::try_from(index)?,
    };
    // SAFETY: all-zero bytes are a valid value of this structure of integers.
    let mut parameter: libc::sched_param = unsafe { mem::zeroed() };
    parameter.sched_priority = priority;
    // SAFETY: the structure outlives the call; 0 is the calling thread.
    if unsafe { libc::sched_setscheduler(0, libc::SCHED_FIFO, &raw const parameter) } == 0 {
        Ok(())
    } else {
        Err(io::Error::last_os_error().into())
    }
}
