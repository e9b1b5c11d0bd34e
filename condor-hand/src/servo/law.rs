use crate::math::{Real, max, min, real};

/// How a joint follows positions.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum PositionLaw<T: Real = f64> {
    /// `kp e + kv de/dt + ki ∫ e dt`, with gravity and the friction of the asked-for rate fed
    /// forward.
    Pd {
        /// N m/rad
        kp: T,
        /// N m s/rad
        kv: T,
        /// N m/(rad s)
        ki: T,
        /// The most that the integral may add, N m.
        integral_nm: T,
    },
    /// The torque that gives the acceleration `a + 2 zeta w de/dt + w² e`, from the inverse dynamics
    /// of the whole finger: every joint behaves as if it were alone (computed torque; Craig,
    /// Introduction to Robotics, 10.4).
    ComputedTorque {
        /// w / 2 pi, Hz.
        bandwidth_hz: T,
        /// zeta; 1 does not overshoot.
        damping_ratio: T,
    },
}

/// A spring and a damper before each limit of a joint, for whatever inertia it has; they push inwards
/// only.
///
/// The servo makes of the acceleration the torques with which only this joint is accelerated, as
/// [`PositionLaw::ComputedTorque`] does. A spring of a given stiffness would make light joints swing faster
/// than the servo can hold.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SoftStop<T: Real = f64> {
    /// The lower limit of the joint, rad.
    pub low: T,
    /// The upper limit, rad.
    pub high: T,
    /// How far before a limit the spring begins, rad.
    pub zone: T,
    /// The natural frequency of the joint on the spring, Hz.
    pub bandwidth_hz: T,
    /// 1 does not overshoot.
    pub damping_ratio: T,
}

impl<T: Real> SoftStop<T> {
    /// Where a joint can rest: from the end of one zone to that of the other, rad.
    #[must_use]
    pub fn between(&self) -> (T, T) {
        (self.low + self.zone, self.high - self.zone)
    }

    /// The acceleration that it adds at a position (rad) and a rate (rad/s), rad/s²; zero outside both
    /// zones.
    #[inline]
    #[must_use]
    pub fn acceleration(&self, position: T, rate: T) -> T {
        let w = T::two_pi() * self.bandwidth_hz;
        let damping = real::<T>(2.0) * self.damping_ratio * w;
        let (low, high) = self.between();
        if position < low {
            max(w * w * (low - position) - damping * rate, T::zero())
        } else if position > high {
            min(w * w * (high - position) - damping * rate, T::zero())
        } else {
            T::zero()
        }
    }
}

#[cfg(test)]
mod tests {
    use super::SoftStop;

    const STOP: SoftStop = SoftStop {
        low: 0.0,
        high: 1.0,
        zone: 0.1,
        bandwidth_hz: 0.5 / core::f64::consts::PI,
        damping_ratio: 0.5,
    };

    #[test]
    fn a_stop_pushes_inwards_and_never_pulls() {
        // With w = 1 and 2 zeta w = 1.
        assert_eq!(STOP.acceleration(0.5, 9.0), 0.0);
        assert!((STOP.acceleration(0.05, 0.0) - 0.05).abs() < 1e-15);
        assert!((STOP.acceleration(0.95, 0.0) + 0.05).abs() < 1e-15);
        assert!((STOP.acceleration(0.05, -1.0) - 1.05).abs() < 1e-15);
        assert_eq!(STOP.acceleration(0.05, 9.0), 0.0);
        assert_eq!(STOP.acceleration(0.95, -9.0), 0.0);
    }
}
