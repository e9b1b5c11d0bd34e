//! Shared memory and doorbells of Linux.
//!
//! | you have | you take |
//! |---|---|
//! | unrelated programs | [`System::named`], or [`System::at`] for a directory of your own |
//! | another machine's memory, as one file | [`System::in_memory`], and then [`System::at`] everywhere |
//! | one program that starts the others | [`System::family`], [`System::pass_to`], [`System::inherited`] |
//! | a device, or a file with a layout of its own | [`LinuxWindow::map`], [`LinuxWindow::uio`] and your own doorbell |
//!
//! A [`System`] has *N* numbers. [`System::claim`] takes one of them for this process and gives
//! its [`Claim`]: the windows of all processors and a [`LinuxDoorbell`]. What belongs to a
//! processor are two pieces of shared memory, `mail` and `data` (see [`layout`](crate::layout)),
//! and a pipe, its *bell*, for those who poll.
//!
//! ```
//! # use condor_mbox::Processor;
//! use condor_mbox::linux::System;
//!
//! # const HOST: Processor = Processor(0);
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! // For the processes that this one starts; `System::named("robot", 4096)` is for any others.
//! let mut host = System::<2>::family(4096)?.claim(HOST)?.mailbox()?;
//! host.join()?;
//! # Ok(())
//! # }
//! ```
//!
//! The feature `critical-section` of `condor-platform` brings what [`CriticalSection`](crate::CriticalSection) needs;
//! a mailbox that one thread alone uses can have a [`SingleContext`](crate::SingleContext) instead:
//! [`Claim::mailbox_with`].
//!
//! # Death
//!
//! A number is held by a write lock on the open file description of its `mail`. The kernel drops
//! it when the last descriptor is closed, however the program ended, and that is what
//! [`Evidence`](crate::Evidence) looks at. It happens while the kernel takes the program apart:
//! after its memory was given back, which takes long if there are gigabytes of it. A process that
//! was forked from the holder and did not `exec` holds the number too.
//!
//! Files of a named system outlive all programs, and every object comes into being whole, so that
//! programs may be killed at any moment: nothing is ever cleaned up by hand. A program that wants
//! the files gone calls [`System::remove`]. Where the windows lie in one memory, a small file stands
//! for each `mail` to be locked; whether a processor of another machine lives is then for the process
//! to say that holds its number.
//!
//! # Who is protected from whom
//!
//! What peers *write* is never believed by a mailbox, wherever it lies. What else they can do
//! depends on where it lies:
//!
//! | | family | named |
//! |---|---|---|
//! | who can take part | the processes that were given the descriptors | everyone whom the directory's permissions allow |
//! | truncate the memory | nobody: it is sealed | everyone who takes part; all accesses then are `Lost` |
//! | delete the files | there are none | everyone who takes part; who has them mapped goes on, later ones are alone |
//! | make another process open or change a file elsewhere | nobody | nobody: no link is followed at the end of a path, and a memory is believed of this user, root and the directory's owner only |
//! | write a peer's `mail` | everyone who takes part, by opening it anew: the kernel lets a mapping be read-only, not a participant | likewise |
//! | hold a number without using it, ring for nothing | everyone who takes part | likewise |
//!
//! So participants can disturb each other's *work*, never a program's memory, and those who are
//! to be kept out are kept out by permissions: a directory that [`System::named`] creates is its
//! user's alone (mode 0700). For a group, create a directory with the group's permissions and use
//! [`System::at`]: files get the read and write permissions that the directory has. Whoever may write
//! the directory *above* can put another one in its place. A family
//! re-opens what it inherited through `/proc/self/fd`, so `/proc` must be mounted, and the program
//! must keep its user id.
//!
//! # SIGBUS
//!
//! With the first window, a handler for SIGBUS is installed, which passes on what does not concern
//! a window to the handler that was there. Who installs one later must likewise pass on what does
//! not concern him. A thread that blocks SIGBUS is killed by the kernel if it touches memory that
//! has vanished.
//!
//! # Real time
//!
//! Accesses of windows are plain memory accesses once their pages are there: call `mlockall`, as
//! for all other memory. `ring` makes one system call, or two if its receiver polls; it does not
//! allocate or block and may be called from a signal handler.

mod claim;
mod copy;
mod description;
mod directory;
mod doorbell;
mod error;
mod family;
mod fault;
mod lock;
mod memory;
mod objects;
mod system;
mod transfer;
mod window;

pub use claim::Claim;
pub use doorbell::{LinuxDoorbell, PollableBell};
pub use error::{FileKind, SystemError};
pub use memory::{Memory, Run};
pub use system::System;
pub use window::{Access, LinuxWindow, LinuxWindowError, MapError};

/// A mailbox of Linux, for a process whose threads may all use it.
pub type Mailbox<'v, const N: usize, X = crate::CriticalSection> =
    crate::Mailbox<'v, (LinuxWindow, LinuxDoorbell<N>, X), N>;
