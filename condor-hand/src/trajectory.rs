//! Smooth set-points of joints, computed from requested motions.
//!
//! There are three layers, and each is useful alone. Profiles are functions of time:
//! [`Polynomial`], [`Segments`] and [`Spline`], with their exact extremes. A [`Generator`] takes a
//! queue of [`Primitive`]s and returns set-points at the master's rate, within the limits of every
//! joint; a [`JointStream`] makes them from points that come while the joints move, and a
//! [`JointPath`] makes a primitive of a [`CartesianPath`], a line or an arc of the tip. An
//! [`Interpolator`] computes set-points between them at the servo's rate, and stays
//! smooth when a tick is late.
//!
//! Positions are in rad (m for a prismatic joint), time is in s. Time is counted in ticks; no clock
//! is read.

#![allow(
    clippy::neg_cmp_op_on_partial_ord,
    reason = "what compares with a NaN is to fall on the side that refuses"
)]

mod cartesian;
mod event;
mod generator;
mod guard;
pub mod image;
mod interpolator;
mod joint_path;
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
mod stream;

// Profiles.
pub use polynomial::Polynomial;
pub use segments::{Bounds, Segments};
pub use spline::Spline;

// Motions.
pub use event::{Happening, MotionEnd, MotionEvent, MotionProgress, MotionTicket};
pub use generator::Generator;
pub use guard::StopGuard;
pub use primitive::{
    Begin, Guards, MAX_VIAS, MotionError, MotionGuard, Observations, OnEnd, Pace, Primitive,
    Profile, Target, Via,
};

// Paths of a tip in space.
pub use cartesian::CartesianPath;
pub use joint_path::{JointPath, JointPathError, PathDeviation};

// Points that come while the joints move.
pub use stream::{JointStream, JointStreamError, StreamEnd, StreamPoint, StreamQuantity};

// The servo's side.
pub use interpolator::Interpolator;

use crate::Subject;
use crate::math::{abs, max, min};
use crate::number::{NumberError, Requirement, check, finite, is_within, positive};

/// The desired state of a joint at an instant: its position, velocity and acceleration.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct SetPoint {
    /// The position, rad.
    pub position: f64,
    /// The velocity, rad/s.
    pub velocity: f64,
    /// The acceleration, rad/s².
    pub acceleration: f64,
}

impl SetPoint {
    /// Makes a set-point for a joint that rests at `position` (rad): velocity and acceleration are
    /// zero.
    #[must_use]
    pub fn rest(position: f64) -> Self {
        Self {
            position,
            velocity: 0.0,
            acceleration: 0.0,
        }
    }
}

/// The limits of position, velocity, acceleration and jerk that the trajectory of a joint must
/// keep.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct ProfileLimits {
    /// The least position, rad.
    pub low: f64,
    /// The greatest position, rad.
    pub high: f64,
    /// The greatest speed to either side, rad/s.
    pub velocity: f64,
    /// The greatest acceleration to either side, rad/s².
    pub acceleration: f64,
    /// The greatest jerk to either side, rad/s³; only [`Profile::JerkLimited`] keeps it.
    pub jerk: f64,
}

impl ProfileLimits {
    /// Checks that these limits are possible. `joint` is the number of the joint (from 0) to name
    /// in the error.
    ///
    /// # Errors
    /// [`NumberError`] if a limit is not finite, the range is empty, or the limit of a derivative is not above
    /// zero.
    pub fn validate(&self, joint: usize) -> Result<(), NumberError> {
        let above = Requirement::Above(self.low);
        finite("the least position, rad,", self.low)
            .and_then(|()| check("the greatest position, rad,", self.high, above))
            .and_then(|()| check_rates(self.velocity, self.acceleration, self.jerk))
            .map_err(|error| error.at(Subject::Joint(joint as u16)))
    }

    /// Returns true if a joint may be at `position` (rad): in the range of the limits, or beyond it by no more than
    /// rounding explains.
    #[must_use]
    pub fn contains(&self, position: f64) -> bool {
        is_within(position, self.low, self.high)
    }
}

/// The limits of the derivatives of a position.
fn check_rates(velocity: f64, acceleration: f64, jerk: f64) -> Result<(), NumberError> {
    positive("the limit of the velocity, rad/s,", velocity)?;
    positive("the limit of the acceleration, rad/s²,", acceleration)?;
    positive("the limit of the jerk, rad/s³,", jerk)
}

/// A position from which a joint starts.
fn check_start(joint: usize, position: f64) -> Result<(), NumberError> {
    finite("the starting position, rad,", position)
        .map_err(|error| error.at(Subject::Joint(joint as u16)))
}

/// The extremes of position, velocity and acceleration of a profile, which is the motion of one
/// joint in time, between its beginning and its end.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ProfilePeaks {
    /// The least position, rad.
    pub low: f64,
    /// The greatest position, rad.
    pub high: f64,
    /// The greatest speed to either side, rad/s.
    pub velocity: f64,
    /// The greatest acceleration to either side, rad/s².
    pub acceleration: f64,
}

impl ProfilePeaks {
    fn of(point: &SetPoint) -> Self {
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
