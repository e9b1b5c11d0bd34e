//! Turns a bus error of a guarded access into an error of that access.
//!
//! The handler compares the interrupted instruction with those of [`guarded`](crate::guarded)
//! and lets the access return with an error. Everything else goes to whoever handled SIGBUS before. It
//! touches nothing but the interrupted context, and is async-signal-safe.

use core::ffi::{c_int, c_void};
use core::mem::{self, MaybeUninit};
use core::ptr;
use std::io;
use std::sync::OnceLock;

use crate::guarded::resume;

type Handler = extern "C" fn(c_int, *mut libc::siginfo_t, *mut c_void);

/// What was done on SIGBUS before this module came.
static PREVIOUS: OnceLock<libc::sigaction> = OnceLock::new();

/// Puts the handler in place, once for the process.
pub(super) fn install() -> io::Result<()> {
    static INSTALLED: OnceLock<Result<(), i32>> = OnceLock::new();
    let installed = INSTALLED.get_or_init(|| {
        // The old action is stored first: from the moment the handler is in place, it may run.
        let previous = PREVIOUS.get_or_init(previous_action);
        let handler: Handler = on_bus_error;
        // Mask and nesting are those that the previous handler asked for, since it may be called
        // from here; this one does not care.
        let action = libc::sigaction {
            sa_sigaction: handler as usize,
            sa_flags: libc::SA_SIGINFO
                | libc::SA_ONSTACK
                | (previous.sa_flags & (libc::SA_NODEFER | libc::SA_RESTART)),
            ..*previous
        };
        set_action(&action)
    });
    installed.map_err(io::Error::from_raw_os_error)
}

fn previous_action() -> libc::sigaction {
    let mut action = MaybeUninit::<libc::sigaction>::zeroed();
    // SAFETY: a null action only asks, and `action` is large enough for the answer.
    let _ = unsafe { libc::sigaction(libc::SIGBUS, ptr::null(), action.as_mut_ptr()) };
    // SAFETY: all-zero is a valid `sigaction` (the default one); the kernel wrote another, if any.
    unsafe { action.assume_init() }
}

fn set_action(action: &libc::sigaction) -> Result<(), i32> {
    // SAFETY: `action` is either the default or `on_bus_error`, which is async-signal-safe and has
    // the signature that SA_SIGINFO asks for.
    if unsafe { libc::sigaction(libc::SIGBUS, action, ptr::null_mut()) } == 0 {
        Ok(())
    } else {
        let code = io::Error::last_os_error().raw_os_error();
        Err(code.unwrap_or(libc::EINVAL))
    }
}

/// Where the program is when the handler returns.
#[cfg(target_arch = "x86_64")]
fn instruction(context: &mut libc::ucontext_t) -> &mut libc::greg_t {
    &mut context.uc_mcontext.gregs[libc::REG_RIP as usize]
}

/// Where the program is when the handler returns.
#[cfg(target_arch = "aarch64")]
fn instruction(context: &mut libc::ucontext_t) -> &mut libc::c_ulonglong {
    &mut context.uc_mcontext.pc
}

/// Where the program is when the handler returns.
#[cfg(target_arch = "riscv64")]
fn instruction(context: &mut libc::ucontext_t) -> &mut libc::c_ulong {
    &mut context.uc_mcontext.__gregs[libc::REG_PC as usize]
}

extern "C" fn on_bus_error(signal: c_int, info: *mut libc::siginfo_t, context: *mut c_void) {
    // SAFETY: the kernel gives a valid `siginfo_t` to a handler with SA_SIGINFO.
    let code = unsafe { (*info).si_code };
    // A signal that a program sent has a code of zero or less, and interrupts any instruction.
    let sent = code <= 0;
    // SAFETY: the kernel gives the interrupted context to a handler with SA_SIGINFO, and nobody else
    // uses it meanwhile.
    let interrupted = unsafe { context.cast::<libc::ucontext_t>().as_mut() };
    if let (false, Some(interrupted)) = (sent, interrupted) {
        let instruction = instruction(interrupted);
        let address = usize::try_from(*instruction).unwrap_or_default();
        if let Some(Ok(end)) = resume(address).map(TryFrom::try_from) {
            *instruction = end;
            return;
        }
    }
    pass_on(sent, signal, info, context);
}

/// Does what would have been done without this module.
fn pass_on(sent: bool, signal: c_int, info: *mut libc::siginfo_t, context: *mut c_void) {
    let Some(previous) = PREVIOUS.get() else {
        return die(sent);
    };
    match previous.sa_sigaction {
        libc::SIG_IGN if sent => {}
        // The kernel does not let a program ignore its own bus error.
        libc::SIG_DFL | libc::SIG_IGN => die(sent),
        handler => {
            if previous.sa_flags & libc::SA_RESETHAND != 0 {
                set_default();
            }
            if previous.sa_flags & libc::SA_SIGINFO != 0 {
                // SAFETY: the program installed this address as a handler with SA_SIGINFO.
                let handler: Handler = unsafe { mem::transmute(handler) };
                handler(signal, info, context);
            } else {
                // SAFETY: the program installed this address as a handler without SA_SIGINFO.
                let handler: extern "C" fn(c_int) = unsafe { mem::transmute(handler) };
                handler(signal);
            }
        }
    }
}

fn set_default() {
    let mut action = MaybeUninit::<libc::sigaction>::zeroed();
    // SAFETY: all-zero is the default action with an empty mask.
    let action = unsafe { action.assume_init_mut() };
    action.sa_sigaction = libc::SIG_DFL;
    let _ = set_action(action);
}

/// Ends the program by this very signal: a fault repeats itself once the handler is gone.
fn die(sent: bool) {
    set_default();
    if sent {
        // SAFETY: `raise` is async-signal-safe.
        unsafe { libc::raise(libc::SIGBUS) };
    }
}
