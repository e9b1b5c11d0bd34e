use condor_mbox::{MailboxError, Processor, Vector};
use serde::Serialize;

use super::{View, ViewError};
use crate::control::Member;
use crate::names::word;

/// The counts of a processor's messages to one vector; all of them wrap at 2³².
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct VectorCounts {
    /// The number of the vector.
    pub vector: u8,
    /// The name that the program gave to its handler; empty if it has none.
    pub name: String,
    /// The number of messages that the processor sent to this vector of any processor.
    pub sent: u32,
    /// The number of messages to this vector that it handled.
    pub handled: u32,
    /// The number of messages that it sent to this vector and that ended in an error.
    pub failed: u32,
    /// The longest run time of its handler, in µs.
    pub worst_us: f64,
}

impl View {
    /// Returns the vectors of `processor` that have a name or a count above 0, in the order of their numbers. There are
    /// none if no program has ever joined there.
    ///
    /// # Errors
    /// [`ViewError::Mailbox`] if there is no such processor or its memory cannot be read.
    pub fn vectors(&self, processor: Processor) -> Result<Vec<VectorCounts>, ViewError> {
        let mut vectors = Vec::new();
        for number in 0..Vector::COUNT as u8 {
            let counts = match self.post.vector_statistics(processor, Vector(number)) {
                Ok(counts) => counts,
                // Nobody has ever joined there.
                Err(MailboxError::Layout { .. }) => break,
                Err(error) => return Err(error.into()),
            };
            let row = VectorCounts {
                vector: number,
                name: counts.name().into(),
                sent: counts.sent,
                handled: counts.handled,
                failed: counts.failed,
                worst_us: f64::from(counts.worst_ns) / 1e3,
            };
            if !row.name.is_empty() || row.sent != 0 || row.handled != 0 || row.failed != 0 {
                vectors.push(row);
            }
        }
        Ok(vectors)
    }

    /// Finds a vector of the processor `member`. `text` is the name of the vector's handler, or the number of the
    /// vector.
    ///
    /// # Errors
    /// Returns [`ViewError::NoVector`] if there is no such vector; [`ViewError::Mailbox`] if the memory of the
    /// processor cannot be read.
    pub fn vector(&self, member: &Member, text: &str) -> Result<Vector, ViewError> {
        let there = self.vectors(member.processor())?;
        vector(text, &member.name, &there).map_err(ViewError::NoVector)
    }
}

/// The vector of a number or a name.
fn vector(text: &str, processor: &str, there: &[VectorCounts]) -> Result<Vector, String> {
    let named = there.iter().find(|vector| vector.name == text);
    if let Some(vector) = named {
        return Ok(Vector(vector.vector));
    }
    let number = word(text).ok().and_then(|number| u8::try_from(number).ok());
    let number = number.filter(|number| usize::from(*number) < Vector::COUNT);
    number.map(Vector).ok_or_else(|| {
        let choices: Vec<String> = there
            .iter()
            .filter(|vector| !vector.name.is_empty())
            .map(|vector| format!("{} ({})", vector.name, vector.vector))
            .collect();
        format!(
            "{processor} has no vector `{text}`: name one of {}, or a number from 0 to {}",
            choices.join(", "),
            Vector::COUNT - 1
        )
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn vectors_have_numbers_and_names() {
        let there = [VectorCounts {
            vector: 40,
            name: "servos".into(),
            sent: 0,
            handled: 0,
            failed: 0,
            worst_us: 0.0,
        }];
        assert_eq!(vector("0x3f", "a", &there), Ok(Vector(63)));
        assert_eq!(vector("servos", "a", &there), Ok(Vector(40)));
        for wrong in ["64", "servo", "300"] {
            let text = vector(wrong, "a", &there).unwrap_err();
            assert!(
                text.contains("servos (40)") && text.contains("63"),
                "{text}"
            );
        }
    }
}
