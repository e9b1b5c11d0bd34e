//! Bare-metal RISC-V: the timer of a CLINT, and loops that nest by a call from its interrupt.
//!
//! ```ignore
//! // SAFETY: the board has a CLINT there; this is hart 0, in machine mode.
//! static SCHEDULER: Scheduler<Clint, 2, 8> =
//!     Scheduler::new(unsafe { Clint::new(0x0200_0000, 0, MTIME) }, TABLE);
//!
//! #[riscv_rt::core_interrupt(Interrupt::MachineTimer)]
//! fn timer() {
//!     // SAFETY: this is the handler of the machine timer interrupt.
//!     unsafe { SCHEDULER.platform().on_interrupt(|| SCHEDULER.on_timer()) };
//! }
//! ```
//!
//! The crate `riscv` has an implementation of critical sections for programs whose statics belong
//! to one hart (`critical-section-single-hart`); the program chooses the implementation.

use core::arch::asm;
use core::sync::atomic::{AtomicBool, Ordering};

use ::riscv::register::mstatus;
use condor_platform::riscv::ClintRegisters;

use crate::platform::Platform;
use crate::rate::Rate;
use crate::timer::{Armed, Timer};

/// The bit of `mie` and `mip`.
const MACHINE_TIMER: usize = 1 << 7;
/// Nothing is due so late.
const NEVER: u64 = u64::MAX;

/// The [`Platform`] of one bare-metal RISC-V hart (hardware thread): its timer is the CLINT's
/// `mtime` with the hart's `mtimecmp`, and loops nest by calls in the timer's interrupt.
///
/// After a reset `mtimecmp` may have any value: call [`disarm`](Timer::disarm) before the interrupt
/// is enabled for the first time.
#[derive(Debug)]
pub struct Clint {
    registers: ClintRegisters,
    frequency: Rate,
    /// The interrupts, as bits of `mie`, that may interrupt loops which an interrupt has started.
    nested: usize,
    /// Whether the hart is in `on_interrupt`, and not in a loop that was called from there. Of this
    /// hart alone, changed with interrupts masked.
    in_handler: AtomicBool,
}

impl Clint {
    /// Makes the platform of hart number `hart`. `clint` is the address of the CLINT, whose `mtime`
    /// counts `frequency` ticks per second.
    ///
    /// # Safety
    /// A CLINT is at address `clint`. Only hart `hart` uses this platform, in machine mode, and no
    /// memory protection keeps it from the CLINT's registers. Nothing else writes the `mtimecmp` of
    /// this hart.
    #[must_use]
    pub const unsafe fn new(clint: usize, hart: u16, frequency: Rate) -> Self {
        Self {
            // SAFETY: the caller vouches for it.
            registers: unsafe { ClintRegisters::new(clint, hart) },
            frequency,
            nested: MACHINE_TIMER,
            in_handler: AtomicBool::new(false),
        }
    }

    /// Lets the given interrupts interrupt running loops, too, if they are enabled. `interrupts`
    /// has a bit for each, as the register `mie` has.
    ///
    /// Without this, interrupts other than the timer's wait until all loops that the timer's
    /// interrupt has started are done. Loops that the background has started can be interrupted by
    /// every enabled interrupt.
    #[must_use]
    pub const fn interrupted_also_by(mut self, interrupts: usize) -> Self {
        self.nested |= interrupts;
        self
    }

