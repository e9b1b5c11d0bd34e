//! [`Turn`]: a value that one context at a time uses.

use core::cell::{Cell, UnsafeCell};
use core::marker::PhantomData;
use core::ops::Deref;

#[cfg(not(condor_loom))]
use core::sync::atomic::{AtomicBool, Ordering};
#[cfg(condor_loom)]
use loom::sync::atomic::{AtomicBool, Ordering};

/// A value that belongs to the context whose turn it is: background, handler, or thread.
pub(super) struct Turn<T> {
    taken: AtomicBool,
    value: UnsafeCell<T>,
}

// SAFETY: a reference to the value is made by `Alone` alone, of which `take` lets one exist, and which
// is not shared by threads. What a context does to the value happens before the next one's turn.
unsafe impl<T: Send> Sync for Turn<T> {}

impl<T> Turn<T> {
    pub(super) fn new(value: T) -> Self {
        Self {
            taken: AtomicBool::new(false),
            value: UnsafeCell::new(value),
        }
    }

    /// Begins the turn of this context; `None` during that of another one. Never waits.
    #[inline]
    pub(super) fn take(&self) -> Option<Alone<'_, T>> {
        (!self.set_taken()).then(|| Alone {
            turn: self,
            unshared: PhantomData,
        })
    }

    /// The value, for one who has the whole.
    pub(super) fn get_mut(&mut self) -> &mut T {
        self.value.get_mut()
    }

    /// Whether it was taken before.
    #[cfg(any(target_has_atomic = "8", condor_loom))]
    #[inline]
    fn set_taken(&self) -> bool {
        // Acquire: pairs with the Release store of `Alone::drop`. Who is refused stores nothing.
        let exchanged =
            (self.taken).compare_exchange(false, true, Ordering::Acquire, Ordering::Relaxed);
        exchanged.is_err()
    }

    /// Marks the turn as taken, on processors without compare-and-swap; returns true if it was taken
    /// before.
    #[cfg(not(any(target_has_atomic = "8", condor_loom)))]
    fn set_taken(&self) -> bool {
        critical_section::with(|_| {
            // Acquire: as above. In a critical section nobody comes between load and store.
            let taken = self.taken.load(Ordering::Acquire);
            self.taken.store(true, Ordering::Relaxed);
            taken
        })
    }
}

/// The turn of a context, which ends when it is dropped.
pub(super) struct Alone<'t, T> {
    turn: &'t Turn<T>,
    /// Threads may pass it on, but not share it: the value need not be `Sync`.
    unshared: PhantomData<Cell<()>>,
}

impl<T> Deref for Alone<'_, T> {
    type Target = T;

    #[inline]
    fn deref(&self) -> &T {
        // SAFETY: `take` made this the only `Alone` until it is dropped, and nobody makes a reference
        // that could change the value meanwhile.
        unsafe { &*self.turn.value.get() }
    }
}

impl<T> Drop for Alone<'_, T> {
    #[inline]
    fn drop(&mut self) {
        // Release: pairs with the Acquire in `set_taken`.
        self.turn.taken.store(false, Ordering::Release);
    }
}

/// Loom on the shipped code, with two and three contexts. Each model explores every execution; the
/// bound is none. Together they take some seconds.
#[cfg(all(test, condor_loom))]
mod loom_models {
    use std::sync::Arc;

    use super::*;

    /// Loom reports two that touch it at a time, and those of which none is before the other.
    type Value = loom::cell::Cell<u32>;

    /// Counts if it is this one's turn; returns true if it is.
    fn count(turn: &Turn<Value>) -> bool {
        let alone = turn.take();
        if let Some(alone) = &alone {
            alone.set(alone.get() + 1);
        }
        alone.is_some()
    }

    #[test]
    fn one_context_at_a_time_has_the_value() {
        loom::model(|| {
            let turn = Arc::new(Turn::new(Value::new(0)));
            let others: Vec<_> = (0..2)
                .map(|_| {
                    let turn = Arc::clone(&turn);
                    loom::thread::spawn(move || u32::from(count(&turn)) + u32::from(count(&turn)))
                })
                .collect();
            let mut turns = u32::from(count(&turn));
            for other in others {
                turns += other.join().unwrap();
            }
            let alone = turn.take().expect("all turns have ended");
            assert_eq!(alone.get(), turns, "none is lost");
        });
    }

    #[test]
    fn who_waits_for_its_turn_sees_what_was_done_before() {
        loom::model(|| {
            let turn = Arc::new(Turn::new(Value::new(0)));
            let other = Arc::clone(&turn);
            let waiter = loom::thread::spawn(move || {
                while !count(&other) {
                    loom::thread::yield_now();
                }
            });
            while !count(&turn) {
                loom::thread::yield_now();
            }
            waiter.join().unwrap();
            let alone = turn.take().expect("all turns have ended");
            assert_eq!(alone.get(), 2);
        });
    }
}
