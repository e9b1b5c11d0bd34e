//! The joints of any mechanism that bring its tip as near to a point as their limits permit.

use nalgebra::{SVector, Vector3};

use super::descent::Goal;
use super::{Chain, JointLimits, Side};
use crate::Pose;
use crate::math::max;
use crate::number::{NumberError, finite};

/// Steps of one search: within reach a few are enough, at the edge of the reach some dozens.
const STEPS: u32 = 100;
/// The largest change of a joint in one step, rad or m.
const STRIDE: f64 = 0.2;

/// The result of [`Chain::nearest`]: the posture that brings the tip as near to a point as the
/// limits permit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Nearest<const N: usize> {
    /// The posture, within the limits, rad (m for a prismatic joint).
    pub posture: SVector<f64, N>,
    /// The distance of the tip from the point, m.
    pub distance: f64,
    /// The joints that would move the tip nearer if their limits were wider, with the side of the limit.
    pub held: [Option<Side>; N],
}

impl<const N: usize> Chain<N> {
    /// Returns the posture within `limits` that brings the tip as near to `target` (m, in the palm) as a search from
    /// `present` (rad) finds. The joints go no further than they must.
    ///
    /// The search goes downhill. Where it ends away from the target it begins a second time, in the middle of all
    /// limits, and the nearer end counts. So a target within reach may be missed where the way to it leads uphill; the
    /// distance in the result tells.
    ///
    /// Each step is one of Newton's on half the square of the distance, with `λ` added to the diagonal where that is
    /// needed to go downhill (Levenberg 1944). Joints that a limit holds are left out.
    ///
    /// # Errors
    /// [`NumberError`] if a coordinate of the target or a position is not finite.
    pub fn nearest(
        &self,
        target: &Vector3<f64>,
        present: &SVector<f64, N>,
        limits: &JointLimits<N>,
    ) -> Result<Nearest<N>, NumberError> {
        for &coordinate in target {
            finite("a coordinate of the target", coordinate)?;
        }
        for &position in present {
            finite("a position of the present posture", position)?;
        }
        let goal = Goal {
            mechanism: self,
            limits,
            target: Pose {
                position: *target,
                ..Pose::identity()
            },
            size: max(self.size(), f64::EPSILON),
            length: 0.0,
            stride: STRIDE,
            enough: (-1.0, -1.0),
        };
        let first = Nearest::of(&goal, limits.clamp(present));
        if first.distance <= REACHED {
            return Ok(first);
        }
        let second = Nearest::of(&goal, limits.middle());
        // A slightly nearer posture is not worth a jump.
        Ok(if second.distance + REACHED < first.distance {
            second
        } else {
            first
        })
    }

    /// The length of all links, m.
    fn size(&self) -> f64 {
        let joints = self.joints.iter();
        let links = joints.map(|joint| joint.placement.position.norm());
        links.fold(self.tip.norm(), |sum, length| sum + length)
    }
}

/// The distance within which a tip is at its target, m.
const REACHED: f64 = 1e-9;

impl<const N: usize> Nearest<N> {
    fn of(goal: &Goal<'_, Chain<N>, N>, q: SVector<f64, N>) -> Self {
        let (place, _) = goal.descend(q, STEPS);
        let distance = place.shift.norm();
        Self {
            posture: place.q,
            distance,
            held: if distance <= REACHED {
                [None; N]
            } else {
                goal.held(&place)
            },
        }
    }
}
