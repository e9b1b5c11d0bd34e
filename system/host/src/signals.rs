//! Signals that ask a program to end: as a descriptor to poll, and as a flag.

use std::io::Read;
use std::os::fd::{AsFd, BorrowedFd};
use std::os::unix::net::UnixStream;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use signal_hook::SigId;
use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};

const ENDING: [i32; 3] = [SIGHUP, SIGINT, SIGTERM];

/// A receiver of the signals that ask a program to end. They do not end this process as long as this value
/// exists, so a service can clean up before it ends.
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

    /// Takes over the signals `signals` in the same way.
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

    /// Returns a descriptor that becomes readable when a signal has come.
    #[must_use]
    pub fn descriptor(&self) -> BorrowedFd<'_> {
        self.reader.as_fd()
    }

    /// Returns how many signals have come since the last call.
    pub fn taken(&mut self) -> usize {
        self.reader.read(&mut [0; 16]).unwrap_or(0)
    }
}

/// Returns a flag that SIGHUP, SIGINT and SIGTERM set instead of ending this process.
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
