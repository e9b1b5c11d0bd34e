use crate::Real;
use crate::tendon::Pair;
use crate::trajectory::SetPoint;

/// The mode of a joint: the quantity that its servo controls.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
#[repr(u8)]
pub enum ServoMode {
    /// Both tendons are at their least tension.
    #[default]
    Off = 0,
    /// Both tendons hold tensions that the user sets.
    Tension = 1,
    /// The joint exerts a torque that the user sets.
    Torque = 2,
    /// The joint follows positions.
    Position = 3,
    /// The joint exerts the torque that the grasp law computes for the whole hand.
    Grasp = 4,
    /// The joint is a spring and a damper that the user sets; gravity is compensated.
    Impedance = 5,
}

impl ServoMode {
    /// Returns the mode with this number in messages; `None` if no mode has it.
    #[must_use]
    pub const fn from_number(number: u32) -> Option<Self> {
        match number {
            0 => Some(Self::Off),
            1 => Some(Self::Tension),
            2 => Some(Self::Torque),
            3 => Some(Self::Position),
            4 => Some(Self::Grasp),
            5 => Some(Self::Impedance),
            _ => None,
        }
    }

    /// Returns the name of the mode, for messages to people.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Off => "off",
            Self::Tension => "tension",
            Self::Torque => "torque",
            Self::Position => "position",
            Self::Grasp => "grasp",
            Self::Impedance => "impedance",
        }
    }
}

/// The target of a joint, which also determines the mode of the joint.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum JointTarget<T: Real = f64> {
    /// No target, for [`ServoMode::Off`].
    Off,
    /// Tensions of its two tendons, N, for [`ServoMode::Tension`].
    Tension(Pair<T>),
    /// A torque, N m, for [`ServoMode::Torque`].
    Torque(T),
    /// A position with its rate and acceleration (rad, rad/s, rad/s²), for [`ServoMode::Position`].
    Position(SetPoint<T>),
    /// A torque of the grasp law, N m, for [`ServoMode::Grasp`].
    Grasp(T),
    /// A spring and a damper, for [`ServoMode::Impedance`].
    Impedance {
        /// The position at which the spring has no torque, rad.
        position: T,
        /// The stiffness of the spring, N m/rad.
        stiffness: T,
        /// The damping, N m s/rad.
        damping: T,
    },
}

impl<T: Real> JointTarget<T> {
    /// Returns the mode in which a joint has this kind of target.
    #[must_use]
    pub const fn mode(&self) -> ServoMode {
        match self {
            Self::Off => ServoMode::Off,
            Self::Tension(_) => ServoMode::Tension,
            Self::Torque(_) => ServoMode::Torque,
            Self::Position(_) => ServoMode::Position,
            Self::Grasp(_) => ServoMode::Grasp,
            Self::Impedance { .. } => ServoMode::Impedance,
        }
    }
}
