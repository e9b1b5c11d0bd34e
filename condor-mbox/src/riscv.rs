//! The doorbell of bare-metal RISC-V: machine software interrupts of a CLINT.

use core::num::NonZeroU32;

use ::riscv::register::{mie, mip, mstatus};
use condor_platform::riscv::ClintRegisters;

use crate::doorbell::Doorbell;
use crate::id::Processor;
use crate::sync::{AtomicU32, Ordering};
use crate::time::{Clock, Instant};

const NS_PER_S: u64 = 1_000_000_000;

/// The doorbell of one hart: its bit `msip` in the CLINT, and `mtime` as the clock.
///
/// Each hart has a doorbell of its own, and runs in machine mode. Waiting needs no interrupt
/// handler: `wfi` wakes up for interrupts that are masked. If a hart enables the machine software
/// interrupt, to [serve](crate::Messenger::serve) from it, its handler first calls
/// [`acknowledge`](Self::acknowledge).
///
/// While the doorbell waits, it uses the timer compare register of its hart and restores it
/// afterwards; a timer interrupt that is enabled and due earlier ends the wait. Writes to the
/// register may take effect with a delay, so a timer handler must check whether its time has come.
#[derive(Debug)]
pub struct MsipDoorbell<const N: usize> {
    clint: ClintRegisters,
    hart: u16,
    harts: [u16; N],
    mtime_hz: NonZeroU32,
    /// Rings that were acknowledged. Of this hart alone, written with interrupts masked.
    rings: AtomicU32,
}

impl<const N: usize> MsipDoorbell<N> {
    /// Makes the doorbell of the processor `me`, where processor *p* of the system is hart
    /// `harts[p]`. Returns `None` if there is no processor `me`.
    ///
    /// `clint` is the address of the CLINT, and `mtime_hz` the frequency of `mtime`, in Hz.
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
            // SAFETY: the caller vouches for it.
            clint: unsafe { ClintRegisters::new(clint, harts[me.index()]) },
            hart: harts[me.index()],
            harts,
            mtime_hz,
            rings: AtomicU32::new(0),
        })
    }

    /// Clears the ring that raised this hart's software interrupt. The interrupt's handler calls
    /// this first, while interrupts are masked as the trap has left them, and before
    /// [`serve`](crate::Messenger::serve).
    pub fn acknowledge(&self) {
        self.clint.set_msip(self.hart, false);
        // A processor that rang before this had stored its message before: the looks that follow see it.
        ::riscv::asm::fence();
        // A wait that was prepared before the ring and has not begun must not sleep.
        let rings = self.rings.load(Ordering::Relaxed);
        self.rings.store(rings.wrapping_add(1), Ordering::Relaxed);
    }

    /// Sleeps until any interrupt is pending that the hart would take, or this doorbell's.
    fn sleep(&self, until: Instant, interruptible: bool) {
        let enabled = mie::read();
        let former = self.clint.mtimecmp();
        let due = self.ticks(until);
        let compare = if enabled.mtimer() {
            due.min(former)
        } else {
            due
        };
        self.clint.set_mtimecmp(compare);
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
        self.clint.set_mtimecmp(former);
        let has_handler = interruptible && enabled.msoft();
        if !has_handler && mip::read().msoft() {
            self.acknowledge();
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
}

impl<const N: usize> Clock for MsipDoorbell<N> {
    fn now(&self) -> Instant {
        let ticks = self.clint.mtime();
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
            self.clint.set_msip(hart, true);
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
