use thiserror::Error;

use crate::decimal::Decimal;
use crate::math::is_finite;
use crate::tendon::ArmError;

/// The reason for which a plant cannot be made, or cannot move on.
#[derive(Clone, Copy, Debug, PartialEq, Error)]
#[non_exhaustive]
pub enum PlantError {
    /// A parameter must be above zero.
    #[error("{name} is {value}; it must be finite and above zero", value = Decimal(*.value))]
    NotPositive {
        /// The parameter, with its unit.
        name: &'static str,
        /// Its value.
        value: f64,
    },
    /// A parameter must not be below zero.
    #[error("{name} is {value}; it must be finite and not below zero", value = Decimal(*.value))]
    Negative {
        /// The parameter, with its unit.
        name: &'static str,
        /// Its value.
        value: f64,
    },
    /// A parameter or a state is not finite.
    #[error("{name} is {value}; it must be finite", value = Decimal(*.value))]
    NotFinite {
        /// The parameter or state, with its unit.
        name: &'static str,
        /// Its value.
        value: f64,
    },
    /// The ends of a range are not in order.
    #[error(
        "{name} is from {low} to {high}; the first must be below the second",
        low = Decimal(*.low),
        high = Decimal(*.high),
    )]
    Range {
        /// The range, with its unit.
        name: &'static str,
        /// Its lower end.
        low: f64,
        /// Its upper end.
        high: f64,
    },
    /// A mass matrix is not positive definite, so no torque determines an acceleration.
    #[error(
        "the mass matrix is not positive definite at joint positions that begin {first} rad",
        first = Decimal(*.first),
    )]
    Massless {
        /// The position of the first joint, rad.
        first: f64,
    },
    /// A parameter must be zero.
    #[error("{name} is {value}; it must be zero", value = Decimal(*.value))]
    NotZero {
        /// The parameter, with its unit.
        name: &'static str,
        /// Its value.
        value: f64,
    },
    /// The hand does not have the finger.
    #[error("there is no finger {finger}; the hand has {fingers}")]
    NoFinger {
        /// Its number, from 0.
        finger: usize,
        /// The number of fingers.
        fingers: usize,
    },
    /// The bank does not have the channel.
    #[error("there is no channel {channel}; the bank has {channels}")]
    NoChannel {
        /// Its number, from 0.
        channel: usize,
        /// The number of channels.
        channels: usize,
    },
    /// The width of a converter is not possible.
    #[error("a converter has {bits} bits; it must have 1 to 32")]
    Bits {
        /// The width, in bits.
        bits: u8,
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

pub(super) fn positive(name: &'static str, value: f64) -> Result<(), PlantError> {
    if is_finite(value) && value > 0.0 {
        Ok(())
    } else {
        Err(PlantError::NotPositive { name, value })
    }
}

pub(super) fn not_negative(name: &'static str, value: f64) -> Result<(), PlantError> {
    if is_finite(value) && value >= 0.0 {
        Ok(())
    } else {
        Err(PlantError::Negative { name, value })
    }
}

pub(super) fn finite(name: &'static str, value: f64) -> Result<(), PlantError> {
    if is_finite(value) {
        Ok(())
    } else {
        Err(PlantError::NotFinite { name, value })
    }
}

pub(super) fn all_finite<'a>(
    name: &'static str,
    values: impl IntoIterator<Item = &'a f64>,
) -> Result<(), PlantError> {
    values
        .into_iter()
        .try_for_each(|&value| finite(name, value))
}

pub(super) fn ordered(name: &'static str, (low, high): (f64, f64)) -> Result<(), PlantError> {
    if is_finite(low) && is_finite(high) && low < high {
        Ok(())
    } else {
        Err(PlantError::Range { name, low, high })
    }
}
