//! [`GuardedMmio`]: an access fault is a bus error.

use crate::bus::{AccessError, Bus, BusErrorKind, Width};
use crate::guarded::{load, resume, store};
use crate::mmio::Mmio;

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
}

const fn no_answer(address: usize) -> AccessError {
    AccessError {
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
    type Error = AccessError;

    #[inline]
    fn read(&self, address: usize, width: Width) -> Result<u32, AccessError> {
        let register = self.0.register(address, width)?;
        // SAFETY: it is aligned and in a range for which the caller of `Mmio`'s constructor vouches,
        // unless it faults, for which that of `new` does.
        unsafe { load(register, width) }.ok_or(no_answer(address))
    }

    #[inline]
    fn write(&self, address: usize, width: Width, value: u32) -> Result<(), AccessError> {
        let register = self.0.register(address, width)?;
        // SAFETY: as in `read`.
        unsafe { store(register, width, value) }.ok_or(no_answer(address))
    }
}
