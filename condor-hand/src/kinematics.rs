//! The pose of a mechanism's tip, its motion with the joints, and the joints for a given position or pose.
//!
//! All vectors are in the axes of the palm; a tip is a point of the last link.

mod chain;
mod check;
mod descent;
mod finger;
mod limits;
mod nearest;
mod null;
mod product;
mod reach;

pub use chain::{Carrier, Chain, ChainBody, ChainJoint, ChainMotion, Following};
pub(crate) use check::{body_inertia, pose as check_pose};
pub use finger::{PlanarFinger, Rod};
pub use limits::{JointLimits, Side};
pub use nearest::Nearest;
pub use reach::{PoseSearch, Reach};

use nalgebra::{SMatrix, SVector};

use crate::Pose;

/// The Jacobian of a fingertip, in the axes of the palm: one column for each joint, whose rows are
/// the motion of the tip along x, y, z (m/rad) and then about x, y, z (rad/rad).
pub type Jacobian<const N: usize> = SMatrix<f64, 6, N>;

/// The kinematics of a serial mechanism of N joints: where its tip is, and how the joints move the
/// tip.
///
/// # For users
///
/// Every method takes joint positions in rad (m for a prismatic joint). For finite positions the
/// results are finite; no method panics.
///
/// # For implementers
///
/// Two implementations exist: [`Chain`] for any mechanism, and the closed form [`PlanarFinger`].
/// The pose that `kinematics` returns must be exactly that of `tip`.
pub trait Kinematics<const N: usize> {
    /// Returns the pose of the frame at the tip, in the frame of the palm.
    fn tip(&self, q: &SVector<f64, N>) -> Pose;

    /// Returns the pose of the frame at the tip, in the frame of the palm, and its Jacobian,
    /// together.
    fn kinematics(&self, q: &SVector<f64, N>) -> (Pose, Jacobian<N>);

    /// Returns the unit direction in which the joints move without moving the tip's position;
    /// `None` if there is none, or more than one.
    fn self_motion(&self, q: &SVector<f64, N>) -> Option<SVector<f64, N>>;
}
