//! [`Driver`]: what one kind of board can do.

use crate::bus::{Bus, Registers, Width};

/// A kind of board, and the state of one of its boards.
///
/// # For users
/// Programs name drivers in a [`device_switch!`](crate::device_switch) and reach them through its
/// file descriptors; see [`Switch`](crate::Switch). What is peculiar to a board, its driver offers as
/// methods of its own, which take the registers first; see [`Device`](crate::Device).
///
/// # For implementers
/// A value is one board, with its buffer (memo, section 3.1): it lives in a `static`, and background,
/// servo loops and interrupts reach it at the same time through `&self`. The interrupt's half and
/// the other one share the buffer by atomics, so that neither ever waits for the other. No
/// call waits for the board: what cannot be done now is [`DeviceError::WouldBlock`].
///
/// Only [`NEW`](Self::NEW) is required: what is provided makes a device that has calls of its own and
/// transfers no bytes.
pub trait Driver: Sync + Sized + 'static {
    /// A board that has not been initialised.
    const NEW: Self;

    /// Whether it can be opened for reading.
    const READS: bool = true;

    /// Whether it can be opened for writing.
    const WRITES: bool = true;

    /// Returns whether the board is there, before anything else is done to it: as provided, whether
    /// a byte at its first address answers.
    #[must_use]
    fn probe<B: Bus>(registers: Registers<'_, B>) -> bool {
        registers.answers(0, Width::Bits8)
    }

    /// Brings the board, whatever it did before, into a known state that does not interrupt.
    ///
    /// # Errors
    /// The bus's: then the board is not used.
    fn init<B: Bus>(&self, _: Registers<'_, B>) -> Result<(), B::Error> {
        Ok(())
    }

    /// Opens the board, which nobody had open: from here on it may interrupt, also before this
    /// returns.
    ///
    /// # Errors
    /// The bus's: then it is not open.
    fn open<B: Bus>(&self, _: Registers<'_, B>) -> Result<(), B::Error> {
        Ok(())
    }

    /// Closes the board, which nobody has open any more: it must not interrupt after this.
    ///
    /// # Errors
    /// The bus's.
    fn close<B: Bus>(&self, _: Registers<'_, B>) -> Result<(), B::Error> {
        Ok(())
    }

    /// Reads at least one byte into `into`, which is not empty, and says how many.
    ///
    /// # Errors
    /// [`DeviceError`].
    fn read<B: Bus>(
        &self,
        _: Registers<'_, B>,
        into: &mut [u8],
    ) -> Result<usize, DeviceError<B::Error>> {
        Err(DeviceError::no_bytes(into.len()))
    }

    /// Writes at least one byte of `from`, which is not empty, and says how many.
    ///
    /// # Errors
    /// [`DeviceError`].
    fn write<B: Bus>(
        &self,
        _: Registers<'_, B>,
        from: &[u8],
    ) -> Result<usize, DeviceError<B::Error>> {
        Err(DeviceError::no_bytes(from.len()))
    }

    /// Whether all that was written has left for the world outside.
    ///
    /// # Errors
    /// The bus's.
    fn is_flushed<B: Bus>(&self, _: Registers<'_, B>) -> Result<bool, B::Error> {
        Ok(true)
    }

    /// Whether [`read`](Self::read) would read something.
    ///
    /// # Errors
    /// The bus's.
    fn read_ready<B: Bus>(&self, _: Registers<'_, B>) -> Result<bool, B::Error> {
        Ok(false)
    }

    /// Whether [`write`](Self::write) would write something.
    ///
    /// # Errors
    /// The bus's.
    fn write_ready<B: Bus>(&self, _: Registers<'_, B>) -> Result<bool, B::Error> {
        Ok(false)
    }

    /// The board's vector interrupted: serves the board, if it was this one.
    ///
    /// # Errors
    /// The bus's: the board is taken for one that did not interrupt.
    fn interrupt<B: Bus>(&self, _: Registers<'_, B>) -> Result<Attention, B::Error> {
        Ok(Attention::NotMine)
    }
}

/// Whether a board had asked for the interrupt that it was polled for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Attention {
    /// It had, and has been served.
    Mine,
    /// It had not.
    NotMine,
}

/// Why a transfer moved nothing.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum DeviceError<E> {
    /// The board has nothing to read, or no room, at this moment.
    #[error("the device is not ready")]
    WouldBlock,
    /// The board does not transfer this many bytes at a time, or in its present configuration.
    #[error("{bytes} bytes, where the device moves a multiple of {unit} at a time")]
    Length {
        /// What it was asked for.
        bytes: usize,
        /// What it moves at once: a multiple of this; 0 if it transfers no bytes.
        unit: usize,
    },
    /// The board reported an error of its own: overrun, framing; bits as its driver documents.
    #[error("the device reports error {0:#04x}")]
    Device(u8),
    /// The bus.
    #[error("{0}")]
    Bus(E),
}

impl<E> DeviceError<E> {
    /// Returns the outcome of a transfer of `bytes` to or from a driver's buffer, after which the board
    /// was `told` of it: an error of the bus is for the next call to find if bytes were moved.
    ///
    /// # Errors
    /// [`Bus`](Self::Bus), or [`WouldBlock`](Self::WouldBlock), if none were.
    pub fn unless_moved<T>(bytes: usize, told: Result<T, E>) -> Result<usize, Self> {
        if bytes == 0 {
            told?;
            return Err(Self::WouldBlock);
        }
        Ok(bytes)
    }

    /// The error of a device that transfers no bytes this way.
    const fn no_bytes(bytes: usize) -> Self {
        Self::Length { bytes, unit: 0 }
    }
}

impl<E> From<E> for DeviceError<E> {
    fn from(error: E) -> Self {
        Self::Bus(error)
    }
}
