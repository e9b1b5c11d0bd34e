//! The entry of interrupts, and the order in which they are served.
//!
//! RISC-V takes a software interrupt before a timer interrupt. Here loops come first, then boards, then
//! messages: interrupts of boards and of the mailbox let the timer in before they serve, and one that comes while
//! loops run, or while another one of its kind is served, is served when they are done. It comes nevertheless,
//! since it may be the host's or the debugger's.

use condor_debug::Stub;
use condor_dev::riscv::Context;
use condor_dev::{Location, Mmio, Switch, device_switch};
use condor_mbox::{AccessError, StaticWindow};
use condor_mos::riscv::preserving_floats;
use critical_section::CriticalSection;
use qemu_virt_host::{Control, HartState};
use riscv::register::{mhartid, mie, mip, mstatus};

use crate::boards::{self, HartPlic};
use crate::hooks::{self, Hooks};
use crate::link::{self, Line, PORT};
use crate::machine::{LINE, MONITOR, SOFTWARE, UART, UART_VECTOR, cause};
use crate::memory::{LEAST_BYTES, memory};
use crate::msip::{self, ring_hart};

/// The reason why a hart enters the monitor. The monitor gets it in register `a0`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(usize)]
pub enum Return {
    /// The machine was switched on.
    Cold = 0,
    /// The program has ended; its status is in the page of the hart.
    Ended = 1,
    /// The host has abandoned the program.
    Abandoned = 2,
    /// The program has caused a trap that it does not handle.
    Faulted = 3,
}

impl Return {
    /// Returns the reason that `word`, the value of register `a0`, stands for; unknown values are
    /// [`Cold`](Self::Cold).
    #[must_use]
    pub const fn from_word(word: usize) -> Self {
        match word {
            1 => Self::Ended,
            2 => Self::Abandoned,
            3 => Self::Faulted,
            _ => Self::Cold,
        }
    }
}

/// The stack of the stub of a hart.
pub(crate) const STACK_BYTES: usize = 4096;
/// `mcause` of a breakpoint instruction.
pub(crate) const BREAKPOINT: usize = 3;
/// The instruction `c.ebreak`.
pub(crate) const C_EBREAK: u16 = 0x9002;

core::arch::global_asm!(
    include_str!("trap.s"),
    faulted = const Return::Faulted as usize,
    monitor = const MONITOR,
    stack_shift = const STACK_BYTES.trailing_zeros(),
    planted = const condor_debug::PLANTED,
    most_planted = const condor_debug::MOST_PLANTED,
    c_ebreak = const C_EBREAK,
    breakpoint = const BREAKPOINT,
);

/// The hart that the serial port interrupts.
const RECEIVER: usize = 0;

device_switch! {
    /// The serial line, which interrupts hart 0 whatever it runs.
    struct Lines { line: Line = [Location::at(UART).interrupting(UART_VECTOR, 1)] }
}

/// The interrupts for which a hart waits while a debugger holds its program, as bits of `mie`.
pub(crate) const AWAITED: usize = SOFTWARE | LINE;

/// The PLIC as hart 0 sees it in supervisor mode, in which nothing runs.
static CONTROLLER: HartPlic = boards::plic(Context::new(1).unwrap());

/// Nobody opens the line.
static LINES: Switch<&Mmio, &HartPlic, Lines, 0> = Switch::new(&PORT, &CONTROLLER, Lines::new());

/// Makes what interrupts hart 0 forget what was before.
pub(crate) fn reset() {
    if mhartid::read() == RECEIVER {
        link::reset();
        // The range has all of its registers.
        let _ = CONTROLLER.reset();
    }
}

/// Has no board interrupt this hart, and hart 0 pass on what the serial port receives, whatever the hart runs.
pub(crate) fn listen() {
    let hart = mhartid::read();
    if let Some(plic) = boards::own_plic(hart as u32) {
        // The range has all of its registers.
        let _ = plic.reset();
    }
    if hart == RECEIVER {
        LINES.start();
    }
}

/// Returns the causes of this hart's interrupts that nobody handles, as bits.
pub(crate) fn unhandled_causes() -> u32 {
    critical_section::with(|section| {
        hooks::of_this(section).map_or(0, |hooks| hooks.unhandled.get())
    })
}