    /// Handles the machine timer interrupt by calling `handler`, which must call
    /// [`Scheduler::on_timer`](crate::Scheduler::on_timer).
    ///
    /// This function preserves the floating-point registers and `fcsr`, which the usual trap frames
    /// (those of `riscv-rt`) do not save. So the loops that run now do not disturb the arithmetic
    /// of the interrupted loop. The compiler puts no floating-point instructions into a handler
    /// that only calls this. Registers are saved only if `mstatus.FS` shows that the interrupted
    /// code has used some, and restored only if it shows that `handler` has changed some.
    ///
    /// # Safety
    /// * It is called from the handler of the machine timer interrupt, outside of any critical
    ///   section, with interrupts masked as the hart did it.
    /// * The trap entry has saved the integer registers that a call may change on the stack that
    ///   `handler` runs on; it need not have saved `mepc` and `mstatus`.
    /// * The handler has done no floating-point arithmetic before, and will do none after.
    /// * If the program is compiled for floating point, `mstatus.FS` is not off.
    #[inline]
    pub unsafe fn on_interrupt(&self, handler: impl FnOnce()) {
        let outer = self.in_handler.load(Ordering::Relaxed);
        self.in_handler.store(true, Ordering::Relaxed);
        let masked = !self.nested;
        let (mepc, mstatus, mie): (usize, usize, usize);
        // SAFETY: the interrupts of `masked` stay masked in loops, too. No `nomem`: memory that handlers
        // use is stored before.
        unsafe {
            asm!(
                "csrr {mepc}, mepc",
                "csrr {mstatus}, mstatus",
                "csrrc {mie}, mie, {masked}",
                mepc = out(reg) mepc,
                mstatus = out(reg) mstatus,
                mie = out(reg) mie,
                masked = in(reg) masked,
                options(nostack),
            );
        }
        float::preserving(mstatus, handler);
        // SAFETY: as the trap has left it: where and how it returns, whatever other traps came in
        // loops. The floating-point registers are as they were, so `FS` is, too.
        unsafe {
            asm!(
                "csrs mie, {held}",
                "csrw mepc, {mepc}",
                "csrw mstatus, {mstatus}",
                held = in(reg) mie & masked,
                mepc = in(reg) mepc,
                mstatus = in(reg) mstatus,
                options(nostack),
            );
        }
        self.in_handler.store(outer, Ordering::Relaxed);
    }
}

impl Timer for Clint {
    type Instant = u64;

    #[inline]
    fn frequency(&self) -> Rate {
        self.frequency
    }

    #[inline]
    fn now(&self) -> u64 {
        self.registers.mtime()
    }

    #[inline]
    fn arm(&self, at: u64) -> Armed {
        self.registers.set_mtimecmp(at);
        if self.now() >= at {
            Armed::Past
        } else {
            Armed::Ahead
        }
    }

    #[inline]
    fn disarm(&self) {
        self.registers.set_mtimecmp(NEVER);
    }
}

impl Platform for Clint {
    /// Masked interrupts stay masked, except directly in the timer's interrupt: elsewhere somebody
    /// has reason to mask them.
    #[inline]
    fn interruptible(&self, _: u32, body: impl FnOnce()) {
        if !self.in_handler.load(Ordering::Relaxed) {
            return body();
        }
        self.in_handler.store(false, Ordering::Relaxed);
        // SAFETY: `on_interrupt`'s caller vouches that no critical section is in progress and that
        // the trap frame is saved; `on_interrupt` has saved what another trap changes beside it.
        unsafe { asm!("csrsi mstatus, 8", options(nostack)) };
        body();
        // SAFETY: interrupts are masked, as the trap has left them.
        unsafe { asm!("csrci mstatus, 8", options(nostack)) };
        self.in_handler.store(true, Ordering::Relaxed);
    }
}

/// Calls `handler`, which may do floating-point arithmetic, and restores the floating-point
/// registers and `fcsr` of the interrupted code. Use it in the handlers of other interrupts than
/// the timer's if their trap entry saves only integer registers. The caller must not do
/// floating-point arithmetic before or after.
pub fn preserving_floats(handler: impl FnOnce()) {
    float::preserving(mstatus::read().bits(), handler);
}

/// The floating-point registers of harts that have some, which shows at run time alone: a compiler
/// tells a crate nothing of it.
mod float {
    use core::arch::{asm, naked_asm};
    use core::mem::ManuallyDrop;

    use ::riscv::register::mstatus;

