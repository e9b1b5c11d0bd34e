//! Refusals as words.

use super::ALL_JOINTS;
use super::words::{WordReader, WordWriter};
use crate::number::{NumberError, Requirement, Subject};
use crate::servo::{RATES, ServoRefusal, TargetQuantity};

/// Words that a refusal takes.
pub(super) const WORDS: usize = 9;

impl ServoRefusal {
    /// A code, two words, three numbers. The only numbers that a servo refuses in a message, other than targets beyond
    /// limits, are rates that are not finite.
    pub(super) fn put(&self, put: &mut WordWriter<'_>) {
        let (words, numbers) = match *self {
            Self::Operation { operation } => ([16, operation, 0], [0.0; 3]),
            Self::NoFinger { finger, served } => ([17, finger, served], [0.0; 3]),
            Self::NoJoint { joint, joints } => ([18, joint, joints], [0.0; 3]),
            Self::Mode { mode } => ([19, mode, 0], [0.0; 3]),
            Self::Part { part } => ([21, part, 0], [0.0; 3]),
            Self::AfterFault => ([23, 0, 0], [0.0; 3]),
            Self::Target {
                joint,
                quantity,
                value,
                low,
                high,
            } => ([24, joint, quantity as u32], [value, low, high]),
            Self::Number(error) => {
                let joint = match error.at {
                    Subject::Joint(joint) => joint.into(),
                    _ => ALL_JOINTS,
                };
                let mut rates = (0..).zip(RATES);
                let rate = rates.find(|(_, what)| *what == error.what);
                let rate = rate.map_or(u32::MAX, |(rate, _)| rate);
                ([25, joint, rate], [error.value, 0.0, 0.0])
            }
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
            21 => Self::Part { part: a },
            23 => Self::AfterFault,
            24 => Self::Target {
                joint: a,
                quantity: TargetQuantity::from_number(b)?,
                value: x,
                low,
                high,
            },
            25 => Self::Number(NumberError {
                at: match a {
                    ALL_JOINTS => Subject::Whole,
                    joint => Subject::Joint(joint as u16),
                },
                what: RATES.get(b as usize).copied().unwrap_or("a number"),
                value: x,
                must: Requirement::Finite,
            }),
            _ => return None,
        })
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
            ServoRefusal::Part { part: 3 },
            ServoRefusal::AfterFault,
            ServoRefusal::Target {
                joint,
                quantity: TargetQuantity::Torque,
                value: 9.0,
                low: -1.5,
                high: 2.5,
            },
            ServoRefusal::Number(NumberError {
                at: Subject::Joint(3),
                what: "the acceleration, rad/s²,",
                value: f64::INFINITY,
                must: Requirement::Finite,
            }),
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
