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

use super::sink::Sink;

/// The behaviour of a [`Pty`] while no program has it open.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Unwatched {
    /// It takes nothing, so output waits for the next program that opens it. If the ring is full
    /// meanwhile, the terminal's policy says what happens.
    #[default]
    Hold,
    /// It takes everything and counts it. Use this for a terminal that is also on a screen or in a
    /// log.
    Discard,
}

/// A pseudo-terminal to which any terminal program attaches, such as `screen` or `picocom`.
///
/// It is raw: the processor does echo and editing. If a program has it open and does not read, the
/// kernel's buffer fills, and then output stays in the terminal's ring.
#[derive(Debug)]
pub struct Pty {
    controller: OwnedFd,
    path: PathBuf,
    unwatched: Unwatched,
    discarded: u64,
}

impl Pty {
    /// Opens a new pseudo-terminal.
    ///
    /// # Errors
    /// The error of the operating system, which may have no more of them.
    pub fn open(unwatched: Unwatched) -> io::Result<Self> {
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
            unwatched,
            discarded: 0,
        })
    }

    /// Returns the path that a terminal program opens.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Returns whether a program has it open.
    ///
    /// # Errors
    /// The error of the operating system if it cannot tell.
    pub fn is_watched(&self) -> io::Result<bool> {
        let mut polled = [PollFd::new(&self.controller, PollFlags::OUT)];
        loop {
            match rustix::event::poll(&mut polled, Some(&Timespec::default())) {
                Ok(_) => {
                    let [polled] = &polled;
                    return Ok(!polled.revents().contains(PollFlags::HUP));
                }
                Err(Errno::INTR) => {}
                Err(error) => return Err(error.into()),
            }
        }
    }

    /// Returns the number of bytes that were taken while no program had it open.
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
    fn take(&mut self, bytes: &[u8]) -> io::Result<usize> {
        if !self.is_watched()? {
            if self.unwatched == Unwatched::Hold {
                return Ok(0);
            }
            self.discarded += bytes.len() as u64;
            return Ok(bytes.len());
        }
        match rustix::io::write(&self.controller, bytes) {
            Ok(count) => Ok(count),
            Err(Errno::AGAIN | Errno::INTR | Errno::IO) => Ok(0),
            Err(error) => Err(error.into()),
        }
    }

    fn typed(&mut self, into: &mut [u8]) -> io::Result<usize> {
        match rustix::io::read(&self.controller, into) {
            Ok(count) => Ok(count),
            // EIO: nobody has it open.
            Err(Errno::AGAIN | Errno::INTR | Errno::IO) => Ok(0),
            Err(error) => Err(error.into()),
        }
    }
}

/// Switches echo and editing off, and leaves it closed: the kernel tells of a pseudo-terminal that
/// is not open only once it has been.
fn make_raw(path: &Path) -> io::Result<()> {
    let flags = OFlags::RDWR | OFlags::NOCTTY | OFlags::CLOEXEC;
    let user = rustix::fs::open(path, flags, Mode::empty())?;
    let mut settings = rustix::termios::tcgetattr(&user)?;
    settings.make_raw();
    rustix::termios::tcsetattr(&user, OptionalActions::Now, &settings)?;
    Ok(())
}
