use crate::math::{max, min};

/// The control law by which a joint in position mode follows its set-points, with its gains.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub enum PositionLaw {
    /// `kp e + kv de/dt + ki ∫ e dt`, plus gravity and the friction at the desired rate as
    /// feed-forward.
    Pd {
        /// The gain kp of the position error, N m/rad.
        kp: f64,
        /// The gain kv of the velocity error, N m s/rad.
        kv: f64,
        /// The gain ki of the integral of the position error, N m/(rad s).
        ki: f64,
        /// The greatest torque of the integral, N m.
        integral_nm: f64,
    },
    /// The torque for the acceleration `a + 2 zeta w de/dt + w² e`, by the inverse dynamics of the
    /// whole finger: every joint behaves as if it were alone (computed torque; Craig, Introduction
    /// to Robotics, 10.4).
    ComputedTorque {
        /// The natural frequency w / 2 pi, Hz.
        bandwidth_hz: f64,
        /// The damping ratio zeta; 1 does not overshoot.
        damping_ratio: f64,
    },
}

/// A soft stop of a joint: a virtual spring and damper before each limit, which push only inwards
/// and adapt to the inertia of the joint.
///
/// The servo converts the acceleration into torques that accelerate only this joint, as
/// [`PositionLaw::ComputedTorque`] does. With a spring of constant stiffness, light joints would
/// swing faster than the servo can control.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SoftStop {
    /// The lower limit of the joint, rad.
    pub low: f64,
    /// The upper limit, rad.
    pub high: f64,
    /// The distance before a limit at which the spring begins, rad.
    pub zone: f64,
    /// The natural frequency of the joint on the spring, Hz.
    pub bandwidth_hz: f64,
    /// The damping ratio; 1 does not overshoot.
    pub damping_ratio: f64,
}

impl SoftStop {
    /// Returns the range in which the joint can rest, `(lowest, highest)` in rad: between the zones
    /// of the spring before its two limits.
    #[must_use]
    pub fn between(&self) -> (f64, f64) {
        (self.low + self.zone, self.high - self.zone)
    }

    /// Returns the acceleration (rad/s²) that the stop demands at a position (rad) and a rate
    /// (rad/s). It points inwards, or is zero; outside of both zones it is zero.
    #[inline]
    #[must_use]
    pub fn acceleration(&self, position: f64, rate: f64) -> f64 {
        let w = core::f64::consts::TAU * self.bandwidth_hz;
        let damping = 2.0 * self.damping_ratio * w;
        let (low, high) = self.between();
        if position < low {
            max(w * w * (low - position) - damping * rate, 0.0)
        } else if position > high {
            min(w * w * (high - position) - damping * rate, 0.0)
        } else {
            0.0
        }
    }
}
