//! The platform of the scheduler: the counter and the alarm of the board, and one vector for each
//! rank.

use core::arch::asm;

use board::{Interrupt, LOOPS, hardware_priority, timer};
use condor_mos::{Armed, Platform, Rate, Timer, Wrapping};
use cortex_m::peripheral::NVIC;
use critical_section::CriticalSection;

/// The alarm is the vector of rank 0; the others are in order.
const PRIORITIES: [(Interrupt, u8); LOOPS] = [
    (Interrupt::TIMER0, 4),
    (Interrupt::SPARE1, 3),
    (Interrupt::SPARE2, 2),
];

/// The counter and the alarm of the board, and the vectors.
pub(crate) struct Board;

impl Board {
    /// Sets the counter to 0, and unmasks the interrupts.
    pub(crate) fn prepare(nvic: &mut NVIC) {
        timer::stop_at_zero();
        for (interrupt, logical) in PRIORITIES {
            // SAFETY: no lock of this firmware relies on a priority.
            unsafe {
                nvic.set_priority(interrupt, hardware_priority(logical));
                NVIC::unmask(interrupt);
            }
        }
    }
}

impl Timer for Board {
    type Instant = Wrapping<32>;

    #[inline(always)]
    fn frequency(&self) -> Rate {
        Rate::hz(timer::HERTZ)
    }

    #[inline(always)]
    fn now(&self) -> Wrapping<32> {
        Wrapping::new(timer::now())
    }

    #[inline(always)]
    fn arm(&self, at: Wrapping<32>) -> Armed {
        if timer::arm_ahead(at.count()) {
            Armed::Ahead
        } else {
            Armed::Past
        }
    }

    fn disarm(&self) {
        timer::acknowledge();
    }
}

impl Platform for Board {
    const VECTORS: bool = true;

    #[inline(always)]
    fn pend(&self, ranks: u32) {
        let vectors =
            (ranks & !1) << Interrupt::SPARE0 as u16 | (ranks & 1) << Interrupt::TIMER0 as u16;
        // SAFETY: a write of 0 to a bit of this register does nothing.
        unsafe { (*NVIC::PTR).ispr[0].write(vectors) };
    }

    #[inline(always)]
    fn interruptible(&self, _: u32, body: impl FnOnce()) {
        body();
    }

    #[inline(always)]
    fn masked<R>(&self, f: impl FnOnce(CriticalSection<'_>) -> R) -> R {
        let primask: u32;
        // SAFETY: masking is sound anywhere, and nothing moves across the assembly.
        unsafe { asm!("mrs {}, PRIMASK", "cpsid i", out(reg) primask, options(nostack)) };
        // SAFETY: interrupts are masked on the only core.
        let result = f(unsafe { CriticalSection::new() });
        // SAFETY: this puts back what was there.
        unsafe { asm!("msr PRIMASK, {}", in(reg) primask, options(nostack)) };
        result
    }
}
