//! [`Turns`]: the short turns of all ways.

use crate::Result;
use crate::clock::{Calibration, ticks};
use crate::measure::quantile;

/// Nanoseconds beside which a time stamp costs nothing.
const BATCH_NS: f64 = 50_000.0;

/// Batches of a turn, however long they take.
const LEAST_BATCHES: usize = 3;

/// What was measured so far.
pub(super) struct Turns {
    calibration: Calibration,
    /// Ticks of one call, a value for each batch, of each place.
    samples: Vec<Vec<f64>>,
    turn_ns: f64,
}

impl Turns {
    /// For as many places, with turns of so many nanoseconds.
    pub(super) fn of(places: usize, turn_ns: f64) -> Self {
        Self {
            calibration: Calibration::begin(),
            samples: vec![Vec::new(); places],
            turn_ns,
        }
    }

    /// A turn: calls in batches that are timed.
    pub(super) fn take(
        &mut self,
        place: usize,
        mut call: impl FnMut() -> Result<()>,
    ) -> Result<()> {
        let ns_per_tick = self.calibration.ns_per_tick();
        // Twice, for who has slept meanwhile.
        call()?;
        let begin = ticks();
        call()?;
        let call_ns = (ticks().wrapping_sub(begin) as f64 * ns_per_tick).max(1.0);
        let calls = whole(BATCH_NS / call_ns).clamp(1, 1000);
        let batches = whole(self.turn_ns / (call_ns * calls as f64)).max(LEAST_BATCHES);
        for _ in 0..batches.min(100) {
            let begin = ticks();
            for _ in 0..calls {
                call()?;
            }
            let passed = ticks().wrapping_sub(begin) as f64;
            self.samples[place].push(passed / calls as f64);
        }
        Ok(())
    }

    /// The median of each, in nanoseconds.
    pub(super) fn figures(mut self) -> Vec<f64> {
        let ns_per_tick = self.calibration.ns_per_tick();
        let of = |samples: &mut Vec<f64>| quantile(samples, 0.5) * ns_per_tick;
        self.samples.iter_mut().map(of).collect()
    }
}

/// The whole part of a number that is not negative.
fn whole(value: f64) -> usize {
    // Not negative, as callers divide positive numbers.
    #[allow(clippy::cast_sign_loss)]
    let whole = value as usize;
    whole
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_turn_times_what_it_calls() {
        let mut turns = Turns::of(2, 1e5);
        let mut calls = 0;
        let called = turns.take(1, || {
            calls += 1;
            Ok(())
        });
        called.unwrap();
        assert!(calls > LEAST_BATCHES, "{calls}");
        let figures = turns.figures();
        assert!(figures[0].total_cmp(&0.0).is_eq() && figures[1] > 0.0);
    }
}
