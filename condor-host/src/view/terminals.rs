use condor_mbox::{Processor, Region};
use condor_tty::layout::{MAGIC, VERSION, host, mode, processor as words};
use serde::Serialize;

use super::{View, ViewError};
use condor_rt::objects::{Kind, Object};

/// How a terminal of a processor is; counts wrap at 2³².
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
#[non_exhaustive]
pub struct TerminalCounts {
    /// Its name in the processor's object table.
    pub name: String,
    /// Bytes that the program has written.
    pub written: u32,
    /// Bytes that found no room.
    pub lost: u32,
    /// Bytes that the terminal service has not dealt with yet.
    pub unread: u32,
    /// Bytes of its ring.
    pub capacity: u32,
    /// Who reads it: the number of a processor.
    pub reader: Option<u8>,
    /// Whether a person has stopped its output.
    pub is_stopped: bool,
    /// Whether a character has been refused, and its program has read nothing since.
    pub is_full: bool,
}

impl View {
    /// The terminals of `processor`. Nobody attaches to them for that.
    ///
    /// # Errors
    /// [`ViewError::Mailbox`], [`ViewError::Memory`].
    pub fn terminals(&self, processor: Processor) -> Result<Vec<TerminalCounts>, ViewError> {
        let region = self.region(processor)?;
        let mut terminals = Vec::new();
        for object in self.objects(processor, Kind::Terminal)? {
            let counts = read(&region, &object);
            terminals.extend(counts.map_err(|source| ViewError::Memory { processor, source })?);
        }
        Ok(terminals)
    }
}

/// None while the program makes it.
fn read<W: condor_mbox::MemoryWindow>(
    region: &Region<W>,
    object: &Object,
) -> Result<Option<TerminalCounts>, condor_mbox::AccessError> {
    let word = |offset: u32| region.word(object.offset.saturating_add(offset));
    let life = word(words::LIFE)?;
    if word(words::MAGIC)? != MAGIC || word(words::VERSION)? != VERSION || life == 0 {
        return Ok(None);
    }
    // The host's words may still be about the life before.
    let (reader, tail) = if word(host::LIFE)? == life {
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
