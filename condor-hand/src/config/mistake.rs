use core::fmt;

use thiserror::Error;

use super::{Channel, Converter, Name, ProcessorKind};
use crate::Requirement;
use crate::decimal::Decimal;

/// The path to a value within the part of the hand that has it, such as `flexor.gains.kt` in a
/// joint.
pub type MistakeField = heapless::String<39, u8>;

/// The part of a hand (finger, joint, axis, processor or the hand itself) in which a [`Mistake`]
/// was found.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum MistakeOwner {
    /// The hand as a whole.
    Hand,
    /// The processor of this number.
    ControlProcessor(u8),
    /// An axis of the table.
    Axis(Name),
    /// The finger of this name.
    Finger(Name),
    /// The joint of these names.
    Joint {
        /// The name of the finger.
        finger: Name,
        /// The name of its joint.
        joint: Name,
    },
}

/// The place of a [`Mistake`]: a part of the hand, and the path to a value in that part.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct MistakePlace {
    /// The owner of the value.
    pub owner: MistakeOwner,
    /// The path to the value within its owner; empty for the owner itself.
    pub field: MistakeField,
}

/// The report that a hand breaks a rule: the place of the wrong value, and the rule.
#[derive(Clone, Debug, PartialEq, Error)]
#[error("{place} {problem}")]
pub struct Mistake {
    /// The value that is wrong.
    pub place: MistakePlace,
    /// The rule that it breaks.
    pub problem: Problem,
}

/// The rule that a value of a hand breaks, as a [`Mistake`] reports it.
#[derive(Clone, Debug, PartialEq, Error)]
#[non_exhaustive]
pub enum Problem {
    /// The value breaks a rule that has no numbers: an empty list or name, a name that is taken, a
    /// gain of zero, a body that cannot be, a mount where there must be none.
    #[error("{0}")]
    Is(&'static str),
    /// A number is not possible.
    #[error("is {}; it must be {must}", Decimal(*.value))]
    Number {
        /// The number that was given.
        value: f64,
        /// The requirement that it does not meet.
        must: Requirement,
    },
    /// A soft stop is so stiff that its joint would swing.
    #[error(
        "is {}; a stop so stiff would make the joint swing at its limit instead of coming to rest: with its servo and its actuators, {} is the most",
        Decimal(*.bandwidth_hz),
        Decimal(*.most),
    )]
    Restless {
        /// The bandwidth that was configured, Hz.
        bandwidth_hz: f64,
        /// The greatest bandwidth at which the joint is stable, Hz.
        most: f64,
    },
    /// Two limits are in the wrong order.
    #[error("is {}; it must be below `{upper}`, which is {}", Decimal(*.value), Decimal(*.limit))]
    Order {
        /// The number that must be below the other.
        value: f64,
        /// The other number, of the same owner.
        upper: &'static str,
        /// The value of the other number.
        limit: f64,
    },
    /// A converter cannot represent a value that it needs.
    #[error(
        "would need {} counts for {}, but its converter has only 0 to {full_scale}",
        Decimal(*.counts),
        Decimal(*.value),
    )]
    BeyondConverter {
        /// The value that it must read or make.
        value: f64,
        /// The counts that this value would have.
        counts: f64,
        /// The largest number of counts; the smallest is zero.
        full_scale: u32,
    },
    /// Axes are not orthogonal unit vectors, or are left-handed.
    #[error(
        "is not a rotation: its axes differ by up to {} from orthogonal unit vectors, and its determinant, which must be 1, is {}",
        Decimal(*.error),
        Decimal(*.determinant),
    )]
    NotRotation {
        /// The largest error of an entry of `RᵀR`.
        error: f64,
        /// The determinant, which must be 1.
        determinant: f64,
    },
    /// An axis is not a unit vector.
    #[error("has the length {}; an axis has the length 1", Decimal(*.length))]
    NotUnit {
        /// The length of the axis; it must be 1.
        length: f64,
    },
    /// There is no processor of this number.
    #[error("is {number}, which the hand does not have")]
    NoProcessor {
        /// The number of the processor.
        number: u8,
    },
    /// A processor does another kind of work.
    #[error("is {number}, which is a {kind} processor, but must be a {needed} processor")]
    WrongKind {
        /// The number of the processor.
        number: u8,
        /// The kind of its work.
        kind: ProcessorKind,
        /// The kind that is needed.
        needed: ProcessorKind,
    },
    /// Two processors would serve one finger.
    #[error(
        "is {number}, but the finger's first joint has processor {first}; tendons couple the joints of a finger, so give \
         them all one processor"
    )]
    SplitFinger {
        /// The processor of the joint.
        number: u8,
        /// The processor of the first joint of the finger.
        first: u8,
    },
    /// A rate is not a multiple of that of the trajectories.
    #[error("is {rate_hz}, which is not a multiple of {trajectory_hz}, the trajectories' rate")]
    Rate {
        /// The rate that was given, Hz.
        rate_hz: u32,
        /// The rate of the trajectories, Hz.
        trajectory_hz: u32,
    },
    /// A processor has more work than its budget allows.
    #[error(
        "is {}, but the loop of the processor would take {} of its time; give it fewer joints or axes, or a lower rate",
        Decimal(*.budget),
        Decimal(*.load),
    )]
    Load {
        /// The fraction of its time that its loop takes.
        load: f64,
        /// The fraction that it may take.
        budget: f64,
    },
    /// Two wires have the same channel.
    #[error("is {channel}, which {first} has already; a channel has one wire")]
    SameChannel {
        /// The channel that two wires have.
        channel: Channel,
        /// The owner of the other wire.
        first: MistakeOwner,
    },
    /// The tendons of a joint cannot cross another one.
    #[error("names joint `{crossed}`, which {problem}")]
    Crosses {
        /// The joint that they would cross.
        crossed: Name,
        /// The reason.
        problem: &'static str,
    },
    /// A planar finger does not have four joints.
    #[error(
        "is planar and has {joints} joints, but a planar finger must have 4; for another number write \
         `form = {{ chain = … }}`"
    )]
    PlanarJoints {
        /// The number of its joints.
        joints: usize,
    },
}

impl fmt::Display for MistakeOwner {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Hand => f.write_str("the hand"),
            Self::ControlProcessor(number) => write!(f, "processor {number}"),
            Self::Axis(name) => write!(f, "axis `{name}`"),
            Self::Finger(name) => write!(f, "finger `{name}`"),
            Self::Joint { finger, joint } => write!(f, "joint `{joint}` of finger `{finger}`"),
        }
    }
}

impl fmt::Display for MistakePlace {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.field.is_empty() {
            return self.owner.fmt(f);
        }
        write!(f, "`{}` of {}", self.field, self.owner)
    }
}

impl fmt::Display for Channel {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let converter = match self.converter {
            Converter::Adc => "A/D",
            Converter::Dac => "D/A",
        };
        write!(
            f,
            "{converter} channel {} of board {}",
            self.channel, self.board
        )
    }
}

impl fmt::Display for ProcessorKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Servo => "servo",
            Self::Table => "table",
            Self::Master => "master",
        })
    }
}
