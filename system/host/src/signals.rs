//! Signals that ask a program to end: as a descriptor to poll, and as a flag.

use std::io::Read;
use std::os::fd::{AsFd, BorrowedFd};
use std::os::unix::net::UnixStream;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use signal_hook::SigId;
use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};

const ENDING: [i32; 3] = [SIGHUP, SIGINT, SIGTERM];

/// A receiver of signals, by default of those that ask a program to end. As long as this value exists, these signals do
/// not end the process, so a program can clean up before it ends.
#[derive(Debug)]
pub struct EndSignals {
    reader: UnixStream,
    registered: Vec<SigId>,
}

impl EndSignals {
    /// Takes over the signals that ask a program to end: SIGHUP, SIGINT and SIGTERM.
    ///
    /// # Errors
    /// Returns the operating system's error if the signals cannot be handled.
    pub fn new() -> std::io::Result<Self> {
        Self::of(&ENDING)
    }

    /// Takes over the given `signals` instead of those of [`new`](Self::new).
    ///
    /// # Errors
    /// Returns the operating system's error if the signals cannot be handled.
    pub fn of(signals: &[i32]) -> std::io::Result<Self> {
        let (reader, writer) = UnixStream::pair()?;
        reader.set_nonblocking(true)?;
        let mut this = Self {
            reader,
            registered: Vec::new(),
        };
        for &signal in signals {
            let id = signal_hook::low_level::pipe::register(signal, writer.try_clone()?)?;
            this.registered.push(id);
        }
        Ok(this)
    }

    /// Returns a descriptor for `poll`. It becomes readable when a signal comes, and stays so until
    /// [`taken`](Self::taken) is called.
    #[must_use]
    pub fn descriptor(&self) -> BorrowedFd<'_> {
        self.reader.as_fd()
    }

    /// Returns the number of signals that have come since the last call. A call counts 16 of them at most, and leaves
    /// the others for the next call.
    pub fn taken(&mut self) -> usize {
        self.reader.read(&mut [0; 16]).unwrap_or(0)
    }
}

/// Returns a flag that is false until SIGHUP, SIGINT or SIGTERM comes. From now on these signals set the flag instead
/// of ending this process.
///
/// # Errors
/// Returns the operating system's error if the signals cannot be handled.
pub fn flag() -> std::io::Result<Arc<AtomicBool>> {
    let flag = Arc::new(AtomicBool::new(false));
    for signal in ENDING {
        signal_hook::flag::register(signal, flag.clone())?;
    }
    Ok(flag)
}

impl Drop for EndSignals {
    fn drop(&mut self) {
        for id in self.registered.drain(..) {
            signal_hook::low_level::unregister(id);
        }
    }
}
