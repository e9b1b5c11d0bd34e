use thiserror::Error;

use super::words::{WordReader, WordWriter};
use crate::decimal::Decimal;
use crate::servo::{SettingError, TargetError, TargetQuantity};

/// The reason why a request was refused, with the wrong values.
#[derive(Clone, Copy, Debug, PartialEq, Error)]
#[non_exhaustive]
pub enum ServoRefusal {
    /// The operation of the request does not exist.
    #[error("there is no operation {operation}")]
    Operation {
        /// The number of the operation.
        operation: u32,
    },
    /// The processor does not serve the finger.
    #[error("the processor does not serve finger {finger}, counted from 0")]
    NoFinger {
        /// The finger that was named, from 0.
        finger: u32,
        /// The fingers of the hand that it serves: bit *i* stands for finger *i*.
        served: u32,
    },
    /// The finger does not have the joint, or the request allows only one joint.
    #[error("there is no joint {joint}; the finger has {joints}, from 0")]
    NoJoint {
        /// The joint that was named.
        joint: u32,
        /// The number of joints.
        joints: u32,
    },
    /// The mode that was asked for does not exist.
    #[error("there is no mode {mode}")]
    Mode {
        /// The number of the mode.
        mode: u32,
    },
    /// The law of position that was asked for does not exist.
    #[error("there is no law {law} of position")]
    Law {
        /// The number of the law.
        law: u32,
    },
    /// The part of an order that was asked for does not exist.
    #[error("orders have no part {part}")]
    Part {
        /// The number of the part.
        part: u32,
    },
    /// A number is not finite, or negative although it must not be.
    #[error("number {number} of the request, from 0, is {value}", value = Decimal(*.value))]
    Number {
        /// The index of the number in the request, from 0.
        number: u32,
        /// The number.
        value: f64,
    },
    /// The finger rests after a fault, or is on its way to rest.
    #[error("the finger rests after a fault; enable it first")]
    AfterFault,
    /// The joint cannot have the target.
    #[error(transparent)]
    Target(#[from] TargetError),
    /// The servo of the joint refuses another setting.
    #[error("the servo of joint {joint} does not take it")]
    Setting {
        /// The joint, from 0.
        joint: u32,
    },
}

/// Words that a refusal takes.
pub(super) const WORDS: usize = 9;

impl ServoRefusal {
    /// A code, two words, three numbers.
    pub(super) fn put(&self, put: &mut WordWriter<'_>) {
        let (words, numbers) = match *self {
            Self::Operation { operation } => ([16, operation, 0], [0.0; 3]),
            Self::NoFinger { finger, served } => ([17, finger, served], [0.0; 3]),
            Self::NoJoint { joint, joints } => ([18, joint, joints], [0.0; 3]),
            Self::Mode { mode } => ([19, mode, 0], [0.0; 3]),
            Self::Law { law } => ([20, law, 0], [0.0; 3]),
            Self::Part { part } => ([21, part, 0], [0.0; 3]),
            Self::Number { number, value } => ([22, number, 0], [value, 0.0, 0.0]),
            Self::AfterFault => ([23, 0, 0], [0.0; 3]),
            Self::Target(TargetError {
                joint,
                quantity,
                value,
                low,
                high,
            }) => ([24, joint, quantity as u32], [value, low, high]),
            Self::Setting { joint } => ([25, joint, 0], [0.0; 3]),
        };
        put.words(&words).numbers(&numbers);
    }

    /// The refusal in these words; none for a code that is none.
    pub(super) fn take(taken: &mut WordReader<'_>) -> Option<Self> {
        let (code, a, b) = (taken.word(), taken.word(), taken.word());
        let [x, low, high] = taken.numbers();
        Some(match code {
            16 => Self::Operation { operation: a },
            17 => Self::NoFinger {
                finger: a,
                served: b,
            },
            18 => Self::NoJoint {
                joint: a,
                joints: b,
            },
            19 => Self::Mode { mode: a },
            20 => Self::Law { law: a },
            21 => Self::Part { part: a },
            22 => Self::Number {
                number: a,
                value: x,
            },
            23 => Self::AfterFault,
            24 => Self::Target(TargetError {
                joint: a,
                quantity: TargetQuantity::from_number(b)?,
                value: x,
                low,
                high,
            }),
            25 => Self::Setting { joint: a },
            _ => return None,
        })
    }

    /// The refusal for an error from the servo of `joint`.
    pub(super) fn of_servo(joint: u32, error: &SettingError) -> Self {
        match *error {
            SettingError::AfterFault => Self::AfterFault,
            SettingError::NoJoint { joints, .. } => Self::NoJoint {
                joint,
                joints: joints as u32,
            },
            SettingError::Target(error) => Self::Target(error),
            _ => Self::Setting { joint },
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_refusal_comes_back_from_its_words() {
        let joint = 3;
        for refusal in [
            ServoRefusal::Operation { operation: 7 },
            ServoRefusal::NoFinger {
                finger: 9,
                served: 2,
            },
            ServoRefusal::NoJoint { joint, joints: 3 },
            ServoRefusal::Mode { mode: 5 },
            ServoRefusal::Law { law: 2 },
            ServoRefusal::Part { part: 3 },
            ServoRefusal::Number {
                number: 4,
                value: f64::INFINITY,
            },
            ServoRefusal::AfterFault,
            ServoRefusal::Target(TargetError {
                joint,
                quantity: TargetQuantity::Torque,
                value: 9.0,
                low: -1.5,
                high: 2.5,
            }),
            ServoRefusal::Setting { joint },
        ] {
            let mut words = [0; WORDS];
            refusal.put(&mut WordWriter::into(&mut words));
            assert_eq!(
                ServoRefusal::take(&mut WordReader::from(&words)),
                Some(refusal)
            );
        }
        assert_eq!(ServoRefusal::take(&mut WordReader::from(&[0; WORDS])), None);
    }
}
