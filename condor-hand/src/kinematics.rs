//! Where the tip of a finger is, how it moves with the joints, and which joints bring it to a point.
//!
//! All vectors are in the axes of the palm; a tip is a point of the last link.

mod chain;
mod finger;
mod inverse;
mod limits;
mod null;
mod planar;
mod product;
mod rates;
mod search;

pub use chain::{Body, Chain, ChainError, Joint, Motion, Part};
pub use finger::{PlanarFinger, Rod};
pub use inverse::{Branches, InverseError, Reach, Redundancy};
pub use limits::{JointLimits, JointLimitsError};
pub use planar::NotPlanar;
pub use rates::{damped_rates, joint_rates, manipulability, singular_values};
pub use search::{SearchOptions, search};

use nalgebra::{SMatrix, SVector, Vector3};

use crate::{Pose, Real};

/// How the tip moves with the joints: rows x, y, z (m/rad) and then the rotation about x, y, z
/// (rad/rad), in the axes of the palm; one column for each joint.
pub type Jacobian<T, const N: usize> = SMatrix<T, 6, N>;

/// A serial mechanism of N joints with a tip.
///
/// # For users
///
/// Every method takes joint positions in rad (m for a prismatic joint). Finite positions give finite
/// answers; none panics.
///
/// # For implementers
///
/// Two ship: [`Chain`] for any mechanism, and the closed form
/// [`PlanarFinger`]. `kinematics` gives exactly the pose of `tip`.
pub trait Kinematics<T: Real, const N: usize> {
    /// The frame at the tip, in the palm.
    fn tip(&self, q: &SVector<T, N>) -> Pose<T>;

    /// The frame at the tip and its Jacobian, together.
    fn kinematics(&self, q: &SVector<T, N>) -> (Pose<T>, Jacobian<T, N>);

    /// The unit direction in which the joints move without moving the tip's position; `None`
    /// where there is none, or more than one.
    fn self_motion(&self, q: &SVector<T, N>) -> Option<SVector<T, N>>;

    /// The velocity of the tip's position for the rates of the joints, m/s.
    fn tip_velocity(&self, q: &SVector<T, N>, qd: &SVector<T, N>) -> Vector3<T> {
        let (_, jacobian) = self.kinematics(q);
        jacobian.fixed_rows::<3>(0) * qd
    }
}
