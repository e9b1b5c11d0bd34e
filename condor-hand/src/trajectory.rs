//! From motions that are asked for to smooth set-points of joints.
//!
//! Three layers, each useful alone. Profiles are functions of time: [`Polynomial`], [`Segments`] and
//! [`Spline`], with their exact extremes. A [`Generator`] takes a queue of [`Primitive`]s and gives
//! set-points at the master's rate, within the limits of every joint. An [`Interpolator`] fills in the
//! servo's rate between them, and stays smooth when a tick is late.
//!
//! Positions are in rad (m for a prismatic joint), time is in s; time is counted in ticks, no clock is
//! read.

#![allow(
    clippy::neg_cmp_op_on_partial_ord,
    reason = "what compares with a NaN is to fall on the side that refuses"
)]

mod generator;
pub mod image;
mod interpolator;
#[cfg(feature = "text")]
pub mod motion;
mod path;
mod plan;
mod polynomial;
mod primitive;
mod root;
mod running;
mod segments;
mod spline;

// Profiles.
pub use polynomial::Polynomial;
pub use segments::{Bounds, Segments};
pub use spline::Spline;

// Motions.
pub use generator::{Ended, Event, Generator, Happening, Progress, Ticket};
pub use primitive::{
    Begin, Guard, Guards, MAX_VIAS, Observations, OnEnd, Pace, Primitive, PrimitiveError, Profile,
    Target, Via,
};

// The servo's side.
pub use interpolator::{Interpolator, SetPointError, Timing};

use thiserror::Error;

use crate::decimal::Decimal;
use crate::math::{Real, abs, is_finite, max, min};

/// Where a joint has to be, and how it moves there.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct SetPoint<T> {
    /// rad
    pub position: T,
    /// rad/s
    pub velocity: T,
    /// rad/s²
    pub acceleration: T,
}

impl<T: Real> SetPoint<T> {
    /// At rest.
    #[must_use]
    pub fn rest(position: T) -> Self {
        Self {
            position,
            velocity: T::zero(),
            acceleration: T::zero(),
        }
    }

    /// Neither moves nor is about to.
    #[must_use]
    pub fn is_rest(&self) -> bool {
        self.velocity == T::zero() && self.acceleration == T::zero()
    }

    fn is_finite(&self) -> bool {
        is_finite(self.position) && is_finite(self.velocity) && is_finite(self.acceleration)
    }
}

/// What a joint may do.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Limits<T> {
    /// The least position, rad.
    pub low: T,
    /// The greatest position, rad.
    pub high: T,
    /// Speed to both sides, rad/s.
    pub velocity: T,
    /// Acceleration to both sides, rad/s².
    pub acceleration: T,
    /// Jerk to both sides, rad/s³; only [`Profile::JerkLimited`] keeps it.
    pub jerk: T,
}

/// Limits that no joint can have.
#[derive(Clone, Copy, Debug, PartialEq, Error)]
#[non_exhaustive]
pub enum TrajectoryError {
    /// The range of positions is empty or not finite.
    #[error(
        "joint {joint} may be in {low}..={high} rad; low must be below high, both finite",
        low = Decimal(*.low),
        high = Decimal(*.high),
    )]
    Range {
        /// The joint, from 0.
        joint: usize,
        /// The least position, rad.
        low: f64,
        /// The greatest position, rad.
        high: f64,
    },
    /// A rate that is not above zero, or not finite.
    #[error(
        "the limit {value} of the {quantity} of joint {joint} must be above zero and finite",
        value = Decimal(*.value),
    )]
    Rate {
        /// The joint, from 0.
        joint: usize,
        /// Which derivative.
        quantity: Quantity,
        /// The limit.
        value: f64,
    },
    /// A start that is not finite.
    #[error("joint {joint} starts at {value} rad", value = Decimal(*.value))]
    Start {
        /// The joint, from 0.
        joint: usize,
        /// The position, rad.
        value: f64,
    },
    /// A tick that does not last.
    #[error("a tick of {value} s must be above zero and finite", value = Decimal(*.value))]
    Tick {
        /// Its duration, s.
        value: f64,
    },
    /// An interpolator that would never move.
    #[error("a tick must have a substep")]
    Substeps,
}

