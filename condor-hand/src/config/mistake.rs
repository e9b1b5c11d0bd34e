use core::fmt;

use thiserror::Error;

use super::{Converter, Name, ProcessorKind};
use crate::Requirement;
use crate::decimal::Decimal;

/// The path to a value within its owner, such as `flexor.gains.kt`.
pub type Field = heapless::String<39, u8>;

/// The owner of a value.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Owner {
    /// The hand as a whole.
    Hand,
    /// The processor of this number.
    ControlProcessor(u8),
    /// An axis of the table.
    Axis(Name),
    /// A finger.
    Finger(Name),
    /// A joint.
    Joint {
        /// The finger.
        finger: Name,
        /// Its joint.
        joint: Name,
    },
}

/// The place of a value.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ValuePlace {
    /// The owner of the value.
    pub owner: Owner,
    /// The path to the value within its owner.
    pub field: Field,
}

/// One end of a wire.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct WireEnd {
    /// The joint or the axis.
    pub owner: Owner,
    /// The part of it.
    pub part: WirePart,
}

/// The part of a joint or an axis that a wire leads to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum WirePart {
    /// Its position.
    Position,
    /// The tendon that pulls a joint to positive angles.
    Flexor,
    /// The antagonist of the flexor.
    Extensor,
    /// The drive of an axis.
    Drive,
}

