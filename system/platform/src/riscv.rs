//! Bare-metal RISC-V: the registers of a CLINT.

const MSIP: usize = 0;
const MTIMECMP: usize = 0x4000;
const MTIME: usize = 0xbff8;

/// The registers of a CLINT, the timer and software interrupts of RISC-V harts, as one hart uses them: the counter, its
/// own compare register, and the software interrupts of all harts.
///
/// Source: the CLINT of the `SiFive` FU540-C000 manual, chapter 9, which is also the layout of
/// the ACLINT devices MSWI and MTIMER side by side.
#[derive(Clone, Copy, Debug)]
pub struct ClintRegisters {
    msip: usize,
    mtime: usize,
    mtimecmp: usize,
}

impl ClintRegisters {
    /// Makes the access of the hart with the number `hart` to the registers of the CLINT at address
    /// `base`.
    ///
    /// # Safety
    /// A CLINT lies at `base`. The hart that uses the registers may access `mtime`, `mtimecmp` of
    /// `hart`, and `msip` of each hart whose number is passed to [`set_msip`](Self::set_msip).
    #[must_use]
    pub const unsafe fn new(base: usize, hart: u16) -> Self {
        Self {
            msip: base.wrapping_add(MSIP),
            mtime: base.wrapping_add(MTIME),
            mtimecmp: base.wrapping_add(MTIMECMP).wrapping_add(8 * hart as usize),
        }
    }

    /// Returns `mtime`, the counter of all harts, in ticks of the machine's timer.
    #[must_use]
    #[inline]
    pub fn mtime(&self) -> u64 {
        // SAFETY: `new`'s caller vouches for the register.
        unsafe { read_u64(self.mtime) }
    }

    /// Returns `mtimecmp` of the hart, in ticks of the machine's timer. The timer interrupt of the
    /// hart is pending while `mtime` has reached this value.
    #[must_use]
    #[inline]
    pub fn mtimecmp(&self) -> u64 {
        // SAFETY: `new`'s caller vouches for the register.
        unsafe { read_u64(self.mtimecmp) }
    }

    /// Sets `mtimecmp` of the hart to `value`, in ticks of the machine's timer: the instant from
    /// which the timer interrupt of the hart is pending.
    #[inline]
    pub fn set_mtimecmp(&self, value: u64) {
        // SAFETY: `new`'s caller vouches for the register.
        unsafe { write_u64(self.mtimecmp, value) };
    }

    /// Sets or clears the pending bit of the software interrupt of `hart`, which may be any hart.
    ///
    /// The write is ordered only with other accesses to devices. If that hart must see earlier
    /// writes to memory, execute a fence before the call.
    #[inline]
    pub fn set_msip(&self, hart: u16, pending: bool) {
        let register = self.msip.wrapping_add(4 * usize::from(hart)) as *mut u32;
        // SAFETY: `new`'s caller vouches for the register.
        unsafe { register.write_volatile(u32::from(pending)) };
    }
}

/// Reads a 64-bit register that may count meanwhile.
///
/// # Safety
/// `address` is that of such a register.
#[cfg(target_arch = "riscv64")]
#[inline]
unsafe fn read_u64(address: usize) -> u64 {
    // SAFETY: as for this function.
    unsafe { (address as *const u64).read_volatile() }
}

/// Writes a 64-bit register.
///
/// # Safety
/// `address` is that of such a register.
#[cfg(target_arch = "riscv64")]
#[inline]
unsafe fn write_u64(address: usize, value: u64) {
    // SAFETY: as for this function.
    unsafe { (address as *mut u64).write_volatile(value) };
}

/// Reads a 64-bit register that may count meanwhile, by halves.
///
/// # Safety
/// `address` is that of such a register.
#[cfg(target_arch = "riscv32")]
#[inline]
unsafe fn read_u64(address: usize) -> u64 {
    let halves = address as *const u32;
    loop {
        // SAFETY: as for this function; the upper half follows the lower one.
        let (before, low, after) = unsafe {
            (
                halves.wrapping_add(1).read_volatile(),
                halves.read_volatile(),
                halves.wrapping_add(1).read_volatile(),
            )
        };
        if before == after {
            return u64::from(after) << 32 | u64::from(low);
        }
    }
}

/// Writes a 64-bit compare register by halves; the values that it holds in between are never too early.
///
/// # Safety
/// `address` is that of such a register.
#[cfg(target_arch = "riscv32")]
#[inline]
unsafe fn write_u64(address: usize, value: u64) {
    let halves = address as *mut u32;
    // SAFETY: as for this function; the upper half follows the lower one.
    unsafe {
        halves.wrapping_add(1).write_volatile(u32::MAX);
        halves.write_volatile(value as u32);
        halves.wrapping_add(1).write_volatile((value >> 32) as u32);
    }
}
