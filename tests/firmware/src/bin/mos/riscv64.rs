//! Servo loops that nest by calls from the timer's interrupt, on one hart.
//!
//! The trap entry of `riscv-rt` saves integer registers alone: what else has to survive is up to
//! `condor_mos::riscv`.
use core::sync::atomic::{AtomicBool, AtomicU32, Ordering::Relaxed};

use condor_mos::riscv::{Clint, preserving_floats};
use condor_mos::{ClockSpec, LoopId, Loops, Overrun, Rate, Timer as _};
use firmware::{CLINT, Checks, MTIME_HZ, check, ring};
use riscv::interrupt::Interrupt;
use riscv::register::{mie, mstatus};
use riscv_rt::core_interrupt;

use crate::{SCANNED, TABLED, await_until, loops};

pub(crate) type Core = Clint;

const MTIME: Rate = Rate::hz(MTIME_HZ);
pub(crate) const CLOCK: ClockSpec = ClockSpec::of::<u64>(MTIME);
/// The bit of `mie`.
const SOFTWARE: usize = 1 << 3;

// SAFETY: the machine has a CLINT there; this program runs on hart 0 alone, in machine mode, and
// protects nothing.
pub(crate) static PLATFORM: Clint =
    unsafe { Clint::new(CLINT, 0, MTIME).interrupted_also_by(SOFTWARE) };

/// Software interrupts and timer interrupts that have come.
static RUNG: AtomicU32 = AtomicU32::new(0);
static TIMED: AtomicU32 = AtomicU32::new(0);

#[firmware::entry]
fn main() -> ! {
    // The compare is anything after a reset.
    PLATFORM.disarm();
    // SAFETY: the handlers are below, and no critical section is in progress here.
    unsafe {
        mie::set_mtimer();
        mie::set_msoft();
        mstatus::set_mie();
    }
    let interrupts = || TIMED.load(Relaxed);
    check(|checks| {
        loops(checks, interrupts);
        checks.group("another interrupt");
        other_interrupt(checks);
    })
}

/// Checks a loop that rings its own hart: the interrupt comes in the middle of its arithmetic.
fn other_interrupt(checks: &mut Checks) {
    let (runs, interrupted) = (AtomicU32::new(0), AtomicU32::new(0));
    let right = AtomicBool::new(true);
    let mut body = |_| {
        let before = RUNG.load(Relaxed);
        let mut sum = core::hint::black_box(0.0_f64);
        for round in 0..1000 {
            // The interrupt comes within some instructions, or when no loop is left.
            if round == 5 {
                ring(0, true);
            }
            sum += 0.5;
        }
        if sum.to_bits() != 500.0_f64.to_bits() {
            right.store(false, Relaxed);
        }
        let came = RUNG.load(Relaxed).wrapping_sub(before);
        interrupted.store(interrupted.load(Relaxed).wrapping_add(came), Relaxed);
        runs.store(runs.load(Relaxed).wrapping_add(1), Relaxed);
    };
    let done = SCANNED.scope(|scope| {
        let assigned = scope.assign(LoopId(1), Overrun::Skip, &mut body);
        let started = SCANNED.start();
        let done = await_until(|| runs.load(Relaxed) >= 5);
        SCANNED.stop();
        (assigned, started, done)
    });
    checks.same(done, (Ok(()), Ok(()), true));
    checks.that(interrupted.load(Relaxed) == runs.load(Relaxed));
    checks.that(right.load(Relaxed));
}

#[core_interrupt(Interrupt::MachineSoft)]
fn software() {
    preserving_floats(|| {
        spoil_floating_point();
        ring(0, false);
        RUNG.store(RUNG.load(Relaxed).wrapping_add(1), Relaxed);
    });
}

#[core_interrupt(Interrupt::MachineTimer)]
fn timer() {
    // SAFETY: this is the handler of the timer's interrupt, the entry has saved the integer
    // registers, and nothing here does arithmetic.
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
