use zerocopy::{FromBytes, Immutable, IntoBytes};

use crate::number::{NumberError, Requirement, Subject};
use crate::trajectory::{JointStreamError, QUANTITIES};

/// A [`JointStreamError`] as it lies in an answer. Fields that an error does not use are zero.
#[derive(Clone, Copy, Debug, Default, PartialEq, FromBytes, IntoBytes, Immutable)]
#[repr(C)]
pub struct StreamRefusal {
    /// The kind of error: 1 for the time, 2 for the sequence, 3 for the end, 4 for a joint, 0 for none.
    pub kind: u32,
    /// The joint, or the number of the batch that was found.
    pub which: u32,
    /// The quantity of a joint, or the number of the batch that was expected.
    pub quantity: u32,
    /// The requirement that the quantity does not meet: 0 for finite, 1 for above, 2 for below, 3 for at
    /// least, 4 for at most.
    pub must: u32,
    /// The time of the point, s.
    pub time: f64,
    /// The value of the quantity, or the time of the previous point, s.
    pub value: f64,
    /// The bound of the requirement.
    pub bound: f64,
}

impl StreamRefusal {
    pub(super) fn of(error: JointStreamError) -> Self {
        match error {
            JointStreamError::Time { time, after } => Self {
                kind: 1,
                time,
                value: after,
                ..Self::default()
            },
            JointStreamError::Sequence { found, expected } => Self {
                kind: 2,
                which: found,
                quantity: expected,
                ..Self::default()
            },
            // A full stream never comes here: the answer is `Code::Busy`.
            JointStreamError::Ended | JointStreamError::Full { .. } => Self {
                kind: 3,
                ..Self::default()
            },
            JointStreamError::Joint { joint, time, error } => {
                let (must, bound) = match error.must {
                    // The last three are none of a stream's.
                    Requirement::Finite
                    | Requirement::Within(..)
                    | Requirement::Equal(_)
                    | Requirement::MultipleOf(_) => (0, 0.0),
                    Requirement::Above(bound) => (1, bound),
                    Requirement::Below(bound) => (2, bound),
                    Requirement::AtLeast(bound) => (3, bound),
                    Requirement::AtMost(bound) => (4, bound),
                };
                let mut quantities = (0..).zip(QUANTITIES);
                let quantity = quantities.find(|&(_, what)| what == error.what);
                Self {
                    kind: 4,
                    which: joint as u32,
                    quantity: quantity.map_or(u32::MAX, |(number, _)| number),
                    must,
                    time,
                    value: error.value,
                    bound,
                }
            }
        }
    }

    /// Returns the error; `None` if no controller writes these fields.
    pub(super) fn error(&self) -> Option<JointStreamError> {
        let Self {
            time, value, bound, ..
        } = *self;
        Some(match self.kind {
            1 => JointStreamError::Time { time, after: value },
            2 => JointStreamError::Sequence {
                found: self.which,
                expected: self.quantity,
            },
            3 => JointStreamError::Ended,
            4 => {
                let must = match self.must {
                    0 => Requirement::Finite,
                    1 => Requirement::Above(bound),
                    2 => Requirement::Below(bound),
                    3 => Requirement::AtLeast(bound),
                    4 => Requirement::AtMost(bound),
                    _ => return None,
                };
                let what = QUANTITIES.get(self.quantity as usize)?;
                JointStreamError::Joint {
                    joint: self.which as usize,
                    time,
                    error: NumberError {
                        at: Subject::Whole,
                        what,
                        value,
                        must,
                    },
                }
            }
            _ => return None,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_answer_has_the_whole_reason() {
        let must = [
            Requirement::Finite,
            Requirement::Above(-0.5),
            Requirement::Below(1.5),
            Requirement::AtLeast(-2.5),
            Requirement::AtMost(3.5),
        ];
        let errors = QUANTITIES.into_iter().flat_map(|what| {
            let error = must.map(|must| NumberError {
                at: Subject::Whole,
                what,
                value: 7.25,
                must,
            });
            error.map(|error| JointStreamError::Joint {
                joint: 14,
                time: 0.4,
                error,
            })
        });
        let others = [
            JointStreamError::Time {
                time: 0.1,
                after: 0.2,
            },
            JointStreamError::Sequence {
                found: 2,
                expected: 1,
            },
            JointStreamError::Ended,
        ];
        for error in errors.chain(others) {
            assert_eq!(StreamRefusal::of(error).error(), Some(error));
        }
        assert_eq!(StreamRefusal::default().error(), None);
    }
}
