//! Timestamps that are cheap beside a round trip of a hundred nanoseconds.

use std::time::Instant;

/// Reads a counter of constant rate, after everything before it is done.
///
/// That is the time stamp counter on `x86_64` and the virtual counter on `aarch64`.
#[inline]
pub(crate) fn ticks() -> u64 {
    #[cfg(target_arch = "x86_64")]
    {
        // SAFETY: both instructions are part of the baseline of `x86_64` and touch no memory;
        // Linux lets programs read the counter.
        unsafe {
            core::arch::x86_64::_mm_lfence();
            core::arch::x86_64::_rdtsc()
        }
    }
    #[cfg(target_arch = "aarch64")]
    {
        let now;
        // SAFETY: reads a register that Linux opens to programs; the barrier keeps it from
        // being read early.
        unsafe {
            core::arch::asm!("isb", "mrs {}, cntvct_el0", out(reg) now, options(nostack));
        }
        now
    }
}

/// Learns the rate of [`ticks`] from the system's clock, over the time from its beginning to its end.
pub(crate) struct Calibration {
    ticks: u64,
    instant: Instant,
}

impl Calibration {
    /// Begins to compare the clocks.
    pub(crate) fn begin() -> Self {
        Self {
            ticks: ticks(),
            instant: Instant::now(),
        }
    }

    /// Returns the nanoseconds of one tick, the more exact the later it is called.
    pub(crate) fn ns_per_tick(&self) -> f64 {
        let passed = ticks().wrapping_sub(self.ticks).max(1);
        self.instant.elapsed().as_nanos() as f64 / passed as f64
    }
}
