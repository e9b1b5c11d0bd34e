//! Ordinary memory as a window, and a view of it that stops after some accesses.
#![allow(dead_code, reason = "every test file includes it and uses a part")]

use std::cell::Cell;
use std::sync::atomic::{AtomicU32, Ordering};

use condor_mbox::window::{CompareExchange, WindowError, WindowErrorKind, check_access};
use condor_mbox::{LoadOrder, MemoryWindow, StoreOrder};

/// Words of the program's own memory.
#[derive(Debug)]
pub(crate) struct Memory(Vec<AtomicU32>);

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct MemoryError(pub(crate) WindowErrorKind);

impl WindowError for MemoryError {
    fn kind(&self) -> WindowErrorKind {
        self.0
    }
}

impl Memory {
    pub(crate) fn new(words: usize) -> Self {
        Self::filled(words, |_| 0)
    }

    pub(crate) fn filled(words: usize, word: impl FnMut(usize) -> u32) -> Self {
        Self((0..words).map(word).map(AtomicU32::new).collect())
    }

    fn word(&self, offset: u32) -> Result<&AtomicU32, MemoryError> {
        self.check(offset, 4)?;
        Ok(&self.0[offset as usize / 4])
    }
}

impl MemoryWindow for Memory {
    type Error = MemoryError;

    fn size(&self) -> u32 {
        u32::try_from(self.0.len() * 4).unwrap()
    }

    fn load(&self, offset: u32, order: LoadOrder) -> Result<u32, MemoryError> {
        Ok(self.word(offset)?.load(match order {
            LoadOrder::Relaxed => Ordering::Relaxed,
            LoadOrder::Acquire => Ordering::Acquire,
        }))
    }

    fn store(&self, offset: u32, value: u32, order: StoreOrder) -> Result<(), MemoryError> {
        self.word(offset)?.store(
            value,
            match order {
                StoreOrder::Relaxed => Ordering::Relaxed,
                StoreOrder::Release => Ordering::Release,
            },
        );
        Ok(())
    }

    fn check(&self, offset: u32, len: usize) -> Result<(), MemoryError> {
        check_access(self.size(), offset, len).map_err(MemoryError)
    }
}

impl CompareExchange for Memory {
    fn compare_exchange(&self, offset: u32, current: u32, new: u32) -> Result<u32, MemoryError> {
        let word = self.word(offset)?;
        let (Ok(found) | Err(found)) =
            word.compare_exchange(current, new, Ordering::AcqRel, Ordering::Acquire);
        Ok(found)
    }
}

/// The memory as seen by a program that stops for ever after some accesses.
#[derive(Debug)]
pub(crate) struct Mortal<'a> {
    memory: &'a Memory,
    left: Cell<u32>,
}

impl<'a> Mortal<'a> {
    /// Incarnations for `accesses` words.
    pub(crate) fn new(memory: &'a Memory, accesses: u32) -> Self {
        Self {
            memory,
            left: Cell::new(accesses),
        }
    }

    pub(crate) fn is_dead(&self) -> bool {
        self.left.get() == 0
    }

    fn live(&self) -> Result<(), MemoryError> {
        match self.left.get().checked_sub(1) {
            Some(left) => {
                self.left.set(left);
                Ok(())
            }
            None => Err(MemoryError(WindowErrorKind::Lost)),
        }
    }
}

impl MemoryWindow for Mortal<'_> {
    type Error = MemoryError;

    fn size(&self) -> u32 {
        self.memory.size()
    }

    fn load(&self, offset: u32, order: LoadOrder) -> Result<u32, MemoryError> {
        self.live()?;
        self.memory.load(offset, order)
    }

    fn store(&self, offset: u32, value: u32, order: StoreOrder) -> Result<(), MemoryError> {
        self.live()?;
        self.memory.store(offset, value, order)
    }

    fn check(&self, offset: u32, len: usize) -> Result<(), MemoryError> {
        self.memory.check(offset, len)
    }
}

impl CompareExchange for Mortal<'_> {
    fn compare_exchange(&self, offset: u32, current: u32, new: u32) -> Result<u32, MemoryError> {
        self.live()?;
        self.memory.compare_exchange(offset, current, new)
    }
}
