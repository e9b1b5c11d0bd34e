//! [`Device`]: a board with its type, for the calls that only its driver has.

use core::fmt;

use crate::bus::Registers;
use crate::driver::Driver;
use crate::fd::{Fd, FdTable};
use crate::unit::Unit;

/// A board whose descriptor has been checked: the memo's way around the device switch, in place of
/// `ioctl`.
///
/// Drivers offer what is peculiar to them as methods of `Device<'_, B, TheDriver, F>`; they cost
/// what the driver itself costs.
pub struct Device<'s, B, D: Driver, const F: usize> {
    /// The driver's state of this board.
    pub unit: &'s D,
    /// Its registers.
    pub registers: Registers<'s, B>,
    fds: &'s FdTable<F>,
    fd: Fd,
}

impl<'s, B, D: Driver, const F: usize> Device<'s, B, D, F> {
    pub(crate) fn new(unit: &'s Unit<D>, bus: &'s B, fds: &'s FdTable<F>, fd: Fd) -> Self
    where
        B: crate::bus::Bus,
    {
        Self {
            unit: &unit.driver,
            registers: Registers::new(bus, unit.place.base()),
            fds,
            fd,
        }
    }

    /// The descriptor that was checked.
    #[must_use]
    pub const fn fd(&self) -> Fd {
        self.fd
    }
}

impl<B, D: Driver, const F: usize> fmt::Debug for Device<'_, B, D, F> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} at {}", D::NAME, self.fd)
    }
}

impl<B, D: Driver, const F: usize> Drop for Device<'_, B, D, F> {
    fn drop(&mut self) {
        critical_section::with(|_| self.fds.hold(self.fd, -1));
    }
}
