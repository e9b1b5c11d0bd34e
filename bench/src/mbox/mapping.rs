//! The memory that a round is played on: mapped once, shared by fork.

use std::marker::PhantomData;
use std::ops::Range;
use std::ptr::NonNull;
use std::sync::atomic::AtomicU32;

use rustix::mm::{MapFlags, ProtFlags, mmap_anonymous, munmap};

use crate::Result;

/// Bytes that every contestant has to itself.
pub(super) const PLACE_BYTES: usize = 256 << 10;

/// Words of a cache line.
pub(super) const LINE_WORDS: usize = 16;

/// Fresh memory; unmapped when dropped.
pub(super) struct Mapping {
    base: NonNull<u8>,
    places: usize,
}

impl Mapping {
    /// Maps zeroed memory for so many places.
    pub(super) fn new(places: usize) -> Result<Self> {
        let flags = MapFlags::SHARED | MapFlags::POPULATE;
        let access = ProtFlags::READ | ProtFlags::WRITE;
        // SAFETY: a new mapping at an address that the kernel chooses disturbs no other memory.
        let base =
            unsafe { mmap_anonymous(std::ptr::null_mut(), places * PLACE_BYTES, access, flags) }?;
        let base = NonNull::new(base.cast()).ok_or("mapped at address zero")?;
        Ok(Self { base, places })
    }

    /// The place with this number.
    pub(super) fn place(&self, index: usize) -> Place<'_> {
        assert!(index < self.places, "place {index} of {}", self.places);
        Place {
            // SAFETY: inside the mapping, by the assertion.
            base: unsafe { self.base.add(index * PLACE_BYTES) },
            mapping: PhantomData,
        }
    }
}

impl Drop for Mapping {
    fn drop(&mut self) {
        // SAFETY: this is the whole mapping, and every `Place` borrowed `self`. A failure leaves
        // it mapped, which does no harm.
        let _ = unsafe { munmap(self.base.as_ptr().cast(), self.places * PLACE_BYTES) };
    }
}

/// The part of the mapping that belongs to one contestant.
#[derive(Clone, Copy)]
pub(super) struct Place<'m> {
    base: NonNull<u8>,
    mapping: PhantomData<&'m Mapping>,
}

impl<'m> Place<'m> {
    /// The first word of cache line `line`.
    pub(super) fn line(self, line: usize) -> &'m AtomicU32 {
        &self.words()[line * LINE_WORDS]
    }

    /// The whole place as words.
    pub(super) fn words(self) -> &'m [AtomicU32] {
        // SAFETY: the place is mapped for `'m`, aligned to more than a word, and zeroed, so that
        // it holds valid words; other processes change them only atomically.
        unsafe { std::slice::from_raw_parts(self.base.as_ptr().cast(), PLACE_BYTES / 4) }
    }

    /// The addresses of the place.
    pub(super) fn bytes(self) -> Range<*mut u8> {
        let start = self.base.as_ptr();
        start..start.wrapping_add(PLACE_BYTES)
    }
}
