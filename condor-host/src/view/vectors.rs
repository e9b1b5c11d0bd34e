use condor_mbox::{Error, Processor, Vector};
use serde::Serialize;

use super::{View, ViewError};

/// The counts of a vector of a processor; they wrap at 2³².
#[derive(Clone, Debug, PartialEq, Serialize)]
#[non_exhaustive]
pub struct VectorCounts {
    /// Its number.
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
    /// Returns the vectors of `processor` that have a name or a count.
    ///
    /// # Errors
    /// [`ViewError::Mailbox`] if there is no such processor or its memory cannot be read.
    pub fn vectors(&self, processor: Processor) -> Result<Vec<VectorCounts>, ViewError> {
        let mut vectors = Vec::new();
        for number in 0..Vector::COUNT as u8 {
            let counts = match self.post.vector_statistics(processor, Vector(number)) {
                Ok(counts) => counts,
                // Nobody has ever joined there.
                Err(Error::Layout { .. }) => break,
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
}
