//! [`Fd`]: the descriptor of an open board; and the table of descriptors.

use core::fmt;
use core::sync::atomic::{AtomicU32, Ordering};

use bitflags::bitflags;

bitflags! {
    /// The mode in which a board is opened: a combination of these flags, such as `READ | WRITE`.
    #[derive(Clone, Copy, Debug, PartialEq, Eq)]
    pub struct OpenMode: u8 {
        /// Opens for reading.
        const READ = 1;
        /// Opens for writing.
        const WRITE = 2;
        /// Opens the board alone: it can have no other descriptor at the same time.
        const EXCLUSIVE = 4;
    }
}

impl fmt::Display for OpenMode {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let names = [
            (Self::READ, "reading"),
            (Self::WRITE, "writing"),
            (Self::EXCLUSIVE, "exclusive use"),
        ];
        let mut between = "";
        for (_, name) in names.into_iter().filter(|(mode, _)| self.contains(*mode)) {
            write!(f, "{between}{name}")?;
            between = " and ";
        }
        f.write_str(if between.is_empty() { "nothing" } else { "" })
    }
}

/// The descriptor of an open board: [`Switch::open`](crate::Switch::open) returns it, and calls
/// such as [`Switch::read`](crate::Switch::read) take it. It is a plain number: an index into the
/// switch's table of descriptors, and a generation, which counts how often that entry of the table
/// was used before. So a closed descriptor is not taken for a newer one with the same index.
///
/// The generation wraps after 65 536 uses of an entry.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Fd {
    index: u16,
    generation: u16,
}

impl Fd {
    /// Makes a descriptor from the index `number` and a generation. Only tables of
    /// descriptors need this. A [`Switch`](crate::Switch) accepts the descriptor if it has one open with
    /// the same index and generation.
    #[must_use]
    pub const fn new(number: u16, generation: u16) -> Self {
        Self {
            index: number,
            generation,
        }
    }

    /// Returns the index of the descriptor in the switch's table.
    #[must_use]
    pub const fn number(self) -> u16 {
        self.index
    }

    /// Returns the generation: how often the entry of the table was used for other descriptors
    /// before.
    #[must_use]
    pub const fn generation(self) -> u16 {
        self.generation
    }
}

impl fmt::Display for Fd {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}.{}", self.index, self.generation)
    }
}

/// The reason why a [`Switch`](crate::Switch) refuses a descriptor.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum FdError {
    /// The descriptor has been closed, or belongs to another switch. A newer descriptor may have
    /// its index.
    #[error("descriptor {fd} is not open")]
    Closed {
        /// The descriptor.
        fd: Fd,
    },
    /// The descriptor was not opened for reading, or not for writing.
    #[error("descriptor {fd} is open for {opened}, not for {wanted}")]
    Direction {
        /// The descriptor.
        fd: Fd,
        /// The direction of the call.
        wanted: OpenMode,
        /// The mode in which it was opened.
        opened: OpenMode,
    },
    /// The descriptor belongs to another device.
    #[error("descriptor {fd} does not belong to the device {wanted}")]
    WrongType {
        /// The descriptor.
        fd: Fd,
        /// The name of the device that was requested.
        wanted: &'static str,
    },
    /// The descriptor cannot be closed, because a [`Device`](crate::Device) of it is held.
    #[error("descriptor {fd} cannot be closed while a `Device` of it is held; drop that first")]
    InUse {
        /// The descriptor.
        fd: Fd,
    },
}

/// The contents of a place of the table, in one word, from the top: slot, whether it is open, its mode, and
/// generation. The bits with which a descriptor is compared are at the bottom, and the slot, which leads to the
/// driver, is one shift away.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Entry(u32);

const GENERATION: u16 = 0xffff;
const MODE: u32 = 16;
const OPEN: u32 = 1 << 19;
const SLOT: u32 = 20;

impl Entry {
    /// Kinds of devices, and boards of a kind, of which an entry can tell all apart.
    pub(crate) const MOST: usize = 64;

    const fn new(generation: u16, slot: u16, mode: OpenMode) -> Self {
        Self((slot as u32) << SLOT | Self::wanted(generation, mode))
    }