/// A rule that a hand breaks.
#[derive(Clone, Debug, PartialEq, Error)]
#[non_exhaustive]
pub enum Mistake {
    /// A number is not possible.
    #[error("{place} is {}; it must be {must}", Decimal(*.value))]
    Number {
        /// Which number.
        place: ValuePlace,
        /// Its value.
        value: f64,
        /// What it must be.
        must: Requirement,
    },
    /// A soft stop is so stiff that its joint would swing.
    #[error(
        "{place} is {bandwidth_hz}; with its servo and its actuators the joint comes to rest there only \
         up to {most}",
        bandwidth_hz = Decimal(*.bandwidth_hz),
        most = Decimal(*.most),
    )]
    Restless {
        /// The bandwidth.
        place: ValuePlace,
        /// Its value, Hz.
        bandwidth_hz: f64,
        /// The greatest bandwidth at which the joint is stable, Hz.
        most: f64,
    },
    /// Two limits are in the wrong order.
    #[error(
        "{place} is {value}; it must be below `{upper}`, which is {limit}",
        value = Decimal(*.value),
        limit = Decimal(*.limit),
    )]
    Order {
        /// The number that must be below the other.
        place: ValuePlace,
        /// Its value.
        value: f64,
        /// The other number, of the same owner.
        upper: &'static str,
        /// Its value.
        limit: f64,
    },
    /// A gain of a converter is zero.
    #[error("{place} is 0: all counts would mean the same")]
    ZeroGain {
        /// Which gain.
        place: ValuePlace,
    },
    /// A converter cannot represent a value that it needs.
    #[error(
        "{place} has {counts} counts for {value}; its converter ends at {full_scale}",
        counts = Decimal(*.counts),
        value = Decimal(*.value),
    )]
    BeyondConverter {
        /// Which converter.
        place: ValuePlace,
        /// The value that it must read or make.
        value: f64,
        /// The counts that this value would have.
        counts: f64,
        /// The largest number of counts; the smallest is zero.
        full_scale: u32,
    },
    /// The cutoff of a filter is too high for the rate of its loop.
    #[error(
        "{place} is {cutoff_hz}; a loop of {rate_hz} Hz filters below half of that",
        cutoff_hz = Decimal(*.cutoff_hz),
    )]
    Cutoff {
        /// Which cutoff.
        place: ValuePlace,
        /// Its value, Hz.
        cutoff_hz: f64,
        /// The rate of the loop, Hz.
        rate_hz: u32,
    },
    /// Axes are not orthogonal unit vectors, or are left-handed.
    #[error(
        "{place} is no rotation: the products of its axes are wrong by {error}, \
         and its determinant is {determinant}",
        error = Decimal(*.error),
        determinant = Decimal(*.determinant),
    )]
    NotRotation {
        /// Which rotation.
        place: ValuePlace,
        /// The largest error of an entry of `RᵀR`.
        error: f64,
        /// The determinant, which must be 1.
        determinant: f64,
    },
    /// An axis is not a unit vector.
    #[error(
        "{place} has the length {length}; an axis has the length 1",
        length = Decimal(*.length),
    )]
    NotUnit {
        /// Which axis.
        place: ValuePlace,
        /// Its length.
        length: f64,
    },
    /// No body has this inertia: it is not positive definite, or one moment is above the sum of the
    /// two others.
    #[error("{place} is no inertia of a body")]
    NotInertia {
        /// Which inertia.
        place: ValuePlace,
    },
    /// A name has no letter.
    #[error("{place} is empty")]
    NoName {
        /// Which name.
        place: ValuePlace,
    },
    /// Two things of the same kind have the same name.
    #[error("the name of {owner} is taken already")]
    SameName {
        /// The second owner of the name.
        owner: Owner,
    },
    /// A list that must have entries is empty.
    #[error("{place} is empty")]
    Empty {
        /// The list.
        place: ValuePlace,
    },
    /// Two processors have the same number.
    #[error("there are two processors of number {number}")]
    SameProcessor {
        /// The number.
        number: u8,
    },
    /// There is no processor of this number.
    #[error("{owner} is on processor {number}, which the hand does not have")]
    NoProcessor {
        /// The owner that names it.
        owner: Owner,
        /// The number.
        number: u8,
    },
    /// A processor does another kind of work.
    #[error("{owner} is on processor {number}, which is a {kind}; it needs a {needed}")]
    WrongKind {
        /// The owner that names it.
        owner: Owner,
        /// The number.
        number: u8,
        /// The kind of its work.
        kind: ProcessorKind,
        /// The kind that is needed.
        needed: ProcessorKind,
    },
    /// Two processors would serve one finger.
    #[error(
        "{owner} is on processor {number} and the finger's first joint on {first}; \
         tendons couple the joints of a finger, so one processor serves them all"
    )]
    SplitFinger {
        /// The joint.
        owner: Owner,
        /// Its processor.
        number: u8,
        /// The processor of the first joint of the finger.
        first: u8,
    },
    /// A rate is not a multiple of that of the trajectories.
    #[error(
        "{place} is {rate_hz}, which is no multiple of {trajectory_hz}, the trajectories' rate"
    )]
    Rate {
        /// Which rate.
        place: ValuePlace,
        /// Its value, Hz.
        rate_hz: u32,
        /// The rate of the trajectories, Hz.
        trajectory_hz: u32,
    },
    /// A processor has more work than its budget allows.
    #[error(
        "processor {number} would be busy for {load} of its time; its budget is {budget}",
        load = Decimal(*.load),
        budget = Decimal(*.budget),
    )]
    Load {
        /// The processor.
        number: u8,
        /// The fraction of its time that its loop takes.
        load: f64,
        /// The fraction that it may take.
        budget: f64,
    },
    /// Two wires have the same channel.
    #[error("{converter} channel {channel} of board {board} is for {first} and for {second}")]
    SameChannel {
        /// The direction of the board.
        converter: Converter,
        /// The board.
        board: u8,
        /// The channel.
        channel: u8,
        /// The first wire.
        first: WireEnd,
        /// The second wire.
        second: WireEnd,
    },
    /// A tendon does not pull its own joint to its own side.
    #[error(
        "{place} is {arm} m; a flexor's is above 0, an extensor's below",
        arm = Decimal(*.arm),
    )]
    OwnArm {
        /// Which arm.
        place: ValuePlace,
        /// Its value, m.
        arm: f64,
    },
    /// A tendon crosses a joint that the finger does not have.
    #[error("the tendons of {owner} cross joint `{crossed}`, which the finger does not have")]
    CrossesNothing {
        /// The joint that the tendons pull.
        owner: Owner,
        /// The joint that does not exist.
        crossed: Name,
    },
    /// A tendon crosses a joint that is not proximal to its own.
    #[error("the tendons of {owner} cross joint `{crossed}`, which is not proximal to it")]
    CrossesDistal {
        /// The joint that the tendons pull.
        owner: Owner,
        /// The joint that they would cross.
        crossed: Name,
    },
    /// A joint crosses another one in two entries.
    #[error("the tendons of {owner} cross joint `{crossed}` twice")]
    CrossesTwice {
        /// The joint that the tendons pull.
        owner: Owner,
        /// The joint that they cross twice.
        crossed: Name,
    },
    /// A planar finger does not have four joints.
    #[error("{owner} is planar and has {joints} joints; the closed form is of 4")]
    PlanarJoints {
        /// The finger.
        owner: Owner,
        /// The number of its joints.
        joints: usize,
    },
    /// A body of a planar finger is not on the line of its link.
    #[error("{place} is not on the x axis; a planar finger's links are")]
    OffAxis {
        /// The centre or the inertia.
        place: ValuePlace,
    },
    /// A joint of a chain has no mount.
    #[error("{owner} has no `mount`, which a joint of a chain needs")]
    NoMount {
        /// The joint.
        owner: Owner,
    },
    /// A joint of a planar finger has a mount.
    #[error("{owner} has a `mount`; in a planar finger the lengths say where joints are")]
    NeedlessMount {
        /// The joint.
        owner: Owner,
    },
}

impl fmt::Display for Owner {
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

impl fmt::Display for ValuePlace {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "`{}` of {}", self.field, self.owner)
    }
}

impl fmt::Display for WireEnd {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let part = match self.part {
            WirePart::Position => "position",
            WirePart::Flexor => "flexor",
            WirePart::Extensor => "extensor",
            WirePart::Drive => "drive",
        };
        write!(f, "the {part} of {}", self.owner)
    }
}

impl fmt::Display for Converter {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Adc => "A/D",
            Self::Dac => "D/A",
        })
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
