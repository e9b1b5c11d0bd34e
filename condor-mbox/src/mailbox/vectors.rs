//! The vector table: handlers, their names, and counts of messages.

use super::{Handler, Mailbox};
use crate::backend::Backend;
use crate::error::MailboxError;
use crate::id::{Processor, Vector};
use crate::layout::{NAME_BYTES, vector};
use crate::mail::{At, Mail};
use crate::window::{LoadOrder, MemoryWindow, StoreOrder};

/// The name of one vector of one processor, and counts of its messages. Counts wrap at 2³².
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct VectorStatistics {
    name: [u8; NAME_BYTES],
    /// The number of messages that the processor sent to the vector with this number on any
    /// processor.
    pub sent: u32,
    /// The number of messages that the processor's own handler of the vector has handled.
    pub handled: u32,
    /// The number of messages that the processor sent to the vector with this number on any
    /// processor, and that ended in an error.
    pub failed: u32,
    /// The longest time of the processor's own handler in nanoseconds, from the look that found the
    /// message until after the reply; `u32::MAX` stands for any longer time.
    pub worst_ns: u32,
}

impl VectorStatistics {
    /// Returns the name that was set with the handler; empty if there is no handler, or if the peer
    /// wrote something that is not text.
    #[must_use]
    pub fn name(&self) -> &str {
        let len = self
            .name
            .iter()
            .position(|&byte| byte == 0)
            .unwrap_or(NAME_BYTES);
        self.name
            .get(..len)
            .and_then(|name| core::str::from_utf8(name).ok())
            .unwrap_or("")
    }
}

impl<'v, B: Backend, const N: usize> Mailbox<'v, B, N> {
    /// Sets the handler that runs when a message arrives for `vector` (`mbox_set_vector` of A.I.
    /// Memo 977).
    ///
    /// `name` is for people: every processor can list the names and counts of every other. A vector
    /// may be set at any time. The sender of a message that is served before gets
    /// [`MailboxError::NoHandler`].
    ///
    /// # Errors
    /// [`MailboxError::NoSuchVector`] if the number of `vector` is too large,
    /// [`MailboxError::VectorTaken`] if it has a handler already, [`MailboxError::NameTooLong`] if
    /// `name` is longer than [`NAME_BYTES`] bytes, [`MailboxError::Window`] if this mailbox's own
    /// memory cannot be accessed.
    pub fn set_vector(
        &mut self,
        vector: Vector,
        handler: Handler<'v>,
        name: &str,
    ) -> Result<(), MailboxError> {
        let entry = self
            .handlers
            .get_mut(vector.index())
            .ok_or(MailboxError::NoSuchVector { vector })?;
        if entry.is_some() {
            return Err(MailboxError::VectorTaken { vector });
        }
        if name.len() > NAME_BYTES {
            return Err(MailboxError::NameTooLong {
                vector,
                len: name.len(),
            });
        }
        *entry = Some(handler);
        self.write_name(vector, name)
    }

    /// Removes the handler of `vector`, if it has one, and its name.
    ///
    /// # Errors
    /// [`MailboxError::NoSuchVector`] if the number is too large; [`MailboxError::Window`] if this mailbox's
    /// own memory cannot be accessed.
    pub fn clear_vector(&mut self, vector: Vector) -> Result<(), MailboxError> {
        let entry = self
            .handlers
            .get_mut(vector.index())
            .ok_or(MailboxError::NoSuchVector { vector })?;
        *entry = None;
        self.write_name(vector, "")
    }

    /// Returns the name of `vector` on `processor` and the counts of its messages. The processor is
    /// not stopped for this.
    ///
    /// # Errors
    /// [`MailboxError::NoSuchProcessor`] or [`MailboxError::NoSuchVector`] if a number is too
    /// large; [`MailboxError::Layout`] if the memory of `processor` has another layout;
    /// [`MailboxError::Window`] if it cannot be accessed.
    pub fn vector_statistics(
        &self,
        processor: Processor,
        vector: Vector,
    ) -> Result<VectorStatistics, MailboxError> {
        let peer = self.peer(processor)?;
        if vector.index() >= Vector::COUNT {
            return Err(MailboxError::NoSuchVector { vector });
        }
        peer.check_layout()?;
        let word = |field| {
            let at = At::<N>::vector(vector, field);
            peer.mail().load(at, LoadOrder::Relaxed)
        };
        let mut name = [0; NAME_BYTES];
        for (bytes, field) in name.chunks_exact_mut(4).zip((vector::NAME..).step_by(4)) {
            bytes.copy_from_slice(&word(field)?.to_le_bytes());
        }
        Ok(VectorStatistics {
            name,
            sent: word(vector::SENT)?,
            handled: word(vector::HANDLED)?,
            failed: word(vector::FAILED)?,
            worst_ns: word(vector::WORST)?,
        })
    }

    fn write_name(&self, vector: Vector, name: &str) -> Result<(), MailboxError> {
        let own = self.own()?;
        let mut bytes = name.bytes();
        for field in (vector::NAME..).step_by(4).take(NAME_BYTES / 4) {
            let word = core::array::from_fn(|_| bytes.next().unwrap_or(0));
            let at = At::<N>::vector(vector, field);
            own.store(at, u32::from_le_bytes(word), StoreOrder::Relaxed)?;
        }
        Ok(())
    }
}

/// Empties the table in `own`.
pub(super) fn clear<W: MemoryWindow, const N: usize>(
    own: &Mail<'_, W, N>,
) -> Result<(), MailboxError> {
    for number in 0..Vector::COUNT {
        for field in (vector::NAME..=vector::WORST).step_by(4) {
            let at = At::<N>::vector(Vector(number as u8), field);
            own.store(at, 0, StoreOrder::Relaxed)?;
        }
    }
    Ok(())
}