    /// The bits of all entries of a generation that are open, and for `mode`.
    const fn wanted(generation: u16, mode: OpenMode) -> u32 {
        OPEN | (mode.bits() as u32) << MODE | generation as u32
    }

    const fn generation(self) -> u16 {
        self.0 as u16
    }

    /// The number of the board among all boards of the set.
    pub(crate) const fn slot(self) -> u16 {
        (self.0 >> SLOT) as u16
    }

    const fn mode(self) -> OpenMode {
        OpenMode::from_bits_truncate((self.0 >> MODE & 7) as u8)
    }
}

/// The `F` descriptors of a switch.
///
/// A use is one load and two comparisons; opening and closing are critical sections of the switch.
pub(crate) struct FdTable<const F: usize> {
    entries: [AtomicU32; F],
    /// The number of holders of the device of each descriptor.
    holders: [AtomicU32; F],
}

impl<const F: usize> FdTable<F> {
    pub(crate) const fn new() -> Self {
        const {
            assert!(
                F <= u16::MAX as usize,
                "a descriptor has 16 bits for its number"
            );
        };
        Self {
            entries: [const { AtomicU32::new(0) }; F],
            holders: [const { AtomicU32::new(0) }; F],
        }
    }

    /// Takes a free place, in a critical section.
    pub(crate) fn insert(&self, slot: u16, mode: OpenMode) -> Option<Fd> {
        for (index, place) in self.entries.iter().enumerate() {
            let entry = Entry(place.load(Ordering::Relaxed));
            if entry.0 & OPEN == 0 {
                let generation = entry.generation();
                // Release: pairs with the Acquire load in `get`; the device has been opened.
                place.store(Entry::new(generation, slot, mode).0, Ordering::Release);
                return Some(Fd {
                    index: index as u16,
                    generation,
                });
            }
        }
        None
    }

    /// Returns the entry of `fd`, if it is open for `wanted`.
    #[inline(always)]
    pub(crate) fn get(&self, fd: Fd, wanted: OpenMode) -> Result<Entry, FdError> {
        if let Some(place) = self.entries.get(usize::from(fd.index)) {
            // Acquire: pairs with the Release store in `insert`.
            let entry = Entry(place.load(Ordering::Acquire));
            let mask = Entry::wanted(GENERATION, wanted);
            if entry.0 & mask == Entry::wanted(fd.generation, wanted) {
                return Ok(entry);
            }
        }
        Err(self.misuse(fd, wanted))
    }

    /// Frees the place of `fd`, in a critical section.
    pub(crate) fn remove(&self, fd: Fd) -> Result<Entry, FdError> {
        let entry = self.get(fd, OpenMode::empty())?;
        let index = usize::from(fd.index);
        if let (Some(place), Some(holders)) = (self.entries.get(index), self.holders.get(index)) {
            if holders.load(Ordering::Relaxed) != 0 {
                return Err(FdError::InUse { fd });
            }
            let next = fd.generation.wrapping_add(1);
            place.store(next.into(), Ordering::Release);
        }
        Ok(entry)
    }

    /// Counts one who holds the device of `fd`, in a critical section; `-1` as `step` takes him back.
    pub(crate) fn hold(&self, fd: Fd, step: i32) {
        if let Some(holders) = self.holders.get(usize::from(fd.index)) {
            let count = holders.load(Ordering::Relaxed).wrapping_add_signed(step);
            holders.store(count, Ordering::Relaxed);
        }
    }

    #[cold]
    fn misuse(&self, fd: Fd, wanted: OpenMode) -> FdError {
        let place = self.entries.get(usize::from(fd.index));
        // Relaxed: only the error depends on it.
        let entry = Entry(place.map_or(0, |place| place.load(Ordering::Relaxed)));
        if entry.generation() != fd.generation || entry.0 & OPEN == 0 {
            return FdError::Closed { fd };
        }
        let opened = entry.mode();
        FdError::Direction { fd, wanted, opened }
    }
}

#[cfg(test)]
#[path = "../tests/inside/fd.rs"]
mod tests;
