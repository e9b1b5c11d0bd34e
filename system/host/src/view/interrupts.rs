use condor_mbox::published::PublishedReadError;
use condor_mbox::{Processor, Published};
use condor_rt::Interrupts;
use condor_rt::objects::{ObjectKind, SharedObject};
use serde::Serialize;

use super::{View, ViewError};

/// The interrupts of a processor's boards since its program began, by outcome. Counts wrap.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct BoardInterrupts {
    /// The number of interrupts that a board had raised and that were served.
    pub served: u32,
    /// The number of interrupts after which no vector was pending.
    pub spurious: u32,
    /// The number of interrupts of a vector none of whose boards had raised one.
    pub unclaimed: u32,
    /// The number of interrupts of a vector that no board has.
    pub unhandled: u32,
    /// The number of times that a vector was disabled because its interrupts did not end.
    pub stuck: u32,
    /// The first of the vectors that interrupted and that no board has.
    pub unhandled_vectors: Vec<u16>,
    /// The first of the vectors that were disabled because their interrupts did not end.
    pub stuck_vectors: Vec<u16>,
    /// The causes of traps that the processor does not handle and that occurred.
    pub unhandled_causes: Vec<u8>,
}

impl View {
    /// Reads the counts of the interrupts of `processor`, which its background publishes from time to time; `None` if
    /// its program has no boards that interrupt.
    ///
    /// # Errors
    /// [`ViewError::Mailbox`] if there is no such processor, [`ViewError::Memory`] if its memory
    /// cannot be read, [`ViewError::Version`] if the object table has another version.
    pub fn interrupts(&self, processor: Processor) -> Result<Option<BoardInterrupts>, ViewError> {
        let objects = self.objects(processor, ObjectKind::Other)?;
        // A program may have another cell of that name.
        let is_such = |it: &&SharedObject| {
            it.name.to_string() == Interrupts::NAME && it.len == Published::<Interrupts>::BYTES
        };
        let object = objects.iter().find(is_such);
        let Some(object) = object else {
            return Ok(None);
        };
        let cell = Published::<Interrupts>::at(object.offset);
        let read = cell.subscriber(self.region(processor)?);
        let read = read.map(|cell| cell.read());
        match read {
            Ok(Ok(latest)) => Ok(Some(BoardInterrupts::of(&latest.value))),
            Ok(Err(PublishedReadError::Access(source))) | Err(source) => {
                Err(ViewError::Memory { processor, source })
            }
            Ok(Err(_)) => Ok(None),
        }
    }
}

impl BoardInterrupts {
    fn of(seen: &Interrupts) -> Self {
        let named = |vectors: &[i32]| {
            let numbers = vectors
                .iter()
                .filter_map(|&vector| u16::try_from(vector).ok());
            numbers.collect()
        };
        let causes = (0..32).filter(|cause| seen.unhandled_causes >> cause & 1 != 0);
        Self {
            served: seen.served,
            spurious: seen.spurious,
            unclaimed: seen.unclaimed,
            unhandled: seen.unhandled,
            stuck: seen.stuck,
            unhandled_vectors: named(&seen.unhandled_vectors),
            stuck_vectors: named(&seen.stuck_vectors),
            unhandled_causes: causes.collect(),
        }
    }
}
