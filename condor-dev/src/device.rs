//! [`Device`]: a board with the type of its driver, for the driver's own methods.

use core::fmt;
use core::ops::Deref;

use crate::bus::{Bus, Registers};
use crate::driver::Driver;
use crate::error::IoError;
use crate::fd::{Fd, FdTable};
use crate::unit::Unit;

/// An open board together with its driver, on which a program calls the driver's own methods. It
/// takes the place of `ioctl`. [`Switch::open_typed`](crate::Switch::open_typed) and
/// [`Switch::device`](crate::Switch::device) return it, and check the descriptor once.
///
/// It dereferences to the driver, whose methods take the [`registers`](Self::registers) first, as
/// in `sensor.angle(sensor.registers)`. Such a call costs no more than a direct call of the driver.
/// While a `Device` is held, its descriptor cannot be closed by others; dropping it closes nothing.
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

    /// Returns the descriptor of the board, for [`Switch::read`](crate::Switch::read) and
    /// [`Switch::write`](crate::Switch::write).
    #[must_use]
    pub const fn fd(&self) -> Fd {
        self.fd
    }

    /// Closes the descriptor. The driver also closes the board if no other descriptor of it is
    /// open.
    ///
    /// # Errors
    /// [`IoError::Fd`] with [`InUse`](crate::FdError::InUse) if there is another `Device` of this
    /// descriptor; [`IoError::Bus`] if the bus fails while the driver closes the board; the
    /// descriptor is closed all the same.
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
