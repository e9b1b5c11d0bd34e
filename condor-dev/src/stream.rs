//! [`DeviceStream`]: a descriptor with the traits of `embedded-io`, whose reads and writes wait for a
//! bounded time.

use core::fmt;
use core::hint::spin_loop;

use embedded_io::{ErrorKind, ErrorType, Read, ReadReady, Write, WriteReady};

use crate::bus::{Bus, BusError, BusErrorKind};
use crate::error::IoError;
use crate::fd::{Fd, FdError};
use crate::interrupt::InterruptController;
use crate::set::DeviceSet;
use crate::switch::Switch;

/// Reads and writes by descriptor, as a [`Switch`] makes them. A [`DeviceStream`] needs only this
/// trait, so the type of the switch does not matter to it.
///
/// # For users
/// `&dyn Descriptors<Error = …>` can stand for a switch whose full type is too long to write.
///
/// # For implementers
/// [`Switch`] implements it. A program can implement it for descriptors of its own, or as a wrapper
/// of a switch; [`Fd::new`] makes such descriptors. No call may wait for a device. A call that
/// moves no bytes must return an error, unless the buffer is empty: at the end of a file that is
/// [`IoError::End`].
pub trait Descriptors {
    /// The bus's error if an access fails.
    type Error: BusError;

    /// Reads as [`Switch::read`] does.
    ///
    /// # Errors
    /// [`IoError::WouldBlock`] if there is nothing to read; otherwise the [`IoError`] of the
    /// descriptor, the device or the bus.
    fn read(&self, fd: Fd, into: &mut [u8]) -> Result<usize, IoError<Self::Error>>;

    /// Writes as [`Switch::write`] does.
    ///
    /// # Errors
    /// [`IoError::WouldBlock`] if there is no room; otherwise the [`IoError`] of the descriptor,
    /// the device or the bus.
    fn write(&self, fd: Fd, from: &[u8]) -> Result<usize, IoError<Self::Error>>;

    /// Returns true if [`read`](Self::read) would read something, as [`Switch::read_ready`] does.
    ///
    /// # Errors
    /// [`IoError::Fd`] if the descriptor is refused, [`IoError::Bus`] if the bus fails.
    fn read_ready(&self, fd: Fd) -> Result<bool, IoError<Self::Error>>;

    /// Returns true if [`write`](Self::write) would write something, as [`Switch::write_ready`]
    /// does.
    ///
    /// # Errors
    /// [`IoError::Fd`] if the descriptor is refused, [`IoError::Bus`] if the bus fails.
    fn write_ready(&self, fd: Fd) -> Result<bool, IoError<Self::Error>>;

    /// Returns true if all bytes that were written have left the device, as [`Switch::is_flushed`]
    /// does.
    ///
    /// # Errors
    /// [`IoError::Fd`] if the descriptor is refused, [`IoError::Bus`] if the bus fails.
    fn is_flushed(&self, fd: Fd) -> Result<bool, IoError<Self::Error>>;
}

impl<B: Bus, C: InterruptController, S: DeviceSet, const F: usize> Descriptors
    for Switch<B, C, S, F>
{
    type Error = B::Error;

    #[inline]
    fn read(&self, fd: Fd, into: &mut [u8]) -> Result<usize, IoError<B::Error>> {
        self.read(fd, into)
    }

    #[inline]
    fn write(&self, fd: Fd, from: &[u8]) -> Result<usize, IoError<B::Error>> {
        self.write(fd, from)
    }

    fn read_ready(&self, fd: Fd) -> Result<bool, IoError<B::Error>> {
        self.read_ready(fd)
    }

    fn write_ready(&self, fd: Fd) -> Result<bool, IoError<B::Error>> {
        self.write_ready(fd)
    }

    fn is_flushed(&self, fd: Fd) -> Result<bool, IoError<B::Error>> {
        self.is_flushed(fd)
    }
}

/// Returns a `wait` function for [`DeviceStream::new`] that needs no clock: the stream tries
/// `count` times without a pause, and then the call fails. With 0 it tries once, for contexts that
/// must not wait.
pub fn looks(count: u32) -> impl FnMut(u32) -> bool + Clone {
    move |looks| {
        spin_loop();
        looks < count
    }
}

/// Returns a `wait` function for [`DeviceStream::new`] with a time limit: a call of the stream
/// fails when the device was not ready for `ticks` ticks of `clock` since its first attempt.
///
/// `clock` returns a count of ticks, which never runs backwards and may wrap as a `u32` does. The
/// stream must then try at least once in 2³² ticks to notice the end of the time.
pub fn timeout(mut clock: impl FnMut() -> u32, ticks: u32) -> impl FnMut(u32) -> bool {
    let mut began = 0;
    move |looks| {
        spin_loop();
        let now = clock();
        if looks == 1 {
            began = now;
        }
        now.wrapping_sub(began) < ticks
    }
}

/// The reason why a read, write or flush of a [`DeviceStream`] failed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum DeviceStreamError<E: fmt::Debug> {
    /// The device was not ready for as long as the [`DeviceStream`] waits. Nothing was moved.
    #[error("the device was not ready in time")]
    TimedOut,
    /// The switch, the device or the bus returned this error; it is never [`IoError::WouldBlock`],
    /// and from a read never [`IoError::End`].
    #[error(transparent)]
    Io(#[from] IoError<E>),
}

