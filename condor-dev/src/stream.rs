//! [`DeviceStream`]: a descriptor with the traits of `embedded-io`, whose reads and writes wait for a bounded time.

use embedded_io::{ErrorKind, ErrorType, Read, Write};

use crate::bus::{Bus, BusError, BusErrorKind};
use crate::error::IoError;
use crate::fd::{Fd, FdError};
use crate::interrupt::InterruptController;
use crate::set::DeviceSet;
use crate::switch::Switch;

/// A [`Switch`] without its type: `&dyn Descriptors` can stand for any switch. Of an error of the bus, its methods
/// return the kind.
pub trait Descriptors {
    /// Reads as [`Switch::read`] does.
    ///
    /// # Errors
    /// [`IoError::WouldBlock`] if there is nothing to read now; another [`IoError`] if the switch refuses the descriptor,
    /// or the device or the bus fails.
    fn read(&self, fd: Fd, into: &mut [u8]) -> Result<usize, IoError<BusErrorKind>>;

    /// Writes as [`Switch::write`] does.
    ///
    /// # Errors
    /// [`IoError::WouldBlock`] if there is no room now; another [`IoError`] if the switch refuses the descriptor, or the
    /// device or the bus fails.
    fn write(&self, fd: Fd, from: &[u8]) -> Result<usize, IoError<BusErrorKind>>;

    /// Returns true if all bytes that were written have left the device, as [`Switch::is_flushed`] does.
    ///
    /// # Errors
    /// [`IoError::Fd`] if the descriptor is refused, [`IoError::Bus`] if the bus fails.
    fn is_flushed(&self, fd: Fd) -> Result<bool, IoError<BusErrorKind>>;

    /// Closes a descriptor, as [`Switch::close`] does.
    ///
    /// # Errors
    /// [`IoError::Fd`] if the descriptor is refused; [`IoError::Bus`] if the bus fails, though the descriptor is closed
    /// all the same.
    fn close(&self, fd: Fd) -> Result<(), IoError<BusErrorKind>>;
}

impl<B: Bus, C: InterruptController, S: DeviceSet, const F: usize> Descriptors
    for Switch<B, C, S, F>
{
    fn read(&self, fd: Fd, into: &mut [u8]) -> Result<usize, IoError<BusErrorKind>> {
        self.read(fd, into).map_err(IoError::of_any_bus)
    }

    fn write(&self, fd: Fd, from: &[u8]) -> Result<usize, IoError<BusErrorKind>> {
        self.write(fd, from).map_err(IoError::of_any_bus)
    }

    fn is_flushed(&self, fd: Fd) -> Result<bool, IoError<BusErrorKind>> {
        self.is_flushed(fd).map_err(IoError::of_any_bus)
    }

    fn close(&self, fd: Fd) -> Result<(), IoError<BusErrorKind>> {
        self.close(fd).map_err(IoError::of_any_bus)
    }
}

impl<E: BusError> IoError<E> {
    fn of_any_bus(self) -> IoError<BusErrorKind> {
        match self {
            Self::Fd(error) => IoError::Fd(error),
            Self::WouldBlock => IoError::WouldBlock,
            Self::Length { bytes, unit } => IoError::Length { bytes, unit },
            Self::Device(bits) => IoError::Device(bits),
            Self::Bus(error) => IoError::Bus(error.kind()),
        }
    }
}

/// The reason why a read, write or flush of a [`DeviceStream`] failed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum DeviceStreamError {
    /// The device was not ready for as long as the [`DeviceStream`] waits. Nothing was moved.
    #[error("the device was not ready in time")]
    TimedOut,
    /// The switch, the device or the bus returned this error; it is never [`IoError::WouldBlock`].
    #[error(transparent)]
    Io(#[from] IoError<BusErrorKind>),
}

impl embedded_io::Error for DeviceStreamError {
    fn kind(&self) -> ErrorKind {
        match self {
            Self::TimedOut => ErrorKind::TimedOut,
            Self::Io(IoError::Fd(FdError::Direction { .. })) => ErrorKind::PermissionDenied,
            Self::Io(
                IoError::Fd(FdError::Closed { .. })
                | IoError::Bus(BusErrorKind::NoAnswer | BusErrorKind::Lost),
            ) => ErrorKind::NotConnected,
            Self::Io(IoError::Length { .. }) => ErrorKind::InvalidInput,
            Self::Io(_) => ErrorKind::Other,
        }
    }
}

/// An open descriptor of a switch with the traits of `embedded-io`. Reads, writes and flushes wait for the device for a
/// limited time, and then fail with [`DeviceStreamError::TimedOut`].
///
/// The function of type `W` sets the limit. The stream calls it each time the device was not ready; it returns true if
/// the stream must try again, perhaps after a sleep until an interrupt. It must return false at some time. The limit
/// applies to each call: `write_all` begins a new wait whenever the device has taken something.
///
/// A stream does not own its descriptor, which is a plain number: dropping the stream closes nothing. Once the
/// descriptor is closed with [`Switch::close`], its streams fail with [`FdError::Closed`].
pub struct DeviceStream<'s, W> {
    switch: &'s dyn Descriptors,
    fd: Fd,
    wait: W,
}

impl<'s, W: FnMut() -> bool> DeviceStream<'s, W> {
    /// Makes a stream of the descriptor `fd` of `switch`. `wait` decides how long reads, writes and flushes wait.
    pub const fn new(switch: &'s dyn Descriptors, fd: Fd, wait: W) -> Self {
        Self { switch, fd, wait }
    }

    /// Tries until something is moved, or the wait is over.
    fn moved(
        &mut self,
        mut attempt: impl FnMut(&dyn Descriptors, Fd) -> Result<usize, IoError<BusErrorKind>>,
    ) -> Result<usize, DeviceStreamError> {
        loop {
            match attempt(self.switch, self.fd) {
                // A driver that took nothing was not ready: `Ok(0)` would be taken for the end.
                Ok(0) | Err(IoError::WouldBlock) => {}
                Ok(bytes) => return Ok(bytes),
                Err(error) => return Err(error.into()),
            }
            if !(self.wait)() {
                return Err(DeviceStreamError::TimedOut);
            }
        }
    }
}

impl<W> ErrorType for DeviceStream<'_, W> {
    type Error = DeviceStreamError;
}

impl<W: FnMut() -> bool> Read for DeviceStream<'_, W> {
    fn read(&mut self, into: &mut [u8]) -> Result<usize, DeviceStreamError> {
        if into.is_empty() {
            return Ok(0);
        }
        self.moved(|switch, fd| switch.read(fd, into))
    }
}

impl<W: FnMut() -> bool> Write for DeviceStream<'_, W> {
    fn write(&mut self, from: &[u8]) -> Result<usize, DeviceStreamError> {
        if from.is_empty() {
            return Ok(0);
        }
        self.moved(|switch, fd| switch.write(fd, from))
    }

    fn flush(&mut self) -> Result<(), DeviceStreamError> {
        let flushed = self.moved(|switch, fd| switch.is_flushed(fd).map(usize::from));
        flushed.map(drop)
    }
}
