//! [`Memory`]: where registers would be.

use core::cell::UnsafeCell;

use condor_dev::Mmio;

/// The bus address of the first board.
pub(crate) const BASE: usize = 0xee00_0000;
const WORDS: usize = 0x180;

/// Memory that answers as a bus.
#[repr(transparent)]
pub(crate) struct Memory(UnsafeCell<[u32; WORDS]>);

/// The memory of this program.
pub(crate) static MEMORY: Memory = Memory(UnsafeCell::new([0; WORDS]));

// SAFETY: it is reached by volatile accesses of buses alone, in contexts of one processor.
unsafe impl Sync for Memory {}

impl Memory {
    /// Returns the bus with the addresses from [`BASE`] on.
    pub(crate) const fn bus(&'static self) -> Mmio {
        // SAFETY: the memory is aligned to words, lives for ever and has no references into it.
        unsafe { Mmio::translated(self.0.get().cast(), BASE, 4 * WORDS) }
    }
}
