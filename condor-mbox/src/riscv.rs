//! The doorbell of bare-metal RISC-V: machine software interrupts of a CLINT.

use core::num::NonZeroU32;

use ::riscv::register::{mie, mip, mstatus};

use crate::doorbell::Doorbell;
use crate::id::Processor;
use crate::sync::{AtomicU32, Ordering};
use crate::time::{Clock, Instant};

const MSIP: usize = 0;
const MTIMECMP: usize = 0x4000;
const MTIME: usize = 0xbff8;
const NS_PER_S: u64 = 1_000_000_000;

/// The doorbell of one hart: its bit `msip` in the CLINT, and `mtime` as the clock.
///
/// Each hart has one of its own, and runs in machine mode. Waiting needs no interrupt handler:
/// `wfi` wakes up for interrupts that are masked. A hart that enables the machine software
/// interrupt, to [serve](crate::Messenger::serve) from it, calls
/// [`acknowledge`](Self::acknowledge) first in its handler.
///
/// While it waits it uses the timer compare of its hart, and gives it back as it was; a timer
/// interrupt that is enabled and due earlier ends the wait. Writes to the compare may take a
/// moment to be seen, so a timer handler must look whether its time has come.
///
/// Source: the CLINT of the `SiFive` FU540-C000 manual, chapter 9, which is also the layout of
/// the ACLINT devices MSWI and MTIMER side by side.
#[derive(Debug)]
pub struct MsipDoorbell<const N: usize> {
    clint: usize,
    hart: u16,
    harts: [u16; N],
    mtime_hz: NonZeroU32,
    /// Rings that were acknowledged. Of this hart alone, written with interrupts masked.
    rings: AtomicU32,
}

impl<const N: usize> MsipDoorbell<N> {
    /// The doorbell of `me`, where processor *p* of the system is hart `harts[p]`.
    ///
    /// `mtime_hz` is how often `mtime` counts in a second. `None` if there is no processor `me`.
    ///
    /// # Safety
    ///
    /// A CLINT lies at address `clint`, no protection keeps this hart from its registers `msip`
    /// of all `harts`, `mtimecmp` of `harts[me]` and `mtime`, and this hart, which is
    /// `harts[me]`, runs in machine mode whenever it uses the doorbell.
    #[must_use]
    pub const unsafe fn new(
        clint: usize,
        me: Processor,
        harts: [u16; N],
        mtime_hz: NonZeroU32,
    ) -> Option<Self> {
        if me.index() >= N {
            return None;
        }
        Some(Self {
            clint,
            hart: harts[me.index()],
            harts,
            mtime_hz,
            rings: AtomicU32::new(0),
        })
    }

    /// Takes the ring that raised this hart's software interrupt: first thing in its handler,
    /// before [`serve`](crate::Messenger::serve).
    pub fn acknowledge(&self) {
        masked(|_| self.take_ring());
    }

    fn take_ring(&self) {
        self.set_msip(self.hart, 0);
        // Whoever rang before this had stored its message before: the looks that follow see it.
        ::riscv::asm::fence();
        // A wait that was prepared before the ring and has not begun must not sleep.
        let rings = self.rings.load(Ordering::Relaxed);
        self.rings.store(rings.wrapping_add(1), Ordering::Relaxed);
    }

    /// Sleeps until any interrupt is pending that the hart would take, or this doorbell's.
    fn sleep(&self, until: Instant, interruptible: bool) {
        let enabled = mie::read();
        let former = self.compare();
        let due = self.ticks(until);
        self.set_compare(if enabled.mtimer() {
            due.min(former)
        } else {
            due
        });
        // SAFETY: no handler runs for them, since the caller has masked interrupts; the
        // program's own settings are restored below.
        unsafe {
            mie::set_msoft();
            mie::set_mtimer();
        }
        ::riscv::asm::wfi();
        if !enabled.msoft() {
            // SAFETY: as the program had it.
            unsafe { mie::clear_msoft() };
        }
        if !enabled.mtimer() {
            // SAFETY: as the program had it.
            unsafe { mie::clear_mtimer() };
        }
        self.set_compare(former);
        let has_handler = interruptible && enabled.msoft();
        if !has_handler && mip::read().msoft() {
            self.take_ring();
        }
    }

