//! Servo loops that nest by calls from the timer's interrupt, on one hart.
//!
//! The trap entry saves integer registers alone, as that of `riscv-rt` does: what else has to
//! survive is up to `condor_mos::riscv`.
#![no_std]
#![no_main]

mod machine;

use core::panic::PanicInfo;
use core::sync::atomic::{AtomicU32, Ordering::Relaxed};

use checks::Checks;
use condor_mos::riscv::Clint;
use condor_mos::{Clock, Instant as _, LoopId, Loops, Overrun, Timer as _};
use machine::{CLINT, MTIME, print, ring, switch_off};
use mos_exercise::{Scanned, Tabled};
use riscv::register::{mie, mstatus};

// Floating point is on: `FS` is initial.
core::arch::global_asm!(
    include_str!("../../one-hart.s"),
    include_str!("trap.s"),
    mstatus = const 0x2000
);

const CLOCK: Clock = Clock::of::<u64>(MTIME);
const SOFTWARE_INTERRUPT: usize = 1 << (usize::BITS - 1) | 3;
const TIMER_INTERRUPT: usize = 1 << (usize::BITS - 1) | 7;
/// The bit of `mie`.
const SOFTWARE: usize = 1 << 3;

// SAFETY: the machine has a CLINT there; this program runs on hart 0 alone, in machine mode, and
// protects nothing.
static PLATFORM: Clint = unsafe { Clint::new(CLINT, 0, MTIME).interrupted_also_by(SOFTWARE) };
static TABLED: Tabled<&Clint> = mos_exercise::tabled(&PLATFORM, CLOCK);
static SCANNED: Scanned<&Clint> = mos_exercise::scanned(&PLATFORM, CLOCK);

/// Software interrupts and timer interrupts that have come.
static RUNG: AtomicU32 = AtomicU32::new(0);
static TIMED: AtomicU32 = AtomicU32::new(0);

/// Where hart 0 comes from `one-hart.s`.
#[unsafe(no_mangle)]
extern "C" fn main(hart: usize) {
    // The compare is anything after a reset.
    PLATFORM.disarm();
    // SAFETY: the trap entry is set up, and no critical section is in progress here.
    unsafe {
        mie::set_mtimer();
        mie::set_msoft();
        mstatus::set_mie();
    }
    let mut checks = Checks::new(&print);
    #[cfg(feature = "conformance")]
    {
        checks.group("the timer");
        let interrupts = || TIMED.load(Relaxed);
        mos_exercise::conformance::timer(&mut checks, &PLATFORM, interrupts);
    }
    mos_exercise::loops(&mut checks, &PLATFORM, &TABLED, &SCANNED);
    checks.group("another interrupt");
    other_interrupt(&mut checks);
    may_panic(hart);
    switch_off(checks.conclude());
}

/// A loop rings its own hart: the interrupt comes in its middle.
fn other_interrupt(checks: &mut Checks<'_>) {
    let (runs, interrupted) = (AtomicU32::new(0), AtomicU32::new(0));
    let mut body = |_| {
        let before = RUNG.load(Relaxed);
        ring(true);
        // It comes within some instructions, or when no loop is left.
        for _ in 0..1000 {
            core::hint::spin_loop();
        }
        let came = RUNG.load(Relaxed).wrapping_sub(before);
        interrupted.store(interrupted.load(Relaxed).wrapping_add(came), Relaxed);
        runs.store(runs.load(Relaxed).wrapping_add(1), Relaxed);
    };
    let done = SCANNED.scope(|scope| {
        let assigned = scope.assign(LoopId(1), Overrun::Skip, &mut body);
        let started = SCANNED.start();
        let begin = PLATFORM.now();
        while runs.load(Relaxed) < 5 && PLATFORM.now().since(begin) < 20 * MTIME.numerator() {}
        SCANNED.stop();
        (assigned, started)
    });
    checks.same("a loop runs", done, (Ok(()), Ok(())));
    checks.that(
        "what interrupts loops, too, does so",
        runs.load(Relaxed) >= 5 && interrupted.load(Relaxed) == runs.load(Relaxed),
    );
}

/// Every trap comes here, with interrupts masked.
#[unsafe(no_mangle)]
extern "C" fn trap(cause: usize) {
    if cause == SOFTWARE_INTERRUPT {
        ring(false);
        RUNG.store(RUNG.load(Relaxed).wrapping_add(1), Relaxed);
        return;
    }
    if cause != TIMER_INTERRUPT {
        print("an exception, or an interrupt that nobody enabled\n");
        switch_off(false);
    }
    // SAFETY: this is the timer's interrupt, the entry has saved the integer registers, and nothing
    // here does arithmetic.
    unsafe {
        PLATFORM.on_interrupt(|| {
            spoil_floating_point();
            TIMED.store(TIMED.load(Relaxed).wrapping_add(1), Relaxed);
            // The interrupt lasts until the compare is another one.
            PLATFORM.disarm();
            // Those that are not started ignore it.
            TABLED.on_timer();
            SCANNED.on_timer();
        });
    }
}

/// Changes all registers that a call may change, and the way of rounding.
fn spoil_floating_point() {
    // SAFETY: the registers are declared; `fcsr` is nobody's between calls, other than that whoever
    // was interrupted has its own.
    unsafe {
        core::arch::asm!(
            ".irp register, ft0, ft1, ft2, ft3, ft4, ft5, ft6, ft7, ft8, ft9, ft10, ft11, \
             fa0, fa1, fa2, fa3, fa4, fa5, fa6, fa7",
            "fcvt.d.w \\register, zero",
            ".endr",
            "csrsi fflags, 31",
            out("ft0") _, out("ft1") _, out("ft2") _, out("ft3") _, out("ft4") _, out("ft5") _,
            out("ft6") _, out("ft7") _, out("ft8") _, out("ft9") _, out("ft10") _,
            out("ft11") _, out("fa0") _, out("fa1") _, out("fa2") _, out("fa3") _,
            out("fa4") _, out("fa5") _, out("fa6") _, out("fa7") _,
            options(nostack),
        );
    }
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
