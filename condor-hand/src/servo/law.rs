use crate::math::{Real, max, min};

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

/// A spring and a damper before each limit of a joint; they push inwards only.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SoftStop<T: Real = f64> {
    /// The lower limit of the joint, rad.
    pub low: T,
    /// The upper limit, rad.
    pub high: T,
    /// How far before a limit the spring begins, rad.
    pub zone: T,
    /// N m/rad
    pub stiffness: T,
    /// N m s/rad
    pub damping: T,
}

impl<T: Real> SoftStop<T> {
    /// The torque at a position (rad) and a rate (rad/s), N m; zero outside both zones.
    #[inline]
    #[must_use]
    pub fn torque(&self, position: T, rate: T) -> T {
        let (low, high) = (self.low + self.zone, self.high - self.zone);
        if position < low {
            max(
                self.stiffness * (low - position) - self.damping * rate,
                T::zero(),
            )
        } else if position > high {
            min(
                self.stiffness * (high - position) - self.damping * rate,
                T::zero(),
            )
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
        stiffness: 2.0,
        damping: 0.1,
    };

    #[test]
    fn a_stop_pushes_inwards_and_never_pulls() {
        assert_eq!(STOP.torque(0.5, 9.0), 0.0);
        assert!((STOP.torque(0.05, 0.0) - 0.1).abs() < 1e-15);
        assert!((STOP.torque(0.95, 0.0) + 0.1).abs() < 1e-15);
        assert_eq!(STOP.torque(0.05, 9.0), 0.0);
        assert_eq!(STOP.torque(0.95, -9.0), 0.0);
    }
}
