//! [`Mmio`]: registers in the address space of the processor.

use core::ffi::c_void;

use crate::bus::{Bus, BusAccessError, BusErrorKind, Width};

/// A [`Bus`] of memory-mapped registers: a range of the processor's addresses at which boards
/// answer. Each access is one volatile access.
///
/// Accesses outside of the range, and misaligned ones, are refused without being made. If nothing
/// answers at an address inside of the range, the result depends on the processor: some read ones,
/// others trap. On a RISC-V processor that traps, use `riscv::GuardedMmio`, so that start-up can
/// look for boards.
///
/// Accesses are in program order as the processor sees them. For boards to see the same order, the
/// range must be device memory of the processor (strongly ordered I/O on RISC-V, Device memory on
/// Arm), as it is for registers.
#[derive(Clone, Copy, Debug)]
pub struct Mmio {
    /// The place where `first` is reached.
    memory: *mut u8,
    first: usize,
    len: usize,
}

// SAFETY: a range of addresses belongs to no thread; the constructors' callers vouch for accesses
// at any time.
unsafe impl Send for Mmio {}
// SAFETY: as for `Send`.
unsafe impl Sync for Mmio {}

impl Mmio {
    /// Makes a bus of the `len` bytes from the processor's address `first` on. Bus addresses are
    /// equal to the processor's addresses.
    ///
    /// # Safety
    ///
    /// As long as the bus or a copy of it is used:
    ///
    /// * no part of the range is memory that Rust knows of: no variable, stack or heap;
    /// * every aligned access of 8, 16 and 32 bits in it may be made at any time: if nothing
    ///   answers, the processor reads something and ignores writes, or the access is guarded
    ///   (`riscv::GuardedMmio`);
    /// * no write in it makes a device change such memory, by DMA for example, unless another part
    ///   of the program gave the device these addresses and is responsible for that.
    #[must_use]
    pub const unsafe fn new(first: usize, len: usize) -> Self {
        // SAFETY: as for this function.
        unsafe { Self::translated(first as *mut u8, first, len) }
    }

    /// Makes a bus of the `len` bytes that the processor sees at `memory`, with the bus addresses
    /// from `first` on. Use it if the processor's addresses of the boards differ from their bus
    /// addresses.
    ///
    /// # Safety
    ///
    /// The contract is that of [`new`](Self::new), for the `len` bytes at `memory`. Both `memory`
    /// and `first` must be aligned to four bytes. The bytes may also be an allocation that is
    /// accessed only through pointers.
    #[must_use]
    pub const unsafe fn translated(memory: *mut u8, first: usize, len: usize) -> Self {
        Self { memory, first, len }
    }

    /// The pointer by which the register at a bus address is reached: inside the range, and aligned.
    #[inline(always)]
    pub(crate) fn register(
        &self,
        address: usize,
        width: Width,
    ) -> Result<*mut c_void, BusAccessError> {
        width.check(address)?;
        let offset = address.wrapping_sub(self.first);
        if offset >= self.len || self.len - offset < width.bytes() {
            let kind = BusErrorKind::OutOfRange;
            return Err(BusAccessError { address, kind });
        }
        Ok(self.memory.wrapping_add(offset).cast())
    }
}

impl Bus for Mmio {
    type Error = BusAccessError;

    #[inline(always)]
    fn read(&self, address: usize, width: Width) -> Result<u32, BusAccessError> {
        let register = self.register(address, width)?;
        // SAFETY: it is aligned and in the range for which the constructor's caller vouches.
        Ok(unsafe {
            match width {
                Width::Bits8 => register.cast::<u8>().read_volatile().into(),
                Width::Bits16 => register.cast::<u16>().read_volatile().into(),
                Width::Bits32 => register.cast::<u32>().read_volatile(),
            }
        })
    }

    #[inline(always)]
    fn write(&self, address: usize, width: Width, value: u32) -> Result<(), BusAccessError> {
        let register = self.register(address, width)?;
        // SAFETY: it is aligned and in the range for which the constructor's caller vouches.
        unsafe {
            match width {
                Width::Bits8 => register.cast::<u8>().write_volatile(value as u8),
                Width::Bits16 => register.cast::<u16>().write_volatile(value as u16),
                Width::Bits32 => register.cast::<u32>().write_volatile(value),
            }
        }
        Ok(())
    }
}
