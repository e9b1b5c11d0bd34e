//! The conditions on a mechanism under which its equations hold.

use core::fmt;

use nalgebra::{Matrix3, Vector3};
use thiserror::Error;

use crate::decimal::Decimal;
use crate::math::{Real, abs, is_finite, max, sqrt};
use crate::number::{self, NumberError};
use crate::pose::Pose;

/// The reason why a mechanism is refused.
#[derive(Clone, Copy, Debug, PartialEq, Error)]
pub enum MechanismError {
    /// The axis of a joint is not a unit vector.
    #[error(
        "the axis of joint {joint} has the length {length}; it must be 1: divide the axis by its length",
        length = Decimal(*.length)
    )]
    Axis {
        /// The joint, from 0.
        joint: usize,
        /// The length of its axis; not finite if the axis is not.
        length: f64,
    },
    /// The rotation of a pose does not only turn.
    #[error(
        "the rotation of {part} is off by {off} from an orthonormal right-handed matrix; its columns \
         must be unit vectors at right angles, x, y and z = x × y",
        off = Decimal(*.off)
    )]
    Rotation {
        /// The part of the mechanism.
        part: Part,
        /// The largest entry of `RᵀR - 1`, or of the difference of the determinant from 1.
        off: f64,
    },
    /// A number is outside of what it may be.
    #[error("{part}: {error}")]
    Number {
        /// The part of the mechanism.
        part: Part,
        /// The number, and what it must be.
        error: NumberError,
    },
    /// No body has this inertia.
    #[error(
        "link {link} has the moments of inertia {x}, {y} and {z} kg m²; the matrix must be symmetric, \
         without negative moments in any axes, and none may exceed the sum of the two others",
        x = Decimal(.moments[0]), y = Decimal(.moments[1]), z = Decimal(.moments[2])
    )]
    Inertia {
        /// The link, from 0.
        link: usize,
        /// The diagonal of the matrix, kg m².
        moments: [f64; 3],
    },
}

/// A part of a mechanism, for errors.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Part {
    /// The base of the finger in the palm.
    Base,
    /// The placement of a joint, from 0.
    Placement(usize),
    /// A link and its body, from 0.
    Link(usize),
    /// The tip of the finger on its last link.
    Tip,
}

impl fmt::Display for Part {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Base => f.write_str("the base"),
            Self::Placement(joint) => write!(f, "the placement of joint {joint}"),
            Self::Link(link) => write!(f, "link {link}"),
            Self::Tip => f.write_str("the tip"),
        }
    }
}

impl Part {
    /// An error about a number of this part.
    pub(super) fn of<T>(self, checked: Result<T, NumberError>) -> Result<T, MechanismError> {
        checked.map_err(|error| MechanismError::Number { part: self, error })
    }
}

/// The largest error of an entry of an orthonormal matrix: people write ten digits, and `f32` has seven.
fn tolerance<T: Real>() -> f64 {
    if T::of(1.0 + 1e-9).to_f64() > 1.0 {
        1e-9
    } else {
        1e-6
    }
}

pub(super) fn position<T: Real>(part: Part, at: &Vector3<T>) -> Result<(), MechanismError> {
    part.of(at
        .iter()
        .try_for_each(|&x| number::finite("a coordinate, m,", x)))
}

pub(super) fn pose<T: Real>(part: Part, pose: &Pose<T>) -> Result<(), MechanismError> {
    position(part, &pose.position)?;
    let mut entries = pose.rotation.iter();
    part.of(entries.try_for_each(|&x| number::finite("an entry of the rotation", x)))?;
    let rotation = pose.rotation.map(T::to_f64);
    let product = rotation.tr_mul(&rotation) - Matrix3::identity();
    let turned = abs(rotation.determinant() - 1.0);
    let off = product
        .iter()
        .fold(turned, |off, &entry| max(off, abs(entry)));
    if off <= tolerance::<T>() {
        return Ok(());
    }
    Err(MechanismError::Rotation { part, off })
}

pub(super) fn axis<T: Real>(joint: usize, axis: &Vector3<T>) -> Result<(), MechanismError> {
    let axis = axis.map(T::to_f64);
    let length = sqrt(axis.dot(&axis));
    if abs(length - 1.0) <= tolerance::<T>() {
        return Ok(());
    }
    Err(MechanismError::Axis { joint, length })
}

pub(super) fn inertia<T: Real>(link: usize, inertia: &Matrix3<T>) -> Result<(), MechanismError> {
    let inertia = inertia.map(T::to_f64);
    if is_inertia(&inertia, tolerance::<T>()) {
        return Ok(());
    }
    let moments = inertia.diagonal().into();
    Err(MechanismError::Inertia { link, moments })
}

/// Returns whether a body, perhaps a flat one, a thin one or a point, can have this inertia, up to
/// `slack` of its trace. With `S = tr(I)/2 - I`, the second moments of its mass, this is: `S` is
/// symmetric and has no negative principal minor.
pub(crate) fn is_inertia(inertia: &Matrix3<f64>, slack: f64) -> bool {
    let trace = inertia.trace();
    if inertia.iter().all(|&entry| entry == 0.0) {
        return true;
    }
    if !(is_finite(trace) && trace > 0.0) {
        return false;
    }
    // Of the scale of one, so that small bodies do not underflow.
    let scaled = inertia / trace;
    let second = Matrix3::from_diagonal_element(0.5) - scaled;
    let minor = |a: f64, b: f64, c: f64| a * b - c * c;
    let (x, y, z) = (second.m11, second.m22, second.m33);
    [
        x,
        y,
        z,
        minor(x, y, second.m12),
        minor(x, z, second.m13),
        minor(y, z, second.m23),
        second.determinant(),
        -abs(scaled.m12 - scaled.m21),
        -abs(scaled.m13 - scaled.m31),
        -abs(scaled.m23 - scaled.m32),
    ]
    .iter()
    .all(|&at_least_zero| at_least_zero >= -slack)
}
