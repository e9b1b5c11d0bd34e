//! [`GuardedMmio`]: an access fault is a bus error.

use crate::bus::{Bus, BusAccessError, BusErrorKind, Width};
use crate::guarded::{load, resume, store};
use crate::mmio::Mmio;

const LOAD_ACCESS_FAULT: usize = 5;
const STORE_ACCESS_FAULT: usize = 7;
const LOAD_PAGE_FAULT: usize = 13;
const STORE_PAGE_FAULT: usize = 15;

/// An [`Mmio`] for processors that trap if nothing answers at an address: such an access returns
/// the error [`NoAnswer`](BusErrorKind::NoAnswer) instead. So start-up can find out which boards
/// are there.
///
/// The program's trap handler must call [`on_fault`]. An access costs one call more than an access
/// to an [`Mmio`].
///
/// Faults must be precise, as those of loads are. Some processors report the fault of a store late,
/// as an interrupt; there a store to an absent board is not noticed. Drivers probe by loads.
#[derive(Clone, Copy, Debug)]
pub struct GuardedMmio(Mmio);

impl GuardedMmio {
    /// Makes a bus with the addresses of `bus` that turns faults of accesses into errors.
    ///
    /// # Safety
    ///
    /// On every hart that uses the bus, from now on, the trap handler must ask [`on_fault`] about
    /// each exception, and return to the address that it returns. Then accesses that fault are
    /// among those that "may be made" in the contract of [`Mmio::new`].
    #[must_use]
    pub const unsafe fn new(bus: Mmio) -> Self {
        Self(bus)
    }
}

const fn no_answer(address: usize) -> BusAccessError {
    BusAccessError {
        address,
        kind: BusErrorKind::NoAnswer,
    }
}

/// Returns the address at which a trap handler must continue after the fault of an access through
/// [`GuardedMmio`]; `None` for all other exceptions. The trap handler must call this on every
/// exception, with `mcause` as `cause` and `mepc` as `instruction` (`scause` and `sepc` in
/// supervisor mode).
///
/// ```ignore
/// if let Some(resume) = condor_dev::riscv::on_fault(mcause, mepc) {
///     mepc::write(resume);
///     return;
/// }
/// ```
#[must_use]
pub fn on_fault(cause: usize, instruction: usize) -> Option<usize> {
    match cause {
        LOAD_ACCESS_FAULT | STORE_ACCESS_FAULT | LOAD_PAGE_FAULT | STORE_PAGE_FAULT => {
            resume(instruction)
        }
        _ => None,
    }
}

impl Bus for GuardedMmio {
    type Error = BusAccessError;

    #[inline]
    fn read(&self, address: usize, width: Width) -> Result<u32, BusAccessError> {
        let register = self.0.register(address, width)?;
        // SAFETY: it is aligned and in a range for which the caller of `Mmio`'s constructor vouches,
        // unless it faults, for which that of `new` does.
        unsafe { load(register, width) }.ok_or(no_answer(address))
    }

    #[inline]
    fn write(&self, address: usize, width: Width, value: u32) -> Result<(), BusAccessError> {
        let register = self.0.register(address, width)?;
        // SAFETY: as in `read`.
        unsafe { store(register, width, value) }.ok_or(no_answer(address))
    }
}
