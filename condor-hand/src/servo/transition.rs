//! [`Transition`] and [`Mean`]: how the efforts of actuators pass from before a change to after it.

use crate::math::max;
use crate::transmission::EffortLimits;

/// The number of ticks within which a joint reaches the mean efforts that it takes over.
const SETTLING_TICKS: f64 = 4.0;

/// The mean effort of an actuator, N or N m, over as many ticks as a transition has, or at least half as many; over
/// fewer if it began since then.
#[derive(Clone, Copy, Debug)]
pub(super) struct Mean {
    /// The sums over a whole half of a transition, and over the ticks since then.
    half: Sum,
    rest: Sum,
}

#[derive(Clone, Copy, Debug)]
struct Sum {
    effort: f64,
    ticks: f64,
}

impl Sum {
    const NOTHING: Self = Self {
        effort: 0.0,
        ticks: 0.0,
    };
}

impl Mean {
    /// Makes an empty mean.
    pub(super) const fn new() -> Self {
        Self {
            half: Sum::NOTHING,
            rest: Sum::NOTHING,
        }
    }

    /// Adds one tick; `part` is one divided by the ticks of a transition.
    #[inline(always)]
    pub(super) fn add(&mut self, effort: f64, part: f64) {
        let sum = &mut self.rest;
        sum.effort += effort;
        sum.ticks += 1.0;
        if sum.ticks * part >= 0.5 {
            self.half = core::mem::replace(sum, Sum::NOTHING);
        }
    }

    /// The mean; `None` before the first tick.
    pub(super) fn effort(&self) -> Option<f64> {
        let ticks = self.half.ticks + self.rest.ticks;
        (ticks > 0.0).then(|| (self.half.effort + self.rest.effort) / ticks)
    }
}

/// The steps that changes would make in the efforts at once.
#[derive(Clone, Debug)]
pub(super) struct Transition<const A: usize> {
    change: Step<A>,
    /// From the last efforts of a joint to their mean, if it takes that over.
    settling: Step<A>,
}

impl<const A: usize> Transition<A> {
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

    /// A change from the efforts of the last tick, of which joints go on from `kept`, to `new`.
    pub(super) fn begin(&mut self, last: &[f64; A], kept: &[f64; A], new: &[f64; A]) {
        self.change.begin(kept, new);
        self.settling.begin(last, kept);
    }

    /// Adds to the efforts what is left.
    #[inline(always)]
    pub(super) fn smooth(
        &mut self,
        efforts: &mut [f64; A],
        limits: &[EffortLimits; A],
        periods: f64,
    ) {
        if self.change.left > 0.0 || self.settling.left > 0.0 {
            self.change.add(efforts, periods);
            self.settling.add(efforts, periods);
            for (effort, limits) in efforts.iter_mut().zip(limits) {
                *effort = limits.clamp(*effort);
            }
        }
    }
}

/// A step of efforts, N or N m, which is worked off in equal parts.
#[derive(Clone, Debug)]
struct Step<const A: usize> {
    whole: [f64; A],
    /// The part of it that is left, from 1, and the part that a tick works off.
    left: f64,
    part: f64,
}

impl<const A: usize> Step<A> {
    fn new(ticks: f64) -> Self {
        Self {
            whole: [0.0; A],
            left: 0.0,
            part: 1.0 / max(ticks, 1.0),
        }
    }

    fn begin(&mut self, from: &[f64; A], to: &[f64; A]) {
        self.left = 1.0;
        for ((step, from), to) in self.whole.iter_mut().zip(from).zip(to) {
            *step = from - to;
        }
    }

    fn add(&mut self, efforts: &mut [f64; A], periods: f64) {
        for (effort, step) in efforts.iter_mut().zip(&self.whole) {
            *effort += self.left * step;
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
        assert_eq!(mean.effort(), None);
        for (tick, expected) in [(4.0, 4.0), (8.0, 6.0), (0.0, 4.0), (8.0, 4.0), (1.0, 3.0)] {
            mean.add(tick, 0.25);
            assert_eq!(mean.effort(), Some(expected));
        }
    }
}
