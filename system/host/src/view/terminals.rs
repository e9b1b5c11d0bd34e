use condor_mbox::{Processor, Region};
use condor_tty::layout::{MAGIC, VERSION, host, mode, processor as words};
use serde::Serialize;

use super::{View, ViewError};
use condor_rt::objects::{ObjectKind, SharedObject};

/// The state of a terminal of a processor: bytes written, lost and unread, and its reader. Counts wrap at 2³².
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
#[non_exhaustive]
pub struct TerminalCounts {
    /// The name of the terminal in the processor's object table.
    pub name: String,
    /// The number of bytes that the program has written.
    pub written: u32,
    /// The number of bytes that were lost because there was no room.
    pub lost: u32,
    /// The number of bytes that the terminal service has not read yet.
    pub unread: u32,
    /// The size of its ring of output, in bytes.
    pub capacity: u32,
    /// The number of the service or visitor that reads it; `None` if none does.
    pub reader: Option<u8>,
    /// Whether a person has stopped its output.
    pub is_stopped: bool,
    /// Whether a typed character was refused for lack of room, and the program has read nothing
    /// since.
    pub is_full: bool,
}

impl View {
    /// Reads the state of the terminals of `processor`, without becoming their reader.
    ///
    /// # Errors
    /// [`ViewError::Mailbox`] if there is no such processor, [`ViewError::Memory`] if its memory
    /// cannot be read, [`ViewError::Version`] if the object table has another version.
    pub fn terminals(&self, processor: Processor) -> Result<Vec<TerminalCounts>, ViewError> {
        let region = self.region(processor)?;
        let mut terminals = Vec::new();
        for object in self.objects(processor, ObjectKind::Terminal)? {
            let counts = read(&region, &object);
            terminals.extend(counts.map_err(|source| ViewError::Memory { processor, source })?);
        }
        Ok(terminals)
    }
}

/// None while the program makes it.
fn read<W: condor_mbox::MemoryWindow>(
    region: &Region<W>,
    object: &SharedObject,
) -> Result<Option<TerminalCounts>, condor_mbox::AccessError> {
    let word = |offset: u32| region.word(object.offset.saturating_add(offset));
    let incarnation = word(words::INCARNATION)?;
    if word(words::MAGIC)? != MAGIC || word(words::VERSION)? != VERSION || incarnation == 0 {
        return Ok(None);
    }
    // The host's words may still be about the incarnation before.
    let (reader, tail) = if word(host::INCARNATION)? == incarnation {
        let [reader, ..] = word(host::ATTACHED)?.to_le_bytes();
        (reader.checked_sub(1), word(host::TAIL)?)
    } else {
        (None, 0)
    };
    let (written, mode_bits) = (word(words::HEAD)?, word(words::MODE)?);
    Ok(Some(TerminalCounts {
        name: object.name.as_str().into(),
        written,
        lost: word(words::LOST)?,
        unread: written.wrapping_sub(tail),
        capacity: word(words::CAPACITY)?,
        reader,
        is_stopped: mode_bits & mode::STOPPED != 0,
        is_full: mode_bits & mode::FULL != 0,
    }))
}
