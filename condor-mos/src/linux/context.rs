//! What a thread and its signal handlers know of each other.

use core::cell::Cell;
use core::sync::atomic::{AtomicBool, AtomicU32, Ordering, compiler_fence};

/// What a signal calls, as long as the thread is connected.
#[derive(Clone, Copy)]
pub(super) struct Service {
    /// Never called while a critical section is held, or by two contexts at a time.
    pub(super) call: unsafe fn(*const ()),
    pub(super) data: *const (),
}

/// The words of one thread. Its handlers are the only other contexts that see them, so all accesses
/// are relaxed, kept in order by compiler fences.
pub(super) struct Context {
    /// The thread is in a critical section.
    held: AtomicBool,
    /// The thread is in the scheduler: interrupts are closed, as in a handler of a processor.
    closed: AtomicBool,
    /// A signal came while one of them was set.
    pending: AtomicBool,
    number: AtomicU32,
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

/// The kernel's number of the calling thread; a system call in the first use alone.
#[inline]
pub(super) fn thread_number() -> u32 {
    with(|context| match context.number.load(Ordering::Relaxed) {
        0 => context.ask_number(),
        number => number,
    })
}

impl Context {
    const fn new() -> Self {
        Self {
            held: AtomicBool::new(false),
            closed: AtomicBool::new(false),
            pending: AtomicBool::new(false),
            number: AtomicU32::new(0),
            service: Cell::new(None),
        }
    }

    #[cold]
    fn ask_number(&self) -> u32 {
        static WATCHED: AtomicBool = AtomicBool::new(false);
        extern "C" fn forget_number() {
            with(|context| context.number.store(0, Ordering::Relaxed));
        }
        if !WATCHED.swap(true, Ordering::Relaxed) {
            // The thread that goes on in a forked process has another number there.
            // SAFETY: the function only stores to a word of its own thread.
            unsafe { libc::pthread_atfork(None, None, Some(forget_number)) };
        }
        let number = rustix::thread::gettid().as_raw_nonzero().get();
        let number = number.cast_unsigned();
        self.number.store(number, Ordering::Relaxed);
        number
    }

    /// Enters a critical section; false if the thread is in one.
    #[cfg(feature = "critical-section-linux")]
    #[inline]
    pub(super) fn hold(&self) -> bool {
        if self.held.load(Ordering::Relaxed) {
            return false;
        }
        self.held.store(true, Ordering::Relaxed);
        compiler_fence(Ordering::SeqCst);
        true
    }

    /// Leaves the outermost critical section, and does what a signal has asked for meanwhile.
    #[cfg(feature = "critical-section-linux")]
    #[inline]
    pub(super) fn let_go(&self) {
        compiler_fence(Ordering::SeqCst);
        self.held.store(false, Ordering::Relaxed);
        if !self.closed.load(Ordering::Relaxed) {
            self.do_pending();
        }
    }

    pub(super) fn is_held(&self) -> bool {
        self.held.load(Ordering::Relaxed)
    }

    #[inline]
    pub(super) fn is_closed(&self) -> bool {
        self.closed.load(Ordering::Relaxed)
    }

    /// What a signal does: serves, or leaves it to whom it has interrupted.
    #[inline]
    pub(super) fn on_signal(&self) {
        if self.held.load(Ordering::Relaxed) || self.closed.load(Ordering::Relaxed) {
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
        self.service.set(service);
        self.pending.store(false, Ordering::Relaxed);
        compiler_fence(Ordering::SeqCst);
    }
}
