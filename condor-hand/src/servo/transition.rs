//! [`Transition`] and [`Mean`]: how a finger's tensions pass from before a change to after it.

use crate::math::{Real, clamp, max, real};
use crate::tendon::{Pair, TendonPairs, TensionAllocation};

/// The number of ticks within which a joint reaches the mean tensions that it takes over.
const SETTLING_TICKS: f64 = 4.0;

/// The mean tensions of a joint, N, over as many ticks as a transition has, or at least half as many; over
/// fewer if it began since then.
#[derive(Clone, Copy, Debug)]
pub(super) struct Mean<T> {
    /// The sums over a whole half of a transition, and over the ticks since then.
    half: Sum<T>,
    rest: Sum<T>,
}

#[derive(Clone, Copy, Debug)]
struct Sum<T> {
    tension: Pair<T>,
    ticks: T,
}

impl<T: Real> Sum<T> {
    fn nothing() -> Self {
        Self {
            tension: Pair::both(T::zero()),
            ticks: T::zero(),
        }
    }
}

impl<T: Real> Mean<T> {
    /// Makes an empty mean.
    pub(super) fn new() -> Self {
        Self {
            half: Sum::nothing(),
            rest: Sum::nothing(),
        }
    }

    /// Adds one tick; `part` is one divided by the ticks of a transition.
    #[inline(always)]
    pub(super) fn add(&mut self, tension: Pair<T>, part: T) {
        let sum = &mut self.rest;
        sum.tension.flexor += tension.flexor;
        sum.tension.extensor += tension.extensor;
        sum.ticks += T::one();
        if sum.ticks * part >= real(0.5) {
            self.half = core::mem::replace(sum, Sum::nothing());
        }
    }

    /// The mean; `None` before the first tick.
    pub(super) fn tension(&self) -> Option<Pair<T>> {
        let ticks = self.half.ticks + self.rest.ticks;
        let mean = |half: T, rest: T| (half + rest) / ticks;
        let (half, rest) = (&self.half.tension, &self.rest.tension);
        (ticks > T::zero()).then(|| Pair {
            flexor: mean(half.flexor, rest.flexor),
            extensor: mean(half.extensor, rest.extensor),
        })
    }
}

/// The steps that changes would make in the tensions at once.
#[derive(Clone, Debug)]
pub(super) struct Transition<T: Real, const N: usize> {
    change: Step<T, N>,
    /// From the last tensions of a joint to their mean, if it takes that over.
    settling: Step<T, N>,
}

impl<T: Real, const N: usize> Transition<T, N> {
    /// Makes a transition of `ticks` ticks, at least one.
    pub(super) fn new(ticks: T) -> Self {
        Self {
            change: Step::new(ticks),
            settling: Step::new(real(SETTLING_TICKS)),
        }
    }

    /// The part of a transition that a tick has.
    #[inline(always)]
    pub(super) fn part(&self) -> T {
        self.change.part
    }

    /// Forgets what is left of the last change.
    pub(super) fn end(&mut self) {
        self.change.left = T::zero();
        self.settling.left = T::zero();
    }

    /// A change from the tensions of the last tick, of which joints go on from `kept`, to `new`.
    pub(super) fn begin(
        &mut self,
        last: &TendonPairs<T, N>,
        kept: &TendonPairs<T, N>,
        new: &TendonPairs<T, N>,
    ) {
        self.change.begin(kept, new);
        self.settling.begin(last, kept);
    }

    /// Adds to the tensions what is left.
    #[inline(always)]
    pub(super) fn smooth(
        &mut self,
        tensions: &mut TendonPairs<T, N>,
        allocation: &[TensionAllocation<T>; N],
        periods: T,
    ) {
        if self.change.left > T::zero() || self.settling.left > T::zero() {
            self.change.add(tensions, periods);
            self.settling.add(tensions, periods);
            for (tension, allocation) in tensions.iter_mut().zip(allocation) {
                *tension = tension.map(|it| clamp(it, allocation.min_n, allocation.max_n));
            }
        }
    }
}

/// A step of tensions, N, which is worked off in equal parts.
#[derive(Clone, Debug)]
struct Step<T: Real, const N: usize> {
    whole: TendonPairs<T, N>,
    /// The part of it that is left, from 1, and the part that a tick works off.
    left: T,
    part: T,
}

impl<T: Real, const N: usize> Step<T, N> {
    fn new(ticks: T) -> Self {
        Self {
            whole: [Pair::both(T::zero()); N],
            left: T::zero(),
            part: T::one() / max(ticks, T::one()),
        }
    }

    fn begin(&mut self, from: &TendonPairs<T, N>, to: &TendonPairs<T, N>) {
        self.left = T::one();
        for ((step, from), to) in self.whole.iter_mut().zip(from).zip(to) {
            step.flexor = from.flexor - to.flexor;
            step.extensor = from.extensor - to.extensor;
        }
    }

    fn add(&mut self, tensions: &mut TendonPairs<T, N>, periods: T) {
        for (tension, step) in tensions.iter_mut().zip(&self.whole) {
            tension.flexor += self.left * step.flexor;
            tension.extensor += self.left * step.extensor;
        }
        self.left = max(self.left - self.part * periods, T::zero());
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
