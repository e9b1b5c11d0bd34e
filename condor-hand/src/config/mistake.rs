use core::fmt;

use thiserror::Error;

use super::{Converter, Name, ProcessorKind};
use crate::decimal::Decimal;

/// The way to a value within the thing that has it, such as `flexor.gains.kt`.
pub type Field = heapless::String<39, u8>;

/// What has a value.
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

/// Which value.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ValuePlace {
    /// What has it.
    pub owner: Owner,
    /// The way to it from there.
    pub field: Field,
}

/// What is at one end of a wire.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct WireEnd {
    /// The joint or the axis.
    pub owner: Owner,
    /// What of it.
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

/// Why a hand cannot be.
#[derive(Clone, Debug, PartialEq, Error)]
#[non_exhaustive]
pub enum Mistake {
    /// A number that is infinite or none at all.
    #[error("{place} is {value}, which is no finite number", value = Decimal(*.value))]
    NotFinite {
        /// Which number.
        place: ValuePlace,
        /// Its value.
        value: f64,
    },
    /// A number that must be above zero.
    #[error("{place} is {value}; it must be above 0", value = Decimal(*.value))]
    NotPositive {
        /// Which number.
        place: ValuePlace,
        /// Its value.
        value: f64,
    },
    /// A number that must be at least something.
    #[error(
        "{place} is {value}; it must be at least {least}",
        value = Decimal(*.value),
        least = Decimal(*.least),
    )]
    TooSmall {
        /// Which number.
        place: ValuePlace,
        /// Its value.
        value: f64,
        /// The least value.
        least: f64,
    },
    /// A number that must be at most something.
    #[error(
        "{place} is {value}; it must be at most {most}",
        value = Decimal(*.value),
        most = Decimal(*.most),
    )]
    TooLarge {
        /// Which number.
        place: ValuePlace,
        /// Its value.
        value: f64,
        /// The largest value.
        most: f64,
    },
    /// A soft stop in which a joint would swing.
    #[error(
        "{place} is {bandwidth_hz}; with its servo and its actuators the joint comes to rest there only \
         up to {most}",
        bandwidth_hz = Decimal(*.bandwidth_hz),
        most = Decimal(*.most),
    )]
    Restless {
        /// The bandwidth.
        place: ValuePlace,
        /// What it is, Hz.
        bandwidth_hz: f64,
        /// The largest that the joint bears, Hz.
        most: f64,
    },
    /// Two limits in the wrong order.
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
    /// A gain of zero where counts become a value, or a value counts.
    #[error("{place} is 0: all counts would mean the same")]
    ZeroGain {
        /// Which gain.
        place: ValuePlace,
    },
    /// A value that a converter must have, but cannot.
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
        /// The counts that this takes.
        counts: f64,
        /// The largest number of counts; the smallest is zero.
        full_scale: u32,
    },
    /// A filter that its loop is too slow for.
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
    /// Axes that are not orthogonal unit vectors, or left-handed.
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
    /// An axis that is no unit vector.
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
    /// An inertia that no body has: not positive definite, or one moment above the two others.
    #[error("{place} is no inertia of a body")]
    NotInertia {
        /// Which inertia.
        place: ValuePlace,
    },
    /// A name with no letter in it.
    #[error("{place} is empty")]
    NoName {
        /// Which name.
        place: ValuePlace,
    },
    /// A name that another thing of the same kind has.
    #[error("the name of {owner} is taken already")]
    SameName {
        /// What has it a second time.
        owner: Owner,
    },
    /// Nothing where there must be something.
    #[error("{place} is empty")]
    Empty {
        /// What has no entries.
        place: ValuePlace,
    },
    /// Two processors with one number.
    #[error("there are two processors of number {number}")]
    SameProcessor {
        /// The number.
        number: u8,
    },
    /// A processor that the hand does not have.
    #[error("{owner} is on processor {number}, which the hand does not have")]
    NoProcessor {
        /// What names it.
        owner: Owner,
        /// The number.
        number: u8,
    },
    /// A processor that does something else.
    #[error("{owner} is on processor {number}, which is a {kind}; it needs a {needed}")]
    WrongKind {
        /// What names it.
        owner: Owner,
        /// The number.
        number: u8,
        /// What it does.
        kind: ProcessorKind,
        /// What it should do.
        needed: ProcessorKind,
    },
    /// A finger that two processors would serve.
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
    /// A rate that is no multiple of that of the trajectories.
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
    /// A processor that has too much to do.
    #[error(
        "processor {number} would be busy for {load} of its time; its budget is {budget}",
        load = Decimal(*.load),
        budget = Decimal(*.budget),
    )]
    Load {
        /// The processor.
        number: u8,
        /// The part of its time that its loop takes.
        load: f64,
        /// The part that it may take.
        budget: f64,
    },
    /// A channel with two wires.
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
    /// A tendon that does not pull its own joint to its own side.
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
    /// A crossed joint that the finger does not have.
    #[error("the tendons of {owner} cross joint `{crossed}`, which the finger does not have")]
    CrossesNothing {
        /// The joint that the tendons pull.
        owner: Owner,
        /// The joint that does not exist.
        crossed: Name,
    },
    /// A crossed joint that is not proximal to the tendon's own.
    #[error("the tendons of {owner} cross joint `{crossed}`, which is not proximal to it")]
    CrossesDistal {
        /// The joint that the tendons pull.
        owner: Owner,
        /// The joint that they are said to cross.
        crossed: Name,
    },
    /// A joint that is crossed in two entries.
    #[error("the tendons of {owner} cross joint `{crossed}` twice")]
    CrossesTwice {
        /// The joint that the tendons pull.
        owner: Owner,
        /// The joint that they are said to cross.
        crossed: Name,
    },
    /// A planar finger that does not have four joints.
    #[error("{owner} is planar and has {joints} joints; the closed form is of 4")]
    PlanarJoints {
        /// The finger.
        owner: Owner,
        /// How many joints it has.
        joints: usize,
    },
    /// A body of a planar finger that is not on the line of its link.
    #[error("{place} is not on the x axis; a planar finger's links are")]
    OffAxis {
        /// Which centre or inertia.
        place: ValuePlace,
    },
    /// A joint of a chain without a mount.
    #[error("{owner} has no `mount`, which a joint of a chain needs")]
    NoMount {
        /// The joint.
        owner: Owner,
    },
    /// A joint of a planar finger with a mount.
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
