use nalgebra::{Matrix3, Vector3};

use super::check;
use crate::number::{NumberError, not_negative};
use crate::{Pose, Subject};

/// The motion by which a joint moves its link relative to the link before it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ChainMotion {
    /// The link rotates about this unit axis, rad.
    Revolute(Vector3<f64>),
    /// The link slides along this unit axis, m.
    Prismatic(Vector3<f64>),
    /// The link does not move: it stands for a joint that this mechanism does not have. Its column
    /// of a Jacobian is zero.
    Fixed,
}

/// A joint of a [`Chain`]: its place on the link before it, and its motion.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ChainJoint {
    /// The frame of the link at the joint's zero, in the frame of the link before it.
    pub placement: Pose,
    /// Its motion from there; the axis is in the frame of the link.
    pub motion: ChainMotion,
}

/// The mass, the centre of mass and the inertia of a link of a [`Chain`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ChainBody {
    /// The mass, kg.
    pub mass: f64,
    /// The centre of mass, m.
    pub center: Vector3<f64>,
    /// Inertia about the centre of mass in the axes of the link, kg m².
    pub inertia: Matrix3<f64>,
}

/// The kinematic and dynamic model of any serial mechanism of N joints, each of which rotates,
/// slides or is fixed. Make one with [`new`](Self::new).
///
/// ```
/// use condor_hand::Pose;
/// use condor_hand::kinematics::{Chain, ChainBody, ChainJoint, ChainMotion, Kinematics};
/// use nalgebra::Vector3;
///
/// let hinge = |x| ChainJoint {
///     placement: Pose::at(x, 0.0, 0.0),
///     motion: ChainMotion::Revolute(Vector3::y()),
/// };
/// let bodies = [ChainBody::massless(); 2];
/// let arm = Chain::new(Pose::identity(), [hinge(0.0), hinge(0.3)], bodies, Vector3::x() * 0.2)?;
/// assert_eq!(arm.tip(&[0.0, 0.0].into()).position.x, 0.5);
/// # Ok::<_, condor_hand::NumberError>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Chain<const N: usize> {
    pub(crate) base: Pose,
    pub(crate) joints: [ChainJoint; N],
    pub(crate) bodies: [ChainBody; N],
    pub(crate) tip: Vector3<f64>,
}

impl<const N: usize> Chain<N> {
    /// Makes a mechanism from its parts.
    ///
    /// * `base`: the pose of the mechanism's base in the palm.
    /// * `joints`: proximal first.
    /// * `bodies`: the bodies that the joints move, [massless](ChainBody::massless) if only kinematics is needed.
    /// * `tip`: the position of the tip in the frame of the last link, m.
    ///
    /// # Errors
    /// [`NumberError`] for the first part that cannot be: an axis that is not a unit vector, a
    /// rotation that is not orthonormal and right-handed, a negative mass, an inertia that no body
    /// has, or a number that is not finite. Entries may be off by 10⁻⁹.
    pub fn new(
        base: Pose,
        joints: [ChainJoint; N],
        bodies: [ChainBody; N],
        tip: Vector3<f64>,
    ) -> Result<Self, NumberError> {
        check::pose(Subject::Base, &base)?;
        for (number, joint) in joints.iter().enumerate() {
            check::pose(Subject::Placement(number as u16), &joint.placement)?;
            if let ChainMotion::Revolute(axis) | ChainMotion::Prismatic(axis) = &joint.motion {
                check::axis(number, axis)?;
            }
        }
        for (link, body) in bodies.iter().enumerate() {
            body.check(link)?;
        }
        check::position(Subject::Tip, &tip)?;
        Ok(Self {
            base,
            joints,
            bodies,
            tip,
        })
    }

    /// Returns the pose of the mechanism's base in the frame of the palm.
    #[must_use]
    pub const fn base(&self) -> &Pose {
        &self.base
    }

    /// Returns the joints of the mechanism, proximal first.
    #[must_use]
    pub const fn joints(&self) -> &[ChainJoint; N] {
        &self.joints
    }

    /// Returns the bodies of the links; body *i* is moved by joint *i*.
    #[must_use]
    pub const fn bodies(&self) -> &[ChainBody; N] {
        &self.bodies
    }

    /// Returns the position of the tip in the frame of the last link, m.
    #[must_use]
    pub const fn tip_point(&self) -> &Vector3<f64> {
        &self.tip
    }

    /// Returns a chain that ends at the link of joint number `joint` (from 0), with the origin of that link as its tip.
    /// The joints after it are fixed, so the number of joints stays the same.
    #[must_use]
    pub fn up_to(&self, joint: usize) -> Self {
        let mut part = *self;
        for after in part.joints.iter_mut().skip(joint.saturating_add(1)) {
            *after = ChainJoint {
                placement: Pose::identity(),
                motion: ChainMotion::Fixed,
            };
        }
        part.tip = Vector3::zeros();
        part
    }
}

impl ChainBody {
    /// Returns a body with zero mass and zero inertia, for a chain of which only the kinematics is
    /// used.
    #[must_use]
    pub fn massless() -> Self {
        Self {
            mass: 0.0,
            center: Vector3::zeros(),
            inertia: Matrix3::zeros(),
        }
    }

    /// Checks that link `link` can be this body.
    pub(super) fn check(&self, link: usize) -> Result<(), NumberError> {
        let part = Subject::Link(link as u16);
        not_negative("the mass, kg,", self.mass).map_err(|error| error.at(part))?;
        check::position(part, &self.center)?;
        check::inertia(link, &self.inertia)
    }
}
