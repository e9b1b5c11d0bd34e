use thiserror::Error;

use crate::decimal::Decimal;
use crate::kinematics::Side;
use crate::number::NumberError;

/// A deviation of a tip from the pose that it should have: a distance and an angle.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PathDeviation {
    /// The distance, m.
    pub position: f64,
    /// The angle, rad.
    pub rotation: f64,
}

/// The reason why no joints take a tip along a path. `fraction` is the place on the path, from 0 to 1; joints are counted
/// from 0.
#[derive(Clone, Copy, Debug, PartialEq, Error)]
#[non_exhaustive]
pub enum JointPathError {
    /// A number is not possible.
    #[error(transparent)]
    Number(#[from] NumberError),
    /// No joint is at a limit, and yet the tip does not come to the path: the pose there is out of reach, or singular.
    #[error(
        "at {} of the path the tip comes no nearer than {} m and {} rad; move the path into the reach of the mechanism",
        Decimal(*.fraction), Decimal(.off.position), Decimal(.off.rotation)
    )]
    OutOfReach {
        /// The place on the path.
        fraction: f64,
        /// The error that remains there.
        off: PathDeviation,
    },
    /// A limit of a joint keeps the tip off the path.
    #[error(
        "at {} of the path joint {joint} is at its {} limit, which keeps the tip {} m and {} rad off; start from another \
         posture",
        Decimal(*.fraction), .side.name(), Decimal(.off.position), Decimal(.off.rotation)
    )]
    Limit {
        /// The place on the path.
        fraction: f64,
        /// The joint that is at a limit.
        joint: usize,
        /// The limit at which it is.
        side: Side,
        /// The error that remains there.
        off: PathDeviation,
    },
    /// A joint would have to jump: the path passes a singular posture, or the end of a branch.
    #[error(
        "at {} of the path joint {joint} would have to jump by {} rad: a singular posture is near; start from another \
         posture",
        Decimal(*.fraction), Decimal(*.by)
    )]
    Jump {
        /// The place on the path.
        fraction: f64,
        /// The joint that moves most.
        joint: usize,
        /// The change of its position within a short part of the path, rad or m.
        by: f64,
    },
    /// Between the via points that a motion can have the tip would leave the path by too much.
    #[error(
        "at {} of the path the tip would be {} m and {} rad off; divide the path, or permit more",
        Decimal(*.fraction), Decimal(.off.position), Decimal(.off.rotation)
    )]
    Deviation {
        /// The place on the path.
        fraction: f64,
        /// The deviation there.
        off: PathDeviation,
    },
}

impl Side {
    /// The name of the side in an error.
    const fn name(self) -> &'static str {
        match self {
            Self::Low => "lower",
            Self::High => "upper",
        }
    }
}
