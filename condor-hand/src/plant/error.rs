use thiserror::Error;

use crate::decimal::Decimal;
use crate::number::{NumberError, Requirement, check, finite};
use crate::tendon::ArmError;

/// The reason why a plant cannot be made, or cannot move on.
#[derive(Clone, Copy, Debug, PartialEq, Error)]
#[non_exhaustive]
pub enum PlantError {
    /// A parameter or a state is not possible.
    #[error(transparent)]
    Number(#[from] NumberError),
    /// A mass matrix is not positive definite, so no torque determines an acceleration.
    #[error(
        "the mass matrix is not positive definite at joint positions that begin {first} rad",
        first = Decimal(*.first),
    )]
    Massless {
        /// The position of the first joint, rad.
        first: f64,
    },
    /// The hand does not have the finger.
    #[error("there is no finger {finger}; the hand has {fingers}")]
    NoFinger {
        /// Its number, from 0.
        finger: usize,
        /// The number of fingers.
        fingers: usize,
    },
    /// The bank of sensors does not have the channel.
    #[error("there is no channel {channel}; the bank has {channels}")]
    NoChannel {
        /// Its number, from 0.
        channel: usize,
        /// The number of channels.
        channels: usize,
    },
    /// No finger can have these moment arms.
    #[error(transparent)]
    Arms(#[from] ArmError),
    /// The simulated table cannot have an axis of this direction.
    #[error(
        "an axis along ({x}, {y}, {z}); each must lie along another of x, y and z",
        x = Decimal(*.x),
        y = Decimal(*.y),
        z = Decimal(*.z),
    )]
    Direction {
        /// The x component of the direction.
        x: f64,
        /// The y component of the direction.
        y: f64,
        /// The z component of the direction.
        z: f64,
    },
}

pub(super) fn all_finite<'a>(
    what: &'static str,
    values: impl IntoIterator<Item = &'a f64>,
) -> Result<(), NumberError> {
    values
        .into_iter()
        .try_for_each(|&value| finite(what, value))
}

/// Refuses a range whose ends are not in order.
pub(super) fn ordered(what: &'static str, (low, high): (f64, f64)) -> Result<(), NumberError> {
    finite(what, low)?;
    check(what, high, Requirement::Above(low))
}
