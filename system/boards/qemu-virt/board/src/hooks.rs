//! The hooks by which a program handles interrupts of its hart, until it ends.

use core::cell::Cell;

use condor_mos::riscv::Clint;
use critical_section::CriticalSection;
use riscv::register::mhartid;

use crate::boards::HartLines;
use crate::msip::{HARTS, MSIPS, Msip, of_harts};

/// A handler that is there for as long as a program runs.
type Hook = &'static dyn Fn();

/// The hooks of a hart. What they borrow is in frames that are still there; see [`with`].
pub(crate) struct Hooks {
    /// The doorbell of the hart.
    pub(crate) bell: &'static Msip,
    /// The timer whose interrupt it is, and the hook that it calls.
    pub(crate) timer: Cell<Option<(&'static Clint, Hook)>>,
    pub(crate) mail: Cell<Option<Hook>>,
    /// The lines of boards that are memory, and what serves all boards.
    pub(crate) boards: Cell<Option<(HartLines, Hook)>>,
    /// Whether loops run or boards are served: interrupts of boards and messages wait for the end.
    pub(crate) busy: Cell<bool>,
    /// Whether a mailbox interrupt serves.
    pub(crate) serving: Cell<bool>,
    /// Whether a ring came meanwhile.
    pub(crate) rung: Cell<bool>,
    /// The causes of interrupts that nobody handles, as bits of `mie`.
    pub(crate) unhandled: Cell<u32>,
}

impl Hooks {
    const fn new(hart: usize) -> Self {
        Self {
            bell: &MSIPS[hart],
            timer: Cell::new(None),
            mail: Cell::new(None),
            boards: Cell::new(None),
            busy: Cell::new(false),
            serving: Cell::new(false),
            rung: Cell::new(false),
            unhandled: Cell::new(0),
        }
    }

    /// Takes all handlers away.
    pub(crate) fn clear(&self) {
        self.timer.set(None);
        self.mail.set(None);
        self.boards.set(None);
        self.busy.set(false);
        self.serving.set(false);
        self.rung.set(false);
        self.unhandled.set(0);
    }
}

struct OfHarts([Hooks; HARTS]);

// SAFETY: each hart uses its own entry alone, with interrupts masked.
unsafe impl Sync for OfHarts {}

static HOOKS: OfHarts = OfHarts(of_harts!(Hooks::new));

/// Those of this hart, to be used while interrupts are masked.
pub(crate) fn of_this(_: CriticalSection<'_>) -> Option<&'static Hooks> {
    HOOKS.0.get(mhartid::read())
}

/// Changes those of this hart.
pub(crate) fn change(change: impl FnOnce(&Hooks)) {
    critical_section::with(|section| of_this(section).map(change));
}

/// Has interrupts call `hook`, which `set` stores and takes away, while `body` runs.
pub(crate) fn with<R>(
    hook: &dyn Fn(),
    set: impl Fn(&Hooks, Option<&'static dyn Fn()>),
    body: impl FnOnce() -> R,
) -> R {
    // SAFETY: it is there until `body` has returned, and is taken away before; nothing unwinds here.
    let forever = unsafe { core::mem::transmute::<&dyn Fn(), &'static dyn Fn()>(hook) };
    change(|hooks| set(hooks, Some(forever)));
    let result = body();
    change(|hooks| set(hooks, None));
    result
}
