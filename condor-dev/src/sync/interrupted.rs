//! Atomics before each of whose accesses a test's interrupt may come, on one processor: the routine
//! runs to its end on the interrupted stack, and not within a critical section.

use std::cell::{Cell, RefCell};
use std::rc::Rc;
use std::sync::atomic::Ordering;

#[derive(Default)]
struct Interrupt {
    /// Accesses until it comes; 0 if it does not.
    left: Cell<u32>,
    routine: RefCell<Option<Rc<dyn Fn()>>>,
    masked: Cell<u32>,
    pending: Cell<bool>,
}

thread_local! {
    static INTERRUPT: Interrupt = Interrupt::default();
}

/// Lets `routine` interrupt `operation` at its `k`-th access; says whether there was one.
pub(crate) fn comes_in(k: u32, routine: Rc<dyn Fn()>, operation: impl FnOnce()) -> bool {
    INTERRUPT.with(|this| {
        *this.routine.borrow_mut() = Some(routine);
        this.left.set(k);
    });
    operation();
    INTERRUPT.with(|this| {
        assert!(this.masked.get() == 0 && !this.pending.get());
        this.routine.borrow_mut().take();
        this.left.replace(0) == 0
    })
}

/// Something that the contexts share is about to be reached.
pub(crate) fn access() {
    INTERRUPT.with(|this| match this.left.get() {
        0 => {}
        1 if this.masked.get() > 0 => {
            this.left.set(0);
            this.pending.set(true);
        }
        1 => {
            this.left.set(0);
            run(this);
        }
        left => this.left.set(left - 1),
    });
}

fn run(this: &Interrupt) {
    let routine = this.routine.borrow_mut().take();
    if let Some(routine) = routine {
        routine();
    }
}

/// Keeps the interrupt out of `body`; one that came meanwhile comes at the end.
pub(crate) fn masked<R>(body: impl FnOnce() -> R) -> R {
    INTERRUPT.with(|this| {
        this.masked.set(this.masked.get() + 1);
        let result = critical_section::with(|_| body());
        this.masked.set(this.masked.get() - 1);
        if this.masked.get() == 0 && this.pending.replace(false) {
            run(this);
        }
        result
    })
}

macro_rules! atomic {
    ($name:ident, $word:ty) => {
        #[derive(Debug)]
        pub(crate) struct $name(std::sync::atomic::$name);

        impl $name {
            pub(crate) const fn new(value: $word) -> Self {
                Self(std::sync::atomic::$name::new(value))
            }

            pub(crate) fn load(&self, order: Ordering) -> $word {
                access();
                self.0.load(order)
            }

            pub(crate) fn store(&self, value: $word, order: Ordering) {
                access();
                self.0.store(value, order);
            }
        }
    };
}

atomic!(AtomicBool, bool);
atomic!(AtomicU8, u8);
atomic!(AtomicU32, u32);
