//! [`Spinner`]: a timer and boards whose interrupts are calls where the background polls.

use core::cell::Cell;
use core::ptr;
use core::sync::atomic::{AtomicBool, AtomicU64, Ordering::Relaxed};
use std::thread::LocalKey;

use condor_mos::ConnectError;

const NEVER: u64 = u64::MAX;

/// The instant at which the timer interrupts. The handlers are in variables of the thread.
#[derive(Debug)]
pub(super) struct Spinner {
    armed: AtomicU64,
    /// Whether boards have a handler.
    boards: AtomicBool,
}

/// A handler that the polls of a thread call. It lives only as long as [`Spinner::with`] runs.
#[derive(Clone, Copy)]
struct Connected {
    /// Only compared.
    spinner: *const Spinner,
    handler: &'static (dyn Fn() + Sync),
    /// The handler runs.
    closed: bool,
}

/// The place of a handler.
type Place = &'static LocalKey<Cell<Option<Connected>>>;

thread_local! {
    static TIMER: Cell<Option<Connected>> = const { Cell::new(None) };
    static BOARDS: Cell<Option<Connected>> = const { Cell::new(None) };
}

impl Spinner {
    pub(super) const fn new() -> Self {
        Self {
            armed: AtomicU64::new(NEVER),
            boards: AtomicBool::new(false),
        }
    }

    pub(super) fn arm(&self, at: u64) {
        self.armed.store(at, Relaxed);
    }

    pub(super) fn disarm(&self) {
        self.armed.store(NEVER, Relaxed);
    }

    /// Calls the timer's handler if its instant has passed at `now`, and then that of boards, if this is their thread.
    #[inline]
    pub(super) fn poll(&self, now: u64) {
        if now >= self.armed.load(Relaxed) {
            self.interrupt(&TIMER, Self::disarm);
        }
        if self.boards.load(Relaxed) {
            self.interrupt(&BOARDS, |_| ());
        }
    }

    /// Calls `before` and then the handler, if it may be called now.
    #[cold]
    fn interrupt(&self, place: Place, before: fn(&Self)) {
        // Boards do not interrupt loops.
        let loops_run = self.connected(&TIMER).is_some_and(|timer| timer.closed);
        let Some(connected) = self.connected(place) else {
            return;
        };
        if connected.closed || loops_run {
            return;
        }
        let closed = Connected {
            closed: true,
            ..connected
        };
        let _open = Restore(place, place.replace(Some(closed)));
        before(self);
        (connected.handler)();
    }

    /// Whether this thread's stack is that of the loops; if not, has its thread look soon.
    pub(super) fn is_loops_stack(&self) -> bool {
        let mine = self.connected(&TIMER).is_some();
        if !mine {
            self.armed.store(0, Relaxed);
        }
        mine
    }

    fn connected(&self, place: Place) -> Option<Connected> {
        let connected = place.get();
        connected.filter(|connected| ptr::eq(connected.spinner, self))
    }

    /// Runs `background`, whose polls call `handler` when the timer interrupts, on this thread alone.
    pub(super) fn with_handler<R>(
        &self,
        handler: impl Fn() + Sync,
        background: impl FnOnce() -> R,
    ) -> Result<R, ConnectError> {
        self.with(&TIMER, &handler, background)
    }

    /// Runs `background`, whose polls call `handler`, which looks whether a board interrupts, on this thread alone.
    pub(super) fn with_boards<R>(
        &self,
        handler: impl Fn() + Sync,
        background: impl FnOnce() -> R,
    ) -> Result<R, ConnectError> {
        self.with(&BOARDS, &handler, || {
            self.boards.store(true, Relaxed);
            let result = background();
            self.boards.store(false, Relaxed);
            result
        })
    }

    fn with<R>(
        &self,
        place: Place,
        handler: &(dyn Fn() + Sync),
        background: impl FnOnce() -> R,
    ) -> Result<R, ConnectError> {
        if place.get().is_some() {
            return Err(ConnectError::Connected);
        }
        // SAFETY: only the lifetime differs. Only this thread finds the handler, and `_disconnect` takes it
        // away before it goes, also when the background unwinds; a call in progress is on this stack, and
        // so ends before.
        let handler = unsafe {
            core::mem::transmute::<&(dyn Fn() + Sync), &'static (dyn Fn() + Sync)>(handler)
        };
        let connected = Connected {
            spinner: self,
            handler,
            closed: false,
        };
        let _disconnect = Restore(place, place.replace(Some(connected)));
        Ok(background())
    }
}

/// Puts back what the thread was connected to before.
struct Restore(Place, Option<Connected>);

impl Drop for Restore {
    fn drop(&mut self) {
        self.0.set(self.1);
    }
}
