use thiserror::Error;

use crate::decimal::Decimal;
use crate::math::max;
use crate::number::count;
use crate::{NumberError, Requirement, Subject};

/// The numbers of a grasp, as errors name them.
pub(super) mod quantity {
    pub(in crate::grasp) const TIP: &str = "the position of the tip, m,";
    pub(in crate::grasp) const DESIRED_TIP: &str = "the desired position of the tip, m,";
    pub(in crate::grasp) const TIP_MOTION: &str = "the motion of the tip, m or m/s,";
    pub(in crate::grasp) const JACOBIAN: &str = "the Jacobian";
    pub(in crate::grasp) const GRAVITY_TORQUE: &str = "the gravity torque, N m,";
    pub(in crate::grasp) const SELF_MOTION: &str = "the self-motion";
    pub(in crate::grasp) const JOINT_POSITION: &str = "the joint position, rad,";
    pub(in crate::grasp) const JOINT_RATE: &str = "the joint rate, rad/s,";
    pub(in crate::grasp) const FORCE: &str = "the force, N,";
    pub(in crate::grasp) const TORQUE: &str = "the torque, N m,";
}

/// The error of a number of the whole grasp.
#[cold]
pub(super) fn off(what: &'static str, value: f64, must: Requirement) -> GraspError {
    GraspError::Number(NumberError {
        at: Subject::Whole,
        what,
        value,
        must,
    })
}

/// The error of a result that is beyond the range of the type, although all inputs are finite.
#[cold]
pub(super) fn too_large(what: &'static str) -> GraspError {
    off(what, f64::INFINITY, Requirement::Finite)
}

/// The error of a task that takes more contacts.
#[cold]
pub(super) fn too_few(contacts: usize, least: f64) -> GraspError {
    let must = Requirement::AtLeast(least);
    off("the number of contacts", count(contacts), must)
}

/// The error of a contact that is at the same point as another one, within the precision of their coordinates.
#[cold]
pub(super) fn coincident(contact: usize, distance: f64, least: f64) -> GraspError {
    GraspError::Number(NumberError {
        at: Subject::Contact(contact as u16),
        what: "its distance from another contact, m,",
        value: distance,
        must: Requirement::Above(max(distance, least)),
    })
}

/// The reason why a grasp is not possible.
///
/// Fingers, contacts and joints are counted from 0.
#[derive(Clone, Copy, Debug, PartialEq, Error)]
#[non_exhaustive]
pub enum GraspError {
    /// A number is not possible: one of a finger or of a wrench that is not finite, a result beyond the range of the
    /// type, a coefficient of friction, a gain, a limit of a torque, a normal without a direction; too few contacts,
    /// contacts at one point or on a line, a moment about a single contact, gains with a negative eigenvalue, or tips
    /// that determine no rotation.
    #[error(transparent)]
    Number(#[from] NumberError),
    /// A matrix of gains is not symmetric: its spring would be a source of energy.
    #[error(
        "the gains are not symmetric: {value} in row {}, column {}, is not {mirrored} in row {}, column {}; make them \
         the same",
        row + 1, column + 1, column + 1, row + 1, value = Decimal(*.value), mirrored = Decimal(*.mirrored),
    )]
    NotSymmetric {
        /// The row of the matrix, from 0.
        row: usize,
        /// The column of the matrix, from 0.
        column: usize,
        /// The gain at that row and column.
        value: f64,
        /// The gain with row and column exchanged.
        mirrored: f64,
    },
}
