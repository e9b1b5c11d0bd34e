//! Memory that threads of one process share.

use std::ops::Range;
use std::sync::Arc;

use super::cache::Cache;
use crate::layout::LINE;
use crate::sync::{AtomicU32, Ordering};
use crate::window::{
    AccessError, CompareExchange, LoadOrder, MemoryWindow, StoreOrder, WindowErrorKind,
    check_access, check_words,
};

/// A window onto memory of this process, for tests. All clones access the same memory, through the
/// same simulated cache if there is one.
#[derive(Clone)]
pub struct SimWindow {
    words: Arc<[AtomicU32]>,
    cache: Option<Arc<Cache>>,
    writable: bool,
    lost: Arc<std::sync::atomic::AtomicBool>,
}

impl SimWindow {
    /// Makes a window onto new memory of `size` bytes, rounded up to a multiple of four, that holds
    /// zeros.
    #[must_use]
    pub fn new(size: u32) -> Self {
        Self {
            words: (0..size.div_ceil(4)).map(|_| AtomicU32::new(0)).collect(),
            cache: None,
            writable: true,
            lost: Arc::default(),
        }
    }

    /// Returns a window onto the same memory that refuses to be written.
    #[must_use]
    pub fn read_only(&self) -> Self {
        Self {
            writable: false,
            ..self.clone()
        }
    }

    /// The same memory through `cache`.
    pub(super) fn through(self, cache: Option<Arc<Cache>>) -> Self {
        Self { cache, ..self }
    }

    /// Makes all later accesses to the memory fail, as if a file had been truncated or a device had
    /// vanished.
    pub fn lose(&self) {
        self.lost.store(true, std::sync::atomic::Ordering::Relaxed);
    }

    fn word(&self, offset: u32, writes: bool) -> Result<&AtomicU32, AccessError> {
        let kind = if let Err(kind) = check_words(self.size(), offset, 1) {
            kind
        } else if self.lost.load(std::sync::atomic::Ordering::Relaxed) {
            WindowErrorKind::Lost
        } else if writes && !self.writable {
            WindowErrorKind::ReadOnly
        } else {
            // Without a reference to all words: Miri would note each of them at every access.
            let first = Arc::as_ptr(&self.words).cast::<AtomicU32>();
            // SAFETY: `check_words` found the word inside the window, whose memory this `Arc` keeps.
            return Ok(unsafe { &*first.add(offset as usize / 4) });
        };
        Err(AccessError::new(offset, 4, self.size(), kind))
    }

    /// The lines of a range that is inside the window.
    fn lines(&self, offset: u32, len: u32) -> Range<usize> {
        if check_access(self.size(), offset & !3, len as usize).is_err() {
            return 0..0;
        }
        let end = (offset + len).div_ceil(LINE);
        (offset / LINE) as usize..end as usize
    }
}

impl MemoryWindow for SimWindow {
    type Error = AccessError;

    fn size(&self) -> u32 {
        Arc::as_ptr(&self.words).len() as u32 * 4
    }

    fn load(&self, offset: u32, order: LoadOrder) -> Result<u32, AccessError> {
        let word = self.word(offset, false)?;
        Ok(match &self.cache {
            None => word.load(order.into()),
            Some(cache) => cache.access(&self.words, offset as usize / 4, None),
        })
    }

    fn store(&self, offset: u32, value: u32, order: StoreOrder) -> Result<(), AccessError> {
        let word = self.word(offset, true)?;
        match &self.cache {
            None => word.store(value, order.into()),
            Some(cache) => {
                cache.access(&self.words, offset as usize / 4, Some(value));
                self.clean(offset, 4);
            }
        }
        Ok(())
    }

    fn is_coherent(&self) -> bool {
        self.cache.is_none()
    }

    fn clean(&self, offset: u32, len: u32) {
        if let Some(cache) = &self.cache {
            cache.clean(&self.words, self.lines(offset, len));
        }
    }

    fn invalidate(&self, offset: u32, len: u32) {
        if let Some(cache) = &self.cache {
            cache.invalidate(&self.words, self.lines(offset, len));
        }
    }

    fn check(&self, offset: u32, len: usize) -> Result<(), AccessError> {
        let size = self.size();
        check_access(size, offset, len).map_err(|kind| AccessError::new(offset, len, size, kind))
    }
}

/// Returns `NotCoherent` if the window has a cache.
impl CompareExchange for SimWindow {
    fn compare_exchange(&self, offset: u32, current: u32, new: u32) -> Result<u32, AccessError> {
        let word = self.word(offset, true)?;
        if self.cache.is_some() {
            let kind = WindowErrorKind::NotCoherent;
            return Err(AccessError::new(offset, 4, self.size(), kind));
        }
        let (success, failure) = (Ordering::AcqRel, Ordering::Acquire);
        Ok(word
            .compare_exchange(current, new, success, failure)
            .unwrap_or_else(|found| found))
    }
}
