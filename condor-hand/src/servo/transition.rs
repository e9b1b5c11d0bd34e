//! [`Transition`] and [`Mean`]: how a finger's tensions pass from before a change to after it.

use crate::math::max;
use crate::tendon::{MomentArms, Pair, TendonPairs};

/// The number of ticks within which a joint reaches the mean tensions that it takes over.
const SETTLING_TICKS: f64 = 4.0;

/// The mean tensions of a joint, N, over as many ticks as a transition has, or at least half as many; over
/// fewer if it began since then.
#[derive(Clone, Copy, Debug)]
pub(super) struct Mean {
    /// The sums over a whole half of a transition, and over the ticks since then.
    half: Sum,
    rest: Sum,
}

#[derive(Clone, Copy, Debug)]
struct Sum {
    tension: Pair<f64>,
    ticks: f64,
}

impl Sum {
    fn nothing() -> Self {
        Self {
            tension: Pair::both(0.0),
            ticks: 0.0,
        }
    }
}

impl Mean {
    /// Makes an empty mean.
    pub(super) fn new() -> Self {
        Self {
            half: Sum::nothing(),
            rest: Sum::nothing(),
        }
    }

    /// Adds one tick; `part` is one divided by the ticks of a transition.
    #[inline(always)]
    pub(super) fn add(&mut self, tension: Pair<f64>, part: f64) {
        let sum = &mut self.rest;
        sum.tension.flexor += tension.flexor;
        sum.tension.extensor += tension.extensor;
        sum.ticks += 1.0;
        if sum.ticks * part >= 0.5 {
            self.half = core::mem::replace(sum, Sum::nothing());
        }
    }

    /// The mean; `None` before the first tick.
    pub(super) fn tension(&self) -> Option<Pair<f64>> {
        let ticks = self.half.ticks + self.rest.ticks;
        let mean = |half: f64, rest: f64| (half + rest) / ticks;
        let (half, rest) = (&self.half.tension, &self.rest.tension);
        (ticks > 0.0).then(|| Pair {
            flexor: mean(half.flexor, rest.flexor),
            extensor: mean(half.extensor, rest.extensor),
        })
    }
}

/// The steps that changes would make in the tensions at once.
#[derive(Clone, Debug)]
pub(super) struct Transition<const N: usize> {
    change: Step<N>,
    /// From the last tensions of a joint to their mean, if it takes that over.
    settling: Step<N>,
}

impl<const N: usize> Transition<N> {
    /// Makes a transition of `ticks` ticks, at least one.
    pub(super) fn new(ticks: f64) -> Self {
        Self {
            change: Step::new(ticks),
            settling: Step::new(SETTLING_TICKS),
        }
    }

    /// The part of a transition that a tick has.
    #[inline(always)]
    pub(super) fn part(&self) -> f64 {
        self.change.part
    }

    /// Forgets what is left of the last change.
    pub(super) fn end(&mut self) {
        self.change.left = 0.0;
        self.settling.left = 0.0;
    }

    /// A change from the tensions of the last tick, of which joints go on from `kept`, to `new`.
    pub(super) fn begin(
        &mut self,
        last: &TendonPairs<f64, N>,
        kept: &TendonPairs<f64, N>,
        new: &TendonPairs<f64, N>,
    ) {
        self.change.begin(kept, new);
        self.settling.begin(last, kept);
    }

    /// Adds to the tensions what is left.
    #[inline(always)]
    pub(super) fn smooth(
        &mut self,
        tensions: &mut TendonPairs<f64, N>,
        arms: &MomentArms<N>,
        periods: f64,
    ) {
        if self.change.left > 0.0 || self.settling.left > 0.0 {
            self.change.add(tensions, periods);
            self.settling.add(tensions, periods);
            for (tension, limits) in tensions.iter_mut().zip(arms.limits()) {
                tension.flexor = limits.flexor.clamp(tension.flexor);
                tension.extensor = limits.extensor.clamp(tension.extensor);
            }
        }
    }
}

/// A step of tensions, N, which is worked off in equal parts.
#[derive(Clone, Debug)]
struct Step<const N: usize> {
    whole: TendonPairs<f64, N>,
    /// The part of it that is left, from 1, and the part that a tick works off.
    left: f64,
    part: f64,
}

impl<const N: usize> Step<N> {
    fn new(ticks: f64) -> Self {
        Self {
            whole: [Pair::both(0.0); N],
            left: 0.0,
            part: 1.0 / max(ticks, 1.0),
        }
    }

    fn begin(&mut self, from: &TendonPairs<f64, N>, to: &TendonPairs<f64, N>) {
        self.left = 1.0;
        for ((step, from), to) in self.whole.iter_mut().zip(from).zip(to) {
            step.flexor = from.flexor - to.flexor;
            step.extensor = from.extensor - to.extensor;
        }
    }

    fn add(&mut self, tensions: &mut TendonPairs<f64, N>, periods: f64) {
        for (tension, step) in tensions.iter_mut().zip(&self.whole) {
            tension.flexor += self.left * step.flexor;
            tension.extensor += self.left * step.extensor;
        }
        self.left = max(self.left - self.part * periods, 0.0);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_mean_is_of_all_ticks_and_then_of_half_to_a_whole_transition() {
        let mut mean = Mean::new();
        assert_eq!(mean.tension(), None);
        for (tick, expected) in [(4.0, 4.0), (8.0, 6.0), (0.0, 4.0), (8.0, 4.0), (1.0, 3.0)] {
            mean.add(Pair::both(tick), 0.25);
            assert_eq!(mean.tension(), Some(Pair::both(expected)));
        }
    }
}
