//! [`PosixTimer`], and the signal by which it tells.

use core::mem;
use core::ptr;
use std::io;
use std::sync::{Mutex, PoisonError};

use crate::error::ConnectError;

/// A timer that sends its signal to the thread that made it.
#[derive(Debug)]
pub(super) struct PosixTimer(libc::timer_t);

// SAFETY: the handle is a number that is valid in the whole process.
unsafe impl Send for PosixTimer {}

impl PosixTimer {
    pub(super) fn new(signal: i32) -> Result<Self, ConnectError> {
        // SAFETY: all-zero bytes are a valid value of this structure of integers and pointers.
        let mut event: libc::sigevent = unsafe { mem::zeroed() };
        event.sigev_notify = libc::SIGEV_THREAD_ID;
        event.sigev_signo = signal;
        event.sigev_notify_thread_id = rustix::thread::gettid().as_raw_nonzero().get();
        let mut timer = ptr::null_mut();
        // SAFETY: both structures outlive the call.
        check(unsafe {
            libc::timer_create(libc::CLOCK_MONOTONIC, &raw mut event, &raw mut timer)
        })?;
        Ok(Self(timer))
    }

    /// One signal at `at`, an instant of `CLOCK_MONOTONIC` in nanoseconds, or at once if it has
    /// passed; none any more if it is 0. Async-signal-safe.
    #[inline]
    pub(super) fn set(&self, at: u64) {
        let setting = libc::itimerspec {
            it_interval: timespec(0),
            it_value: timespec(at),
        };
        // SAFETY: the timer is deleted in `drop` alone; the setting outlives the call. It cannot
        // fail with these.
        unsafe {
            libc::timer_settime(
                self.0,
                libc::TIMER_ABSTIME,
                &raw const setting,
                ptr::null_mut(),
            )
        };
    }
}

// Both parts fit on every target: a time since the machine started, and less than 10^9.
#[allow(clippy::cast_possible_wrap)]
fn timespec(ns: u64) -> libc::timespec {
    // SAFETY: all-zero bytes are a valid value; some targets have padding that cannot be named.
    let mut time: libc::timespec = unsafe { mem::zeroed() };
    time.tv_sec = (ns / 1_000_000_000) as libc::time_t;
    time.tv_nsec = (ns % 1_000_000_000) as libc::c_long;
    time
}

impl Drop for PosixTimer {
    fn drop(&mut self) {
        // SAFETY: the timer was made by `new`, and nobody has the handle any more.
        unsafe { libc::timer_delete(self.0) };
    }
}

/// Has `handler` called on `signal`, for good: a signal that is on its way when a timer is deleted
/// must not find the default action, which ends the program.
pub(super) fn install(signal: i32, handler: extern "C" fn(i32)) -> Result<(), ConnectError> {
    static ONE_AT_A_TIME: Mutex<()> = Mutex::new(());
    let _one = ONE_AT_A_TIME.lock().unwrap_or_else(PoisonError::into_inner);
    // SAFETY: all-zero bytes are a valid value: the default action, an empty mask and no flags.
    let mut action: libc::sigaction = unsafe { mem::zeroed() };
    // SAFETY: a null action only asks; `action` outlives the call.
    check(unsafe { libc::sigaction(signal, ptr::null(), &raw mut action) })?;
    let handler = handler as usize;
    if action.sa_sigaction == handler {
        return Ok(());
    }
    if action.sa_sigaction != libc::SIG_DFL {
        return Err(ConnectError::SignalTaken { signal });
    }
    action.sa_sigaction = handler;
    // Not blocked in its handler: a word of the thread does that, without a system call.
    action.sa_flags = libc::SA_RESTART | libc::SA_NODEFER;
    // SAFETY: the handler has the type that goes with these flags, and does nothing but what
    // `SignalPlatform::new` was promised that handlers may do.
    check(unsafe { libc::sigaction(signal, &raw const action, ptr::null_mut()) })?;
    Ok(())
}

/// Blocks or unblocks a signal for the calling thread; says whether it was blocked.
pub(super) fn set_blocked(signal: i32, blocked: bool) -> Result<bool, ConnectError> {
    let how = if blocked {
        libc::SIG_BLOCK
    } else {
        libc::SIG_UNBLOCK
    };
    // SAFETY: all-zero bytes are a valid value of these.
    let (mut set, mut former) = unsafe { mem::zeroed::<(libc::sigset_t, libc::sigset_t)>() };
    // SAFETY: the sets outlive the calls.
    unsafe {
        libc::sigemptyset(&raw mut set);
        libc::sigaddset(&raw mut set, signal);
        match libc::pthread_sigmask(how, &raw const set, &raw mut former) {
            0 => Ok(libc::sigismember(&raw const former, signal) == 1),
            os_error => Err(ConnectError::Timer { os_error }),
        }
    }
}

fn check(result: libc::c_int) -> Result<(), ConnectError> {
    if result == 0 {
        Ok(())
    } else {
        Err(ConnectError::Timer {
            os_error: io::Error::last_os_error().raw_os_error().unwrap_or(0),
        })
    }
}
