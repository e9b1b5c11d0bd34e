//! Programs that stop at a fatal error as they are, so that a debugger can look at them.

use core::ffi::{c_int, c_void};
use core::mem::MaybeUninit;
use core::ptr;
use core::sync::atomic::{AtomicBool, Ordering};
use std::boxed::Box;
use std::{io, panic};

/// The signals of errors that end a program.
const FATAL: [c_int; 5] = [
    libc::SIGSEGV,
    libc::SIGBUS,
    libc::SIGILL,
    libc::SIGFPE,
    libc::SIGABRT,
];

/// Stops the whole process with [`hold_for_debugger`] at each panic, and at each of the signals SIGSEGV, SIGBUS, SIGILL,
/// SIGFPE and SIGABRT, from now on until the process ends. A process that goes on after such a signal ends by it, as it
/// would have done at once; after a panic it goes on with the hook for panics that was there before. Further calls have
/// no effect.
///
/// Call it before [`on_bus_error`](super::on_bus_error), whose functions are then asked first. The handler of std for
/// these signals, which says that a stack has overflowed, is not called any more.
///
/// # Errors
/// Returns the operating system's error if it refuses a handler.
pub fn hold_at_fatal_errors() -> io::Result<()> {
    static INSTALLED: AtomicBool = AtomicBool::new(false);
    if INSTALLED.swap(true, Ordering::Relaxed) {
        return Ok(());
    }
    for signal in FATAL {
        let handler: extern "C" fn(c_int, *mut libc::siginfo_t, *mut c_void) = handle;
        set_action(
            signal,
            handler as usize,
            libc::SA_SIGINFO | libc::SA_ONSTACK,
        )?;
    }
    let before = panic::take_hook();
    panic::set_hook(Box::new(move |panic| {
        before(panic);
        hold_for_debugger();
    }));
    Ok(())
}

/// Stops the whole process until it is continued with SIGCONT. A debugger that has attached to it must send this signal,
/// too: otherwise the kernel stops the process again when the debugger detaches.
///
/// The process stops itself by SIGTSTP, which its parent can tell from the SIGSTOP of somebody else. In an orphaned process
/// group, whose members' parents are all in the same group or in other sessions, the kernel ignores this signal, and the
/// function returns at once.
///
/// It is async-signal-safe.
pub fn hold_for_debugger() {
    // A program can inherit that it ignores the signal.
    let _ = set_action(libc::SIGTSTP, libc::SIG_DFL, 0);
    let mut signals = MaybeUninit::<libc::sigset_t>::zeroed();
    // SAFETY: the set is this function's; the three functions are async-signal-safe, and a signal whose action is the
    // default runs no code.
    unsafe {
        libc::sigemptyset(signals.as_mut_ptr());
        libc::sigaddset(signals.as_mut_ptr(), libc::SIGTSTP);
        libc::pthread_sigmask(libc::SIG_UNBLOCK, signals.as_ptr(), ptr::null_mut());
        libc::raise(libc::SIGTSTP);
    }
}

/// Writes `line` and the end of a line to standard error, and raises SIGFPE, which ends the process unless somebody handles
/// it. It is async-signal-safe.
pub fn end_by_arithmetic(line: &str) {
    write(line.as_bytes());
    write(b"\n");
    // SAFETY: `raise` is async-signal-safe.
    unsafe { libc::raise(libc::SIGFPE) };
}

/// Writes to standard error, also in a signal handler.
fn write(bytes: &[u8]) {
    // SAFETY: `write` is async-signal-safe, and reads the bytes alone.
    unsafe { libc::write(libc::STDERR_FILENO, bytes.as_ptr().cast(), bytes.len()) };
}

/// Sets the action of a signal, which must be a constant of libc or a handler as `flags` says.
pub(super) fn set_action(signal: c_int, handler: usize, flags: c_int) -> io::Result<()> {
    let mut action = MaybeUninit::<libc::sigaction>::zeroed();
    // SAFETY: all-zero is the default action with an empty mask.
    let action = unsafe { action.assume_init_mut() };
    action.sa_sigaction = handler;
    action.sa_flags = flags;
    // SAFETY: `handler` is either the default or `handle`, which is async-signal-safe and has the signature that
    // SA_SIGINFO asks for.
    if unsafe { libc::sigaction(signal, action, ptr::null_mut()) } == 0 {
        Ok(())
    } else {
        Err(io::Error::last_os_error())
    }
}

extern "C" fn handle(signal: c_int, info: *mut libc::siginfo_t, _: *mut c_void) {
    write(match signal {
        libc::SIGSEGV => b"fatal error: SIGSEGV, a memory access that is not allowed\n",
        libc::SIGBUS => b"fatal error: SIGBUS, memory that is not there\n",
        libc::SIGILL => b"fatal error: SIGILL, an instruction that does not exist\n",
        libc::SIGFPE => b"fatal error: SIGFPE, arithmetic\n",
        _ => b"fatal error: SIGABRT, the program has ended itself\n",
    });
    hold_for_debugger();
    // The kernel refuses numbers that are no signal, and this is one.
    let _ = set_action(signal, libc::SIG_DFL, 0);
    // SAFETY: the kernel passes a valid `siginfo_t` to a handler with SA_SIGINFO.
    if unsafe { (*info).si_code } <= 0 {
        // A program has sent it. An error of this program repeats itself, since the handler is gone.
        // SAFETY: `raise` is async-signal-safe.
        unsafe { libc::raise(signal) };
    }
}
