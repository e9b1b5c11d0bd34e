use core::fmt;

use thiserror::Error;

use crate::NumberError;

/// The quantity of a grasp that an error is about, such as the position of a tip.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum GraspQuantity {
    /// The position of a tip.
    Tip,
    /// The desired position of a tip.
    DesiredTip,
    /// The motion or velocity of a tip.
    TipMotion,
    /// The Jacobian of a finger.
    Jacobian,
    /// The gravity torque of a finger.
    GravityTorque,
    /// The direction of the self-motion of a finger.
    SelfMotion,
    /// The position of a joint, rad.
    JointPosition,
    /// The rate of a joint, rad/s.
    JointRate,
    /// The force of a finger.
    Force,
    /// The direction in which a squeeze pushes.
    SqueezeDirection,
    /// The torque of a joint.
    Torque,
}

impl fmt::Display for GraspQuantity {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str(match self {
            Self::Tip => "tip position",
            Self::DesiredTip => "desired tip position",
            Self::TipMotion => "tip motion",
            Self::Jacobian => "Jacobian",
            Self::GravityTorque => "gravity torque",
            Self::SelfMotion => "self-motion",
            Self::JointPosition => "joint position",
            Self::JointRate => "joint rate",
            Self::Force => "force",
            Self::SqueezeDirection => "direction of squeeze",
            Self::Torque => "torque",
        })
    }
}

/// The reason why a grasp is not possible.
///
/// Fingers, contacts and joints are counted from 0.
#[derive(Clone, Copy, Debug, PartialEq, Error)]
#[non_exhaustive]
pub enum GraspError {
    /// A number of one finger is infinite or NaN.
    #[error("the {quantity} of finger {finger} is {value}")]
    NotFinite {
        /// The finger, from 0.
        finger: usize,
        /// The quantity that is infinite or NaN.
        quantity: GraspQuantity,
        /// The value of the quantity.
        value: f64,
    },
    /// A wrench, or the point it is about, is infinite or NaN.
    #[error("force {force:?} N and moment {moment:?} N m about {about:?} m are not all finite")]
    WrenchNotFinite {
        /// The force, N.
        force: [f64; 3],
        /// The moment, N m.
        moment: [f64; 3],
        /// The point, m.
        about: [f64; 3],
    },
    /// All inputs are finite, but a result exceeds the range of the type.
    #[error("the {quantity} is beyond the range of numbers")]
    TooLarge {
        /// The first result for which this is so.
        quantity: GraspQuantity,
    },
    /// The task needs more contacts.
    #[error("{contacts} contacts; this takes at least {least}")]
    TooFewContacts {
        /// The number of contacts.
        contacts: usize,
        /// The least number that the task needs.
        least: usize,
    },
    /// Two contacts are the same point, within the precision of their coordinates.
    #[error("contacts {first} and {second} are only {distance} m apart")]
    Coincident {
        /// The first of the two contacts.
        first: usize,
        /// The second of the two contacts.
        second: usize,
        /// The distance between them, m.
        distance: f64,
    },
    /// The contacts lie on one line, or nearly: no moment can be made about it.
    #[error("the contacts are nearly on one line: conditioning {conditioning}, needed {least}")]
    NearCollinear {
        /// The determinant of the contacts' inertia over the cube of a third of its trace: 1 where
        /// they are spread equally in all directions, 0 on a line.
        conditioning: f64,
        /// The limit, which it must exceed.
        least: f64,
    },
    /// One contact cannot produce a moment about itself.
    #[error("a single contact cannot make the moment {moment:?} N m about itself")]
    MomentAtOneContact {
        /// The moment about the contact, N m.
        moment: [f64; 3],
    },
    /// A normal has no direction.
    #[error("the normal of contact {contact} has the length {length}")]
    Normal {
        /// The contact, from 0.
        contact: usize,
        /// The length that was given.
        length: f64,
    },
    /// A coefficient of friction, a gain, or the centre of a ball is not possible.
    #[error(transparent)]
    Number(#[from] NumberError),
    /// No squeeze of this shape keeps every contact inside its friction cone.
    #[error(
        "no squeeze holds: the others need at least {least} N, contact {contact} allows {low} to {high} N"
    )]
    NoSqueeze {
        /// The first contact whose range has nothing in common with those before it.
        contact: usize,
        /// The least squeeze that the contacts before it permit, N.
        least: f64,
        /// The least squeeze that this contact permits, N; NaN if there is none.
        low: f64,
        /// The greatest squeeze that the contacts up to this one permit, N; NaN if there is none.
        high: f64,
    },
    /// A squeeze is along an edge, a pair of contacts, that does not exist, or would pull.
    #[error("a squeeze of {force} N between contacts {first} and {second} of {contacts}")]
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
        "the gains are not symmetric: {value} in row {row}, column {column}, and {mirrored} opposite"
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
    #[error("the gains have a negative eigenvalue: pivot {pivot} of axis {axis}")]
    NotSemidefinite {
        /// The axis whose pivot shows it: 0 to 2 along, 3 to 5 about x, y, z.
        axis: usize,
        /// The pivot of the factorisation, in units of that axis.
        pivot: f64,
    },
    /// The lower limit of a joint's torque is above zero, or the upper one is below zero.
    #[error("joint {joint} of finger {finger} has the torque limits {low} to {high} N m")]
    TorqueLimits {
        /// The finger, from 0.
        finger: usize,
        /// The joint, from 0.
        joint: usize,
        /// The lower limit, N m.
        low: f64,
        /// The upper limit, N m.
        high: f64,
    },
    /// The tips determine no rotation of the object.
    #[error("the tips determine no rotation: separation {separation}, needed {least}")]
    NoRotation {
        /// The product of the gaps between the greatest eigenvalue of the fit and the others, over
        /// the mean spread of the tips.
        separation: f64,
        /// The limit, which it must exceed.
        least: f64,
    },
}
