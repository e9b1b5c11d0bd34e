//! [`FaultCode`]: the kinds of faults, which errors and servos name.

use core::fmt;

/// The kind of a fault of a finger.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
#[repr(u8)]
#[non_exhaustive]
pub enum FaultCode {
    /// A reading or a set-point is not finite.
    NotFinite = 0,
    /// A reading is outside of the sensor's range.
    OutOfRange = 1,
    /// A reading does not change while its set-point moves away, or while the measured quantity
    /// must change.
    Stuck = 2,
    /// The measured value is too far from the desired one.
    Tracking = 3,
    /// The effort of an actuator is less than it must be: a tendon is slack, or broken.
    LowEffort = 4,
    /// The effort of an actuator is more than it, or what it moves, can bear.
    HighEffort = 5,
    /// A joint is past its limits.
    JointLimit = 6,
    /// A tick of the servo came too late.
    MissedDeadline = 7,
    /// The level above has sent no set-point for too long.
    StaleSetPoint = 8,
    /// A reading is implausibly far from the last one.
    Jump = 9,
}

impl FaultCode {
    /// All kinds of faults, in the order of their numbers.
    pub const ALL: [Self; 10] = [
        Self::NotFinite,
        Self::OutOfRange,
        Self::Stuck,
        Self::Tracking,
        Self::LowEffort,
        Self::HighEffort,
        Self::JointLimit,
        Self::MissedDeadline,
        Self::StaleSetPoint,
        Self::Jump,
    ];

    /// Returns the kind of fault in a word or two, such as "stuck".
    #[must_use]
    pub const fn name(self) -> &'static str {
        self.texts().0
    }

    /// Returns what a person can do about such a fault.
    #[must_use]
    pub const fn remedy(self) -> &'static str {
        self.texts().1
    }

    /// The name and the remedy.
    #[rustfmt::skip]
    const fn texts(self) -> (&'static str, &'static str) {
        match self {
            Self::NotFinite => ("not finite", "check the sensor and its wires"),
            Self::OutOfRange => ("out of range", "check the sensor and its wires"),
            Self::Stuck => ("stuck", "check the sensor, and whether something blocks the joint"),
            Self::Tracking => ("tracking error", "see whether something blocks the joint, its load is too large, or an actuator does not move it"),
            Self::LowEffort => ("effort too low", "check the actuator, its tendon if it has one, and the sensor of its effort"),
            Self::HighEffort => ("effort too high", "reduce the load, or the stiffness"),
            Self::JointLimit => ("past its limit", "bring the joint back within its limits"),
            Self::MissedDeadline => ("missed deadline", "see whether its processor has too much to do"),
            Self::StaleSetPoint => ("stale set-point", "see whether the program that sends set-points has ended, or was too slow"),
            Self::Jump => ("jumped", "check the sensor and its wires, whether something hit the joint, and whether its gains let it swing"),
        }
    }
}

impl fmt::Display for FaultCode {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}
