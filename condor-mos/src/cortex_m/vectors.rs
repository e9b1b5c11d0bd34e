//! [`VectorPlatform`]: a spare interrupt for each rank.

use core::mem::offset_of;

use ::cortex_m::interrupt::InterruptNumber;
use ::cortex_m::peripheral::nvic::RegisterBlock;
use ::cortex_m::peripheral::scb::SystemHandler;
use ::cortex_m::peripheral::{NVIC, SCB};

use crate::platform::Platform;
use crate::rate::Rate;
use crate::timer::{Alarm, Armed, Timer};

/// The largest number of interrupts: the register block of ARMv6-M ends behind 32 priorities.
const INTERRUPTS: u16 = if size_of::<RegisterBlock>() > 0x400 {
    256
} else {
    32
};

/// The [`Platform`] of Cortex-M: every loop runs in an interrupt handler with a priority of its
/// own, so that the hardware lets faster loops interrupt slower ones.
///
/// Loops have ranks by their rates, from 0 for the fastest. The platform has a timer `T`, and for
/// each of the `N` ranks after 0 an interrupt of the chip that no device uses. That interrupt is
/// pended when the loop of the rank must run; its handler must call
/// [`Scheduler::on_vector`](crate::Scheduler::on_vector).
///
/// The timer's handler must call [`Scheduler::on_timer`](crate::Scheduler::on_timer), which runs
/// the fastest loop. The other ranks have the priorities below [the timer's](Alarm::LEVELS). The
/// first of the timer's priorities is 0, to which a reset sets it; a second one, if the timer has
/// two, is that of `PendSV`.
pub struct VectorPlatform<T, const N: usize> {
    timer: T,
    ranks: [Vector; N],
    priority_bits: u8,
}

/// An interrupt of the NVIC.
#[derive(Clone, Copy)]
struct Vector {
    number: u16,
    /// The register that pends it: `bit` of ISPR.
    register: *const u32,
    bit: u32,
}

// SAFETY: the register is the core's, and is written by one store.
unsafe impl Send for Vector {}
// SAFETY: as above.
unsafe impl Sync for Vector {}

impl Vector {
    const fn new(number: u16) -> Self {
        Self {
            number,
            register: NVIC::PTR
                .cast::<u8>()
                .wrapping_add(offset_of!(RegisterBlock, ispr) + 4 * (number as usize / 32))
                .cast(),
            bit: 1 << (number % 32),
        }
    }

    #[inline]
    fn pend(self) {
        // SAFETY: every core has the registers there, and setting bits of ISPR pends interrupts
        // that are this vector's own.
        unsafe { self.register.cast_mut().write_volatile(self.bit) };
    }
}

// SAFETY: a number of an interrupt that the NVIC has a place for.
unsafe impl InterruptNumber for Vector {
    fn number(self) -> u16 {
        self.number % INTERRUPTS
    }
}

impl<T: Alarm, const N: usize> VectorPlatform<T, N> {
    /// Makes a platform with `timer`. `interrupts[i]` is the interrupt of rank *i* + 1, by its
    /// number in the vector table of the chip. `priority_bits` is the number of priority bits of
    /// the chip's NVIC: 2 on Cortex-M0 and M0+.
    ///
    /// # Panics
    /// If there are more ranks than priorities below the one or two of the timer, if
    /// `priority_bits` is not from 2 to 8, or if the NVIC has no interrupt of one of the numbers.
    /// In a constant, each of these is a compile error.
    #[must_use]
    pub const fn new(timer: T, interrupts: [u16; N], priority_bits: u8) -> Self {
        assert!(
            priority_bits >= 2
                && priority_bits <= 8
                && T::LEVELS <= 2
                && N + T::LEVELS as usize <= 1 << priority_bits,
            "each rank needs a priority of its own below the timer's"
        );
        let mut vectors = [Vector::new(0); N];
        let mut rank = 0;
        while rank < N {
            assert!(
                interrupts[rank] < INTERRUPTS,
                "the processor has no such interrupt"
            );
            vectors[rank] = Vector::new(interrupts[rank]);
            rank += 1;
        }
        Self {
            timer,
            ranks: vectors,
            priority_bits,
        }
    }

    /// Returns the timer that was passed to [`new`](Self::new), for example to start it.
    #[must_use]
    pub const fn timer(&self) -> &T {
        &self.timer
    }

    /// Sets the priorities of the interrupts of the ranks, and enables these interrupts. Call it before
    /// [`Loops::start`](crate::Loops::start).
    ///
    /// # Safety
    /// The program has no critical section that relies on priorities or on one of the interrupts
    /// being disabled.
    pub unsafe fn enable(&self, nvic: &mut NVIC, scb: &mut SCB) {
        let step = 1_u8 << (8 - self.priority_bits);
        if T::LEVELS > 1 {
            // SAFETY: no section relies on priorities, as the caller promises.
            unsafe { scb.set_priority(SystemHandler::PendSV, step) };
        }
        let mut priority = step.wrapping_mul(T::LEVELS);
        for vector in &self.ranks {
            // SAFETY: no section relies on priorities or on disabled interrupts, as the caller
            // promises.
            unsafe {
                nvic.set_priority(*vector, priority);
                NVIC::unmask(*vector);
            }
            priority = priority.wrapping_add(step);
        }
    }
}

impl<T: Alarm, const N: usize> Timer for VectorPlatform<T, N> {
    type Instant = T::Instant;

    #[inline]
    fn frequency(&self) -> Rate {
        self.timer.frequency()
    }

    #[inline]
    fn now(&self) -> Self::Instant {
        self.timer.now()
    }

    #[inline]
    fn arm(&self, at: Self::Instant) -> Armed {
        self.timer.arm(at)
    }

    #[inline]
    fn disarm(&self) {
        self.timer.disarm();
    }
}

impl<T: Alarm, const N: usize> Platform for VectorPlatform<T, N> {
    const VECTORS: bool = true;

    #[inline]
    fn pend(&self, ranks: u32) {
        if ranks & 1 != 0 {
            self.timer.pend();
        }
        let mut others = ranks >> 1;
        while let Some(vector) = self.ranks.get(others.trailing_zeros() as usize) {
            others &= others - 1;
            vector.pend();
        }
    }

    /// The vector's priority lets faster ones in by itself.
    #[inline]
    fn interruptible(&self, _: u32, body: impl FnOnce()) {
        body();
    }
}
