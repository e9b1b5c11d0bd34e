//! [`Spinner`]: a timer whose interrupt is a call where the background polls.

use core::cell::Cell;
use core::ptr;
use core::sync::atomic::{AtomicU64, Ordering::Relaxed};

use condor_mos::ConnectError;

const NEVER: u64 = u64::MAX;

/// The instant at which the timer interrupts. Its handler is in a variable of the thread.
#[derive(Debug)]
pub(super) struct Spinner {
    armed: AtomicU64,
}

/// The handler that the polls of a thread call. It lives only as long as [`Spinner::with_handler`]
/// runs.
#[derive(Clone, Copy)]
struct Connected {
    /// Only compared.
    spinner: *const Spinner,
    handler: &'static (dyn Fn() + Sync),
    /// The handler runs.
    closed: bool,
}

thread_local! {
    static CONNECTED: Cell<Option<Connected>> = const { Cell::new(None) };
}

impl Spinner {
    pub(super) const fn new() -> Self {
        Self {
            armed: AtomicU64::new(NEVER),
        }
    }

    pub(super) fn arm(&self, at: u64) {
        self.armed.store(at, Relaxed);
    }

    pub(super) fn disarm(&self) {
        self.armed.store(NEVER, Relaxed);
    }

    /// Calls the handler if its instant has passed at `now`, and this is its thread.
    #[inline]
    pub(super) fn poll(&self, now: u64) {
        if now >= self.armed.load(Relaxed) {
            self.interrupt();
        }
    }

    #[cold]
    fn interrupt(&self) {
        let Some(connected) = self.connected().filter(|connected| !connected.closed) else {
            return;
        };
        let _open = Restore(CONNECTED.replace(Some(Connected {
            closed: true,
            ..connected
        })));
        self.armed.store(NEVER, Relaxed);
        (connected.handler)();
    }

    /// Whether this thread's stack is that of the loops; if not, has its thread look soon.
    pub(super) fn is_loops_stack(&self) -> bool {
        let mine = self.connected().is_some();
        if !mine {
            self.armed.store(0, Relaxed);
        }
        mine
    }

    fn connected(&self) -> Option<Connected> {
        CONNECTED
            .get()
            .filter(|connected| ptr::eq(connected.spinner, self))
    }

    /// Runs `background`, whose polls call `handler`, on this thread alone.
    pub(super) fn with_handler<R>(
        &self,
        handler: impl Fn() + Sync,
        background: impl FnOnce() -> R,
    ) -> Result<R, ConnectError> {
        if CONNECTED.get().is_some() {
            return Err(ConnectError::Connected);
        }
        let handler: &(dyn Fn() + Sync) = &handler;
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
        let _disconnect = Restore(CONNECTED.replace(Some(connected)));
        Ok(background())
    }
}

/// Puts back what the thread was connected to before.
struct Restore(Option<Connected>);

impl Drop for Restore {
    fn drop(&mut self) {
        CONNECTED.set(self.0);
    }
}
