//! The points at which an interrupt can come: whenever a context of this thread, unmasked, reaches shared
//! state.

use std::cell::{Cell, RefCell};
use std::rc::Rc;

thread_local! {
    static DEPTH: Cell<u32> = const { Cell::new(0) };
    static ON_POINT: RefCell<Option<Rc<dyn Fn()>>> = const { RefCell::new(None) };
}

/// Calls `on_point` at every point of `program`.
pub fn with_points<R>(on_point: Rc<dyn Fn()>, program: impl FnOnce() -> R) -> R {
    ON_POINT.set(Some(on_point));
    let result = program();
    ON_POINT.set(None);
    result
}

/// Runs `f` without points: for a test that looks on from outside.
pub fn quietly<R>(f: impl FnOnce() -> R) -> R {
    let on_point = ON_POINT.take();
    let result = f();
    ON_POINT.set(on_point);
    result
}

/// Calls the function that [`with_points`] was given, unless interrupts are masked.
pub fn point() {
    if DEPTH.get() == 0
        && let Some(on_point) = ON_POINT.with_borrow(Clone::clone)
    {
        on_point();
    }
}

/// A critical section, until it is dropped: there is a point before and one behind it, and none within.
#[derive(Debug)]
pub struct Section(());

impl Section {
    /// Enters the section.
    #[must_use]
    pub fn enter() -> Self {
        point();
        DEPTH.set(DEPTH.get() + 1);
        Self(())
    }
}

impl Drop for Section {
    fn drop(&mut self) {
        DEPTH.set(DEPTH.get() - 1);
        point();
    }
}

/// An access to shared state, until it is dropped: there is a point before and one behind it.
///
/// In a [`Section`] there is none, so a section that is missing shows.
#[derive(Debug)]
pub struct Access(());

impl Access {
    /// Begins the access.
    #[must_use]
    pub fn begin() -> Self {
        point();
        Self(())
    }
}

impl Drop for Access {
    fn drop(&mut self) {
        point();
    }
}
