//! Servo loops in vectors of the NVIC, on the periods of `SysTick`.
//!
//! For a Cortex-M3, and for a Cortex-M0, whose four levels of priority are one for the timer and
//! three for loops.

use core::sync::atomic::{AtomicU32, Ordering::Relaxed};

use condor_mos::ClockSpec;
use condor_mos::cortex_m::{Ticks, VectorPlatform};
use cortex_m::Peripherals;
use cortex_m_rt::exception;
use firmware::{CORE_HZ, check, print, switch_off};

use crate::{LOOPS, SCANNED, TABLED, loops};

pub(crate) type Core = VectorPlatform<Ticks, { LOOPS - 1 }>;

/// 2000 periods of `SysTick` in a second.
const TICK_CYCLES: u32 = CORE_HZ / 2_000;
pub(crate) const CLOCK: ClockSpec = Ticks::clock(CORE_HZ, TICK_CYCLES);
/// A Cortex-M0 has no more.
const PRIORITY_BITS: u8 = 2;
/// Two interrupts that no device uses: software interrupts of the nRF51.
const MIDDLE: u16 = 22;
const SLOWEST: u16 = 23;

pub(crate) static PLATFORM: Core = VectorPlatform::new(
    Ticks::new(CORE_HZ, TICK_CYCLES),
    [MIDDLE, SLOWEST],
    PRIORITY_BITS,
);

/// The timer's interrupts that have come.
static TIMED: AtomicU32 = AtomicU32::new(0);

#[firmware::entry]
fn main() -> ! {
    let Some(mut core) = Peripherals::take() else {
        switch_off(false);
    };
    // SAFETY: no critical section relies on priorities, or on one of these interrupts.
    unsafe { PLATFORM.enable(&mut core.NVIC, &mut core.SCB) };
    PLATFORM.timer().begin(core.SYST);
    let interrupts = || TIMED.load(Relaxed);
    check(|checks| loops(checks, interrupts))
}

#[exception]
fn SysTick() {
    PLATFORM.timer().on_tick();
}

#[exception]
fn PendSV() {
    TIMED.store(TIMED.load(Relaxed).wrapping_add(1), Relaxed);
    // Those that are not started ignore it.
    TABLED.on_timer();
    SCANNED.on_timer();
}

/// Handles the vectors of the ranks behind the fastest, which is the timer's. The macro wants `unsafe`.
#[exception]
unsafe fn DefaultHandler(interrupt: i16) {
    let rank = match interrupt.cast_unsigned() {
        MIDDLE => 1,
        SLOWEST => 2,
        _ => {
            print("an interrupt that nobody enabled\n");
            switch_off(false);
        }
    };
    TABLED.on_vector(rank);
    SCANNED.on_vector(rank);
}
