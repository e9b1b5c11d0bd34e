//! [`Mmio`]: registers in the address space of the processor.

use core::ffi::c_void;

use crate::bus::{AccessError, Bus, BusErrorKind, Width};

/// A range of addresses that boards answer: one volatile access for each of a driver's.
///
/// What lies outside of the range, or is misaligned, is refused without being accessed. Inside
/// of it, an address that nothing answers gives what the processor makes of it: some read ones,
/// others trap. A RISC-V processor that traps is survived by
/// `riscv::GuardedMmio`, so that start-up can look for boards.
///
/// Accesses are in program order as the processor sees them; that the boards see them so, the
/// range must be device memory of the processor (strongly ordered I/O on RISC-V, Device memory
/// on Arm), as it is where registers are.
#[derive(Clone, Copy, Debug)]
pub struct Mmio {
    /// Where `first` is reached.
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
    /// The `len` bytes of addresses from `first` on, at the same addresses of the bus.
    ///
    /// # Safety
    ///
    /// As long as the bus or a copy of it is used:
    ///
    /// * none of the range is memory that Rust knows of: no variable, stack or heap;
    /// * every aligned access of 8, 16 and 32 bits in it may be made at any time: where nothing
    ///   answers, the processor reads something and ignores writes, or it has the
    ///   access guarded (`riscv::GuardedMmio`);
    /// * no write in it has a device change such memory, by DMA for example, except where what
    ///   gave the device its addresses vouches for them.
    #[must_use]
    pub const unsafe fn new(first: usize, len: usize) -> Self {
        // SAFETY: as for this function.
        unsafe { Self::translated(first as *mut u8, first, len) }
    }

    /// The `len` bytes at `memory`, as the bus addresses from `first` on: where a board's address
    /// and the processor's differ.
    ///
    /// # Safety
    ///
    /// As for [`new`](Self::new), for the `len` bytes at `memory`, which is aligned to four bytes
    /// as `first` is. They may also be an allocation that is reached through pointers only.
    #[must_use]
    pub const unsafe fn translated(memory: *mut u8, first: usize, len: usize) -> Self {
        Self { memory, first, len }
    }

    /// Where the register at a bus address is reached: inside the range, and aligned.
    #[inline(always)]
    pub(crate) fn register(
        &self,
        address: usize,
        width: Width,
    ) -> Result<*mut c_void, AccessError> {
        width.check(address)?;
        let offset = address.wrapping_sub(self.first);
        if offset >= self.len || self.len - offset < width.bytes() {
            let kind = BusErrorKind::OutOfRange;
            return Err(AccessError { address, kind });
        }
        Ok(self.memory.wrapping_add(offset).cast())
    }
}

impl Bus for Mmio {
    type Error = AccessError;

    #[inline(always)]
    fn read(&self, address: usize, width: Width) -> Result<u32, AccessError> {
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
    fn write(&self, address: usize, width: Width, value: u32) -> Result<(), AccessError> {
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
