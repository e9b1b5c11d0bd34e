//! [`Tasks`]: the tasks that await a reply.

use core::cell::RefCell;
use core::task::Waker;

use critical_section::Mutex;

/// The number of tasks that are remembered; those beyond are woken at once, and look again and again.
const ROOM: usize = 8;

/// The tasks to be woken when something has been served.
pub(super) struct Tasks(Mutex<RefCell<[Option<Waker>; ROOM]>>);

impl Tasks {
    pub(super) fn new() -> Self {
        Self(Mutex::new(RefCell::new([const { None }; ROOM])))
    }

    /// Remembers `waker` until the next [`wake`](Self::wake).
    pub(super) fn add(&self, waker: &Waker) {
        let refused = critical_section::with(|section| {
            let mut all = self.0.borrow_ref_mut(section);
            if all.iter().flatten().any(|known| known.will_wake(waker)) {
                return false;
            }
            let free = all.iter_mut().find(|place| place.is_none());
            let refused = free.is_none();
            if let Some(place) = free {
                *place = Some(waker.clone());
            }
            refused
        });
        if refused {
            waker.wake_by_ref();
        }
    }

    /// Wakes all, outside of the section: a waker may do anything.
    pub(super) fn wake(&self) {
        for at in 0..ROOM {
            let waker = critical_section::with(|section| {
                self.0.borrow_ref_mut(section).get_mut(at)?.take()
            });
            if let Some(waker) = waker {
                waker.wake();
            }
        }
    }
}
