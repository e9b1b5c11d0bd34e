//! [`SignalPlatform`]: loops on the stack of the thread that they interrupt.

use core::ptr;

use condor_platform::linux::{is_held, thread_number};

use super::context::{self, Service};
use super::posix_timer::{self, PosixTimer};
use super::time::{self, NANOSECONDS};
use crate::error::ConnectError;
use crate::masked::{Masked, section};
use crate::platform::Platform;
use crate::rate::Rate;
use crate::timer::{Armed, Timer};

/// Not armed, in the words of the kernel.
const NEVER: u64 = 0;

/// No instant that is ever armed: what the kernel has does not matter.
const ANOTHER: u64 = u64::MAX;

/// A platform of Linux on which loops run in signal handlers, on one stack, as in interrupts of a
/// bare processor. A release costs a signal and one system call, and no change of threads.
///
/// [`new`](Self::new) has a contract that the program must keep; [`Threads`](super::Threads) have
/// none.
///
/// [`connect`](Platform::connect) runs the background on the calling thread, which signals
/// interrupt. A platform can be connected to only one thread at a time, and a thread to only one
/// platform. Other threads may call the methods of the platform's scheduler, but not take its
/// locks, which are for its loops and their background. Loops that such calls release run on the
/// connected thread.
///
/// A loop that panics ends the program, since an interrupt cannot unwind. System calls of the
/// background that the kernel does not restart, such as `nanosleep` and `poll`, end early with
/// `EINTR`. A loop does not change `errno`.
///
/// The timer counts `CLOCK_MONOTONIC`, in nanoseconds. It is armed after the fastest loop has run,
/// which nothing may interrupt anyway, so no system call precedes the start of that loop.
pub struct SignalPlatform {
    signal: u8,
    port: Masked<Port>,
}

struct Port {
    /// There while a thread is connected, whose number is `owner`.
    ///
    /// Two, so that the kernel finds the next event when it serves one. With a single timer it
    /// programs the clock device twice for each: to what comes next without us, and again when the
    /// handler arms. With two, the handler only adds an event behind the next one.
    timers: Option<[PosixTimer; 2]>,
    owner: u32,
    /// The instant that the scheduler has armed.
    wanted: u64,
    /// The value of `wanted` that the kernel was given last.
    given: u64,
    /// When the kernel's timers are, or were, to signal.
    set: [u64; 2],
}

impl SignalPlatform {
    /// Makes a platform that uses the signal `SIGRTMIN`.
    ///
    /// # Safety
    /// While a thread is [connected](Platform::connect):
    /// * The functions that the platform's handler and the loops call must be async-signal-safe:
    ///   arithmetic, atomics, this crate's methods, and system calls that POSIX lists as such.
    ///   Loops must not allocate or print. They must not wait for a lock that the interrupted
    ///   thread may hold, such as that of `malloc`, of standard output, or any [`std::sync::Mutex`]
    ///   of the background.
    /// * The stack of that thread must have room for all loops at a time: for each loop, its own
    ///   frames and the frame of a signal, which takes 3.5 kB on `x86_64` (11 kB on processors with
    ///   AMX).
    /// * That thread must not switch to another stack, and must not leave through `longjmp`.
    #[must_use]
    pub const unsafe fn new() -> Self {
        // SAFETY: the caller vouches for it.
        unsafe { Self::with_signal(0) }
    }

    /// Makes a platform that uses the signal `SIGRTMIN + offset`, for programs that use other
    /// real-time signals for something else.
    ///
    /// # Safety
    /// The contract is that of [`new`](Self::new).
    #[must_use]
    pub const unsafe fn with_signal(offset: u8) -> Self {
        let port = Port {
            timers: None,
            owner: 0,
            wanted: NEVER,
            given: NEVER,
            set: [NEVER; 2],
        };
        Self {
            signal: offset,
            port: Masked::new(port),
        }
    }

    fn with_port<R>(&self, f: impl FnOnce(&mut Port) -> R) -> R {
        section(|section| self.port.with(section, f))
    }

    /// Passes to the kernel the instant that was armed in the handler.
    #[inline]
    fn flush(&self) {
        self.with_port(Port::give);
    }

    fn is_mine(&self) -> bool {
        self.with_port(|port| port.owner == thread_number())
    }

    /// After the fastest loop: what has become due during its run finds it unfinished.
    #[inline]
    fn pass_missed(&self) {
        let wanted = self.with_port(|port| port.wanted);
        if wanted != NEVER && self.now() >= wanted {
            context::with(context::Context::call_service);
        }
    }
}

impl Port {
    fn set(&mut self, index: usize, at: u64) {
        if let Some(timers) = &self.timers
            && self.set[index] != at
        {
            timers[index].set(at);
            self.set[index] = at;
        }
    }

    /// Has the kernel signal at what is wanted, and at no other time.
    fn give_alone(&mut self) {
        self.set[0] = ANOTHER;
        self.set(0, self.wanted);
        self.set(1, NEVER);
        self.given = self.wanted;
    }

