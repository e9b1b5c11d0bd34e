//! [`SharedLog`]: a log to which several processors append.

use core::fmt;

use zerocopy::{FromBytes, Immutable, IntoBytes};

use crate::id::Processor;
use crate::layout::LINE;
use crate::region::{Offset, Region};
use crate::spin_lock::{Incarnations, LockOwner, SpinLock, SpinLockError, TestAndSet};
use crate::sync::{Ordering, fence};
use crate::time::{Clock, Instant};
use crate::window::{AccessError, LoadOrder, MemoryWindow, StoreOrder, WindowErrorKind};

/// A log of lines in shared memory, to which several processors append and which others read.
///
/// A [`SpinLock`] keeps processors that append apart. Readers take no lock and hold nobody up: the mark of an entry
/// tells them whether it was overwritten while they copied it. The log keeps the latest entries. If a processor dies
/// while it appends, its entry is lost, and the next processor that appends and knows of the death recovers the lock.
///
/// # In shared memory
///
/// The log has one line of 64 bytes, and behind it entries of 128 bytes, as many as fit into the memory, rounded down to a power of two.
/// All zeros is an empty log. Entry *n* is at index *n* modulo the number of entries:
///
/// | bytes of the log | meaning |
/// |---|---|
/// | 0 to 3 | the letters `CLOG`; 0 until something is appended for the first time |
/// | 4 to 7 | the version, 1 |
/// | 8 to 11 | the number of entries for which the log has room |
/// | 12 to 15 | the number of entries that were appended, modulo 2³² |
///
/// | bytes of entry *n* | meaning |
/// |---|---|
/// | 0 to 3 | 2*n* + 1, modulo 2³², if the entry is complete; 0 while it is written |
/// | 4 | the number of the processor |
/// | 5 | the length of the text in bytes, at most 112 |
/// | 8 to 15 | the time in nanoseconds |
/// | 16 to 127 | the text in UTF-8 |
///
/// ```
/// # #[cfg(target_has_atomic = "32")] {
/// use condor_mbox::shared_log::SharedLogReader;
/// use condor_mbox::spin_lock::{Incarnations, LockOwner, NativeSwap};
/// use condor_mbox::{Clock, Instant, Processor, Region, SharedLog, SpinLock};
/// # use condor_mbox::StaticMemory;
/// static MEMORY: StaticMemory<1024> = StaticMemory::new();
///
/// /// Who lives, as the mailbox knows it: here everybody. The clock of a program is that of its doorbell.
/// struct Known;
///
/// impl Incarnations for Known {
///     fn is_current(&self, _: LockOwner) -> bool {
///         true
///     }
/// }
/// # impl Clock for Known {
/// #     fn now(&self) -> Instant {
/// #         Instant::from_ns(7)
/// #     }
/// # }
///
/// # fn main() -> Result<(), Box<dyn std::error::Error>> {
/// let memory = Region::whole(MEMORY.window());
/// let lock = SpinLock::new(NativeSwap::new(memory.part(960, 64)?, 0)?);
/// let log = SharedLog::new(memory.part(0, 960)?, lock)?;
/// let mut reader = SharedLogReader::new(memory.part(0, 960)?)?;
///
/// let me = LockOwner::new(Processor(3), 1)?;
/// log.try_append(me, &Known, &Known, "the table is at rest")?;
/// let entry = reader.next_entry()?.ok_or("nothing was appended")?;
/// assert_eq!((entry.processor(), entry.text()), (Processor(3), "the table is at rest"));
/// # Ok(())
/// # }
/// # main().unwrap();
/// # }
/// ```
#[derive(Clone, Copy, Debug)]
pub struct SharedLog<W, L> {
    entries: Entries<W>,
    lock: SpinLock<L>,
}

impl SharedLog<(), ()> {
    /// The longest text of an entry, in bytes. Of longer ones the beginning is kept.
    pub const TEXT_BYTES: usize = 112;
}

impl<W: MemoryWindow, L: TestAndSet> SharedLog<W, L> {
    /// Makes a handle of the log that is the whole of `memory`, and that `lock`, which lies elsewhere, protects.
    ///
    /// # Errors
    /// [`AccessError`] of the kind `OutOfBounds` if the memory has no room for one entry, less than 192 bytes.
    pub fn new(memory: Region<W>, lock: SpinLock<L>) -> Result<Self, AccessError> {
        let entries = Entries::new(memory)?;
        Ok(Self { entries, lock })
    }

