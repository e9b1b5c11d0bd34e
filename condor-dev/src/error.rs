//! [`OpenError`] and [`IoError`]: errors of calls of the switch.

use core::fmt;

use crate::bus::BusErrorKind;
use crate::driver::DeviceError;
use crate::fd::{FdError, OpenMode};
use crate::unit::Presence;

/// The reason why [`Switch::open`](crate::Switch::open) did not open a board.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum OpenError<'n> {
    /// The program was built without such a device.
    #[error("there is no device {name}; the devices are: {}", Names(devices))]
    NoSuchDevice {
        /// The requested name.
        name: &'n str,
        /// The names of all devices, each with the number of boards that it may have.
        devices: &'static [(&'static str, u8)],
    },
    /// The program was built for fewer boards of this device.
    #[error("there is no {name} board {board}: the program has {boards}, numbered from 0")]
    NoSuchBoard {
        /// The device.
        name: &'n str,
        /// The requested number of a board.
        board: u8,
        /// The number of boards that the device may have.
        boards: u8,
    },
    /// Start-up has not looked for the board, did not find it, or could not initialise it.
    #[error("{name} board {board} cannot be opened: it is {presence}")]
    NotPresent {
        /// The device.
        name: &'n str,
        /// The number of the board.
        board: u8,
        /// The result of start-up.
        presence: Presence,
    },
    /// The device cannot be opened in a direction of the mode, or the mode has no direction.
    #[error("{name} cannot be opened for {mode}; ask for reading or writing, as it allows")]
    Direction {
        /// The device.
        name: &'n str,
        /// The requested mode.
        mode: OpenMode,
    },
    /// The board is open already, and the old or the new descriptor is exclusive; or another
    /// context is opening or closing it.
    #[error("{name} board {board} is already open, and cannot be shared")]
    Busy {
        /// The device.
        name: &'n str,
        /// The number of the board.
        board: u8,
    },
    /// All descriptors are open.
    #[error("all {count} descriptors are in use: close one first")]
    TooMany {
        /// The number of descriptors.
        count: usize,
    },
    /// The bus failed while the board was being opened.
    #[error("{name} board {board}: {kind}")]
    Bus {
        /// The device.
        name: &'n str,
        /// The number of the board.
        board: u8,
        /// The kind of the bus's error.
        kind: BusErrorKind,
    },
}

/// The reason why a call with a descriptor failed, such as [`Switch::read`](crate::Switch::read). A
/// transfer that failed moved no bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum IoError<E> {
    /// The descriptor is not open, not open in this direction, or held by a
    /// [`Device`](crate::Device).
    #[error(transparent)]
    Fd(#[from] FdError),
    /// The device has nothing to read, or no room, at this moment.
    #[error("the device has nothing to read, or no room, at this moment; try again")]
    WouldBlock,
    /// The device does not transfer this many bytes at a time.
    #[error(
        "the length {bytes} is not a multiple of {unit} bytes, which the device transfers at once"
    )]
    Length {
        /// The number of bytes that was requested.
        bytes: usize,
        /// The unit of the device's transfers, in bytes.
        unit: usize,
    },
    /// The device reported an error of its own; its driver documents the bits.
    #[error("the device reports error {0:#04x}")]
    Device(u8),
    /// The bus returned this error.
    #[error("{0}")]
    Bus(E),
}

/// Names of devices, to be printed.
struct Names<'k>(&'k [(&'static str, u8)]);

impl fmt::Display for Names<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (number, (name, _)) in self.0.iter().enumerate() {
            let comma = if number == 0 { "" } else { ", " };
            write!(f, "{comma}{name}")?;
        }
        Ok(())
    }
}

impl<E> From<DeviceError<E>> for IoError<E> {
    fn from(error: DeviceError<E>) -> Self {
        match error {
            DeviceError::WouldBlock => Self::WouldBlock,
            DeviceError::Length { bytes, unit } => Self::Length { bytes, unit },
            DeviceError::Device(bits) => Self::Device(bits),
            DeviceError::Bus(error) => Self::Bus(error),
        }
    }
}
