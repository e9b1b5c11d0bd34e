use nalgebra::SVector;
use serde::{Deserialize, Serialize};

use crate::trajectory;

/// The limits of the position and the motion of a joint or an axis: rad, or m for sliding ones.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Limits {
    /// The lowest position, rad or m.
    pub low: f64,
    /// The highest position, rad or m.
    pub high: f64,
    /// The largest velocity, rad/s or m/s.
    pub velocity: f64,
    /// The largest acceleration, rad/s² or m/s².
    pub acceleration: f64,
}

impl Limits {
    /// Returns the limits of a trajectory with this jerk to both sides, rad/s³ or m/s³.
    #[must_use]
    pub const fn with_jerk(&self, jerk: f64) -> trajectory::ProfileLimits<f64> {
        trajectory::ProfileLimits {
            low: self.low,
            high: self.high,
            velocity: self.velocity,
            acceleration: self.acceleration,
            jerk,
        }
    }
}

/// The limits of the joints of a finger: rad, rad/s, rad/s², or in m for what slides.
///
/// The vectors have an element for each of `JOINTS` joints; elements without a joint are zero.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MotionLimits<const JOINTS: usize> {
    /// The lowest position of each joint.
    pub low: SVector<f64, JOINTS>,
    /// The highest position of each joint.
    pub high: SVector<f64, JOINTS>,
    /// The largest rate of each joint.
    pub velocity: SVector<f64, JOINTS>,
    /// The largest acceleration of each joint.
    pub acceleration: SVector<f64, JOINTS>,
}
