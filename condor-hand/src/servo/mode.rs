use crate::trajectory::SetPoint;

/// The mode of a joint: the quantity that its servo controls.
#[derive(
    Clone, Copy, Debug, Default, PartialEq, Eq, Hash, serde::Serialize, serde::Deserialize,
)]
pub enum ServoMode {
    /// The joint has no torque, and its actuators have efforts as near to those at rest as the other joints permit.
    #[default]
    Off,
    /// The actuators of the joint have efforts that the user sets.
    Effort,
    /// The joint exerts a torque that the user sets.
    Torque,
    /// The joint follows positions.
    Position,
    /// The joint exerts the torque that the grasp law computes for the whole hand.
    Grasp,
    /// The joint is a spring and a damper that the user sets; gravity is compensated.
    Impedance,
}

impl ServoMode {
    /// All modes.
    pub const ALL: [Self; 6] = [
        Self::Off,
        Self::Effort,
        Self::Torque,
        Self::Position,
        Self::Grasp,
        Self::Impedance,
    ];

    /// Returns the name of the mode, for messages to people.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Off => "off",
            Self::Effort => "effort",
            Self::Torque => "torque",
            Self::Position => "position",
            Self::Grasp => "grasp",
            Self::Impedance => "impedance",
        }
    }
}

/// The target of a joint, which also determines the mode of the joint.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub enum JointTarget {
    /// No target, for [`ServoMode::Off`].
    Off,
    /// The efforts that its actuators have, or that were [set](super::FingerServo::set_effort), for
    /// [`ServoMode::Effort`].
    Effort,
    /// A torque, N m, for [`ServoMode::Torque`].
    Torque(f64),
    /// A position with its rate and acceleration (rad, rad/s, rad/s²), for [`ServoMode::Position`].
    Position(SetPoint),
    /// A torque of the grasp law, N m, for [`ServoMode::Grasp`].
    Grasp(f64),
    /// A spring and a damper, for [`ServoMode::Impedance`].
    Impedance {
        /// The position at which the spring has no torque, rad.
        position: f64,
        /// The stiffness of the spring, N m/rad.
        stiffness: f64,
        /// The damping, N m s/rad.
        damping: f64,
    },
}

impl JointTarget {
    /// Returns the mode in which a joint has this kind of target.
    #[must_use]
    pub const fn mode(&self) -> ServoMode {
        match self {
            Self::Off => ServoMode::Off,
            Self::Effort => ServoMode::Effort,
            Self::Torque(_) => ServoMode::Torque,
            Self::Position(_) => ServoMode::Position,
            Self::Grasp(_) => ServoMode::Grasp,
            Self::Impedance { .. } => ServoMode::Impedance,
        }
    }
}
