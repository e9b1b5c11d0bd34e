//! Processors in one process: ordinary memory, virtual or real time, and faults on demand.
//!
//! [`SimSystem`] makes the windows and doorbells. In *virtual* time everything runs on one thread and
//! is deterministic: while a processor waits, the others run as [`SimSystem::while_waiting`] says, and
//! when none has anything to do, time jumps to the end of the wait. In *real* time each processor
//! is a thread. With [`SimSystem::with_caches`] the memory is not coherent.

mod cache;
mod system;
mod window;

pub use system::{SimDoorbell, SimSystem};
pub use window::SimWindow;

/// The mailbox of a processor of a [`SimSystem`].
pub type SimMailbox<'v, const N: usize> =
    crate::Mailbox<'v, (SimWindow, SimDoorbell, crate::CriticalSection), N>;
