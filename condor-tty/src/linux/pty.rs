//! [`Pty`]: a terminal's output and input on a pseudo-terminal.

use std::ffi::OsString;
use std::io;
use std::os::fd::{AsFd, BorrowedFd, OwnedFd};
use std::os::unix::ffi::OsStringExt;
use std::path::{Path, PathBuf};

use rustix::event::{PollFd, PollFlags, Timespec};
use rustix::fs::{Mode, OFlags};
use rustix::io::Errno;
use rustix::pty::OpenptFlags;
use rustix::termios::OptionalActions;

use super::sink::{Piece, Sink};

/// A [`Sink`] that is a pseudo-terminal: any terminal program can open it, such as `screen` or `picocom`.
///
/// The pseudo-terminal is raw: the processor does echo and editing. If a program has it open and does not read, the
/// kernel's buffer fills, and then output stays in the terminal's ring. While no program has it open, it takes and
/// drops all output, and counts the bytes. A host that wants to keep output for the next program must not serve the
/// terminal while [`is_watched`](Self::is_watched) returns false.
#[derive(Debug)]
pub struct Pty {
    controller: OwnedFd,
    path: PathBuf,
    discarded: u64,
}

impl Pty {
    /// Opens a new pseudo-terminal, whose [`path`](Self::path) terminal programs can open.
    ///
    /// # Errors
    /// Returns the error of the operating system if a call fails, for example because no pseudo-terminal is
    /// left.
    pub fn open() -> io::Result<Self> {
        let controller =
            rustix::pty::openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY | OpenptFlags::CLOEXEC)?;
        rustix::pty::grantpt(&controller)?;
        rustix::pty::unlockpt(&controller)?;
        let name = rustix::pty::ptsname(&controller, Vec::new())?;
        let path = PathBuf::from(OsString::from_vec(name.into_bytes()));
        make_raw(&path)?;
        let flags = rustix::fs::fcntl_getfl(&controller)?;
        rustix::fs::fcntl_setfl(&controller, flags | OFlags::NONBLOCK)?;
        Ok(Self {
            controller,
            path,
            discarded: 0,
        })
    }

    /// Returns the path of the pseudo-terminal, which a terminal program opens.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Returns true if a terminal program has the pseudo-terminal open.
    ///
    /// # Errors
    /// Returns the error of the operating system if it cannot report the state.
    pub fn is_watched(&self) -> io::Result<bool> {
        let mut polled = [PollFd::new(&self.controller, PollFlags::OUT)];
        // The poll does not wait, so no signal ends it.
        rustix::event::poll(&mut polled, Some(&Timespec::default()))?;
        let [polled] = &polled;
        Ok(!polled.revents().contains(PollFlags::HUP))
    }

    /// Returns the number of bytes of output that were dropped while no terminal program had the pseudo-terminal open.
    #[must_use]
    pub const fn discarded(&self) -> u64 {
        self.discarded
    }
}

/// Returns a descriptor for an event loop: readable when something has been typed, writable when
/// there is room.
impl AsFd for Pty {
    fn as_fd(&self) -> BorrowedFd<'_> {
        self.controller.as_fd()
    }
}

impl Sink for Pty {
    fn take(&mut self, piece: Piece<'_>) -> io::Result<usize> {
        if !self.is_watched()? {
            self.discarded += piece.bytes.len() as u64;
            return Ok(piece.bytes.len());
        }
        moved(rustix::io::write(&self.controller, piece.bytes))
    }

    fn typed(&mut self, into: &mut [u8]) -> io::Result<usize> {
        moved(rustix::io::read(&self.controller, into))
    }
}

fn moved(outcome: Result<usize, Errno>) -> io::Result<usize> {
    match outcome {
        // EIO: nobody has it open.
        Err(Errno::AGAIN | Errno::INTR | Errno::IO) => Ok(0),
        outcome => Ok(outcome?),
    }
}

/// Opens the terminal, switches echo and editing off, and closes it again. The kernel reports that
/// a pseudo-terminal is not open only if it has been open before.
fn make_raw(path: &Path) -> io::Result<()> {
    let flags = OFlags::RDWR | OFlags::NOCTTY | OFlags::CLOEXEC;
    let user = rustix::fs::open(path, flags, Mode::empty())?;
    let mut settings = rustix::termios::tcgetattr(&user)?;
    settings.make_raw();
    rustix::termios::tcsetattr(&user, OptionalActions::Now, &settings)?;
    Ok(())
}
