use nalgebra::SVector;
use serde::{Deserialize, Serialize};

use crate::trajectory;

/// The configured limits of the position, velocity and acceleration of a joint or an axis.
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
    /// Returns these limits as those of a trajectory, with `jerk` (rad/s³ or m/s³) as the greatest
    /// jerk in both directions.
    #[must_use]
    pub const fn with_jerk(&self, jerk: f64) -> trajectory::ProfileLimits {
        trajectory::ProfileLimits {
            low: self.low,
            high: self.high,
            velocity: self.velocity,
            acceleration: self.acceleration,
            jerk,
        }
    }
}

/// The limits of all joints of a finger, as vectors: rad, rad/s and rad/s², or m, m/s and m/s² for
/// sliding joints.
///
/// Element *i* belongs to joint *i*. If the finger has fewer than `JOINTS` joints, the remaining
/// elements are zero.
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
