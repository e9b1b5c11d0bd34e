use core::fmt;

use thiserror::Error;

use super::{Channel, Converter, ProcessorKind};
use crate::Requirement;
use crate::decimal::Decimal;

/// The way to a value from the top of the file, such as `fingers[1].joints[2].limits.low`.
pub type MistakePath = heapless::String<63, u8>;

/// The place of a value by the names of its owners, such as `` `limits.low` of joint `middle` of finger `index` ``.
pub type MistakePlace = heapless::String<159, u8>;

/// The report that a hand breaks a rule: the place and the value of what is wrong, and what is allowed there.
#[derive(Clone, Debug, PartialEq, Error)]
#[error("{place}{quantity} is {value}; {allowed}")]
pub struct Mistake {
    /// The place, by indices.
    pub path: MistakePath,
    /// The place, by names.
    pub place: MistakePlace,
    /// The quantity that is wrong, such as `": its length"`; empty for the value itself.
    pub quantity: &'static str,
    /// The value that is wrong.
    pub value: MistakeValue,
    /// The rule that it breaks.
    pub allowed: Allowed,
}

/// A value that breaks a rule.
#[derive(Clone, Debug, PartialEq)]
pub enum MistakeValue {
    /// A number, in the unit of its place.
    Number(f64),
    /// The channel at the end of a wire.
    Channel(Channel),
    /// A description of the value in words, such as "empty".
    Words(&'static str),
}

/// The values that a hand may have in the place of a [`Mistake`].
#[derive(Clone, Debug, PartialEq)]
pub enum Allowed {
    /// The numbers that meet the requirement; with its reason or the remedy, which may be empty.
    Number(Requirement, &'static str),
    /// The numbers below another one, which has this name and this value.
    Below(&'static str, f64),
    /// The rule in words.
    Words(&'static str),
    /// Any channel but this one of another wire.
    OtherThan(MistakePath),
}

impl fmt::Display for MistakeValue {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Number(value) => Decimal(*value).fmt(f),
            Self::Channel(channel) => channel.fmt(f),
            Self::Words(words) => f.write_str(words),
        }
    }
}

impl fmt::Display for Allowed {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Number(must, reason) => write!(f, "it must be {must}{reason}"),
            Self::Below(name, limit) => {
                write!(f, "it must be below `{name}`, which is {}", Decimal(*limit))
            }
            Self::Words(words) => f.write_str(words),
            Self::OtherThan(path) => {
                write!(f, "`{path}` is the same, and a channel has one wire")
            }
        }
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
