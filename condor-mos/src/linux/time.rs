//! Nanoseconds of `CLOCK_MONOTONIC`.

use rustix::time::{ClockId, Timespec, clock_gettime};

use crate::clock::ClockSpec;
use crate::rate::Rate;

pub(super) const NANOSECONDS: Rate = Rate::hz(1_000_000_000);

/// The clock to make an [`EventTable`](crate::EventTable) for if its scheduler runs on a
/// [`SignalPlatform`](super::SignalPlatform): nanoseconds of `CLOCK_MONOTONIC`, in 64 bits.
pub const CLOCK: ClockSpec = ClockSpec::of::<u64>(NANOSECONDS);

#[inline]
pub(super) fn now() -> u64 {
    nanoseconds(clock_gettime(ClockId::Monotonic))
}

#[allow(
    clippy::useless_conversion,
    reason = "tv_nsec has 32 bits on some targets"
)]
#[inline]
pub(super) fn nanoseconds(time: Timespec) -> u64 {
    // Since the machine or a thread started: neither negative nor near 584 years.
    let ns = time
        .tv_sec
        .wrapping_mul(1_000_000_000)
        .wrapping_add(i64::from(time.tv_nsec));
    ns.cast_unsigned()
}

// Less than 10^9 fits every type that a target has for it.
#[allow(clippy::cast_possible_wrap)]
pub(super) fn timespec(ns: u64) -> Timespec {
    Timespec {
        tv_sec: (ns / 1_000_000_000).cast_signed(),
        tv_nsec: (ns % 1_000_000_000) as _,
    }
}
