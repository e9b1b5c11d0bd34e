//! [`GuardedMmio`]: an access fault is a bus error.

use crate::bus::{Bus, BusErrorKind};
use crate::guarded::{Register, resume};
use crate::mmio::{Mmio, MmioError};

const LOAD_ACCESS_FAULT: usize = 5;
const STORE_ACCESS_FAULT: usize = 7;
const LOAD_PAGE_FAULT: usize = 13;
const STORE_PAGE_FAULT: usize = 15;

/// An [`Mmio`] of which every access may fault: then it is
/// [`NoAnswer`](BusErrorKind::NoAnswer), so that start-up finds out which boards are there.
///
/// The program's trap handler calls [`on_fault`]. An access costs a call more than one of [`Mmio`].
///
/// A fault must be precise, as those of loads are. Some processors report the fault of a store
/// late, as an interrupt: there, a store to an absent board is not noticed here. Drivers probe by
/// loads.
#[derive(Clone, Copy, Debug)]
pub struct GuardedMmio(Mmio);

impl GuardedMmio {
    /// The range of `bus`, with faults caught.
    ///
    /// # Safety
    ///
    /// On every hart that uses the bus, from now on, the trap handler asks [`on_fault`] about each
    /// exception, and returns to where it says. With that, accesses that fault are
    /// among those that may be made in the sense of [`Mmio::new`].
    #[must_use]
    pub const unsafe fn new(bus: Mmio) -> Self {
        Self(bus)
    }

    #[inline(always)]
    fn read<T: Register>(&self, address: usize) -> Result<T, MmioError> {
        let register = self.0.register::<T>(address)?;
        // SAFETY: it is aligned and in a range for which the caller of `Mmio`'s constructor vouches,
        // unless it faults, for which that of `new` does.
        unsafe { T::load(register) }.ok_or(no_answer(address))
    }

    #[inline(always)]
    fn write<T: Register>(&self, address: usize, value: T) -> Result<(), MmioError> {
        let register = self.0.register::<T>(address)?;
        // SAFETY: as in `read`.
        unsafe { T::store(register, value) }.ok_or(no_answer(address))
    }
}

const fn no_answer(address: usize) -> MmioError {
    MmioError {
        address,
        kind: BusErrorKind::NoAnswer,
    }
}

/// To be asked by the trap handler about an exception, with `mcause` and `mepc` (`scause` and `sepc` in
/// supervisor mode): where to return to, instead, if it is the fault of an access through
/// [`GuardedMmio`]; `None` for all others.
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
    type Error = MmioError;

    fn read8(&self, address: usize) -> Result<u8, MmioError> {
        self.read(address)
    }

    fn read16(&self, address: usize) -> Result<u16, MmioError> {
        self.read(address)
    }

    fn read32(&self, address: usize) -> Result<u32, MmioError> {
        self.read(address)
    }

    fn write8(&self, address: usize, value: u8) -> Result<(), MmioError> {
        self.write(address, value)
    }

    fn write16(&self, address: usize, value: u16) -> Result<(), MmioError> {
        self.write(address, value)
    }

    fn write32(&self, address: usize, value: u32) -> Result<(), MmioError> {
        self.write(address, value)
    }
}
