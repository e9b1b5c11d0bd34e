//! The posture of a position that is farthest from the limits of the joints.

use nalgebra::{SVector, Vector3};

use super::plane::{Aim, distance, far, tolerance};
use super::{InverseError, outside, unreachable};
use crate::kinematics::limits::Tightest;
use crate::kinematics::{JointLimits, PlanarFinger};
use crate::math::{Real, acos, atan2, clamp, max, min, real};

/// Pitches that are tried in each interval before the best is refined.
const SAMPLES: u8 = 16;
/// Each narrows the interval to 0.618 of itself: to 1e-9 rad.
const ITERATIONS: u32 = 40;

/// One kind of posture, and the pitches at which it reaches the target.
#[derive(Clone, Copy)]
struct Family<T: Real> {
    aim: Aim<T>,
    flexed: bool,
    from: T,
    to: T,
}

/// A posture, and its flexion joint nearest to a limit.
#[derive(Clone, Copy)]
struct Candidate<T: Real> {
    q: SVector<T, 4>,
    tightest: Tightest<T>,
}

impl<T: Real> PlanarFinger<T> {
    /// The posture whose flexion joints have the largest least distance from their limits.
    ///
    /// The pitches at which the target is in reach are known: the axis of the last joint must be
    /// in the ring that the two links before it sweep. Within each such interval the best of a few
    /// samples is refined by golden-section search (Kiefer, "Sequential minimax search for a
    /// maximum", 1953).
    pub(super) fn roomiest(
        &self,
        target: &Vector3<T>,
        present: &SVector<T, 4>,
        limits: &JointLimits<T, 4>,
    ) -> Result<SVector<T, 4>, InverseError> {
        let mut best: Option<Candidate<T>> = None;
        let mut turned: Option<Tightest<T>> = None;
        let mut short = far();
        for &(mut aim) in &self.aims(target, present)? {
            let d = distance(aim.along, aim.down);
            let reach = self.reach();
            let by = max(d - reach.greatest, reach.least - d);
            if by > tolerance::<T>() * reach.greatest {
                short = min(by, short);
                continue;
            }
            // The first joint does not depend on the pitch.
            let mut posture = limits.clamp(present);
            posture.x = aim.turn;
            posture = limits.unwind(&posture);
            let first = limits.tightest(&posture, 0);
            if first.margin < -JointLimits::<T, 4>::slack() {
                if turned.is_none_or(|other| first.margin > other.margin) {
                    turned = Some(first);
                }
                continue;
            }
            aim.turn = limits.clamp(&posture).x;
            for family in self.families(aim, d) {
                let most = family.most_room(limits);
                if best.is_some_and(|best| best.tightest.margin >= most) {
                    continue;
                }
                let candidate = self.best_of(&family, limits);
                if best.is_none_or(|best| candidate.is_better_than(&best)) {
                    best = Some(candidate);
                }
            }
        }
        match (best, turned) {
            (Some(best), _) if best.tightest.margin >= -JointLimits::<T, 4>::slack() => {
                Ok(limits.clamp(&best.q))
            }
            (Some(best), _) => Err(outside(&best.tightest)),
            (None, Some(turned)) => Err(outside(&turned)),
            (None, None) => Err(unreachable(short)),
        }
    }

    /// The pitches at which the distance of the last joint's axis from the second is in the ring of
    /// two links: `ρ² = d² + l3² - 2 d l3 cos δ`, with δ from the direction of the target.
    fn families(&self, aim: Aim<T>, d: T) -> [Family<T>; 4] {
        let [_, l1, l2, l3] = self.lengths;
        let direction = atan2(aim.down, aim.along);
        let double = (l3 + l3) * d;
        let square = d * d + l3 * l3;
        let at = |radius: T, otherwise: T| {
            if double > T::zero() {
                acos((square - radius * radius) / double)
            } else {
                otherwise
            }
        };
        let from = at(l1 - l2, T::zero());
        let to = at(l1 + l2, T::pi());
        [(true, true), (true, false), (false, true), (false, false)].map(|(flexed, below)| {
            let side = |delta: T| direction + if below { delta } else { -delta };
            Family {
                aim,
                flexed,
                from: side(from),
                to: side(to),
            }
        })
    }

    fn best_of(&self, family: &Family<T>, limits: &JointLimits<T, 4>) -> Candidate<T> {
        let step = (family.to - family.from) / T::of(f64::from(SAMPLES));
        let at = |pitch: T| self.candidate(family, pitch, limits);
        let mut middle = family.from;
        let mut best = at(middle);
        for sample in 1..=SAMPLES {
            let pitch = family.from + step * T::of(f64::from(sample));
            let candidate = at(pitch);
            if candidate.is_better_than(&best) {
                (middle, best) = (pitch, candidate);
            }
        }

        // (√5 - 1) / 2.
        let golden = real::<T>(0.618_033_988_749_894_9);
        let within = |pitch: T| {
            let (low, high) = if step < T::zero() {
                (family.to, family.from)
            } else {
                (family.from, family.to)
            };
            clamp(pitch, low, high)
        };
        let (mut low, mut high) = (within(middle - step), within(middle + step));
        let (mut left, mut right) = (high - (high - low) * golden, low + (high - low) * golden);
        let (mut of_left, mut of_right) = (at(left), at(right));
        for _ in 0..ITERATIONS {
            if of_left.is_better_than(&of_right) {
                (high, right, of_right) = (right, left, of_left);
                left = high - (high - low) * golden;
                of_left = at(left);
            } else {
                (low, left, of_left) = (left, right, of_right);
                right = low + (high - low) * golden;
                of_right = at(right);
            }
        }
        for candidate in [of_left, of_right] {
            if candidate.is_better_than(&best) {
                best = candidate;
            }
        }
        best
    }

    fn candidate(&self, family: &Family<T>, pitch: T, limits: &JointLimits<T, 4>) -> Candidate<T> {
        let turn = family.aim.turn;
        let axis = self.last_axis(&family.aim, pitch);
        let Ok((q1, q2)) = self.two_links(axis, family.flexed) else {
            // The end of an interval, rounded to outside of it.
            return Candidate {
                q: SVector::from([turn, T::zero(), T::zero(), T::zero()]),
                tightest: Tightest {
                    joint: 2,
                    position: T::zero(),
                    margin: -far::<T>(),
                },
            };
        };
        let q = SVector::from([turn, q1, q2, pitch - q1 - q2]);
        let q = limits.unwind(&q);
        Candidate {
            q,
            tightest: limits.tightest(&q, 1),
        }
    }
}

impl<T: Real> Family<T> {
    /// More room than any of its postures has: that of the middle joint, bent to its side.
    fn most_room(&self, limits: &JointLimits<T, 4>) -> T {
        let (low, high) = (limits.lower().z, limits.upper().z);
        if low < -T::pi() || high > T::pi() {
            return far();
        }
        let middle = (low + high) * real::<T>(0.5);
        let bent = if self.flexed {
            max(middle, T::zero())
        } else {
            min(middle, T::zero())
        };
        min(bent - low, high - bent)
    }
}

impl<T: Real> Candidate<T> {
    fn is_better_than(&self, other: &Self) -> bool {
        self.tightest.margin > other.tightest.margin
    }
}
