//! The handling of SIGBUS, which the kernel sends if the memory under a mapping is gone, or if nothing answers
//! at an address.
//!
//! The kernel has one handler for a process. This handler calls each registered [`Repair`] in turn.
//! A bus error that none of them handles goes to the previous handler of SIGBUS.
//! It is async-signal-safe: it reads a static table and calls functions, and at the end `sigaction` and
//! `raise`.

use core::ffi::{c_int, c_void};
use core::mem::{self, MaybeUninit};
use core::ptr;
use core::sync::atomic::{AtomicPtr, Ordering};
use std::io;
use std::sync::OnceLock;

use super::fatal_signal;

/// The number of functions that may register: the crates of Condor that access memory, and some more.
const REPAIRS: usize = 8;

/// A function that handles bus errors, for [`on_bus_error`]. It returns true if it has handled the given error: then
/// the access is repeated, or the program goes on at another instruction. If it returns false, the next handler is
/// asked.
///
/// The function runs in a signal handler, which may interrupt any code: it may only call async-signal-safe functions.
pub type Repair = fn(&mut MemoryFault<'_>) -> bool;

/// Each is null or a [`Repair`].
static TABLE: [AtomicPtr<()>; REPAIRS] = [const { AtomicPtr::new(ptr::null_mut()) }; REPAIRS];

/// Whether the handler is in place.
static INSTALLED: OnceLock<Result<(), i32>> = OnceLock::new();

/// The previous handling of SIGBUS.
static PREVIOUS: OnceLock<libc::sigaction> = OnceLock::new();

type Handler = extern "C" fn(c_int, *mut libc::siginfo_t, *mut c_void);

/// A bus error (SIGBUS) that the kernel reports because an access to memory has failed. A
/// [`Repair`] gets it.
#[derive(Debug)]
pub struct MemoryFault<'c> {
    address: usize,
    #[cfg_attr(
        not(any(
            target_arch = "x86_64",
            target_arch = "aarch64",
            target_arch = "riscv64"
        )),
        allow(dead_code)
    )]
    interrupted: &'c mut libc::ucontext_t,
}

impl MemoryFault<'_> {
    /// Returns the address that the program could not access.
    #[must_use]
    pub fn address(&self) -> usize {
        self.address
    }
}

/// The instruction at which the program is, and at which it goes on when the handler returns.
#[cfg(any(
    target_arch = "x86_64",
    target_arch = "aarch64",
    target_arch = "riscv64"
))]
impl MemoryFault<'_> {
    /// Returns the address of the instruction whose access failed.
    #[must_use]
    pub fn instruction(&self) -> usize {
        usize::try_from(*counter(&self.interrupted.uc_mcontext)).unwrap_or_default()
    }

    /// Lets the program go on at the address `instruction`. Returns `false` and changes nothing if
    /// `instruction` does not fit the program counter.
    ///
    /// # Safety
    /// The code at `instruction` must work with the registers and the stack as the failed access
    /// left them.
    pub unsafe fn resume_at(&mut self, instruction: usize) -> bool {
        let address = instruction.try_into();
        if let Ok(address) = address {
            *counter_mut(&mut self.interrupted.uc_mcontext) = address;
        }
        address.is_ok()
    }
}

/// The program counter.
macro_rules! counter {
    ($arch:literal, $kind:ty, $($field:tt)+) => {
        #[cfg(target_arch = $arch)]
        fn counter(context: &libc::mcontext_t) -> &$kind {
            &context.$($field)+
        }

        #[cfg(target_arch = $arch)]
        fn counter_mut(context: &mut libc::mcontext_t) -> &mut $kind {
            &mut context.$($field)+
        }
    };
}

counter!("x86_64", libc::greg_t, gregs[libc::REG_RIP as usize]);
counter!("aarch64", libc::c_ulonglong, pc);
counter!("riscv64", libc::c_ulong, __gregs[libc::REG_PC as usize]);

/// Registers `repair`, which is called at each bus error from now on, until the process ends. Registering the
/// same function again has no effect.
///
/// A program that installs its own handler for SIGBUS later must pass other bus errors on to the
/// previous handler. The kernel kills a thread that blocks SIGBUS at a bus error.
///
/// # Errors
/// Returns the operating system's error if it refuses the handler; an error of kind
/// [`Other`](io::ErrorKind::Other) if eight other functions are registered already.
pub fn on_bus_error(repair: Repair) -> io::Result<()> {
    let repair = repair as *mut ();
    let free = TABLE.iter().find(|place| {
        // Release: pairs with the Acquire load in the handler, which then finds what was made before.
        let taken =
            place.compare_exchange(ptr::null_mut(), repair, Ordering::AcqRel, Ordering::Acquire);
        taken.is_ok() || taken == Err(repair)
    });
    if free.is_none() {
        return Err(io::Error::other("all functions for bus errors are in use"));
    }
    let installed = INSTALLED.get_or_init(|| {
        // The old action is stored first: from the moment the handler is in place, it may run.
        let previous = PREVIOUS.get_or_init(previous_action);
        let handler: Handler = handle;
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
    // SAFETY: `action` is either the default or `handle`, which is async-signal-safe and has the
    // signature that SA_SIGINFO asks for.
    if unsafe { libc::sigaction(libc::SIGBUS, action, ptr::null_mut()) } == 0 {
        Ok(())
    } else {
        let code = io::Error::last_os_error().raw_os_error();
        Err(code.unwrap_or(libc::EINVAL))
    }
}

extern "C" fn handle(signal: c_int, info: *mut libc::siginfo_t, context: *mut c_void) {
    // SAFETY: the kernel passes a valid `siginfo_t` to a handler with SA_SIGINFO.
    let code = unsafe { (*info).si_code };
    // A signal that a program sent has a code of zero or less, and no address.
    let sent = code <= 0;
    // SAFETY: the kernel passes the interrupted context to a handler with SA_SIGINFO, and nobody else
    // uses it meanwhile.
    let interrupted = unsafe { context.cast::<libc::ucontext_t>().as_mut() };
    if let (false, Some(interrupted)) = (sent, interrupted) {
        let mut error = MemoryFault {
            // SAFETY: as above; a SIGBUS of the kernel carries an address.
            address: unsafe { (*info).si_addr() } as usize,
            interrupted,
        };
        // Acquire: pairs with the Release in `on_bus_error`.
        let registered = TABLE.iter().map(|place| place.load(Ordering::Acquire));
        for repair in registered.take_while(|repair| !repair.is_null()) {
            // SAFETY: `on_bus_error` alone stores here, and only functions of this type.
            let repair: Repair = unsafe { mem::transmute(repair) };
            if repair(&mut error) {
                return;
            }
        }
    }
    pass_on(sent, signal, info, context);
}

/// Does what would have been done without this handler.
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
    let _ = fatal_signal::set_action(libc::SIGBUS, libc::SIG_DFL, 0);
}

/// Ends the program by this very signal: a fault repeats itself once the handler is gone.
fn die(sent: bool) {
    set_default();
    if sent {
        // SAFETY: `raise` is async-signal-safe.
        unsafe { libc::raise(libc::SIGBUS) };
    }
}
