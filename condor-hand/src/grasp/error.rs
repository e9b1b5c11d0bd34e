use thiserror::Error;

use crate::decimal::Decimal;
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

/// The error of a result that is beyond the range of the type, although all inputs are finite.
#[cold]
pub(super) fn too_large(what: &'static str) -> GraspError {
    GraspError::Number(NumberError {
        at: Subject::Whole,
        what,
        value: f64::INFINITY,
        must: Requirement::Finite,
    })
}

/// The reason why a grasp is not possible.
///
/// Fingers, contacts and joints are counted from 0.
#[derive(Clone, Copy, Debug, PartialEq, Error)]
#[non_exhaustive]
pub enum GraspError {
    /// A number is not possible: one of a finger or of a wrench that is not finite, a result beyond the range of the
    /// type, a coefficient of friction, a gain, a limit of a torque, or a normal without a direction.
    #[error(transparent)]
    Number(#[from] NumberError),
    /// The task needs more contacts.
    #[error("there are {contacts} contacts; this takes at least {least}")]
    TooFewContacts {
        /// The number of contacts.
        contacts: usize,
        /// The least number that the task needs.
        least: usize,
    },
    /// Two contacts are the same point, within the precision of their coordinates.
    #[error("contacts {first} and {second} are only {} m apart; move them apart", Decimal(*.distance))]
    Coincident {
        /// The first of the two contacts.
        first: usize,
        /// The second of the two contacts.
        second: usize,
        /// The distance between them, m.
        distance: f64,
    },
    /// The contacts lie on one line, or nearly: no moment can be made about it.
    #[error(
        "the contacts are nearly on one line: their conditioning is {}, and it must be above {}",
        Decimal(*.conditioning),
        Decimal(*.least),
    )]
    NearCollinear {
        /// The determinant of the contacts' inertia over the cube of a third of its trace: 1 where
        /// they are spread equally in all directions, 0 on a line.
        conditioning: f64,
        /// The limit, which it must exceed.
        least: f64,
    },
    /// One contact cannot produce a moment about itself.
    #[error(
        "a single contact cannot make the moment ({x}, {y}, {z}) N m about itself",
        x = Decimal(.moment[0]), y = Decimal(.moment[1]), z = Decimal(.moment[2]),
    )]
    MomentAtOneContact {
        /// The moment about the contact, N m.
        moment: [f64; 3],
    },
    /// A squeeze is along an edge, a pair of contacts, that does not exist, or would pull.
    #[error(
        "a squeeze of {force} N between contacts {first} and {second}: the force must be at least 0, and the contacts two \
         different ones of the {contacts}, counted from 0",
        force = Decimal(*.force),
    )]
    SqueezeEdge {
        /// The contact at one end of the edge.
        first: usize,
        /// The contact at the other end.
        second: usize,
        /// The number of contacts.
        contacts: usize,
        /// The force, N.
        force: f64,
    },
    /// A matrix of gains is not symmetric: its spring would be a source of energy.
    #[error(
        "the gains are not symmetric: {value} in row {row}, column {column}, and {mirrored} opposite",
        value = Decimal(*.value), mirrored = Decimal(*.mirrored),
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
    /// A matrix of gains has a negative eigenvalue: it would push the object away.
    #[error("the gains have a negative eigenvalue, which would push the object away: axis {axis} (0 to 2 along \
     x, y, z; 3 to 5 about them) has the pivot {}; raise the gain of this axis on the diagonal", Decimal(*.pivot))]
    NotSemidefinite {
        /// The axis whose pivot shows it: 0 to 2 along, 3 to 5 about x, y, z.
        axis: usize,
        /// The pivot of the factorisation, in units of that axis.
        pivot: f64,
    },
    /// The tips determine no rotation of the object.
    #[error(
        "the fingertips are too close together, or nearly on one line, to determine a rotation: the measure of that is {}, \
         and must be above {}",
        Decimal(*.separation),
        Decimal(*.least),
    )]
    NoRotation {
        /// The product of the gaps between the greatest eigenvalue of the fit and the others, over
        /// the mean spread of the tips.
        separation: f64,
        /// The limit, which it must exceed.
        least: f64,
    },
}
