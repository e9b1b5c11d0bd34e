//! Where interrupts come, and in which order they are served.
//!
//! RISC-V takes a software interrupt before a timer interrupt. Here loops come first: the mailbox
//! interrupt masks itself and lets the timer in before it serves, and one that comes while loops run is
//! served when they are done.

use condor_dev::riscv::{Context, Plic};
use condor_dev::{InterruptController as _, Level, Mmio, Vector};
use condor_host::harts::{Control, Map, State};
use condor_mbox::{Doorbell as _, Processor};
use condor_mos::riscv::preserving_floats;
use critical_section::CriticalSection;
use riscv::register::{mhartid, mie, mstatus};

use crate::hooks::{self, Hooks};
use crate::machine::{MONITOR, PLIC, PLIC_BYTES, PLIC_HIGHEST, PLIC_SOURCES, UART_VECTOR, cause};
use crate::memory::{LEAST_BYTES, memory};
use crate::resident::Return;
use crate::{bell, link};

core::arch::global_asm!(
    include_str!("trap.s"),
    faulted = const Return::Faulted as usize,
    monitor = const MONITOR,
);

/// The hart that the serial port interrupts.
const RECEIVER: usize = 0;
const UART: Vector = Vector(UART_VECTOR);

// SAFETY: the machine has a PLIC there, whose registers have four bytes.
static REGISTERS: Mmio = unsafe { Mmio::new(PLIC, PLIC_BYTES) };

/// The PLIC as hart 0 sees it, in machine mode.
static INTERRUPTS: Plic<&Mmio> = Plic::new(
    &REGISTERS,
    PLIC,
    Context::new(0).unwrap(),
    PLIC_SOURCES,
    Level(PLIC_HIGHEST),
);

/// Lets the host interrupt this hart, and has hart 0 pass on what the serial port receives, whatever the
/// hart runs.
pub(crate) fn listen() {
    if mhartid::read() == RECEIVER {
        link::reset();
        // The range has all of its registers.
        let _ = INTERRUPTS.reset();
        INTERRUPTS.enable(UART, Level(1));
    }
}

/// Enables what a hart is to be interrupted by besides its timer, and interrupts.
pub(crate) fn open() {
    // SAFETY: the trap entry is set up, and no critical section is in progress.
    unsafe {
        if mhartid::read() == RECEIVER {
            mie::set_mext();
        }
        mie::set_msoft();
        mstatus::set_mie();
    }
}

/// Enables the timer's interrupt, or disables it.
pub(crate) fn time(on: bool) {
    // SAFETY: a handler is there while it is on.
    unsafe {
        if on {
            mie::set_mtimer();
        } else {
            mie::clear_mtimer();
        }
    }
}

/// The hooks of this hart.
fn hooks() -> Option<&'static Hooks> {
    // SAFETY: a trap masks interrupts, and they are used only while that lasts.
    hooks::of_this(unsafe { CriticalSection::new() })
}

/// The timer's interrupt comes here from `trap.s`, with interrupts masked.
#[unsafe(no_mangle)]
extern "C" fn condor_timer() {
    let Some(hooks) = hooks() else {
        return time(false);
    };
    let Some((clint, handler)) = hooks.timer.get() else {
        return time(false);
    };
    let outer = hooks.timed.replace(true);
    // SAFETY: this is the timer's interrupt, `trap.s` has saved the integer registers, and nothing
    // here does arithmetic.
    unsafe { clint.on_interrupt(handler) };
    hooks.timed.set(outer);
    if !outer && hooks.rung.take() {
        ring_hart(mhartid::read());
    }
}

/// Every other interrupt comes here from `trap.s`, with interrupts masked.
#[unsafe(no_mangle)]
extern "C" fn condor_interrupt(cause: usize) {
    match cause {
        cause::SOFTWARE => software(),
        cause::EXTERNAL => external(),
        // Nothing else is enabled.
        _ => {}
    }
}

fn software() {
    let hart = mhartid::read();
    if let Some(bell) = bell::of(hart) {
        bell.acknowledge();
    }
    if is_abandoned(hart) {
        leave(Return::Abandoned);
    }
    let Some(hooks) = hooks() else {
        return;
    };
    let Some(mail) = hooks.mail.get() else {
        return;
    };
    if hooks.timed.get() {
        return hooks.rung.set(true);
    }
    // SAFETY: no critical section is in progress, since an interrupt came, and the entry has saved
    // what others change.
    unsafe {
        mie::clear_msoft();
        mstatus::set_mie();
    }
    preserving_floats(mail);
    // SAFETY: as the entry left it.
    unsafe {
        mstatus::clear_mie();
        mie::set_msoft();
    }
}

fn external() {
    while let Some(vector) = INTERRUPTS.claim() {
        if vector == UART {
            let map = Map::read(&memory(LEAST_BYTES));
            for number in link::received() {
                let hart = map.as_ref().ok().and_then(|map| map.hart_of(number));
                if let Some(hart) = hart {
                    ring_hart(hart as usize);
                }
            }
            link::send();
        }
        INTERRUPTS.complete(vector);
    }
}

fn ring_hart(hart: usize) {
    if let Some(bell) = bell::of(mhartid::read()) {
        bell.ring(Processor(hart as u8));
    }
}

fn is_abandoned(hart: usize) -> bool {
    let control = Control::new(&memory(LEAST_BYTES), hart as u32);
    // The memory is there.
    control.is_ok_and(|control| {
        matches!(control.state(), Ok(State::Runs { .. })) && control.is_abandoned() == Ok(true)
    })
}

/// Goes back to the monitor; what ran is left as it is.
pub(crate) fn leave(why: Return) -> ! {
    // SAFETY: the monitor is there, and begins with a stack of its own.
    unsafe {
        core::arch::asm!(
            "csrci mstatus, 8",
            "csrw mie, zero",
            "jr {monitor}",
            monitor = in(reg) MONITOR,
            in("a0") why as usize,
            options(noreturn),
        )
    }
}
