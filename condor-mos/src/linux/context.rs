//! State that a thread and its signal handlers share.

use core::cell::Cell;
use core::sync::atomic::{AtomicBool, Ordering, compiler_fence};

use condor_platform::linux;

/// The function that a signal calls, as long as the thread is connected.
#[derive(Clone, Copy)]
pub(super) struct Service {
    /// Never called while a critical section is held, or by two contexts at a time.
    pub(super) call: unsafe fn(*const ()),
    pub(super) data: *const (),
}

/// The words of one thread. Its handlers are the only other contexts that see them, so all accesses
/// are relaxed, kept in order by compiler fences.
pub(super) struct Context {
    /// The thread is in the scheduler: interrupts are closed, as in a handler of a processor.
    closed: AtomicBool,
    /// A signal came meanwhile, or in a critical section.
    pending: AtomicBool,
    /// Changed only while no timer signals this thread.
    service: Cell<Option<Service>>,
}

thread_local! {
    // Constant and without a destructor: reached without a call or an allocation, in handlers, too.
    static CONTEXT: Context = const { Context::new() };
}

/// Uses the calling thread's words.
#[inline]
pub(super) fn with<R>(f: impl FnOnce(&Context) -> R) -> R {
    CONTEXT.with(f)
}

/// Does what a signal has asked for while the thread was in a critical section.
fn after_section() {
    with(|context| {
        if !context.is_closed() {
            context.do_pending();
        }
    });
}

impl Context {
    const fn new() -> Self {
        Self {
            closed: AtomicBool::new(false),
            pending: AtomicBool::new(false),
            service: Cell::new(None),
        }
    }

    #[inline]
    pub(super) fn is_closed(&self) -> bool {
        self.closed.load(Ordering::Relaxed)
    }

    /// Serves a signal, or leaves it to the section that it has interrupted.
    #[inline]
    pub(super) fn on_signal(&self) {
        if linux::is_held() || self.closed.load(Ordering::Relaxed) {
            self.pending.store(true, Ordering::Relaxed);
        } else {
            self.serve();
        }
    }

    #[inline]
    fn do_pending(&self) {
        compiler_fence(Ordering::SeqCst);
        if self.pending.load(Ordering::Relaxed) {
            self.serve();
        }
    }

    fn serve(&self) {
        loop {
            self.pending.store(false, Ordering::Relaxed);
            self.closed.store(true, Ordering::Relaxed);
            compiler_fence(Ordering::SeqCst);
            self.call_service();
            compiler_fence(Ordering::SeqCst);
            self.closed.store(false, Ordering::Relaxed);
            compiler_fence(Ordering::SeqCst);
            if !self.pending.load(Ordering::Relaxed) {
                return;
            }
        }
    }

    #[inline]
    pub(super) fn call_service(&self) {
        if let Some(service) = self.service.get() {
            // SAFETY: whoever has set the service keeps its data until it is taken away.
            unsafe { (service.call)(service.data) }
        }
    }

    /// Lets signals in, on the way from the scheduler to a loop's body.
    #[inline]
    pub(super) fn open(&self) {
        compiler_fence(Ordering::SeqCst);
        self.closed.store(false, Ordering::Relaxed);
        self.do_pending();
    }

    /// Keeps signals out, on the way back.
    #[inline]
    pub(super) fn close(&self) {
        self.closed.store(true, Ordering::Relaxed);
        compiler_fence(Ordering::SeqCst);
    }

    pub(super) fn has_service(&self) -> bool {
        self.service.get().is_some()
    }

    /// # Safety
    /// No timer signals the calling thread, and what the service is given is there until it is
    /// taken away.
    pub(super) unsafe fn set_service(&self, service: Option<Service>) {
        linux::on_leaving(service.map(|_| after_section as fn()));
        self.service.set(service);
        self.pending.store(false, Ordering::Relaxed);
        compiler_fence(Ordering::SeqCst);
    }
}