/// Enables what a hart is to be interrupted by besides its timer, and interrupts.
pub(crate) fn open() {
    // SAFETY: the trap entry is set up, and no critical section is in progress.
    unsafe {
        if mhartid::read() == RECEIVER {
            mie::set_sext();
        }
        mie::set_mext();
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
    let was_busy = hooks.busy.replace(true);
    // SAFETY: this is the timer's interrupt, `trap.s` has saved the integer registers, and nothing
    // here does arithmetic.
    unsafe { clint.on_interrupt(handler) };
    hooks.busy.set(was_busy);
    // Boards interrupt message handlers.
    if hooks.rung.get() && !was_busy {
        hooks.rung.set(false);
        ring_hart(mhartid::read());
    }
}

/// Every other interrupt comes here from `trap.s`, with interrupts masked.
#[unsafe(no_mangle)]
extern "C" fn condor_interrupt(cause: usize) {
    match cause {
        cause::LINE => LINES.on_interrupt(),
        cause::EXTERNAL => external(),
        cause => unhandled(cause),
    }
}

/// An interrupt of a board behind the PLIC, which asks until it is served.
fn external() {
    let Some(hooks) = hooks() else { return };
    let Some((_, boards)) = hooks.boards.get() else {
        return unhandled(cause::EXTERNAL);
    };
    if hooks.busy.get() {
        // Until boards are served, which `condor_software` sees to.
        // SAFETY: nothing counts on it.
        unsafe { mie::clear_mext() };
        hooks.rung.set(true);
        return;
    }
    attend(hooks, boards);
    look_again(hooks);
}

/// Serves the boards' interrupts, which no board interrupts.
fn attend(hooks: &Hooks, boards: &dyn Fn()) {
    hooks.busy.set(true);
    interruptible(boards);
    hooks.busy.set(false);
    // SAFETY: whoever serves boards is there.
    unsafe { mie::set_mext() };
}

/// Calls what serves, which loops may interrupt.
fn interruptible(serve: &dyn Fn()) {
    // SAFETY: no critical section is in progress, since an interrupt came, and the entry has saved
    // what others change.
    unsafe { mstatus::set_mie() };
    preserving_floats(serve);
    // SAFETY: as the entry left it.
    unsafe { mstatus::clear_mie() };
}

/// Serves the serial port of hart 0 while interrupts are masked.
pub(crate) fn poll_line() {
    if mhartid::read() == RECEIVER && mip::read().sext() {
        LINES.on_interrupt();
    }
}

/// Notes an interrupt that nobody handles, and has it come no more.
fn unhandled(cause: usize) {
    let bit = 1_usize.wrapping_shl(cause as u32);
    if let Some(hooks) = hooks() {
        hooks.unhandled.update(|causes| causes | bit as u32);
    }
    // SAFETY: nothing counts on it.
    unsafe { core::arch::asm!("csrc mie, {bit}", bit = in(reg) bit) };
}

/// A ring of this hart comes here from `trap.s`, with interrupts masked. Returns true if the debugger has given
/// its stub a command.
#[unsafe(no_mangle)]
extern "C" fn condor_software() -> bool {
    let Some(hooks) = hooks() else { return false };
    hooks.bell.acknowledge();
    // First, since nothing else is as urgent.
    serve_boards(hooks);
    serve_others(hooks)
}

/// Serves whoever has rung besides boards. Returns true if the debugger has given its stub a command.
fn serve_others(hooks: &Hooks) -> bool {
    let hart = mhartid::read();
    leave_if_abandoned(hart);
    if calls(hart) {
        // Interrupts of the boards' drivers have left their own causes.
        // SAFETY: it is that of this interrupt.
        unsafe { core::arch::asm!("csrw mcause, {}", in(reg) cause::SOFTWARE) };
        return true;
    }
    serve_mail(hooks);
    look_again(hooks);
    false
}

/// Has the hart look once more, when everything is done, for what could not be served when it came.
fn look_again(hooks: &Hooks) {
    let boards = hooks.boards.get();
    // Boards interrupt message handlers.
    let pending = boards.is_some_and(|(lines, _)| lines.is_pending());
    let serving = hooks.serving.get() && !pending;
    if !hooks.busy.get() && !serving && hooks.rung.take() {
        ring_hart(mhartid::read());
    }
}

/// Serves boards; it is done later if somebody serves them already, or if loops run.
fn serve_boards(hooks: &Hooks) {
    let Some((lines, boards)) = hooks.boards.get() else {
        return;
    };
    // The PLIC's interrupt is off if one could not be served when it came.
    if !lines.is_pending() && mie::read().mext() {
        return;
    }
    if hooks.busy.get() {
        hooks.rung.set(true);
    } else {
        attend(hooks, boards);
    }
}

/// Serves messages; it is done later if somebody serves them already, or boards, or if loops run.
fn serve_mail(hooks: &Hooks) {
    let Some(mail) = hooks.mail.get() else {
        return;
    };
    if hooks.busy.get() || hooks.serving.replace(true) {
        hooks.rung.set(true);
        return;
    }
    interruptible(mail);
    hooks.serving.set(false);
}

/// Whether the debugger has given the stub a command.
fn calls(hart: usize) -> bool {
    stub(hart).is_some_and(|stub| stub.has_command() == Ok(true))
}

type HartControl = Control<StaticWindow<'static>>;

/// The page of a hart.
pub(crate) fn control(hart: usize) -> Result<HartControl, AccessError> {
    Control::new(&memory(LEAST_BYTES), hart as u32)
}

/// The stub of a hart that runs a program; `None` if it is in its monitor.
pub(crate) fn stub(hart: usize) -> Option<Stub<StaticWindow<'static>>> {
    let control = control(hart).ok()?;
    let runs = matches!(control.state(), Ok(HartState::Runs { .. }));
    runs.then(|| control.debug_area().ok().map(Stub::new))?
}

/// Takes a ring of this hart, and goes back to the monitor if the host has abandoned its program.
pub(crate) fn heed(hart: usize) {
    if let Some(bell) = msip::of(hart) {
        bell.acknowledge();
    }
    leave_if_abandoned(hart);
}

fn leave_if_abandoned(hart: usize) {
    if is_abandoned(hart) {
        leave(Return::Abandoned);
    }
}

fn is_abandoned(hart: usize) -> bool {
    // The memory is there.
    control(hart).is_ok_and(|control| {
        matches!(control.state(), Ok(HartState::Runs { .. })) && control.is_abandoned() == Ok(true)
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
