//! [`Backend`]: the machine of a mailbox, as one parameter.

use crate::doorbell::Doorbell;
use crate::exclusion::Exclusion;
use crate::window::MemoryWindow;

/// The machine on which a mailbox runs: the types of its memory, of its interrupt, and of what keeps
/// the contexts of one processor apart.
///
/// It is a name and no value. A board has one of its own; three types in parentheses are one, too,
/// for a mailbox that is made once.
///
/// ```
/// use condor_mbox::sim::{SimDoorbell, SimWindow};
/// use condor_mbox::{Backend, CriticalSection, Error, Mailbox, Messenger, Processor, Vector};
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
/// fn greet(mailbox: &Mailbox<'_, Board, 2>) -> Result<(), Error> {
///     mailbox.send(Processor(1), Vector(3), 7, Duration::ZERO)
/// }
///
/// // The same on every machine:
/// fn greet_anywhere<B: Backend>(mailbox: &Mailbox<'_, B, 2>) -> Result<(), Error> {
///     mailbox.send(Processor(1), Vector(3), 7, Duration::ZERO)
/// }
/// ```
pub trait Backend {
    /// The memory.
    type Window: MemoryWindow;
    /// The mailbox interrupt, and the clock.
    type Doorbell: Doorbell;
    /// What keeps background, handlers and interrupts of one processor apart.
    type Exclusion: Exclusion;
}

impl<W: MemoryWindow, D: Doorbell, X: Exclusion> Backend for (W, D, X) {
    type Window = W;
    type Doorbell = D;
    type Exclusion = X;
}
