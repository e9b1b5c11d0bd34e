//! The joints of any mechanism that bring its tip as near to a point as their limits permit.

use nalgebra::{Matrix3, SMatrix, SVector, Vector3};

use super::{Chain, InverseError, JointLimits, Kinematics};
use crate::control::linear::Ldl;
use crate::math::{Real, is_finite, max, min, real};

/// Steps of one search: within reach a few are enough, at the edge of the reach some dozens.
const STEPS: u32 = 400;
/// The largest change of a joint in one step, rad or m.
const STEP: f64 = 0.2;

/// The posture that brings a tip nearest to a point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Nearest<T: Real, const N: usize> {
    /// The posture, within the limits, rad (m for a prismatic joint).
    pub posture: SVector<T, N>,
    /// The distance of the tip from the point, m.
    pub distance: T,
    /// The joints that would move the tip nearer if their limits were wider, with the side of the limit.
    pub held: [Option<Side>; N],
}

/// A side of the range of a joint.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Side {
    /// The lower limit.
    Low,
    /// The upper limit.
    High,
}

impl<T: Real, const N: usize> Chain<T, N> {
    /// Returns the posture within the limits that brings the tip as near to `target` (m, in the palm) as
    /// a search from `present` (rad) finds: the joints go no further than they must.
    ///
    /// The search goes downhill. Where it ends away from the target it begins a second time, in the
    /// middle of all limits, and the nearer end counts. So a target within reach may be missed where the
    /// way to it leads uphill; the distance says so.
    ///
    /// Each step solves `(J Jᵀ + λ) x = e` for the error `e` of the tip and moves the joints by `Jᵀ x`, with
    /// the columns of joints left out that a limit holds (Levenberg–Marquardt on the active set).
    ///
    /// # Errors
    /// [`InverseError::NotFinite`] if a coordinate of the target or a position is not finite.
    pub fn nearest(
        &self,
        target: &Vector3<T>,
        present: &SVector<T, N>,
        limits: &JointLimits<T, N>,
    ) -> Result<Nearest<T, N>, InverseError> {
        super::inverse::check_finite("a coordinate of the target", target.iter())?;
        super::inverse::check_finite("a position of the present posture", present.iter())?;
        let first = self.descend(target, limits.clamp(present), limits);
        if first.distance <= reached() {
            return Ok(first);
        }
        let middle = (limits.lower() + limits.upper()) * real::<T>(0.5);
        let second = self.descend(target, middle, limits);
        // A little nearer is no reason to jump.
        Ok(if second.distance + reached() < first.distance {
            second
        } else {
            first
        })
    }

    fn descend(
        &self,
        target: &Vector3<T>,
        mut q: SVector<T, N>,
        limits: &JointLimits<T, N>,
    ) -> Nearest<T, N> {
        let size = max(self.size(), T::default_epsilon());
        let least = size * size * T::default_epsilon();
        let mut damping = size * size * real::<T>(1e-4);
        let (mut error, mut jacobian) = self.error(target, &q);
        for _ in 0..STEPS {
            let held = held(&jacobian, &error, &q, limits);
            let free = columns(&jacobian, &held);
            let normal = free * free.transpose() + Matrix3::from_diagonal_element(damping);
            let Some(factors) = Ldl::new(&normal) else {
                break;
            };
            let way = free.transpose() * factors.solve(&error);
            let longest = way.amax();
            if !is_finite(longest) || longest <= T::default_epsilon() {
                break;
            }
            let way = way * min(T::one(), real::<T>(STEP) / longest);
            let next = limits.clamp(&(q + way));
            let (nearer, there) = self.error(target, &next);
            if nearer.norm_squared() < error.norm_squared() {
                (q, error, jacobian) = (next, nearer, there);
                damping = max(damping * real::<T>(0.1), least);
            } else if damping > size * size {
                break;
            } else {
                damping *= real::<T>(10.0);
            }
        }
        Nearest {
            posture: q,
            distance: error.norm(),
            held: if error.norm() <= reached() {
                [None; N]
            } else {
                held(&jacobian, &error, &q, limits)
            },
        }
    }

    /// From the tip to the target, and how the joints move the tip.
    fn error(&self, target: &Vector3<T>, q: &SVector<T, N>) -> (Vector3<T>, SMatrix<T, 3, N>) {
        let (tip, jacobian) = self.kinematics(q);
        (
            target - tip.position,
            jacobian.fixed_rows::<3>(0).into_owned(),
        )
    }

    /// The length of all links, m.
    fn size(&self) -> T {
        let joints = self.joints.iter();
        let links = joints.map(|joint| joint.placement.position.norm());
        links.fold(self.tip.norm(), |sum, length| sum + length)
    }
}

/// The distance within which a tip is at its target, m.
fn reached<T: Real>() -> T {
    max(real::<T>(1e-9), real::<T>(64.0) * T::default_epsilon())
}

/// The joints at limits beyond which they would move the tip nearer.
fn held<T: Real, const N: usize>(
    jacobian: &SMatrix<T, 3, N>,
    error: &Vector3<T>,
    q: &SVector<T, N>,
    limits: &JointLimits<T, N>,
) -> [Option<Side>; N] {
    let nearer = jacobian.tr_mul(error);
    let mut held = [None; N];
    let ranges = limits.lower().iter().zip(limits.upper().iter());
    for ((place, (&q, &nearer)), (&lower, &upper)) in
        held.iter_mut().zip(q.iter().zip(nearer.iter())).zip(ranges)
    {
        *place = if q <= lower && nearer < T::zero() {
            Some(Side::Low)
        } else if q >= upper && nearer > T::zero() {
            Some(Side::High)
        } else {
            None
        };
    }
    held
}

/// The columns of the joints that are free; zeros for the others.
fn columns<T: Real, const N: usize>(
    jacobian: &SMatrix<T, 3, N>,
    held: &[Option<Side>; N],
) -> SMatrix<T, 3, N> {
    let mut free = *jacobian;
    for (mut column, held) in free.column_iter_mut().zip(held) {
        if held.is_some() {
            column.fill(T::zero());
        }
    }
    free
}
