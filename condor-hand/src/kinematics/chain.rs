use nalgebra::{Matrix3, Vector3};

use crate::{Pose, Real};

/// The motion of a link's frame relative to that of the link before it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Motion<T: Real = f64> {
    /// The link rotates about this unit axis, rad.
    Revolute(Vector3<T>),
    /// The link slides along this unit axis, m.
    Prismatic(Vector3<T>),
    /// The link does not move: it stands for a joint that this mechanism does not have. Its column
    /// of a Jacobian is zero.
    Fixed,
}

/// A joint, with its place on the link before it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Joint<T: Real = f64> {
    /// The frame of the link at the joint's zero, in the frame of the link before it.
    pub placement: Pose<T>,
    /// Its motion from there; the axis is in the frame of the link.
    pub motion: Motion<T>,
}

/// A rigid body, in the frame of its link.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Body<T: Real = f64> {
    /// The mass, kg.
    pub mass: T,
    /// The centre of mass, m.
    pub center: Vector3<T>,
    /// Inertia about the centre of mass in the axes of the link, kg m².
    pub inertia: Matrix3<T>,
}

/// Any serial mechanism of N joints: the product of constant placements and of one motion each.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Chain<T: Real, const N: usize> {
    /// The base of the mechanism in the palm.
    pub base: Pose<T>,
    /// The joints, proximal first.
    pub joints: [Joint<T>; N],
    /// The bodies that the joints move; their mass is zero if only kinematics is needed.
    pub bodies: [Body<T>; N],
    /// The tip, a point of the last link, m.
    pub tip: Vector3<T>,
}

impl<T: Real, const N: usize> Chain<T, N> {
    /// Returns the part of the chain up to the link of a joint, with the origin of that link as its tip.
    /// The joints after it are fixed.
    #[must_use]
    pub fn up_to(&self, joint: usize) -> Self {
        let mut part = *self;
        for after in part.joints.iter_mut().skip(joint.saturating_add(1)) {
            *after = Joint {
                placement: Pose::identity(),
                motion: Motion::Fixed,
            };
        }
        part.tip = Vector3::zeros();
        part
    }
}

impl<T: Real> Body<T> {
    /// Returns a body without mass.
    #[must_use]
    pub fn massless() -> Self {
        Self {
            mass: T::zero(),
            center: Vector3::zeros(),
            inertia: Matrix3::zeros(),
        }
    }
}
