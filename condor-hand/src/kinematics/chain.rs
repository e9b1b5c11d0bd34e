use core::fmt;

use nalgebra::{Matrix3, Vector3};
use thiserror::Error;

use crate::math::{abs, is_finite, max, real, sqrt};
use crate::{Pose, Real};

/// The motion of a link's frame relative to that of the link before it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Motion<T: Real = f64> {
    /// Rotates about this unit axis, rad.
    Revolute(Vector3<T>),
    /// Slides along this unit axis, m.
    Prismatic(Vector3<T>),
    /// Does not move: it fills the place of a joint that this mechanism does not have. Its column
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
    /// Mass, kg.
    pub mass: T,
    /// Centre of mass, m.
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

/// A part of a chain.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Part {
    /// The pose of the base.
    Base,
    /// A joint, from 0: its placement and its axis.
    Joint(usize),
    /// The body that a joint moves, from 0.
    Body(usize),
    /// The tip.
    Tip,
}

/// The reason for which no mechanism can have these numbers.
#[derive(Clone, Copy, Debug, PartialEq, Error)]
#[non_exhaustive]
pub enum ChainError {
    /// A number is infinite or NaN.
    #[error("{part} has the number {value}, which is not finite")]
    NotFinite {
        /// The part of the chain.
        part: Part,
        /// The number.
        value: f64,
    },
    /// An axis is not of unit length.
    #[error("joint {joint} has an axis of length {length}; it must be 1")]
    Axis {
        /// The joint, from 0.
        joint: usize,
        /// The length of its axis.
        length: f64,
    },
    /// The columns of a rotation are not of unit length and at right angles.
    #[error("the rotation of {part} is off by {deviation} from orthonormal axes")]
    NotOrthonormal {
        /// The base or a joint.
        part: Part,
        /// The largest entry of `RᵀR - 1`.
        deviation: f64,
    },
    /// The axes of a rotation are left-handed.
    #[error("the rotation of {part} has the determinant {determinant}: a mirror image")]
    Mirrored {
        /// The base or a joint.
        part: Part,
        /// The determinant; that of a rotation is 1.
        determinant: f64,
    },
    /// The mass of a body is negative.
    #[error("the body of joint {joint} has a mass of {mass} kg")]
    Mass {
        /// The joint, from 0.
        joint: usize,
        /// Its mass, kg.
        mass: f64,
    },
}

impl fmt::Display for Part {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Base => formatter.write_str("the base"),
            Self::Joint(joint) => write!(formatter, "joint {joint}"),
            Self::Body(joint) => write!(formatter, "the body of joint {joint}"),
            Self::Tip => formatter.write_str("the tip"),
        }
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

impl<T: Real, const N: usize> Chain<T, N> {
    /// Checks whether the numbers are those of a mechanism: finite, with axes of unit length and
    /// right-handed orthonormal rotations, all to 1e-9 (1e-5 for `f32`).
    ///
    /// No other method checks the numbers; so call this once, where they come in.
    ///
    /// # Errors
    ///
    /// [`ChainError`] for the first wrong number, from the base to the tip.
    pub fn check(&self) -> Result<(), ChainError> {
        check_pose(&self.base, Part::Base)?;
        for (joint, Joint { placement, motion }) in self.joints.iter().enumerate() {
            check_pose(placement, Part::Joint(joint))?;
            let (Motion::Revolute(axis) | Motion::Prismatic(axis)) = motion else {
                continue;
            };
            check_finite(axis.iter(), Part::Joint(joint))?;
            let length = sqrt(axis.norm_squared());
            if abs(length - T::one()) > tolerance() {
                let length = length.to_f64();
                return Err(ChainError::Axis { joint, length });
            }
        }
        for (joint, body) in self.bodies.iter().enumerate() {
            let numbers = body.center.iter().chain(body.inertia.iter());
            check_finite(numbers.chain([&body.mass]), Part::Body(joint))?;
            if body.mass < T::zero() {
                let mass = body.mass.to_f64();
                return Err(ChainError::Mass { joint, mass });
            }
        }
        check_finite(self.tip.iter(), Part::Tip)
    }
}

fn check_pose<T: Real>(pose: &Pose<T>, part: Part) -> Result<(), ChainError> {
    check_finite(pose.rotation.iter().chain(pose.position.iter()), part)?;
    let deviation = (pose.rotation.transpose() * pose.rotation - Matrix3::identity())
        .iter()
        .fold(T::zero(), |most, &entry| max(abs(entry), most));
    if deviation > tolerance() {
        let deviation = deviation.to_f64();
        return Err(ChainError::NotOrthonormal { part, deviation });
    }
    let determinant = pose.rotation.determinant();
    if determinant < T::zero() {
        let determinant = determinant.to_f64();
        return Err(ChainError::Mirrored { part, determinant });
    }
    Ok(())
}

fn check_finite<'a, T: Real>(
    numbers: impl IntoIterator<Item = &'a T>,
    part: Part,
) -> Result<(), ChainError> {
    match numbers.into_iter().find(|&&number| !is_finite(number)) {
        Some(number) => {
            let value = number.to_f64();
            Err(ChainError::NotFinite { part, value })
        }
        None => Ok(()),
    }
}

/// Rounding of what a person or another program computed in the same type.
fn tolerance<T: Real>() -> T {
    max(real::<T>(1e-9), real::<T>(84.0) * T::default_epsilon())
}
