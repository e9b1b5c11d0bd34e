//! A raw prototype of servo loops on one stack: what an implementation with signals can reach.
//!
//! One-shot timers with absolute times interrupt the background with a signal, and the loops run
//! in its handler, the fastest first; a faster one interrupts a slower one by nesting. The
//! fastest loop runs before anything else is done, since nothing may interrupt it.

use std::io;
use std::mem;
use std::ptr;
use std::sync::OnceLock;
use std::sync::atomic::{AtomicBool, AtomicU64, AtomicUsize, Ordering, compiler_fence};

use super::turn::{Loop, Turn};
use crate::Result;

/// Ways to arm and to mask.
#[derive(Clone, Copy, Debug)]
struct Variant {
    /// As many timers, each armed so many events ahead.
    ///
    /// With one, arming makes its event the kernel's next, so that the clock device is programmed
    /// twice for each release: once more when the interrupt has found what comes next. With two,
    /// the interrupt finds the next event armed, and the handler only adds to the queue.
    timers: usize,
    /// The handler blocks its signal, and allows it for slower loops by system calls. Otherwise
    /// the signal is never blocked and a flag keeps the scheduler from being entered twice.
    masks: bool,
    /// The timer is armed before the fastest loop runs.
    arms_first: bool,
}

/// One timer, never masked.
pub(super) fn run_one_timer(turn: &'static Turn) -> Result<()> {
    run(
        turn,
        Variant {
            timers: 1,
            masks: false,
            arms_first: false,
        },
    )
}

/// Two timers, never masked.
pub(super) fn run_two_timers(turn: &'static Turn) -> Result<()> {
    run(
        turn,
        Variant {
            timers: 2,
            masks: false,
            arms_first: false,
        },
    )
}

/// One timer, armed before the fastest loop runs.
pub(super) fn run_arming_first(turn: &'static Turn) -> Result<()> {
    run(
        turn,
        Variant {
            timers: 1,
            masks: false,
            arms_first: true,
        },
    )
}

/// Two timers; the signal is blocked but for slower loops.
pub(super) fn run_masking(turn: &'static Turn) -> Result<()> {
    run(
        turn,
        Variant {
            timers: 2,
            masks: true,
            arms_first: false,
        },
    )
}

fn run(turn: &'static Turn, variant: Variant) -> Result<()> {
    let fastest = turn.loops.first().ok_or("no loops")?;
    let servo = |servo_loop: &'static Loop| Servo {
        body: servo_loop,
        every: servo_loop.period_ns / fastest.period_ns,
        released: AtomicU64::new(0),
        ran: AtomicU64::new(0),
    };
    let timers = (0..variant.timers).map(|_| Timer::new());
    let scheduler = Scheduler {
        servos: turn.loops.iter().map(servo).collect(),
        timers: timers.collect::<Result<_>>()?,
        variant,
        start_ns: turn.start_ns,
        period_ns: fastest.period_ns,
        event: AtomicU64::new(0),
        level: AtomicUsize::new(turn.loops.len()),
        inside: AtomicBool::new(false),
        missed: AtomicU64::new(0),
    };
    let scheduler = SCHEDULER.get_or_init(|| scheduler);
    handle_signals(variant)?;
    for event in 0..variant.timers as u64 {
        scheduler.arm(event);
    }
    turn.background()
}

/// What the handler works on.
static SCHEDULER: OnceLock<Scheduler> = OnceLock::new();

extern "C" fn on_signal(_: libc::c_int) {
    if let Some(scheduler) = SCHEDULER.get() {
        scheduler.on_event();
    }
}

/// A loop in the process table.
struct Servo {
    body: &'static Loop,
    /// It is released by one of so many events.
    every: u64,
    released: AtomicU64,
    ran: AtomicU64,
}

impl Servo {
    fn is_pending(&self) -> bool {
        self.ran.load(Ordering::Relaxed) != self.released.load(Ordering::Relaxed)
    }

    fn run(&self) {
        let release = self.ran.load(Ordering::Relaxed);
        self.body.run(release);
        self.ran.store(release + 1, Ordering::Relaxed);
    }
}

/// One thread with its handlers: everything is relaxed, and kept in order by compiler fences.
struct Scheduler {
    servos: Vec<Servo>,
    timers: Vec<Timer>,
    variant: Variant,
    start_ns: u64,
    /// The rates of the sets divide the fastest: an event is a release of the fastest loop.
    period_ns: u64,
    /// The next event.
    event: AtomicU64,
    /// The loop that runs; past the last one, the background.
    level: AtomicUsize,
    /// Whether a handler is in the scheduler.
    inside: AtomicBool,
    /// Events that found it there.
    missed: AtomicU64,
}

impl Scheduler {
    fn on_event(&self) {
        if self.inside.load(Ordering::Relaxed) {
            let missed = self.missed.load(Ordering::Relaxed);
            self.missed.store(missed + 1, Ordering::Relaxed);
            return;
        }
        self.enter();
        self.dispatch();
        self.leave();
    }

    fn enter(&self) {
        self.inside.store(true, Ordering::Relaxed);
        compiler_fence(Ordering::SeqCst);
    }

