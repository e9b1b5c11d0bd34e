//! [`Late`]: a handler that is made after the mailbox that calls it.

use core::cell::Cell;

use condor_mbox::Call;
use critical_section::Mutex;

/// A reference that a message handler follows, once there is something at its end.
///
/// The objects that answer messages follow from the configuration, which comes through the mailbox,
/// which borrows its handlers.
pub(crate) struct Late<'a, T>(Mutex<Cell<Option<&'a T>>>);

impl<'a, T: Sync> Late<'a, T> {
    pub(crate) const fn new() -> Self {
        Self(Mutex::new(Cell::new(None)))
    }

    /// From now on handlers find `object`.
    pub(crate) fn set(&self, object: &'a T) {
        critical_section::with(|section| self.0.borrow(section).set(Some(object)));
    }

    /// What `answer` says; 0, by which handlers refuse, before there is an object.
    pub(crate) fn answer(&self, call: &Call<'_>, answer: impl FnOnce(&T, &Call<'_>) -> u32) -> u32 {
        let object = critical_section::with(|section| self.0.borrow(section).get());
        object.map_or(0, |object| answer(object, call))
    }
}
