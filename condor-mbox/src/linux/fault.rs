//! Turns a bus error inside a window into a flag that the access reads afterwards.
//!
//! Memory behind a mapping can vanish: somebody truncates the file, a device is unbound. The
//! kernel then answers an access with SIGBUS. The handler of this module looks the address up in
//! a table of mappings; if it finds it, it marks the mapping as lost and puts a page of zeros
//! under it, so that the access completes, with a value that the window throws away. A bus error
//! anywhere else goes to whoever handled SIGBUS before.
//!
//! Everything the handler does is async-signal-safe: loads and stores of a static table, `mmap`,
//! `sigaction`, `raise`.

use core::ffi::{c_int, c_void};
use core::mem::{self, MaybeUninit};
use core::ptr;
use core::sync::atomic::{AtomicBool, AtomicUsize, Ordering, fence};
use std::sync::OnceLock;

use rustix::io::Errno;
use rustix::mm::{MapFlags, ProtFlags, mmap_anonymous};

/// How many mappings one process may have: 32 numbers with 64 objects each, twice over.
pub(super) const SLOTS: usize = 4096;

static TABLE: [Slot; SLOTS] = [const { Slot::new() }; SLOTS];

/// What was done on SIGBUS before this module came.
static PREVIOUS: OnceLock<libc::sigaction> = OnceLock::new();

/// One mapping, as the handler sees it.
///
/// `version` makes base and length one value: it is odd while they change. Threads that fault
/// elsewhere read slots of mappings that come and go; a base of one mapping with the length of
/// another could claim an address that belongs to neither.
struct Slot {
    taken: AtomicBool,
    version: AtomicUsize,
    base: AtomicUsize,
    len: AtomicUsize,
    lost: AtomicBool,
}

impl Slot {
    const fn new() -> Self {
        Self {
            taken: AtomicBool::new(false),
            version: AtomicUsize::new(0),
            base: AtomicUsize::new(0),
            len: AtomicUsize::new(0),
            lost: AtomicBool::new(false),
        }
    }

    /// Called by the one who took the slot, so there is one writer at a time.
    fn describe(&self, base: usize, len: usize) {
        let version = self.version.load(Ordering::Relaxed);
        self.version
            .store(version.wrapping_add(1), Ordering::Relaxed);
        // Pairs with the Acquire fence in `covering`: who read a new base or length there sees
        // the odd version, or a later one.
        fence(Ordering::Release);
        self.base.store(base, Ordering::Relaxed);
        self.len.store(len, Ordering::Relaxed);
        // Pairs with the Acquire load in `covering`: who reads this version sees both words.
        self.version
            .store(version.wrapping_add(2), Ordering::Release);
    }

    /// The base and length, if `address` lies inside.
    ///
    /// A slot that changes meanwhile is passed over. It cannot be the one that is looked for: a
    /// window that is being accessed keeps its slot as it is.
    fn covering(&self, address: usize) -> Option<(usize, usize)> {
        // Pairs with the Release store at the end of `describe`.
        let before = self.version.load(Ordering::Acquire);
        let base = self.base.load(Ordering::Relaxed);
        let len = self.len.load(Ordering::Relaxed);
        // Pairs with the Release fence in `describe`.
        fence(Ordering::Acquire);
        let after = self.version.load(Ordering::Relaxed);
        let steady = before == after && before.is_multiple_of(2);
        (steady && address.wrapping_sub(base) < len).then_some((base, len))
    }
}

/// A mapping that is known to the handler, until this is dropped.
#[derive(Debug)]
pub(super) struct Guarded {
    index: usize,
}

/// Why a mapping could not be guarded.
pub(super) enum GuardError {
    /// All slots are in use.
    Full,
    /// The handler could not be installed.
    Install(Errno),
}

impl Guarded {
    /// Lets the handler care for the `len` bytes at `base`, which are mapped as one mapping and
    /// stay so until this is dropped.
    pub(super) fn new(base: usize, len: usize) -> Result<Self, GuardError> {
        install().map_err(GuardError::Install)?;
        // Acquire pairs with the Release store in `drop`: the slot's former holder is done.
        let free = |slot: &Slot| !slot.taken.swap(true, Ordering::Acquire);
        let index = TABLE.iter().position(free).ok_or(GuardError::Full)?;
        let slot = &TABLE[index];
        slot.lost.store(false, Ordering::Relaxed);
        slot.describe(base, len);
        Ok(Self { index })
    }

