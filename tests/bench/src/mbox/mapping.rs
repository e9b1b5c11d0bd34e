//! The memory that a round is played on: mapped once, shared by fork.

use std::ptr::NonNull;
use std::sync::atomic::AtomicU32;

use rustix::mm::{MapFlags, ProtFlags, mmap_anonymous, munmap};

use crate::Result;

/// Words of a cache line.
const LINE_WORDS: usize = 16;

/// Fresh memory; unmapped when dropped.
pub(crate) struct Mapping {
    base: NonNull<AtomicU32>,
    lines: usize,
}

impl Mapping {
    /// Maps so many zeroed cache lines.
    pub(crate) fn new(lines: usize) -> Result<Self> {
        let flags = MapFlags::SHARED | MapFlags::POPULATE;
        let access = ProtFlags::READ | ProtFlags::WRITE;
        // SAFETY: a new mapping at an address that the kernel chooses disturbs no other memory.
        let base = unsafe { mmap_anonymous(std::ptr::null_mut(), bytes(lines), access, flags) }?;
        let base = NonNull::new(base.cast()).ok_or("mapped at address zero")?;
        Ok(Self { base, lines })
    }

    /// Returns the first word of cache line `line`.
    pub(crate) fn line(&self, line: usize) -> &AtomicU32 {
        assert!(line < self.lines, "line {line} of {}", self.lines);
        // SAFETY: inside the mapping, by the assertion; it is aligned to pages, was zeroed, and lives
        // as long as `self`. Other processes change its words only atomically.
        unsafe { self.base.add(line * LINE_WORDS).as_ref() }
    }
}

impl Drop for Mapping {
    fn drop(&mut self) {
        // SAFETY: this is the whole mapping, and every reference into it borrowed `self`. A failure
        // leaves it mapped, which does no harm.
        let _ = unsafe { munmap(self.base.as_ptr().cast(), bytes(self.lines)) };
    }
}

const fn bytes(lines: usize) -> usize {
    lines * LINE_WORDS * size_of::<AtomicU32>()
}
