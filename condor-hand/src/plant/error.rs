use thiserror::Error;

use crate::decimal::Decimal;
use crate::math::is_finite;
use crate::tendon::ArmError;

/// What no plant can be made of, or has come to.
#[derive(Clone, Copy, Debug, PartialEq, Error)]
#[non_exhaustive]
pub enum PlantError {
    /// A parameter that must be above zero.
    #[error("{name} is {value}; it must be finite and above zero", value = Decimal(*.value))]
    NotPositive {
        /// What it is, with its unit.
        name: &'static str,
        /// Its value.
        value: f64,
    },
    /// A parameter that must not be below zero.
    #[error("{name} is {value}; it must be finite and not below zero", value = Decimal(*.value))]
    Negative {
        /// What it is, with its unit.
        name: &'static str,
        /// Its value.
        value: f64,
    },
    /// A parameter or a state that is no finite number.
    #[error("{name} is {value}; it must be finite", value = Decimal(*.value))]
    NotFinite {
        /// What it is, with its unit.
        name: &'static str,
        /// Its value.
        value: f64,
    },
    /// A range whose ends are not in order.
    #[error(
        "{name} is from {low} to {high}; the first must be below the second",
        low = Decimal(*.low),
        high = Decimal(*.high),
    )]
    Range {
        /// What it is, with its unit.
        name: &'static str,
        /// Its lower end.
        low: f64,
        /// Its upper end.
        high: f64,
    },
    /// A mass matrix with which no torque gives an acceleration.
    #[error(
        "the mass matrix is not positive definite at joint positions that begin {first} rad",
        first = Decimal(*.first),
    )]
    Massless {
        /// The position of the first joint, rad.
        first: f64,
    },
    /// A parameter that must be zero.
    #[error("{name} is {value}; it must be zero", value = Decimal(*.value))]
    NotZero {
        /// What it is, with its unit.
        name: &'static str,
        /// Its value.
        value: f64,
    },
    /// A finger that the hand does not have.
    #[error("there is no finger {finger}; the hand has {fingers}")]
    NoFinger {
        /// Its number, from 0.
        finger: usize,
        /// How many there are.
        fingers: usize,
    },
    /// A channel that the bank does not have.
    #[error("there is no channel {channel}; the bank has {channels}")]
    NoChannel {
        /// Its number, from 0.
        channel: usize,
        /// How many there are.
        channels: usize,
    },
    /// A converter of no size that is known.
    #[error("a converter has {bits} bits; it must have 1 to 32")]
    Bits {
        /// Its size.
        bits: u8,
    },
    /// Moment arms that no finger can have.
    #[error(transparent)]
    Arms(#[from] ArmError),
    /// An axis of a table that the simulated one cannot have.
    #[error(
        "an axis along ({x}, {y}, {z}); each must lie along another of x, y and z",
        x = Decimal(*.x),
        y = Decimal(*.y),
        z = Decimal(*.z),
    )]
    Direction {
        /// Of its direction.
        x: f64,
        /// Of its direction.
        y: f64,
        /// Of its direction.
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
