//! [`Backend`]: the machine of a mailbox, as one parameter.

use crate::doorbell::Doorbell;
use crate::exclusion::Exclusion;
use crate::window::MemoryWindow;

/// The machine on which a mailbox runs: the types of its memory, of its interrupt, and of its
/// critical sections.
///
/// A backend is only a name for these types; no value of it exists. Define one for your board, or
/// write the three types in parentheses for a mailbox that is made in only one place.
///
/// ```
/// use condor_mbox::sim::{SimDoorbell, SimWindow};
/// use condor_mbox::{Backend, CriticalSection, MailboxError, Mailbox, Messenger, Processor, Vector};
/// # use std::time::Duration;
///
/// struct Board;
///
/// impl Backend for Board {
///     type Window = SimWindow;
///     type Doorbell = SimDoorbell;
///     type Exclusion = CriticalSection;
/// }
///
/// fn greet(mailbox: &Mailbox<'_, Board, 2>) -> Result<(), MailboxError> {
///     mailbox.send(Processor(1), Vector(3), 7, Duration::ZERO)
/// }
///
/// // The same on every machine:
/// fn greet_anywhere<B: Backend>(mailbox: &Mailbox<'_, B, 2>) -> Result<(), MailboxError> {
///     mailbox.send(Processor(1), Vector(3), 7, Duration::ZERO)
/// }
/// ```
pub trait Backend {
    /// The window onto the shared memory of one processor.
    type Window: MemoryWindow;
    /// The mailbox interrupt, and the clock.
    type Doorbell: Doorbell;
    /// The critical sections that keep background, handlers and interrupts of one processor apart.
    type Exclusion: Exclusion;
}

impl<W: MemoryWindow, D: Doorbell, X: Exclusion> Backend for (W, D, X) {
    type Window = W;
    type Doorbell = D;
    type Exclusion = X;
}
