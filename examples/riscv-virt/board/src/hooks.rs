//! What a program has the interrupts of its hart do, for as long as it lasts.

use core::cell::Cell;

use condor_mos::riscv::Clint;
use riscv::register::mhartid;

use crate::bell::HARTS;

/// The hooks of a hart. What they borrow is in frames that are still there; see [`with`].
#[derive(Clone, Copy)]
pub(crate) struct Hooks {
    /// Whose interrupt it is, and what it calls.
    pub(crate) timer: Option<(&'static Clint, &'static dyn Fn())>,
    pub(crate) mail: Option<&'static dyn Fn()>,
    /// Timer interrupts that have begun and not ended.
    pub(crate) timed: u32,
    /// Whether a ring came meanwhile.
    pub(crate) rung: bool,
}

/// None.
pub(crate) const NONE: Hooks = Hooks {
    timer: None,
    mail: None,
    timed: 0,
    rung: false,
};

struct OfHarts([Cell<Hooks>; HARTS]);

// SAFETY: each hart uses its own entry alone, with interrupts masked.
unsafe impl Sync for OfHarts {}

static HOOKS: OfHarts = OfHarts([const { Cell::new(NONE) }; HARTS]);

/// Those of this hart.
pub(crate) fn get() -> Hooks {
    critical_section::with(|_| HOOKS.0.get(mhartid::read()).map_or(NONE, Cell::get))
}

/// Changes those of this hart.
pub(crate) fn change(change: impl FnOnce(&mut Hooks)) {
    critical_section::with(|_| {
        if let Some(cell) = HOOKS.0.get(mhartid::read()) {
            let mut hooks = cell.get();
            change(&mut hooks);
            cell.set(hooks);
        }
    });
}

/// Has interrupts call `hook`, which `set` stores and takes away, while `body` runs.
pub(crate) fn with<R>(
    hook: &dyn Fn(),
    set: impl Fn(&mut Hooks, Option<&'static dyn Fn()>),
    body: impl FnOnce() -> R,
) -> R {
    // SAFETY: it is there until `body` has returned, and is taken away before; nothing unwinds here.
    let forever = unsafe { core::mem::transmute::<&dyn Fn(), &'static dyn Fn()>(hook) };
    change(|hooks| set(hooks, Some(forever)));
    let result = body();
    change(|hooks| set(hooks, None));
    result
}
