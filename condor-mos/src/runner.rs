//! [`Runner`]: what scopes and locks ask of whatever runs loops.

#[cfg(all(feature = "linux", target_os = "linux", not(condor_loom)))]
use condor_platform::linux::PiLock;

use crate::body::LoopBody;
use crate::error::{LoopError, LoopLockError};
use crate::instant::CounterReading;
use crate::process::{LoopId, Overrun};
use crate::sync::AtomicBool;

/// The part of [`Loops`](crate::Loops) that [`Scope`](crate::Scope) and
/// [`LoopLock`](crate::LoopLock) use. Programs do not call these methods.
pub trait Runner {
    /// The type of an instant of the timer.
    type Instant: CounterReading;

    /// Sets the body of the loop `id`, and enables the loop.
    ///
    /// # Errors
    /// [`LoopError::NoSuchLoop`] if there is no such loop, [`LoopError::Taken`] if it has a body,
    /// [`LoopError::NoThread`] if a thread cannot be started.
    fn assign_body(
        &self,
        id: LoopId,
        overrun: Overrun,
        body: LoopBody<Self::Instant>,
    ) -> Result<(), LoopError>;

    /// Disables loops, takes their bodies away, and returns when none of these loops is in
    /// progress. Bit *n* of `numbers` stands for loop *n*.
    fn withdraw(&self, numbers: u32);

    /// Takes a lock; returns the value to pass to [`leave`](Self::leave) as `former`.
    ///
    /// # Errors
    /// [`LoopLockError`] if the caller may not take the lock, or it is taken already.
    fn enter(&self, gate: &Gate) -> Result<u32, LoopLockError>;

    /// Releases the lock. `former` is the value that [`enter`](Self::enter) returned.
    fn leave(&self, gate: &Gate, former: u32);
}

/// The state of a [`LoopLock`](crate::LoopLock) without its value: the loops that may take it, and
/// whether it is taken.
pub struct Gate {
    /// A bit for each loop that may use it.
    pub(crate) users: u32,
    pub(crate) taken: AtomicBool,
    #[cfg(all(feature = "linux", target_os = "linux", not(condor_loom)))]
    pub(crate) threads: PiLock,
}
