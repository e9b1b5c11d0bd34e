//! What the processes share: the page, and a board on which they check each other.

use std::fs::File;
use std::os::fd::{AsFd, AsRawFd, OwnedFd};
use std::sync::atomic::Ordering::SeqCst;
use std::sync::atomic::{AtomicBool, AtomicU32, AtomicU64};

use condor_clock::Page;
use rustix::fs::{MemfdFlags, ftruncate, memfd_create};
use rustix::mm::{MapFlags, ProtFlags, mmap};

use super::AnyError;

/// The numbers below are processors.
pub(crate) const PROCESSORS: u8 = 3;
pub(crate) const SERVICE: u8 = PROCESSORS;

/// All of the shared memory.
#[repr(C)]
pub(crate) struct Shared {
    pub(crate) page: Page,
    pub(crate) board: Board,
}

/// Written with the turn, and by the parent about those that are dead. Zeros are a board.
pub(crate) struct Board {
    pub(crate) faults: AtomicU32,
    pub(crate) turns: AtomicU64,
    /// The number plus 1 of the processor that has the turn, while it does something with it.
    holder: AtomicU32,
    now: AtomicU64,
    seats: [Seat; PROCESSORS as usize],
}

/// A processor.
pub(crate) struct Seat {
    /// Whether the rest says something: it is alive, and has begun.
    is_known: AtomicBool,
    /// When it is due.
    due: AtomicU64,
    /// Whether a ring ends its wait.
    hears: AtomicBool,
    /// How often the service was told to ring it, and how often it has.
    pub(crate) told: AtomicU32,
    pub(crate) done: AtomicU32,
}

impl Board {
    pub(crate) fn seat(&self, number: u8) -> &Seat {
        &self.seats[usize::from(number)]
    }

    /// Notes that `number` has the turn at `now`, and that nobody is due before it.
    pub(crate) fn take(&self, number: u8, now: u64) {
        let former = self.holder.swap(u32::from(number) + 1, SeqCst);
        if former != 0 {
            self.fault(&format!(
                "{number} has the turn at {now}, and so has {}",
                former - 1
            ));
        }
        let before = self.now.swap(now, SeqCst);
        if before > now {
            self.fault(&format!("{number} goes on at {now}, after {before}"));
        }
        for (other, seat) in (0..).zip(&self.seats) {
            let due = seat.due.load(SeqCst);
            let is_first = (now, number) < (due, other);
            if other != number && seat.is_known.load(SeqCst) && !is_first {
                self.fault(&format!(
                    "{number} goes on at {now}, but {other} is due at {due}"
                ));
            }
        }
        self.turns.fetch_add(1, SeqCst);
    }

    /// Notes that `number` waits until `due`, or until it is rung if it `hears`.
    pub(crate) fn give(&self, number: u8, due: u64, hears: bool) {
        let seat = self.seat(number);
        seat.due.store(due, SeqCst);
        seat.hears.store(hears, SeqCst);
        seat.is_known.store(true, SeqCst);
        self.holder.swap(0, SeqCst);
    }

    /// Notes that `number` is rung at `now`.
    pub(crate) fn ring(&self, number: u8, now: u64) {
        let seat = self.seat(number);
        if seat.hears.load(SeqCst) {
            seat.due.fetch_min(now, SeqCst);
        }
    }

    /// Strikes out one that is dead.
    pub(crate) fn forget(&self, number: u8) {
        let seat = self.seat(number);
        seat.is_known.store(false, SeqCst);
        // If it had the turn, somebody has to take its place.
        let _ = self
            .holder
            .compare_exchange(u32::from(number) + 1, 0, SeqCst, SeqCst);
    }

    fn fault(&self, what: &str) {
        eprintln!("WRONG: {what}");
        self.faults.fetch_add(1, SeqCst);
    }
}

/// The shared memory in a process.
pub(crate) struct Memory {
    descriptor: OwnedFd,
    shared: &'static Shared,
}

impl Memory {
    pub(crate) fn new() -> Result<Self, AnyError> {
        let descriptor = memfd_create("condor-clock-faults", MemfdFlags::CLOEXEC)?;
        ftruncate(&descriptor, size_of::<Shared>() as u64)?;
        Self::map(descriptor)
    }

    /// Maps the memory that the parent has by `descriptor`.
    pub(crate) fn of_parent(descriptor: u64) -> Result<Self, AnyError> {
        let parent = std::os::unix::process::parent_id();
        let path = format!("/proc/{parent}/fd/{descriptor}");
        let file = File::options().read(true).write(true).open(path)?;
        Self::map(file.into())
    }

    fn map(descriptor: OwnedFd) -> Result<Self, AnyError> {
        let (flags, bytes) = (ProtFlags::READ | ProtFlags::WRITE, size_of::<Shared>());
        // SAFETY: nothing else is there, and it is never unmapped; all of it consists of atomics, for
        // which all bytes are valid but those of `bool`, which only this program writes.
        let shared = unsafe {
            let at = mmap(
                std::ptr::null_mut(),
                bytes,
                flags,
                MapFlags::SHARED,
                descriptor.as_fd(),
                0,
            )?;
            &*at.cast::<Shared>()
        };
        Ok(Self { descriptor, shared })
    }

    pub(crate) fn descriptor(&self) -> u64 {
        self.descriptor.as_raw_fd().unsigned_abs().into()
    }

    pub(crate) fn shared(&self) -> &'static Shared {
        self.shared
    }
}

/// splitmix64 of Steele, Lea and Flood, 2014.
pub(crate) struct Random(pub(crate) u64);

impl Random {
    pub(crate) fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mixed = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        let mixed = (mixed ^ (mixed >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        mixed ^ (mixed >> 31)
    }

    /// A number below `end`.
    pub(crate) fn below(&mut self, end: u64) -> u64 {
        self.next() % end
    }
}
