//! The number of round trips of a slice, and the figures that are made of their times.

use crate::measure::quantile;

/// The number of round trips of one slice.
#[derive(Clone, Copy, Debug)]
pub(super) struct Slice {
    /// Round trips that are not timed.
    pub(super) warm_up: u32,
    /// Batches that are timed.
    pub(super) batches: u32,
    /// Round trips of a batch.
    pub(super) batch: u32,
    /// Round trips that are timed one by one.
    pub(super) single: u32,
}

impl Slice {
    /// Learns what a round trip costs; short enough for the slowest contestant.
    pub(super) const TRIAL: Self = Self {
        warm_up: 20,
        batches: 12,
        batch: 8,
        single: 4,
    };

    /// Makes a slice whose round trips take `half_ns` in batches and `half_ns` one by one, at `call_ns`
    /// each.
    pub(super) fn lasting(half_ns: f64, call_ns: f64) -> Self {
        let call_ns = call_ns.max(1.0);
        // Saturates: neither negative nor too large.
        #[allow(clippy::cast_sign_loss)]
        let fit = |ns: f64| (ns / call_ns) as u32;
        let batch = fit(BATCH_NS).clamp(1, 256);
        Self {
            warm_up: fit(WARM_UP_NS).clamp(8, 512),
            batches: (fit(half_ns) / batch).max(8),
            batch,
            single: fit(half_ns).max(32),
        }
    }

    /// Returns the number of requests that the server has to answer.
    pub(super) fn round_trips(&self) -> u32 {
        self.warm_up + self.batches * self.batch + self.single
    }
}

/// Nanoseconds of a batch: long beside a timestamp, short beside a tick of the kernel.
const BATCH_NS: f64 = 20_000.0;
/// Nanoseconds until caches and branch predictors know the contestant again.
const WARM_UP_NS: f64 = 100_000.0;

/// The times of one contestant in one round, in ticks.
#[derive(Default)]
pub(super) struct Samples {
    batches: Vec<f64>,
    singles: Vec<u32>,
}

impl Samples {
    /// Takes the time of a batch.
    pub(super) fn add_batch(&mut self, ticks: u64, round_trips: u32) {
        self.batches.push(ticks as f64 / f64::from(round_trips));
    }

    /// Takes the time of one round trip.
    pub(super) fn add_single(&mut self, ticks: u64) {
        self.singles.push(u32::try_from(ticks).unwrap_or(u32::MAX));
    }

    /// Ticks of a round trip: the median of the batches.
    pub(super) fn median(&mut self) -> f64 {
        quantile(&mut self.batches, 0.5)
    }

    /// Ticks that 99 of 100 round trips stay below.
    pub(super) fn p99(&mut self) -> f64 {
        quantile(&mut self.singles, 0.99)
    }
}
