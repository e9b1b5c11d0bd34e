//! [`DebuggerLock`]: who may give commands to a processor's stub.

use std::fs::File;
use std::io;
use std::os::unix::fs::OpenOptionsExt as _;
use std::path::Path;
use std::time::Duration;

use condor_mbox::MemoryWindow;
use condor_platform::linux::{lock_file, while_held};
use rustix::fs::FlockOperation;

use crate::{Tracer, TracerError};

/// A lock on a file, by which a processor has at most one debugger at a time. The kernel frees the
/// lock when the process that holds it ends, even if that process is killed.
#[derive(Debug)]
pub struct DebuggerLock(File);

impl DebuggerLock {
    /// Takes the lock on `file`, which is made if it does not exist. If another process has the lock, waits for at most
    /// `limit`, and then returns `None`.
    ///
    /// # Errors
    /// [`io::Error`] if the file cannot be made or locked.
    pub fn take(file: &Path, limit: Duration) -> io::Result<Option<Self>> {
        let is_held = |result: &io::Result<_>| matches!(result, Ok(None));
        while_held(limit, is_held, || Self::try_take(file))
    }

    fn try_take(path: &Path) -> io::Result<Option<Self>> {
        let mut options = File::options();
        options.write(true).create(true).truncate(false).mode(0o600);
        let file = options.open(path)?;
        Ok(lock_file(&file, Duration::ZERO)?.then_some(Self(file)))
    }
}

/// A watcher of one processor that cleans up after debuggers that were killed: it removes their
/// breakpoints and lets the program go on.
#[derive(Debug, Default)]
pub struct Cleaner {
    /// Held while the processor is released.
    lock: Option<DebuggerLock>,
}

impl Cleaner {
    /// Makes a watcher that has found no killed debugger yet.
    #[must_use]
    pub const fn new() -> Self {
        Self { lock: None }
    }

    /// Checks whether the debugger of the processor of `tracer` was killed; `file` is the file of that processor's
    /// debugger lock. If so, makes the processor remove all breakpoints and go on. This takes several calls, because
    /// none of them waits: call this method again and again.
    ///
    /// Returns true if this call has found that a debugger was killed.
    ///
    /// # Errors
    /// [`TracerError::Access`] if the area cannot be accessed.
    pub fn look<W: MemoryWindow>(
        &mut self,
        tracer: &Tracer<W>,
        file: &Path,
    ) -> Result<bool, TracerError> {
        let mut found = false;
        if self.lock.is_none() && tracer.mode()?.attached {
            // Without the file there was no debugger that could have it, nor is one stopped.
            self.lock = DebuggerLock::try_take(file).ok().flatten();
            // The debugger may have ended properly meanwhile.
            found = self.lock.is_some() && tracer.mode()?.attached;
        }
        if self.lock.is_some() && tracer.try_release()? {
            self.lock = None;
        }
        Ok(found)
    }

    /// Stops cleaning up. Call it when the program of the processor has ended, since then nothing
    /// is left to release.
    pub fn forget(&mut self) {
        self.lock = None;
    }
}

impl Drop for DebuggerLock {
    fn drop(&mut self) {
        // Closing would do it, unless a child has inherited the descriptor.
        let _ = rustix::fs::flock(&self.0, FlockOperation::Unlock);
    }
}