/// A derivative of a position.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
pub enum Quantity {
    /// rad/s
    #[error("velocity")]
    Velocity,
    /// rad/s²
    #[error("acceleration")]
    Acceleration,
    /// rad/s³
    #[error("jerk")]
    Jerk,
}

impl<T: Real> Limits<T> {
    /// # Errors
    ///
    /// What is not finite, an empty range, and a rate that is not above zero.
    pub fn validate(&self, joint: usize) -> Result<(), TrajectoryError> {
        if !(is_finite(self.low) && is_finite(self.high) && self.low < self.high) {
            return Err(TrajectoryError::Range {
                joint,
                low: self.low.to_f64(),
                high: self.high.to_f64(),
            });
        }
        for (quantity, value) in [
            (Quantity::Velocity, self.velocity),
            (Quantity::Acceleration, self.acceleration),
            (Quantity::Jerk, self.jerk),
        ] {
            if !(is_finite(value) && value > T::zero()) {
                let value = value.to_f64();
                return Err(TrajectoryError::Rate {
                    joint,
                    quantity,
                    value,
                });
            }
        }
        Ok(())
    }
}

/// The extremes of a profile from its beginning to its end.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Peaks<T> {
    /// The least position, rad.
    pub low: T,
    /// The greatest position, rad.
    pub high: T,
    /// The greatest speed to either side, rad/s.
    pub velocity: T,
    /// The greatest acceleration to either side, rad/s².
    pub acceleration: T,
}

impl<T: Real> Peaks<T> {
    fn of(point: &SetPoint<T>) -> Self {
        Self {
            low: point.position,
            high: point.position,
            velocity: abs(point.velocity),
            acceleration: abs(point.acceleration),
        }
    }

    fn include(&mut self, other: &Self) {
        self.low = min(self.low, other.low);
        self.high = max(self.high, other.high);
        self.velocity = max(self.velocity, other.velocity);
        self.acceleration = max(self.acceleration, other.acceleration);
    }
}

/// A profile that does not exist.
#[derive(Clone, Copy, Debug, PartialEq, Error)]
#[non_exhaustive]
pub enum ProfileError {
    /// A boundary that is not finite, or a result too large for the type.
    #[error("a boundary condition or a result of it is not finite")]
    NotFinite,
    /// A duration that is not above zero.
    #[error("a duration of {duration} s must be above zero", duration = Decimal(*.duration))]
    Duration {
        /// s
        duration: f64,
    },
    /// A bound that is not above zero.
    #[error("a bound of {bound} must be above zero and finite", bound = Decimal(*.bound))]
    Bound {
        /// In its own unit.
        bound: f64,
    },
    /// The bounds allow no profile that lasts so short.
    #[error(
        "{duration} s is too short: the bounds need {least} s",
        duration = Decimal(*.duration),
        least = Decimal(*.least),
    )]
    TooShort {
        /// The duration that was given, s.
        duration: f64,
        /// The least duration, s.
        least: f64,
    },
    /// No profile of this kind lasts exactly so long from this moving state.
    #[error(
        "from this moving state nothing lasts exactly {duration} s",
        duration = Decimal(*.duration),
    )]
    Blocked {
        /// The duration that was given, s.
        duration: f64,
    },
    /// Knots that are fewer than two, more than fit, or not as many times as positions.
    #[error("{times} times and {positions} positions of knots; equal numbers in 2..={most} fit")]
    Knots {
        /// How many times.
        times: usize,
        /// How many positions.
        positions: usize,
        /// How many fit.
        most: usize,
    },
    /// A knot that is not after the one before it.
    #[error("knot {index} is at {time} s, not after the one before it", time = Decimal(*.time))]
    Order {
        /// The knot, from 0.
        index: usize,
        /// Its time, s.
        time: f64,
    },
}
