//! The posture of a position, with the last two joints coupled.

use nalgebra::{SVector, Vector3};

use super::plane::{Aim, distance, far, reached, tolerance};
use super::{Branches, InverseError};
use crate::kinematics::PlanarFinger;
use crate::math::{Real, abs, atan2, clamp, min, real, sin_cos, sqrt, wrap};
use crate::number::{Requirement, check, positive};

/// Newton's method doubles the digits, and bisection adds one bit: more than both ever need.
const ITERATIONS: u32 = 200;

impl<T: Real> PlanarFinger<T> {
    /// Returns the postures that bring the tip to `target` (m, in the palm) with coupled joints:
    /// the last joint has the angle `q3 = κ q2`, where κ is `ratio`. There are up to two directions
    /// of the first joint, and for each the finger flexed and extended. The limits of the joints
    /// are not regarded.
    ///
    /// Only the first angle of `present` (rad) is used, and only if the target is on the axis of
    /// the first joint. The middle joint bends no further than where the distance `d` of the tip
    /// from the second axis begins to grow again (κ = 1), or than `π / (1 + κ)`.
    ///
    /// By the law of cosines, twice:
    /// `d² = l1² + l2² + l3² + 2 l1 l2 cos q2 + 2 l2 l3 cos κ q2 + 2 l1 l3 cos (1 + κ) q2`. With κ
    /// = 1 that is quadratic in `cos q2`; otherwise it falls strictly on 0..π/(1 + κ), since each
    /// of the three angles stays within 0..π there, and Newton's method within a bracket solves it.
    ///
    /// # Errors
    /// [`InverseError`] if there is no posture; it has the distance by which the target is out of
    /// reach.
    pub fn coupled_branches(
        &self,
        target: &Vector3<T>,
        ratio: T,
        present: &SVector<T, 4>,
    ) -> Result<Branches<T>, InverseError> {
        let what = "the coupling of the last joint";
        positive(what, ratio)?;
        check(what, ratio, Requirement::AtMost(2.0))?;
        let mut branches = Branches::new();
        let mut short = far();
        for aim in &self.aims(target, present)? {
            let bend = match self.bend(distance(aim.along, aim.down), ratio) {
                Ok(bend) => bend,
                Err(by) => {
                    short = min(by, short);
                    continue;
                }
            };
            for q2 in [bend, -bend] {
                // There is room for four.
                let _ = branches.push(self.coupled_posture(aim, q2, ratio));
            }
        }
        reached(branches, short)
    }

    /// The middle angle, from 0, that puts the tip this far from the second axis; or how far out of
    /// reach that is, m.
    fn bend(&self, d: T, ratio: T) -> Result<T, T> {
        let [_, l1, l2, l3] = self.lengths;
        let greatest = l1 + l2 + l3;
        if d > greatest {
            let short = d - greatest;
            return if short > tolerance::<T>() * greatest {
                Err(short)
            } else {
                Ok(T::zero())
            };
        }
        let (most, bend) = if ratio == T::one() {
            self.quadratic_bend(d)
        } else {
            self.newton_bend(d, ratio)
        };
        let least = distance_of(self.lengths, most, ratio);
        let short = least - d;
        if short > tolerance::<T>() * greatest {
            Err(short)
        } else {
            Ok(bend)
        }
    }

    /// The largest middle angle, and the one for this distance, with κ = 1: `c = cos q2` is the
    /// larger root of `4 l1 l3 c² + 2 (l1 l2 + l2 l3) c + l1² + l2² + l3² - 2 l1 l3 - d² = 0`.
    fn quadratic_bend(&self, d: T) -> (T, T) {
        let [_, l1, l2, l3] = self.lengths;
        let square = real::<T>(4.0) * l1 * l3;
        let half = l2 * (l1 + l3);
        let constant = (l1 - l3 - d) * (l1 - l3 + d) + l2 * l2;
        // Of the two forms of the root the one that does not divide by a small square.
        let root = half + sqrt(half * half - square * constant);
        let angle = |c: T| {
            let c = clamp(c, -T::one(), T::one());
            let half = atan2(sqrt(T::one() - c), sqrt(T::one() + c));
            half + half
        };
        let lowest = if half < square {
            -half / square
        } else {
            -T::one()
        };
        (angle(lowest), angle(-constant / root))
    }

    /// The same for any other coupling.
    fn newton_bend(&self, d: T, ratio: T) -> (T, T) {
        let [_, l1, l2, l3] = self.lengths;
        let outer = T::one() + ratio;
        let most = T::pi() / outer;
        let greatest = l1 + l2 + l3;
        let least = distance_of(self.lengths, most, ratio);
        if d <= least {
            return (most, most);
        }
        // d² falls about as the square of the angle does.
        let share = (greatest - d) * (greatest + d) / ((greatest - least) * (greatest + least));
        let (mut low, mut high) = (T::zero(), most);
        let mut q2 = clamp(most * sqrt(share), low, high);
        for _ in 0..ITERATIONS {
            let excess = distance_of(self.lengths, q2, ratio) - d;
            if abs(excess) <= T::default_epsilon() * greatest {
                break;
            }
            if excess > T::zero() {
                low = q2;
            } else {
                high = q2;
            }
            let change = |angle: T, weight: T| weight * sin_cos(angle).0;
            let slope = -change(q2, l1 * l2)
                - change(ratio * q2, ratio * l2 * l3)
                - change(outer * q2, outer * l1 * l3);
            // (d²)' = 2 d d'.
            let mut next = q2 - excess * (excess + d + d) / (slope + slope);
            if !(next > low && next < high) {
                next = low + (high - low) * real::<T>(0.5);
            }
            if next <= low || next >= high || next == q2 {
                break;
            }
            q2 = next;
        }
        (most, q2)
    }

    /// The posture with this middle angle that points to the aim.
    fn coupled_posture(&self, aim: &Aim<T>, q2: T, ratio: T) -> SVector<T, 4> {
        let (along, down) = ends(self.lengths, q2, ratio);
        let q1 = atan2(aim.down, aim.along) - atan2(down, along);
        SVector::from([aim.turn, wrap(q1), q2, ratio * q2])
    }
}

/// The tip, along the second link and down from it, from the second axis.
fn ends<T: Real>([_, l1, l2, l3]: [T; 4], q2: T, ratio: T) -> (T, T) {
    let (s2, c2) = sin_cos(q2);
    let (s3, c3) = sin_cos((T::one() + ratio) * q2);
    (l1 + l2 * c2 + l3 * c3, l2 * s2 + l3 * s3)
}

fn distance_of<T: Real>(lengths: [T; 4], q2: T, ratio: T) -> T {
    let (along, down) = ends(lengths, q2, ratio);
    distance(along, down)
}