impl<E: BusError> embedded_io::Error for DeviceStreamError<E> {
    fn kind(&self) -> ErrorKind {
        match self {
            Self::TimedOut => ErrorKind::TimedOut,
            Self::Io(error) => error.kind(),
        }
    }
}

impl<E: BusError> embedded_io::Error for IoError<E> {
    fn kind(&self) -> ErrorKind {
        match self {
            Self::Fd(FdError::Direction { .. }) => ErrorKind::PermissionDenied,
            Self::Fd(FdError::Closed { .. }) => ErrorKind::NotConnected,
            Self::Fd(FdError::WrongType { .. }) | Self::Length { .. } => ErrorKind::InvalidInput,
            // The finding of a look that is not followed by another one.
            Self::WouldBlock => ErrorKind::TimedOut,
            Self::Fd(FdError::InUse { .. }) | Self::End | Self::Device(_) => ErrorKind::Other,
            Self::Bus(error) => match error.kind() {
                BusErrorKind::NoAnswer => ErrorKind::NotConnected,
                BusErrorKind::Misaligned | BusErrorKind::OutOfRange => ErrorKind::InvalidInput,
                BusErrorKind::ReadOnly => ErrorKind::PermissionDenied,
                BusErrorKind::Lost => ErrorKind::ConnectionAborted,
                _ => ErrorKind::Other,
            },
        }
    }
}

/// An open descriptor of a switch with the traits of `embedded-io`. Reads, writes and flushes wait
/// for the device for a limited time, and then fail with [`DeviceStreamError::TimedOut`].
///
/// The function of type `W` sets the limit. The stream calls it each time the device was not ready,
/// with the number of attempts in this call so far; it returns true if the stream must try again.
/// Use [`looks`], [`timeout`], or a function that sleeps until an interrupt. It must return false
/// at some time.
///
/// The limit applies to each call: `write_all` begins a new wait whenever the device has taken
/// something. The readiness methods never wait.
///
/// A stream does not own its descriptor, which is a plain number: several streams may use one
/// descriptor, and dropping them closes nothing. The part of the program that opened the descriptor
/// closes it with [`Switch::close`]; from then on its streams fail with [`FdError::Closed`].
#[derive(Debug)]
pub struct DeviceStream<'s, S: ?Sized, W> {
    switch: &'s S,
    fd: Fd,
    wait: W,
}

impl<S: ?Sized, W: Clone> Clone for DeviceStream<'_, S, W> {
    fn clone(&self) -> Self {
        Self {
            wait: self.wait.clone(),
            ..*self
        }
    }
}

impl<'s, S: Descriptors + ?Sized, W: FnMut(u32) -> bool> DeviceStream<'s, S, W> {
    /// Makes a stream of the descriptor `fd` of `switch`. `wait` decides how long reads, writes and
    /// flushes wait; see [`DeviceStream`].
    pub const fn new(switch: &'s S, fd: Fd, wait: W) -> Self {
        Self { switch, fd, wait }
    }

    /// Returns the descriptor that this stream reads and writes.
    #[must_use]
    pub const fn fd(&self) -> Fd {
        self.fd
    }

    /// Tries until something is moved, or the wait is over.
    #[inline]
    fn moved(
        &mut self,
        mut attempt: impl FnMut(&S, Fd) -> Result<usize, IoError<S::Error>>,
    ) -> Result<usize, DeviceStreamError<S::Error>> {
        let mut looks = 0_u32;
        loop {
            match attempt(self.switch, self.fd) {
                // A driver that took nothing was not ready: `Ok(0)` would be taken for the end.
                Ok(0) | Err(IoError::WouldBlock) => {}
                Ok(bytes) => return Ok(bytes),
                Err(error) => return Err(error.into()),
            }
            looks = looks.saturating_add(1);
            if !(self.wait)(looks) {
                return Err(DeviceStreamError::TimedOut);
            }
        }
    }
}

impl<S: Descriptors + ?Sized, W> ErrorType for DeviceStream<'_, S, W> {
    type Error = DeviceStreamError<S::Error>;
}

impl<S: Descriptors + ?Sized, W: FnMut(u32) -> bool> Read for DeviceStream<'_, S, W> {
    fn read(&mut self, into: &mut [u8]) -> Result<usize, Self::Error> {
        if into.is_empty() {
            return Ok(0);
        }
        match self.moved(|switch, fd| switch.read(fd, into)) {
            Err(DeviceStreamError::Io(IoError::End)) => Ok(0),
            outcome => outcome,
        }
    }
}

impl<S: Descriptors + ?Sized, W: FnMut(u32) -> bool> Write for DeviceStream<'_, S, W> {
    fn write(&mut self, from: &[u8]) -> Result<usize, Self::Error> {
        if from.is_empty() {
            return Ok(0);
        }
        self.moved(|switch, fd| switch.write(fd, from))
    }

    fn flush(&mut self) -> Result<(), Self::Error> {
        let flushed = self.moved(|switch, fd| switch.is_flushed(fd).map(usize::from));
        flushed.map(|_| ())
    }
}

impl<S: Descriptors + ?Sized, W> ReadReady for DeviceStream<'_, S, W> {
    fn read_ready(&mut self) -> Result<bool, Self::Error> {
        Ok(self.switch.read_ready(self.fd)?)
    }
}

impl<S: Descriptors + ?Sized, W> WriteReady for DeviceStream<'_, S, W> {
    fn write_ready(&mut self) -> Result<bool, Self::Error> {
        Ok(self.switch.write_ready(self.fd)?)
    }
}