    /// Leaves the scheduler, but for events that were missed inside.
    fn leave(&self) {
        loop {
            compiler_fence(Ordering::SeqCst);
            self.inside.store(false, Ordering::Relaxed);
            compiler_fence(Ordering::SeqCst);
            if self.missed.load(Ordering::Relaxed) == 0 {
                return;
            }
            self.enter();
            // Nobody else counts while the flag is set, but a handler in between: it adds one.
            for _ in 0..self.missed.swap(0, Ordering::Relaxed) {
                self.dispatch();
            }
        }
    }

    /// Takes one event, and runs what is faster than what was interrupted.
    fn dispatch(&self) {
        let event = self.event.load(Ordering::Relaxed);
        self.event.store(event + 1, Ordering::Relaxed);
        for servo in &self.servos {
            if event.is_multiple_of(servo.every) {
                let released = servo.released.load(Ordering::Relaxed);
                servo.released.store(released + 1, Ordering::Relaxed);
            }
        }
        let outer = self.level.load(Ordering::Relaxed);
        if self.variant.arms_first {
            self.arm(event + self.timers.len() as u64);
        }
        // Nothing interrupts the fastest: the scheduler need not be left for it.
        if outer > 0 {
            while self.servos[0].is_pending() {
                self.servos[0].run();
            }
        }
        if !self.variant.arms_first {
            self.arm(event + self.timers.len() as u64);
        }
        for (level, servo) in self.servos.iter().enumerate().take(outer).skip(1) {
            while servo.is_pending() {
                self.level.store(level, Ordering::Relaxed);
                if self.variant.masks {
                    change_mask(libc::SIG_UNBLOCK);
                }
                self.leave();
                servo.run();
                self.enter();
                if self.variant.masks {
                    change_mask(libc::SIG_BLOCK);
                }
            }
        }
        self.level.store(outer, Ordering::Relaxed);
    }

    /// Lets a timer tell of an event; at once if it has passed.
    fn arm(&self, event: u64) {
        let index = event as usize % self.timers.len();
        self.timers[index].arm(self.start_ns + event * self.period_ns);
    }
}

/// A timer that signals the thread that made it; it lives as long as the process.
struct Timer(libc::timer_t);

// SAFETY: the handle is a number of the kernel's that is valid in the whole process.
unsafe impl Sync for Timer {}
// SAFETY: as above.
unsafe impl Send for Timer {}

impl Timer {
    fn new() -> Result<Self> {
        // SAFETY: all-zero bytes are a valid value of this structure of integers and pointers.
        let mut event: libc::sigevent = unsafe { mem::zeroed() };
        event.sigev_notify = libc::SIGEV_THREAD_ID;
        event.sigev_signo = libc::SIGRTMIN();
        // SAFETY: has no preconditions.
        event.sigev_notify_thread_id = unsafe { libc::gettid() };
        let mut timer = ptr::null_mut();
        // SAFETY: both structures outlive the call.
        let made =
            unsafe { libc::timer_create(libc::CLOCK_MONOTONIC, &raw mut event, &raw mut timer) };
        check(made)?;
        Ok(Self(timer))
    }

    fn arm(&self, due_ns: u64) {
        let timespec = |ns: u64| libc::timespec {
            tv_sec: (ns / 1_000_000_000).cast_signed(),
            tv_nsec: (ns % 1_000_000_000).cast_signed(),
        };
        let setting = libc::itimerspec {
            it_interval: timespec(0),
            it_value: timespec(due_ns),
        };
        let no_old = ptr::null_mut();
        // SAFETY: the timer was made by `new` and is never deleted; the setting outlives the
        // call, which is one of those that a handler may make. It cannot fail with these.
        unsafe { libc::timer_settime(self.0, libc::TIMER_ABSTIME, &raw const setting, no_old) };
    }
}

fn handle_signals(variant: Variant) -> Result<()> {
    // SAFETY: all-zero bytes are a valid value: an empty mask and no flags.
    let mut action: libc::sigaction = unsafe { mem::zeroed() };
    action.sa_sigaction = on_signal as extern "C" fn(libc::c_int) as usize;
    action.sa_flags = libc::SA_RESTART | if variant.masks { 0 } else { libc::SA_NODEFER };
    // SAFETY: the handler is of the type that goes with these flags, and calls nothing that a
    // handler may not call: atomics, the clock, `timer_settime` and `pthread_sigmask`.
    check(unsafe { libc::sigaction(libc::SIGRTMIN(), &raw const action, ptr::null_mut()) })
}

/// Blocks or unblocks the timers' signal for the calling thread.
fn change_mask(how: libc::c_int) {
    // SAFETY: all-zero bytes are a valid value, and `sigemptyset` makes it the empty set.
    let mut set: libc::sigset_t = unsafe { mem::zeroed() };
    // SAFETY: the set outlives the calls, which handlers may make; they cannot fail with these.
    unsafe {
        libc::sigemptyset(&raw mut set);
        libc::sigaddset(&raw mut set, libc::SIGRTMIN());
        libc::pthread_sigmask(how, &raw const set, ptr::null_mut());
    }
}

fn check(result: libc::c_int) -> Result<()> {
    if result == 0 {
        Ok(())
    } else {
        Err(io::Error::last_os_error().into())
    }
}
