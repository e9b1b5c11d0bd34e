//! [`Driver`]: the calls of one kind of board.

use crate::bus::{Bus, Registers, Width};

/// A driver of one kind of board, such as a serial port. A value of the type is the driver of one
/// board.
///
/// # For users
/// Programs name drivers in a [`device_switch!`](crate::device_switch) and access them through its
/// file descriptors; see [`Switch`](crate::Switch). A driver offers special functions of its board
/// as methods of its own, which take the registers first; see [`Device`](crate::Device).
///
/// # For implementers
/// A value has the state and the buffer of one board. It is stored in a `static`, and background,
/// servo loops and interrupts access it at the same time through `&self`. The interrupt handler and
/// the other calls share the buffer by atomics, so that neither ever waits for the other. No call
/// waits for the board: if something cannot be done now, it returns [`DeviceError::WouldBlock`].
///
/// Only [`NEW`](Self::NEW) is required; the defaults make a device that has only its own methods
/// and transfers no bytes.
pub trait Driver: Sync + Sized + 'static {
    /// The state of a board that has not been initialised.
    const NEW: Self;

    /// Whether the board can be opened for reading.
    const READS: bool = true;

    /// Whether the board can be opened for writing.
    const WRITES: bool = true;

    /// The 7-bit addresses on I2C that a part of this kind can have: bit *n* stands for address *n*.
    /// [`device_switch!`](crate::device_switch) refuses others.
    const I2C_ADDRESSES: u128 = u128::MAX;

    /// Returns true if a board of this kind is there. The switch calls this before everything else.
    /// It must only read: another board may be at the address, and a write could change it. The
    /// default checks whether the first byte answers.
    #[must_use]
    fn probe<B: Bus>(registers: Registers<'_, B>) -> bool {
        registers.answers(0, Width::Bits8)
    }

    /// Brings the board into a known state in which it does not interrupt, whatever it did before
    /// and whatever a former program set.
    ///
    /// # Errors
    /// Returns the bus's error if an access fails; the board is not used then.
    fn init<B: Bus>(&self, _: Registers<'_, B>) -> Result<(), B::Error> {
        Ok(())
    }

    /// Opens the board, which was not open: from here on it may interrupt, even before this
    /// returns.
    ///
    /// # Errors
    /// Returns the bus's error if an access fails; the board is not open then.
    fn open<B: Bus>(&self, _: Registers<'_, B>) -> Result<(), B::Error> {
        Ok(())
    }

    /// Closes the board, after its last descriptor was closed: it must not interrupt after this.
    ///
    /// # Errors
    /// Returns the bus's error if an access fails.
    fn close<B: Bus>(&self, _: Registers<'_, B>) -> Result<(), B::Error> {
        Ok(())
    }

    /// Reads at least one byte into `into`, which is not empty, and returns the number of bytes.
    ///
    /// # Errors
    /// [`DeviceError`] with the reason if nothing was read.
    fn read<B: Bus>(
        &self,
        _: Registers<'_, B>,
        into: &mut [u8],
    ) -> Result<usize, DeviceError<B::Error>> {
        Err(DeviceError::no_bytes(into.len()))
    }

    /// Writes at least one byte of `from`, which is not empty, and returns the number of bytes.
    ///
    /// # Errors
    /// [`DeviceError`] with the reason if nothing was written.
    fn write<B: Bus>(
        &self,
        _: Registers<'_, B>,
        from: &[u8],
    ) -> Result<usize, DeviceError<B::Error>> {
        Err(DeviceError::no_bytes(from.len()))
    }

    /// Returns true if all bytes that were written have left the board.
    ///
    /// # Errors
    /// Returns the bus's error if an access fails.
    fn is_flushed<B: Bus>(&self, _: Registers<'_, B>) -> Result<bool, B::Error> {
        Ok(true)
    }

    /// Returns true if [`read`](Self::read) would read something.
    ///
    /// # Errors
    /// Returns the bus's error if an access fails.
    fn read_ready<B: Bus>(&self, _: Registers<'_, B>) -> Result<bool, B::Error> {
        Ok(false)
    }

    /// Returns true if [`write`](Self::write) would write something.
    ///
    /// # Errors
    /// Returns the bus's error if an access fails.
    fn write_ready<B: Bus>(&self, _: Registers<'_, B>) -> Result<bool, B::Error> {
        Ok(false)
    }

    /// Handles an interrupt of the board's vector: serves the board if it had asked, and returns
    /// whether it had.
    ///
    /// # Errors
    /// Returns the bus's error if an access fails; the board then counts as one that did not ask.
    fn interrupt<B: Bus>(&self, _: Registers<'_, B>) -> Result<Attention, B::Error> {
        Ok(Attention::NotMine)
    }
}

/// The result of [`Driver::interrupt`]: whether the board had asked for the interrupt.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Attention {
    /// The board had asked, and has been served.
    Mine,
    /// The board had not asked.
    NotMine,
}

/// The reason why a driver's [`read`](Driver::read) or [`write`](Driver::write) moved no bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum DeviceError<E> {
    /// The board has nothing to read, or no room, at this moment.
    #[error("the device has nothing to read, or no room, at this moment; try again")]
    WouldBlock,
    /// The board does not transfer this many bytes at a time, or in its present configuration.
    #[error(
        "the length {bytes} is not a multiple of {unit} bytes, which the device transfers at once"
    )]
    Length {
        /// The number of bytes that was requested.
        bytes: usize,
        /// The unit of transfers in bytes: the board transfers multiples of it. 0 if the board
        /// transfers no bytes this way.
        unit: usize,
    },
    /// The board reported an error of its own, such as overrun or framing; the driver documents the
    /// bits.
    #[error("the device reports error {0:#04x}")]
    Device(u8),
    /// The bus returned this error.
    #[error("{0}")]
    Bus(E),
}

impl<E> DeviceError<E> {
    /// Returns the result for a driver's `read` or `write` that moved `bytes` bytes from or to the
    /// driver's buffer. `told` is the result of the bus access that the driver made afterwards, for
    /// example to enable an interrupt for more bytes. If bytes were moved, the result is their
    /// number; an error in `told` is dropped then, because the next call meets it again.
    ///
    /// # Errors
    /// If no bytes were moved: [`Bus`](Self::Bus) with the error in `told`, or
    /// [`WouldBlock`](Self::WouldBlock) if `told` has none.
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