    /// Appends `text` for `me` without waiting, with the time of `clock`; returns the number of the entry.
    /// `incarnations`, such as the mailbox, tells whether the owner of the lock has ended. Of a text that is too long
    /// the beginning is kept.
    ///
    /// Call this in a critical section of the processor if several of its contexts append: one that interrupts another
    /// one gets [`Busy`](SpinLockError::Busy).
    ///
    /// # Errors
    /// [`SharedLogError::Lock`] with [`SpinLockError::Busy`] if another processor appends just now, or with another
    /// error of [`SpinLock::try_lock`]; [`SharedLogError::NoLog`] if the memory is used for something else;
    /// [`SharedLogError::Access`] if it cannot be accessed.
    pub fn try_append(
        &self,
        me: LockOwner,
        incarnations: &dyn Incarnations,
        clock: &impl Clock,
        text: &str,
    ) -> Result<u32, SharedLogError> {
        // Memory that is used for something else may have no lock, and is left as it is.
        self.entries.check_or_new()?;
        let guard = match self.lock.try_lock(me, incarnations) {
            // The entry that it began is not counted yet, so nothing is to be repaired.
            Err(SpinLockError::OwnerDead { owner }) => {
                self.lock.recover(owner, me, incarnations)?
            }
            tried => tried?,
        };
        let number = self.entries.append(me, clock.now(), text)?;
        guard.release()?;
        Ok(number)
    }
}

/// A program's place in a [`SharedLog`] that it reads from the oldest entry on, without a lock.
#[derive(Clone, Copy, Debug)]
pub struct SharedLogReader<W> {
    entries: Entries<W>,
    next: u32,
}

impl<W: MemoryWindow> SharedLogReader<W> {
    /// Makes a reader of the log that is the whole of `memory`. It begins with the oldest entry that is there.
    ///
    /// # Errors
    /// [`AccessError`] of the kind `OutOfBounds` if the memory has no room for one entry, less than 192 bytes.
    pub fn new(memory: Region<W>) -> Result<Self, AccessError> {
        let entries = Entries::new(memory)?;
        Ok(Self { entries, next: 0 })
    }

    /// Returns the next entry; `None` if no other one was appended, or if entries are overwritten faster than they can be
    /// read. The call never waits. Entries that were overwritten before they could be read are left out; the
    /// [number](SharedLogEntry::number) shows how many.
    ///
    /// # Errors
    /// [`SharedLogError::NoLog`] if the memory is used for something else, [`SharedLogError::Access`] if it cannot be
    /// accessed.
    pub fn next_entry(&mut self) -> Result<Option<SharedLogEntry>, SharedLogError> {
        // Each turn is lost to somebody who appends.
        for _ in 0..=self.entries.capacity {
            // Pairs with the store of the count: the entries before it are complete.
            let count = self.entries.memory.word(COUNT)?;
            if count == self.next {
                return Ok(None);
            }
            self.entries.check()?;
            if count.wrapping_sub(self.next) > self.entries.capacity {
                self.next = count.wrapping_sub(self.entries.capacity);
            }
            let number = self.next;
            self.next = number.wrapping_add(1);
            if let Some(entry) = self.entries.read(number)? {
                return Ok(Some(entry));
            }
        }
        Ok(None)
    }
}

/// A line of a [`SharedLog`], with the processor that appended it and the time.
#[derive(Clone, Copy, PartialEq, Eq)]
pub struct SharedLogEntry {
    /// The number of entries before this one; wraps to 0 after 2³² entries.
    pub number: u32,
    head: Head,
    text: [u8; SharedLog::TEXT_BYTES],
}

impl SharedLogEntry {
    /// Returns the processor that appended it, as it says. Another program may have written any number.
    #[must_use]
    pub const fn processor(&self) -> Processor {
        Processor(self.head.processor)
    }

    /// Returns the time that this processor gave it.
    #[must_use]
    pub const fn at(&self) -> Instant {
        Instant::from_ns(self.head.ns)
    }

    /// Returns the text. It ends before bytes that are not UTF-8; control characters may be among it.
    #[must_use]
    pub fn text(&self) -> &str {
        let bytes = self
            .text
            .get(..usize::from(self.head.len))
            .unwrap_or_default();
        str::from_utf8(bytes).unwrap_or_else(|error| {
            let valid = bytes.get(..error.valid_up_to()).unwrap_or_default();
            str::from_utf8(valid).unwrap_or_default()
        })
    }
}

impl fmt::Debug for SharedLogEntry {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("SharedLogEntry")
            .field("number", &self.number)
            .field("processor", &self.processor())
            .field("at", &self.at())
            .field("text", &self.text())
            .finish_non_exhaustive()
    }
}

/// The reason why a [`SharedLog`] was not appended to, or not read.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum SharedLogError {
    /// The lock was not taken.
    #[error("cannot append to the shared log: {0}")]
    Lock(#[from] SpinLockError),
    /// The memory is used for something else.
    #[error(
        "the memory of the log holds something else: {:#010x}, {:#010x}, {} where `CLOG`, version 1 and the number of \
         entries should be; leave its beginning to the log, and place what programs keep there behind it",
        .found[0],
        .found[1],
        .found[2]
    )]
    NoLog {
        /// The words that were found where a log has `CLOG`, its version and the number of its entries.
        found: [u32; 3],
    },
    /// The memory could not be accessed.
    #[error("cannot access the shared log: {0}")]
    Access(#[from] AccessError),
}