    /// Has the kernel signal at what is wanted, and after it at what will probably be wanted: one
    /// system call if that was right before.
    #[inline]
    fn give(&mut self) {
        let (wanted, before) = (self.wanted, self.given);
        if wanted == before {
            return;
        }
        let holder = match self.set.iter().position(|&at| at == wanted) {
            Some(holder) => holder,
            None => usize::from(self.set[1] < self.set[0]),
        };
        self.set(holder, wanted);
        let gap = wanted.wrapping_sub(before);
        let known = before != NEVER && u32::try_from(gap).is_ok();
        let next = if known { wanted + gap } else { NEVER };
        self.set(1 - holder, next);
        self.given = wanted;
    }
}

impl Timer for SignalPlatform {
    type Instant = u64;

    fn frequency(&self) -> Rate {
        NANOSECONDS
    }

    #[inline]
    fn now(&self) -> u64 {
        time::now()
    }

    #[inline]
    fn arm(&self, at: u64) -> Armed {
        let closed = context::with(context::Context::is_closed);
        self.with_port(|port| {
            // The instant 0 would disarm.
            port.wanted = at.max(1);
            if !(closed && port.owner == thread_number()) {
                port.give_alone();
            }
        });
        if at > self.now() {
            Armed::Ahead
        } else {
            Armed::Past
        }
    }

    fn disarm(&self) {
        self.with_port(|port| {
            port.wanted = NEVER;
            port.give_alone();
        });
    }
}

impl Platform for SignalPlatform {
    fn is_loops_stack(&self) -> bool {
        let mine = self.is_mine();
        if !mine {
            // A signal at once, in which the connected thread finds what there is to run.
            self.with_port(|port| {
                port.wanted = 1;
                port.give_alone();
            });
        }
        mine
    }

    fn has_handler(&self) -> bool {
        self.with_port(|port| port.owner != 0)
    }

    fn connect<R>(
        &self,
        handler: impl Fn() + Sync,
        program: impl FnOnce() -> R,
    ) -> Result<R, ConnectError> {
        let connected = Connected::new(self, &handler)?;
        let result = program();
        drop(connected);
        Ok(result)
    }

    #[inline]
    fn interruptible(&self, rank: u32, body: impl FnOnce()) {
        if !context::with(context::Context::is_closed) {
            // Of the background: signals come in anyway.
            body();
        } else if rank == 0 {
            // Nothing is faster: opening and closing, and the kernel's timer, can wait.
            body();
            self.pass_missed();
        } else {
            self.flush();
            context::with(context::Context::open);
            body();
            context::with(context::Context::close);
        }
    }
}

/// The data of the handler: a platform, and the program's part of the handler.
struct Handler<'h, H> {
    signals: &'h SignalPlatform,
    handler: &'h H,
}

impl<H: Fn()> Handler<'_, H> {
    /// # Safety
    /// `handler` points to a `Handler<H>`.
    unsafe fn call(handler: *const ()) {
        // SAFETY: as the caller promises.
        let handler = unsafe { &*handler.cast::<Handler<'_, H>>() };
        (handler.handler)();
        handler.signals.flush();
    }
}

/// Disconnects the thread, also when the program unwinds.
struct Connected<'h, H> {
    signals: &'h SignalPlatform,
    was_blocked: bool,
    signal: i32,
    /// Pointed to by the thread's service.
    _handler: Box<Handler<'h, H>>,
}

impl<'h, H: Fn() + Sync> Connected<'h, H> {
    fn new(signals: &'h SignalPlatform, handler: &'h H) -> Result<Self, ConnectError> {
        let signal = libc::SIGRTMIN() + i32::from(signals.signal);
        if signal > libc::SIGRTMAX() {
            return Err(ConnectError::NoSuchSignal { signal });
        }
        if !section(|_| is_held()) {
            return Err(ConnectError::OtherSection);
        }
        if context::with(context::Context::has_service) || signals.with_port(|port| port.owner != 0)
        {
            return Err(ConnectError::Connected);
        }
        posix_timer::install(signal, on_signal)?;
        let timers = [PosixTimer::new(signal)?, PosixTimer::new(signal)?];
        let handler = Box::new(Handler { signals, handler });
        let service = Service {
            call: Handler::<H>::call,
            data: ptr::from_ref(&*handler).cast(),
        };
        // SAFETY: the timers are not armed yet; `drop` takes the service away before its data.
        context::with(|context| unsafe { context.set_service(Some(service)) });
        let was_blocked = posix_timer::set_blocked(signal, false)?;
        let connected = Self {
            signals,
            was_blocked,
            signal,
            _handler: handler,
        };
        signals.with_port(|port| {
            port.timers = Some(timers);
            port.owner = thread_number();
            // The instant that was armed before any thread was connected.
            if port.wanted != NEVER {
                port.give_alone();
            }
        });
        Ok(connected)
    }
}

impl<H> Drop for Connected<'_, H> {
    fn drop(&mut self) {
        let timers = self.signals.with_port(|port| {
            port.owner = 0;
            port.set = [NEVER; 2];
            port.timers.take()
        });
        drop(timers);
        // SAFETY: the timers are gone.
        context::with(|context| unsafe { context.set_service(None) });
        if self.was_blocked {
            let _ = posix_timer::set_blocked(self.signal, true);
        }
    }
}

extern "C" fn on_signal(_: libc::c_int) {
    // SAFETY: the address of this thread's `errno`, valid as long as the thread.
    let errno = unsafe { libc::__errno_location() };
    // SAFETY: as above.
    let before = unsafe { *errno };
    context::with(context::Context::on_signal);
    // SAFETY: as above.
    unsafe { *errno = before };
}