    /// The value of `mtime` at `instant`, rounded up.
    fn ticks(&self, instant: Instant) -> u64 {
        let hz = u64::from(self.mtime_hz.get());
        let (seconds, ns) = (instant.as_ns() / NS_PER_S, instant.as_ns() % NS_PER_S);
        seconds
            .saturating_mul(hz)
            .saturating_add((ns * hz).div_ceil(NS_PER_S))
    }

    fn set_msip(&self, hart: u16, value: u32) {
        let address = self.register(MSIP, 4, hart) as *mut u32;
        // SAFETY: `new`'s caller vouches for the register of every hart of the system.
        unsafe { address.write_volatile(value) };
    }

    fn compare(&self) -> u64 {
        let address = self.register(MTIMECMP, 8, self.hart);
        // SAFETY: `new`'s caller vouches for this hart's register.
        unsafe { read_u64(address) }
    }

    fn set_compare(&self, value: u64) {
        let address = self.register(MTIMECMP, 8, self.hart);
        // SAFETY: `new`'s caller vouches for this hart's register.
        unsafe { write_u64(address, value) };
    }

    fn register(&self, array: usize, stride: usize, hart: u16) -> usize {
        self.clint
            .wrapping_add(array)
            .wrapping_add(stride.wrapping_mul(usize::from(hart)))
    }
}

impl<const N: usize> Clock for MsipDoorbell<N> {
    fn now(&self) -> Instant {
        // SAFETY: `new`'s caller vouches for the register.
        let ticks = unsafe { read_u64(self.clint.wrapping_add(MTIME)) };
        let hz = core::num::NonZeroU64::from(self.mtime_hz);
        let (seconds, rest) = (ticks / hz, ticks % hz);
        Instant::from_ns(
            seconds
                .saturating_mul(NS_PER_S)
                .saturating_add(rest * NS_PER_S / hz),
        )
    }
}

impl<const N: usize> Doorbell for MsipDoorbell<N> {
    /// How many rings had been acknowledged.
    type Seen = u32;

    fn ring(&self, processor: Processor) {
        if let Some(&hart) = self.harts.get(processor.index()) {
            // Fences of the memory model do not order device registers: the message first.
            ::riscv::asm::fence();
            self.set_msip(hart, 1);
        }
    }

    fn prepare(&self) -> u32 {
        self.rings.load(Ordering::Relaxed)
    }

    fn wait(&self, seen: u32, until: Instant, _: Option<Processor>) {
        masked(|interruptible| {
            // A ring from here on is pending, and `wfi` does not sleep.
            if self.rings.load(Ordering::Relaxed) == seen {
                self.sleep(until, interruptible);
            }
        });
    }
}

/// Runs `body` with interrupts masked; it is told whether they were not before.
fn masked(body: impl FnOnce(bool)) {
    let interruptible = mstatus::read().mie();
    // SAFETY: masking interrupts breaks nobody's section.
    unsafe { mstatus::clear_mie() };
    body(interruptible);
    if interruptible {
        // SAFETY: they were enabled before, so no section is in progress.
        unsafe { mstatus::set_mie() };
    }
}

/// Reads a 64-bit register that may count meanwhile.
///
/// # Safety
/// `address` is that of such a register.
#[cfg(target_arch = "riscv64")]
unsafe fn read_u64(address: usize) -> u64 {
    // SAFETY: as for this function.
    unsafe { (address as *const u64).read_volatile() }
}

/// Writes a 64-bit register.
///
/// # Safety
/// `address` is that of such a register.
#[cfg(target_arch = "riscv64")]
unsafe fn write_u64(address: usize, value: u64) {
    // SAFETY: as for this function.
    unsafe { (address as *mut u64).write_volatile(value) };
}

/// Reads a 64-bit register that may count meanwhile, by halves.
///
/// # Safety
/// `address` is that of such a register.
#[cfg(target_arch = "riscv32")]
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

/// Writes a 64-bit compare register by halves; what it holds in between is never too early.
///
/// # Safety
/// `address` is that of such a register.
#[cfg(target_arch = "riscv32")]
unsafe fn write_u64(address: usize, value: u64) {
    let halves = address as *mut u32;
    // SAFETY: as for this function; the upper half follows the lower one.
    unsafe {
        halves.wrapping_add(1).write_volatile(u32::MAX);
        halves.write_volatile(value as u32);
        halves.wrapping_add(1).write_volatile((value >> 32) as u32);
    }
}