    /// In `mstatus.FS`: the unit is on, and its registers were changed. Alone, they are initial.
    const CHANGED: usize = 1 << 13;
    /// In `mstatus.FS`: the registers are somebody's. Alone, they are clean.
    const USED: usize = 1 << 14;

    /// Calls `handler`, and leaves the floating-point registers as they were, unless they are nobody's
    /// by `status`, which is `mstatus`. Afterwards `FS` may be dirty.
    #[inline]
    pub(super) fn preserving<F: FnOnce()>(status: usize, handler: F) {
        extern "C" fn call<F: FnOnce()>(handler: *mut ()) {
            // SAFETY: `preserving` passes its handler, and does not use it any more.
            unsafe { ManuallyDrop::take(&mut *handler.cast::<ManuallyDrop<F>>())() }
        }
        if status & USED != 0 {
            let mut handler = ManuallyDrop::new(handler);
            let argument = core::ptr::from_mut(&mut handler).cast();
            // SAFETY: a pointer to the handler is what `call::<F>` expects, and the unit is on.
            return unsafe { with_registers_saved(argument, call::<F>) };
        }
        let mut fcsr = 0_usize;
        if status & CHANGED != 0 {
            // SAFETY: the unit is on.
            unsafe { asm!("csrr {}, 3", out(reg) fcsr, options(nostack)) };
        }
        handler();
        if mstatus::read().bits() & USED != 0 {
            // SAFETY: the unit is on. The way of rounding is everybody's.
            unsafe { asm!("csrw 3, {}", in(reg) fcsr, options(nostack)) };
        }
    }

    /// All that a call may change: the callee keeps `fs0` to `fs11` itself.
    macro_rules! each_register {
        ($instruction:literal) => {
            concat!(
                ".irp number, 0, 1, 2, 3, 4, 5, 6, 7\n",
                $instruction,
                " fa\\number, 8*\\number(sp)\n",
                $instruction,
                " ft\\number, 64+8*\\number(sp)\n",
                ".endr\n",
                ".irp number, 8, 9, 10, 11\n",
                $instruction,
                " ft\\number, 64+8*\\number(sp)\n",
                ".endr",
            )
        };
    }

    #[cfg(target_arch = "riscv64")]
    macro_rules! word {
        ($instruction:literal) => {
            concat!($instruction, "d ra, 168(sp)")
        };
    }
    #[cfg(target_arch = "riscv32")]
    macro_rules! word {
        ($instruction:literal) => {
            concat!($instruction, "w ra, 168(sp)")
        };
    }

    /// Calls `call(argument)`.
    ///
    /// # Safety
    /// `call` can be called with this argument, and floating point is on.
    #[unsafe(naked)]
    unsafe extern "C" fn with_registers_saved(argument: *mut (), call: extern "C" fn(*mut ())) {
        // Twenty registers, `fcsr`, and the return address, on a stack aligned to 16 bytes. Bit 3 of
        // `misa` says that registers have 64 bits. Clean registers that are dirty afterwards were
        // changed.
        naked_asm!(
            ".option push",
            ".option arch, +d",
            "addi sp, sp, -176",
            word!("s"),
            "frcsr t0",
            "sw t0, 160(sp)",
            "li t0, {changed}",
            "csrc mstatus, t0",
            "csrr t0, misa",
            "andi t0, t0, 8",
            "beqz t0, 2f",
            each_register!("fsd"),
            "j 3f",
            "2:",
            each_register!("fsw"),
            "3:",
            "jalr a1",
            "li t0, {changed}",
            "csrrs t1, mstatus, t0",
            "and t1, t1, t0",
            "beqz t1, 6f",
            "csrr t0, misa",
            "andi t0, t0, 8",
            "beqz t0, 4f",
            each_register!("fld"),
            "j 5f",
            "4:",
            each_register!("flw"),
            "5:",
            "lw t0, 160(sp)",
            "fscsr t0",
            "6:",
            word!("l"),
            "addi sp, sp, 176",
            "ret",
            ".option pop",
            changed = const CHANGED,
        )
    }
}
