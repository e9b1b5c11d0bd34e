//! [`Runner`]: what scopes and locks ask of whatever runs loops.

#[cfg(all(feature = "linux", target_os = "linux", not(condor_loom)))]
use condor_platform::linux::PiLock;

use crate::body::LoopBody;
use crate::error::{LoopError, LoopLockError};
use crate::instant::CounterReading;
use crate::process::{LoopId, Overrun};
use crate::sync::AtomicBool;

/// The calls of [`Loops`](crate::Loops) that only its scopes and locks make.
pub trait Runner {
    /// The type of an instant of the timer.
    type Instant: CounterReading;

    fn assign_body(
        &self,
        id: LoopId,
        overrun: Overrun,
        body: LoopBody<Self::Instant>,
    ) -> Result<(), LoopError>;

    /// Disarms these loops, a bit for each, and returns when none of them is in progress.
    fn withdraw(&self, numbers: u32);

    /// Takes a lock; returns the value to pass to [`leave`](Self::leave) as `former`.
    ///
    /// # Errors
    /// [`LoopLockError`] if the caller may not take the lock, or it is taken already.
    fn enter(&self, gate: &Gate) -> Result<u32, LoopLockError>;

    /// Releases the lock. `former` is the value that [`enter`](Self::enter) returned.
    fn leave(&self, gate: &Gate, former: u32);
}

/// A lock without its value.
pub struct Gate {
    /// A bit for each loop that may use it.
    pub(crate) users: u32,
    pub(crate) taken: AtomicBool,
    #[cfg(all(feature = "linux", target_os = "linux", not(condor_loom)))]
    pub(crate) threads: PiLock,
}
