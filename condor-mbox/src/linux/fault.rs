//! Turns a bus error inside a window into a flag that the access reads afterwards.
//!
//! Memory behind a mapping can vanish: somebody truncates the file, a device is unbound. The
//! kernel then answers an access with SIGBUS. Asked about it, this module looks the address up in a
//! table of mappings; if it finds it, it marks the mapping as lost and puts a page of zeros under
//! it, so that the access completes, with a value that the window throws away.
//!
//! All of that is async-signal-safe: loads and stores of a static table, and `mmap`.

use core::ptr;
use core::sync::atomic::{AtomicBool, AtomicUsize, Ordering, fence};
use std::io;

use condor_platform::linux::{MemoryFault, on_bus_error};
use rustix::mm::{MapFlags, ProtFlags, mmap_anonymous};

/// The largest number of mappings of one process: 32 numbers with 64 objects each, twice over.
pub(super) const SLOTS: usize = 4096;

static TABLE: [Slot; SLOTS] = [const { Slot::new() }; SLOTS];

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

/// A mapping that bus errors are repaired in, until this is dropped.
#[derive(Debug)]
pub(super) struct Guarded {
    index: usize,
}

/// The reason why a mapping could not be guarded.
pub(super) enum GuardError {
    /// All slots are in use.
    Full,
    /// The handler could not be installed.
    Install(io::Error),
}

impl Guarded {
    /// Lets bus errors be repaired in the `len` bytes at `base`, which are mapped as one mapping and
    /// stay so until this is dropped.
    pub(super) fn new(base: usize, len: usize) -> Result<Self, GuardError> {
        on_bus_error(repair).map_err(GuardError::Install)?;
        // Acquire pairs with the Release store in `drop`: the slot's former holder is done.
        let free = |slot: &Slot| !slot.taken.swap(true, Ordering::Acquire);
        let index = TABLE.iter().position(free).ok_or(GuardError::Full)?;
        let slot = &TABLE[index];
        slot.lost.store(false, Ordering::Relaxed);
        slot.describe(base, len);
        Ok(Self { index })
    }

    /// The flag that is set when the memory is gone.
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

/// Asked on SIGBUS: whether the address belongs to a mapping, which then has zeros in its place.
fn repair(error: &mut MemoryFault<'_>) -> bool {
    let address = error.address();
    let covering = |slot: &'static Slot| Some((slot, slot.covering(address)?));
    let Some((slot, (base, len))) = TABLE.iter().find_map(covering) else {
        return false;
    };
    // Read by `LinuxWindow` after the access; another thread that sees the zero page sees this flag,
    // because the kernel's change of its page table comes later.
    slot.lost.store(true, Ordering::SeqCst);
    replace(base, len).is_ok()
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