    /// The flag that the handler sets when the memory is gone.
    pub(super) fn lost(&self) -> &'static AtomicBool {
        &TABLE[self.index].lost
    }
}

impl Drop for Guarded {
    fn drop(&mut self) {
        let slot = &TABLE[self.index];
        slot.describe(0, 0);
        // Pairs with the Acquire swap in `new`.
        slot.taken.store(false, Ordering::Release);
    }
}

/// Puts the handler in place, once for the process.
fn install() -> Result<(), Errno> {
    static INSTALLED: OnceLock<Result<(), Errno>> = OnceLock::new();
    *INSTALLED.get_or_init(|| {
        // The old action is stored first: from the moment the handler is in place, it may run.
        let previous = PREVIOUS.get_or_init(previous_action);
        let handler: extern "C" fn(c_int, *mut libc::siginfo_t, *mut c_void) = on_bus_error;
        // Mask and nesting are those that the previous handler asked for, since it may be
        // called from here; this one does not care.
        let action = libc::sigaction {
            sa_sigaction: handler as usize,
            sa_flags: libc::SA_SIGINFO
                | libc::SA_ONSTACK
                | (previous.sa_flags & (libc::SA_NODEFER | libc::SA_RESTART)),
            ..*previous
        };
        set_action(&action)
    })
}

fn previous_action() -> libc::sigaction {
    let mut action = MaybeUninit::<libc::sigaction>::zeroed();
    // SAFETY: a null action only asks, and `action` is large enough for the answer.
    let _ = unsafe { libc::sigaction(libc::SIGBUS, ptr::null(), action.as_mut_ptr()) };
    // SAFETY: all-zero is a valid `sigaction` (the default one); the kernel wrote another, if any.
    unsafe { action.assume_init() }
}

fn set_action(action: &libc::sigaction) -> Result<(), Errno> {
    // SAFETY: `action` is either what the system gave us, the default, or `on_bus_error`, which
    // is async-signal-safe and has the signature that SA_SIGINFO asks for.
    if unsafe { libc::sigaction(libc::SIGBUS, action, ptr::null_mut()) } == 0 {
        Ok(())
    } else {
        let code = std::io::Error::last_os_error().raw_os_error();
        Err(Errno::from_raw_os_error(code.unwrap_or(libc::EINVAL)))
    }
}

extern "C" fn on_bus_error(signal: c_int, info: *mut libc::siginfo_t, context: *mut c_void) {
    // SAFETY: the kernel gives a valid `siginfo_t` to a handler with SA_SIGINFO.
    let code = unsafe { (*info).si_code };
    // A signal that a program sent has a code of zero or less and no address.
    let sent = code <= 0;
    if !sent {
        // SAFETY: as above; a SIGBUS of the kernel carries an address.
        let address = unsafe { (*info).si_addr() } as usize;
        if let Some((slot, (base, len))) = TABLE
            .iter()
            .find_map(|slot| Some((slot, slot.covering(address)?)))
        {
            // Read by `LinuxWindow` after the access; another thread that sees the zero page sees
            // this flag, because the kernel's change of its page table comes later.
            slot.lost.store(true, Ordering::SeqCst);
            if replace(base, len).is_ok() {
                return;
            }
        }
    }
    pass_on(sent, signal, info, context);
}

/// Maps zeros over a mapping that lost its memory.
fn replace(base: usize, len: usize) -> rustix::io::Result<()> {
    // SAFETY: the range is one mapping of a live `LinuxWindow`: the thread that faulted in it, or
    // the window it uses, keeps it mapped. All Rust code reaches it through atomics made for one
    // access each, so exchanging the memory under it is like a store of a peer.
    unsafe {
        mmap_anonymous(
            ptr::without_provenance_mut(base),
            len,
            ProtFlags::READ | ProtFlags::WRITE,
            MapFlags::PRIVATE | MapFlags::FIXED,
        )
    }
    .map(|_| ())
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
                type Handler = extern "C" fn(c_int, *mut libc::siginfo_t, *mut c_void);
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