const CLOG: u32 = u32::from_le_bytes(*b"CLOG");
const VERSION: u32 = 4;
const CAPACITY: u32 = 8;
const COUNT: u32 = 12;
const HEAD_BYTES: u32 = size_of::<Head>() as u32;
const ENTRY_BYTES: u32 = HEAD_BYTES + SharedLog::TEXT_BYTES as u32;

/// The part of an entry before its text.
#[derive(Clone, Copy, PartialEq, Eq, FromBytes, IntoBytes, Immutable)]
#[repr(C)]
struct Head {
    mark: u32,
    processor: u8,
    len: u8,
    unused: [u8; 2],
    ns: u64,
}

/// The mark of a complete entry, which is never 0.
const fn mark_of(number: u32) -> u32 {
    number << 1 | 1
}

/// The shared words of a log that is known to lie inside its memory.
#[derive(Clone, Copy, Debug)]
struct Entries<W> {
    memory: Region<W>,
    /// The number of entries for which there is room: a power of two.
    capacity: u32,
}

impl<W: MemoryWindow> Entries<W> {
    fn new(memory: Region<W>) -> Result<Self, AccessError> {
        let size = memory.size();
        let room = size.saturating_sub(LINE) / ENTRY_BYTES;
        let Some(power) = room.checked_ilog2() else {
            let (needed, kind) = (LINE + ENTRY_BYTES, WindowErrorKind::OutOfBounds);
            return Err(AccessError::new(0, needed as usize, size, kind));
        };
        let capacity = 1 << power;
        Ok(Self { memory, capacity })
    }

    fn kind(&self) -> Result<[u32; 3], AccessError> {
        Ok([
            self.memory.word(0)?,
            self.memory.word(VERSION)?,
            self.memory.word(CAPACITY)?,
        ])
    }

    /// Checks that the memory holds a log.
    fn check(&self) -> Result<(), SharedLogError> {
        let found = self.kind()?;
        if found == [CLOG, 1, self.capacity] {
            return Ok(());
        }
        Err(SharedLogError::NoLog { found })
    }

    /// Checks that the memory holds a log, or nothing.
    fn check_or_new(&self) -> Result<(), SharedLogError> {
        match self.kind()? {
            // A processor may have died in the middle, or be there just now.
            [0, 0 | 1, capacity] if capacity == 0 || capacity == self.capacity => Ok(()),
            _ => self.check(),
        }
    }

    /// Offset of an entry; inside the memory.
    fn offset(&self, number: u32) -> u32 {
        let index = number & self.capacity.wrapping_sub(1);
        LINE.wrapping_add(index.wrapping_mul(ENTRY_BYTES))
    }

    /// Appends an entry; only the owner of the lock may.
    fn append(&self, me: LockOwner, at: Instant, text: &str) -> Result<u32, SharedLogError> {
        self.check_or_new()?;
        if self.check().is_err() {
            for (offset, word) in [(VERSION, 1), (CAPACITY, self.capacity), (0, CLOG)] {
                self.memory.set_word(offset, word)?;
            }
        }
        let number = self.memory.word(COUNT)?;
        let mut ends = (0..=text.len().min(SharedLog::TEXT_BYTES)).rev();
        let end = ends.find(|end| text.is_char_boundary(*end));
        let text = text.as_bytes().get(..end.unwrap_or(0)).unwrap_or_default();
        let head = Head {
            mark: 0,
            processor: me.processor().map_or(u8::MAX, |it| it.0),
            len: text.len() as u8,
            unused: [0; 2],
            ns: at.as_ns(),
        };
        let place = self.offset(number);
        // A reader that copies any of the new words passes its fence after this one, so that its second look at the
        // mark finds this one or a later one.
        self.memory.store(place, 0, StoreOrder::Relaxed)?;
        fence(Ordering::Release);
        self.memory.set(Offset::at(place), &head)?;
        self.memory.write(place.wrapping_add(HEAD_BYTES), text)?;
        // Pairs with the reader's first look at the mark.
        self.memory.set_word(place, mark_of(number))?;
        // Pairs with the reader's look at the count.
        self.memory.set_word(COUNT, number.wrapping_add(1))?;
        Ok(number)
    }

    /// Returns an entry; `None` if it was overwritten.
    fn read(&self, number: u32) -> Result<Option<SharedLogEntry>, AccessError> {
        let (place, mark) = (self.offset(number), mark_of(number));
        // Pairs with the store of the mark: the whole entry is there.
        if self.memory.word(place)? != mark {
            return Ok(None);
        }
        let mut head: Head = self.memory.get(Offset::at(place))?;
        head.len = head.len.min(SharedLog::TEXT_BYTES as u8);
        let mut text = [0; SharedLog::TEXT_BYTES];
        if let Some(text) = text.get_mut(..usize::from(head.len)) {
            self.memory.read(place.wrapping_add(HEAD_BYTES), text)?;
        }
        // Pairs with the fence of who appends: if a word of a later entry was copied, its mark is seen below.
        fence(Ordering::Acquire);
        let is_same = self.memory.load(place, LoadOrder::Relaxed)? == mark;
        Ok(is_same.then_some(SharedLogEntry { number, head, text }))
    }
}
