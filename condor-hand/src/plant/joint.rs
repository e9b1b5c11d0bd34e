use super::check::ordered;
use crate::config::JointFriction;
use crate::math::tanh;
use crate::number::{NumberError, finite, not_negative, positive};

/// The parameters of a simulated joint, except for its actuators and bodies. Units are those of a
/// rotating joint; for a sliding joint read m for rad and N for N m.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct JointParameters {
    /// The inertia of its drive, and its friction. Coulomb friction is `coulomb tanh(rate / coulomb_rate)`, where
    /// `coulomb` includes that of the tendons that cross the joint.
    pub friction: JointFriction,
    /// The stiffness of a spring to `rest`, N m/rad.
    pub stiffness: f64,
    /// The position at which that spring is slack, rad.
    pub rest: f64,
    /// The two ends of the joint, rad.
    pub range: (f64, f64),
    /// The mechanical stop at these ends.
    pub stop: SimStop,
}

/// A simulated mechanical stop at the end of a range: a spring and a damper that push only back
/// into the range.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SimStop {
    /// The stiffness, N m/rad or N/m.
    pub stiffness: f64,
    /// The damping, N m s/rad or N s/m.
    pub damping: f64,
}

/// A torque that depends on the rate: `torque - slope (new rate - rate)`.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Passive {
    pub(super) torque: f64,
    pub(super) slope: f64,
}

impl JointParameters {
    pub(super) fn check(&self) -> Result<(), NumberError> {
        let friction = &self.friction;
        not_negative("the armature of a joint, kg m²", friction.armature)?;
        not_negative(
            "the viscous friction of a joint, N m s/rad",
            friction.viscous,
        )?;
        not_negative("the Coulomb friction of a joint, N m", friction.coulomb)?;
        not_negative("the friction of a tendon per torque", friction.tendon)?;
        let what = "the rate where Coulomb friction fades, rad/s";
        positive(what, friction.coulomb_rate)?;
        not_negative("the spring of a joint, N m/rad", self.stiffness)?;
        finite("the rest of a joint's spring, rad", self.rest)?;
        ordered("the end of a joint's range, rad", self.range)?;
        self.stop.check()
    }

    /// Returns the torques of springs, friction and stops; `load` is the pull of the tendons that cross the joint, N m.
    pub(super) fn passive(&self, q: f64, qd: f64, load: f64) -> Passive {
        let friction = &self.friction;
        let mut passive = Passive {
            torque: -self.stiffness * (q - self.rest) - friction.viscous * qd,
            slope: friction.viscous,
        };
        let size = friction.coulomb + friction.tendon * load;
        passive.add(coulomb(size, friction.coulomb_rate, qd));
        passive.add(self.stop.push(self.range, q, qd));
        passive
    }
}

impl SimStop {
    pub(super) fn check(&self) -> Result<(), NumberError> {
        not_negative("the stiffness of a stop, N/m or N m/rad", self.stiffness)?;
        not_negative("the damping of a stop, N s/m or N m s/rad", self.damping)
    }

    pub(super) fn push(&self, (low, high): (f64, f64), q: f64, qd: f64) -> Passive {
        let depth = if q < low {
            low - q
        } else if q > high {
            high - q
        } else {
            return Passive::default();
        };
        let torque = self.stiffness * depth - self.damping * qd;
        // A damper alone would hold the joint back on its way out.
        if torque * depth > 0.0 {
            let slope = self.damping;
            Passive { torque, slope }
        } else {
            Passive::default()
        }
    }
}

impl Passive {
    pub(super) fn add(&mut self, other: Self) {
        self.torque += other.torque;
        self.slope += other.slope;
    }
}

/// Coulomb friction of the given size, as a smooth function of the rate.
pub(super) fn coulomb(size: f64, fade: f64, rate: f64) -> Passive {
    let direction = tanh(rate / fade);
    Passive {
        torque: -size * direction,
        slope: size / fade * (1.0 - direction * direction),
    }
}
