//! Servo loops in vectors of the NVIC, on the periods of `SysTick`.
//!
//! For a Cortex-M3, and for a Cortex-M0, whose four levels of priority are one for the timer and
//! three for loops.
#![no_std]
#![no_main]

mod machine;

use core::panic::PanicInfo;
use core::sync::atomic::{AtomicU32, Ordering::Relaxed};

use checks::Checks;
use condor_mos::cortex_m::{Ticks, Vectors};
use cortex_m::Peripherals;
use cortex_m_rt::exception;
use machine::{CORE_HZ, SPARE, TICK_HZ, print, switch_off};
use mos_exercise::{LOOPS, Scanned, Tabled};

type Core = Vectors<Ticks, { LOOPS - 1 }>;

const TICK_CYCLES: u32 = CORE_HZ / TICK_HZ;
/// A Cortex-M0 has no more.
const PRIORITY_BITS: u8 = 2;

static PLATFORM: Core = Vectors::new(
    Ticks::new(CORE_HZ, TICK_CYCLES),
    [SPARE, SPARE + 1],
    PRIORITY_BITS,
);
static TABLED: Tabled<&Core> = mos_exercise::tabled(&PLATFORM, Ticks::clock(CORE_HZ, TICK_CYCLES));
static SCANNED: Scanned<&Core> =
    mos_exercise::scanned(&PLATFORM, Ticks::clock(CORE_HZ, TICK_CYCLES));

/// The timer's interrupts that have come.
static TIMED: AtomicU32 = AtomicU32::new(0);

#[cortex_m_rt::entry]
fn main() -> ! {
    let Some(mut core) = Peripherals::take() else {
        switch_off(false);
    };
    // SAFETY: no critical section relies on priorities, or on one of these interrupts.
    unsafe { PLATFORM.enable(&mut core.NVIC, &mut core.SCB) };
    PLATFORM.timer().begin(core.SYST);
    let mut checks = Checks::new(&print);
    #[cfg(feature = "conformance")]
    {
        checks.group("the timer");
        let interrupts = || TIMED.load(Relaxed);
        mos_exercise::conformance::timer(&mut checks, &PLATFORM, interrupts);
    }
    mos_exercise::loops(&mut checks, &PLATFORM, &TABLED, &SCANNED);
    may_panic(TICK_CYCLES as usize);
    switch_off(checks.conclude());
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

/// The vectors of the ranks behind the fastest.
const VECTORS: [extern "C" fn(); LOOPS - 1] = [rank::<1>, rank::<2>];

extern "C" fn rank<const RANK: u32>() {
    TABLED.on_vector(RANK);
    SCANNED.on_vector(RANK);
}

/// Panics, if built to: the search for panicking paths must find this one.
fn may_panic(index: usize) {
    if cfg!(feature = "panicking") {
        let table = core::hint::black_box([0_u8; 4]);
        core::hint::black_box(table[core::hint::black_box(index)]);
    }
}

#[panic_handler]
fn panic(info: &PanicInfo<'_>) -> ! {
    if let Some(place) = info.location() {
        print("panic in ");
        print(place.file());
        print("\n");
    }
    condor_firmware_panicked()
}

/// The name that is searched for in the linked image: it is there only if something can panic.
#[unsafe(no_mangle)]
#[inline(never)]
extern "C" fn condor_firmware_panicked() -> ! {
    switch_off(false)
}
