//! The joints of any mechanism that bring its tip as near to a point as their limits permit.

use nalgebra::{SMatrix, SVector, Vector3};

use super::{Chain, Jacobian, JointLimits, Kinematics};
use crate::control::linear::Ldl;
use crate::math::{is_finite, max, min};
use crate::number::{NumberError, finite};

/// Steps of one search: within reach a few are enough, at the edge of the reach some dozens.
const STEPS: u32 = 100;
/// The largest change of a joint in one step, rad or m.
const STEP: f64 = 0.2;

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

/// One of the two limits of a joint: the lower or the upper one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Side {
    /// The lower limit.
    Low,
    /// The upper limit.
    High,
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
    /// needed to go downhill (Levenberg). With the columns `v` and `w` of the linear and the angular Jacobian and the
    /// error `e` of the tip, the second derivative by joints `i <= j` is `v_i · v_j - e · (w_i x v_j)`. Joints that a
    /// limit holds are left out.
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
        let first = self.descend(target, limits.clamp(present), limits);
        if first.distance <= REACHED {
            return Ok(first);
        }
        let middle = (limits.lower() + limits.upper()) * 0.5;
        let second = self.descend(target, middle, limits);
        // A slightly nearer posture is not worth a jump.
        Ok(if second.distance + REACHED < first.distance {
            second
        } else {
            first
        })
    }

    fn descend(
        &self,
        target: &Vector3<f64>,
        mut q: SVector<f64, N>,
        limits: &JointLimits<N>,
    ) -> Nearest<N> {
        let size = max(self.size(), f64::EPSILON);
        let least = size * size * 1e-10;
        let mut damping = size * size * 1e-4;
        let (mut error, mut jacobian) = self.error(target, &q);
        for _ in 0..STEPS {
            let held = held(&jacobian, &error, &q, limits);
            let (slope, mut curvature) = downhill(&jacobian, &error, &held);
            for place in 0..N {
                if let Some(entry) = curvature.get_mut((place, place)) {
                    *entry += damping;
                }
            }
            let way = Ldl::new(&curvature).map(|factors| factors.solve(&slope));
            let longest = way.map_or(0.0, |way| way.amax());
            if way.is_some() && !(is_finite(longest) && longest > f64::EPSILON) {
                break;
            }
            if let Some(way) = way {
                let next = limits.clamp(&(q + way * min(1.0, STEP / longest)));
                let (nearer, there) = self.error(target, &next);
                if nearer.norm_squared() < error.norm_squared() {
                    (q, error, jacobian) = (next, nearer, there);
                    damping = max(damping * 0.1, least);
                    continue;
                }
            }
            if damping > 1e3 * size * (size + error.norm()) {
                // Rounding is all that is left.
                break;
            }
            damping *= 10.0;
        }
        Nearest {
            posture: q,
            distance: error.norm(),
            held: if error.norm() <= REACHED {
                [None; N]
            } else {
                held(&jacobian, &error, &q, limits)
            },
        }
    }

    /// From the tip to the target, and how the joints move the tip.
    fn error(&self, target: &Vector3<f64>, q: &SVector<f64, N>) -> (Vector3<f64>, Jacobian<N>) {
        let (tip, jacobian) = self.kinematics(q);
        (target - tip.position, jacobian)
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

/// The joints at limits beyond which they would move the tip nearer.
fn held<const N: usize>(
    jacobian: &Jacobian<N>,
    error: &Vector3<f64>,
    q: &SVector<f64, N>,
    limits: &JointLimits<N>,
) -> [Option<Side>; N] {
    let nearer = jacobian.fixed_rows::<3>(0).tr_mul(error);
    let mut held = [None; N];
    let ranges = limits.lower().iter().zip(limits.upper().iter());
    for ((place, (&q, &nearer)), (&lower, &upper)) in
        held.iter_mut().zip(q.iter().zip(nearer.iter())).zip(ranges)
    {
        *place = if q <= lower && nearer < 0.0 {
            Some(Side::Low)
        } else if q >= upper && nearer > 0.0 {
            Some(Side::High)
        } else {
            None
        };
    }
    held
}

/// The derivative of half the square of the distance, downhill, and its second derivative, by the joints that
/// are free.
fn downhill<const N: usize>(
    jacobian: &Jacobian<N>,
    error: &Vector3<f64>,
    held: &[Option<Side>; N],
) -> (SVector<f64, N>, SMatrix<f64, N, N>) {
    let mut columns = [(Vector3::zeros(), Vector3::zeros()); N];
    for ((place, held), &[x, y, z, a, b, c]) in columns.iter_mut().zip(held).zip(&jacobian.data.0) {
        if held.is_none() {
            *place = (Vector3::new(x, y, z), Vector3::new(a, b, c));
        }
    }
    let mut slope = SVector::<f64, N>::zeros();
    let mut curvature = SMatrix::<f64, N, N>::zeros();
    for ((j, (linear, _)), slope) in columns.iter().enumerate().zip(slope.iter_mut()) {
        *slope = linear.dot(error);
        for (i, (before, angular)) in columns.iter().enumerate().take(j + 1) {
            let entry = before.dot(linear) - error.dot(&angular.cross(linear));
            for place in [(i, j), (j, i)] {
                if let Some(place) = curvature.get_mut(place) {
                    *place = entry;
                }
            }
        }
    }
    (slope, curvature)
}
