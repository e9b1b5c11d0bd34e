//! [`Turns`]: the short turns of all ways, and the [`Figures`] of a round.

use super::SIZES;
use super::ways::{Operation, Way};
use crate::Result;
use crate::clock::{Calibration, ticks};
use crate::measure::quantile;

/// Nanoseconds beside which a time stamp costs nothing.
const BATCH_NS: f64 = 50_000.0;

/// Batches of a turn, however long they take.
const LEAST_BATCHES: usize = 3;

/// Every operation and size.
pub(super) fn cells() -> impl Iterator<Item = (Operation, usize)> {
    Operation::ALL
        .into_iter()
        .flat_map(|operation| SIZES.into_iter().map(move |size| (operation, size)))
}

/// How many figures a round has.
pub(super) const FIGURES: usize = Way::ALL.len() * Operation::ALL.len() * SIZES.len();

/// Nanoseconds of a call, for every way, operation and size.
pub(super) struct Figures(Vec<f64>);

impl Figures {
    /// The figure of one of them.
    pub(super) fn of(&self, way: Way, operation: Operation, size: usize) -> f64 {
        self.0[index(way, operation, size)]
    }

    /// To send them through a pipe.
    pub(super) fn bytes(&self) -> Vec<u8> {
        self.0.iter().flat_map(|ns| ns.to_ne_bytes()).collect()
    }

    /// What [`bytes`](Self::bytes) was made from.
    pub(super) fn from_bytes(bytes: &[u8]) -> Self {
        let (values, _) = bytes.as_chunks::<8>();
        Self(values.iter().copied().map(f64::from_ne_bytes).collect())
    }
}

fn index(way: Way, operation: Operation, size: usize) -> usize {
    let size = SIZES.iter().position(|it| *it == size).unwrap_or_default();
    (way as usize * Operation::ALL.len() + operation as usize) * SIZES.len() + size
}

/// What was measured so far.
pub(super) struct Turns {
    calibration: Calibration,
    /// Ticks of one call, a value for each batch.
    samples: Vec<Vec<f64>>,
    turn_ns: f64,
}

impl Turns {
    /// For turns of so many nanoseconds.
    pub(super) fn of(turn_ns: f64) -> Self {
        Self {
            calibration: Calibration::begin(),
            samples: vec![Vec::new(); FIGURES],
            turn_ns,
        }
    }

    /// A turn: calls in batches that are timed.
    pub(super) fn take(
        &mut self,
        (way, operation, size): (Way, Operation, usize),
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
        let samples = &mut self.samples[index(way, operation, size)];
        for _ in 0..batches.min(100) {
            let begin = ticks();
            for _ in 0..calls {
                call()?;
            }
            samples.push(ticks().wrapping_sub(begin) as f64 / calls as f64);
        }
        Ok(())
    }

    /// The median of each.
    pub(super) fn figures(mut self) -> Figures {
        let ns_per_tick = self.calibration.ns_per_tick();
        let of = |samples: &mut Vec<f64>| quantile(samples, 0.5) * ns_per_tick;
        Figures(self.samples.iter_mut().map(of).collect())
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
    fn figures_survive_the_pipe_and_have_places_of_their_own() {
        let values = (0..FIGURES).map(|value| value as f64).collect();
        let figures = Figures::from_bytes(&Figures(values).bytes());
        let mut found = Vec::new();
        for way in Way::ALL {
            found.extend(cells().map(|(operation, size)| figures.of(way, operation, size)));
        }
        assert!(
            found
                .iter()
                .enumerate()
                .all(|(at, ns)| (at as f64).total_cmp(ns).is_eq())
        );
        assert_eq!(found.len(), FIGURES);
    }

    #[test]
    fn a_turn_times_what_it_calls() {
        let mut turns = Turns::of(1e5);
        let mut calls = 0;
        let cell = (Way::Native, Operation::Write, SIZES[1]);
        turns
            .take(cell, || {
                calls += 1;
                Ok(())
            })
            .unwrap();
        let figures = turns.figures();
        assert!(calls > LEAST_BATCHES, "{calls}");
        assert!(figures.of(cell.0, cell.1, cell.2) > 0.0);
        assert!(
            figures
                .of(Way::Ours, cell.1, cell.2)
                .total_cmp(&0.0)
                .is_eq()
        );
    }
}
