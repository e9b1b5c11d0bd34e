//! The joint angles of a [`PlanarFinger`] that bring its tip to a point, in closed form.
//!
//! Four joints and three coordinates leave one freedom, which [`Redundancy`] decides.

mod coupled;
mod pitch;
mod plane;
mod roomiest;

pub use plane::Reach;

use heapless::Vec;
use nalgebra::{SVector, Vector3};
use thiserror::Error;

use super::limits::Tightest;
use super::{JointLimits, PlanarFinger};
use crate::decimal::Decimal;
use crate::math::{Real, min};
use crate::number::{NumberError, finite};

/// A list of the postures of a planar finger that bring its tip to one point: joint angles in rad,
/// in -π..=π. The limits of the joints are not regarded.
pub type Branches<T> = Vec<SVector<T, 4>, 4>;

/// The rule that chooses one posture. A planar finger has four joints for the three coordinates of
/// a target, so infinitely many postures bring its tip there.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub enum Redundancy<T: Real = f64> {
    /// The last link has this angle in the plane of the finger, [`PlanarFinger::pitch`], rad.
    Pitch(T),
    /// The third flexion joint turns in proportion to the second, `q3 = κ q2`, κ in (0, 2]: about
    /// 1 for a finger that curls as a human one does.
    Coupled(T),
    /// The flexion joints stay as far from their limits as they can.
    Roomiest,
}

/// The reason why there is no posture.
#[derive(Clone, Copy, Debug, PartialEq, Error)]
#[non_exhaustive]
pub enum InverseError {
    /// A number of the question is not possible: one that is not finite, a coupling outside of (0, 2], or a link that
    /// is too short or too long to compute with.
    #[error(transparent)]
    Number(#[from] NumberError),
    /// No posture brings the tip there.
    #[error("the target is out of reach by {} m", Decimal(*.by))]
    Unreachable {
        /// The least distance by which the tip (with a given pitch, the axis of the last joint)
        /// misses its place, along a line through the second axis, m.
        by: f64,
    },
    /// Every posture that brings the tip there violates the limits of a joint.
    #[error(
        "joint {joint} would have to be at {}, outside its limits by {} (rad, or m if it slides)",
        Decimal(*.angle),
        Decimal(*.by),
    )]
    OutsideLimits {
        /// The joint that is farthest outside, in the posture that is least outside; from 0.
        joint: usize,
        /// Its position there, rad (m for a prismatic joint).
        angle: f64,
        /// The distance from that position to the limit, rad (m for a prismatic joint).
        by: f64,
    },
}

impl<T: Real> PlanarFinger<T> {
    /// Returns the joint angles (rad), within `limits`, that bring the tip to `target` (m, in the
    /// palm). `redundancy` chooses among the infinitely many postures.
    ///
    /// If several postures remain, the one nearest to `present` (rad) is taken, by the sum of
    /// squares of the differences; with [`Redundancy::Roomiest`], the one with most room to its
    /// limits. If the target is on the axis of the first joint, that joint stays at its angle in
    /// `present`. An angle that is outside of its limits by rounding alone (1e-9 rad) is put onto
    /// the limit.
    ///
    /// # Errors
    /// [`InverseError`] if there is no posture; it has the distance by which the target is out of
    /// reach or outside of the limits.
    pub fn inverse(
        &self,
        target: &Vector3<T>,
        redundancy: Redundancy<T>,
        present: &SVector<T, 4>,
        limits: &JointLimits<T, 4>,
    ) -> Result<SVector<T, 4>, InverseError> {
        let branches = match redundancy {
            Redundancy::Pitch(pitch) => self.pitch_branches(target, pitch, present)?,
            Redundancy::Coupled(ratio) => self.coupled_branches(target, ratio, present)?,
            Redundancy::Roomiest => return self.roomiest(target, present, limits),
        };
        nearest(&branches, present, limits)
    }
}

/// The branch within the limits that is nearest to the present posture.
fn nearest<T: Real>(
    branches: &Branches<T>,
    present: &SVector<T, 4>,
    limits: &JointLimits<T, 4>,
) -> Result<SVector<T, 4>, InverseError> {
    let mut best: Option<(T, SVector<T, 4>)> = None;
    let mut least: Option<Tightest<T>> = None;
    for branch in branches {
        let branch = limits.unwind(branch);
        let tightest = limits.tightest(&branch, 0);
        if tightest.margin >= -JointLimits::<T, 4>::slack() {
            let branch = limits.clamp(&branch);
            let distance = (branch - present).norm_squared();
            if best.is_none_or(|(shortest, _)| distance < shortest) {
                best = Some((distance, branch));
            }
        } else if least.is_none_or(|least| tightest.margin > least.margin) {
            least = Some(tightest);
        }
    }
    match (best, least) {
        (Some((_, branch)), _) => Ok(branch),
        (None, Some(tightest)) => Err(outside(&tightest)),
        (None, None) => Err(unreachable(T::zero())),
    }
}

fn outside<T: Real>(tightest: &Tightest<T>) -> InverseError {
    InverseError::OutsideLimits {
        joint: tightest.joint,
        angle: tightest.position.to_f64(),
        by: -tightest.margin.to_f64(),
    }
}

/// By how much, no more than can be written.
fn unreachable<T: Real>(by: T) -> InverseError {
    InverseError::Unreachable {
        by: min(by.to_f64(), f64::MAX),
    }
}

pub(super) fn check_finite<'a, T: Real>(
    what: &'static str,
    numbers: impl IntoIterator<Item = &'a T>,
) -> Result<(), NumberError> {
    numbers.into_iter().try_for_each(|&x| finite(what, x))
}
