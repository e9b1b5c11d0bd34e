//! [`Device`]: a board with the type of its driver, for the driver's own methods.

use core::fmt;
use core::ops::Deref;

use crate::bus::{Bus, Registers};
use crate::driver::Driver;
use crate::error::IoError;
use crate::fd::{Fd, FdTable};
use crate::unit::Unit;

/// A board with the type of its driver, for the driver's own methods: it takes the place of
/// `ioctl`. Its descriptor has been checked.
///
/// It dereferences to its driver, whose own methods take the [`registers`](Self::registers) first:
/// `sensor.angle(sensor.registers)`. They cost no more than a direct call of the driver. While a
/// `Device` is held, its descriptor cannot be closed by others; dropping it closes nothing.
pub struct Device<'s, B, D: Driver, const F: usize> {
    /// The registers of the board.
    pub registers: Registers<'s, B>,
    unit: &'s Unit<D>,
    fds: &'s FdTable<F>,
    fd: Fd,
}

impl<'s, B: Bus, D: Driver, const F: usize> Device<'s, B, D, F> {
    /// The device of a descriptor that is held already.
    pub(crate) fn new(unit: &'s Unit<D>, bus: &'s B, fds: &'s FdTable<F>, fd: Fd) -> Self {
        Self {
            registers: unit.registers(bus),
            unit,
            fds,
            fd,
        }
    }

    /// Returns the descriptor, for transfers of bytes.
    #[must_use]
    pub const fn fd(&self) -> Fd {
        self.fd
    }

    /// Closes the descriptor. If it is the last one of its board, the board is closed, too.
    ///
    /// # Errors
    /// [`IoError::Fd`] with [`InUse`](crate::FdError::InUse) if there is another `Device` of this
    /// descriptor; [`IoError::Bus`] if the board fails, whose descriptor is closed all the same.
    pub fn close(self) -> Result<(), IoError<B::Error>> {
        let (unit, registers, fds, fd) = (self.unit, self.registers, self.fds, self.fd);
        drop(self);
        critical_section::with(|_| fds.remove(fd))?;
        unit.close(registers).map_err(IoError::Bus)
    }
}

impl<B, D: Driver, const F: usize> Deref for Device<'_, B, D, F> {
    type Target = D;

    #[inline(always)]
    fn deref(&self) -> &D {
        &self.unit.driver
    }
}

impl<B: Bus, D: Driver, const F: usize> fmt::Debug for Device<'_, B, D, F> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "device at {:#x}, descriptor {}",
            self.registers.base(),
            self.fd
        )
    }
}

impl<B, D: Driver, const F: usize> Drop for Device<'_, B, D, F> {
    fn drop(&mut self) {
        critical_section::with(|_| self.fds.hold(self.fd, -1));
    }
}
