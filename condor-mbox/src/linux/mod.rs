//! Shared memory and doorbells of Linux.
//!
//! | your case | use |
//! |---|---|
//! | unrelated programs | [`LinuxSystem::named`], or [`LinuxSystem::at`] for a directory of your own |
//! | the memory of another machine, as one file | [`LinuxSystem::in_memory`] once, and then [`LinuxSystem::at`] in all programs |
//! | one program that starts the others | [`LinuxSystem::family`], [`LinuxSystem::pass_to`], [`LinuxSystem::inherited`] |
//! | a device, or a file with a layout of its own | [`LinuxWindow::map`], [`LinuxWindow::uio`] and your own doorbell |
//!
//! A [`LinuxSystem`] has *N* numbers. [`LinuxSystem::claim`] takes one of them for this process and returns a
//! [`Claim`], which has the windows of all processors and a [`LinuxDoorbell`]. Each processor has two pieces of
//! shared memory, `mail` and `data` (see [`layout`](crate::layout)), and the pipe of its doorbell, for programs
//! that poll.
//!
//! ```
//! # use condor_mbox::Processor;
//! use condor_mbox::linux::LinuxSystem;
//!
//! # const HOST: Processor = Processor(0);
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! // For the processes that this one starts; `LinuxSystem::named("robot", 4096)` is for any others.
//! let mut host = LinuxSystem::<2>::family(4096)?.claim(HOST)?.mailbox()?;
//! host.join()?;
//! # Ok(())
//! # }
//! ```
//!
//! [`CriticalSection`](crate::CriticalSection) needs the feature `critical-section` of
//! `condor-platform`. A mailbox that only one thread uses can have a
//! [`SingleContext`](crate::SingleContext) instead: see [`Claim::mailbox_with`].
//!
//! # Death
//!
//! A process holds a number by a write lock on the open file description of its `mail`. The kernel
//! drops the lock when the last descriptor is closed, however the program ended;
//! [`Evidence`](crate::Evidence) is based on this. It happens after the kernel has freed the
//! program's memory, which takes long for gigabytes of it. A process that was forked from the
//! holder and did not `exec` holds the number, too: every process that a program starts does so for
//! some milliseconds. So [`LinuxSystem::claim`] waits up to [`LOCK_PATIENCE`], which is 1 s, before it
//! says that a number is taken.
//!
//! The files of a named system outlive all programs, and every file appears complete or not at all.
//! So programs may be killed at any moment, and nothing has to be cleaned up by hand.
//! [`LinuxSystem::remove`] removes the files. If the windows lie in one memory file, each `mail` has a
//! small file that is locked in its place. Only the process that holds a number can tell whether a
//! processor of another machine is alive.
//!
//! # Protection of participants
//!
//! A mailbox never believes what peers *write*, wherever the memory lies. What else peers can do
//! depends on its place:
//!
//! | | family | named |
//! |---|---|---|
//! | may take part | the processes that got the descriptors | everyone whom the directory's permissions allow |
//! | can truncate the memory | nobody: it is sealed | every participant; all accesses then return `Lost` |
//! | can delete the files | there are none | every participant; programs that have them mapped go on, later programs are alone |
//! | can make another process open or change a file elsewhere | nobody | nobody: no link is followed at the end of a path, and only this user, root and the directory's owner can name a memory file |
//! | can write a peer's `mail` | every participant, by opening it again: the kernel can make a mapping read-only, but not a participant | likewise |
//! | can hold a number without using it, and ring without reason | every participant | likewise |
//!
//! So participants can disturb each other's *work*, but not a program's own memory. Permissions
//! keep others out: a directory that [`LinuxSystem::named`] creates is accessible to its user only (mode
//! 0700). For a group, create a directory with the group's permissions and use [`LinuxSystem::at`]:
//! files get the read and write permissions of the directory. A user who may write the directory
//! *above* can replace the directory. A family opens inherited descriptors again through
//! `/proc/self/fd`, so `/proc` must be mounted, and the program must keep its user id.
//!
//! # SIGBUS
//!
//! The first window installs a handler for SIGBUS. It passes on signals that do not concern a
//! window to the handler that was installed before. A handler that is installed later must likewise
//! pass on signals that do not concern it. If a thread blocks SIGBUS and touches memory that has
//! vanished, the kernel kills it.
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
pub use condor_platform::linux::LOCK_PATIENCE;
pub use directory::allocate;
pub use doorbell::{LinuxDoorbell, PollableBell};
pub use error::{FileKind, SystemError};
pub use memory::{Memory, ObjectPositions};
pub use system::LinuxSystem;
pub use window::{LinuxWindow, WindowAccess, WindowMapError};

/// The mailbox of a process of Linux. All threads of the process may use it if `X` is
/// [`CriticalSection`](crate::CriticalSection).
pub type LinuxMailbox<'v, const N: usize, X = crate::CriticalSection> =
    crate::Mailbox<'v, (LinuxWindow, LinuxDoorbell<N>, X), N>;
