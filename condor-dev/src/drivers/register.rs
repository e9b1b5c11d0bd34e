//! [`ShadowRegister`]: a register that both halves of a driver write. [`Count`]: a number that both count up.

use crate::sync::{AtomicU32, Ordering::Relaxed, masked};

/// Not the value of any register of 16 bits.
const UNKNOWN: u32 = u32::MAX;

/// The value that was last written to a register, whose right value follows from the driver's state.
///
/// Either half brings it up to date after changing that state. Deciding and writing are one
/// critical section: otherwise a context that was interrupted in between would write what the one
/// that interrupted it had put right.
#[derive(Debug)]
pub struct ShadowRegister(AtomicU32);

impl ShadowRegister {
    /// Makes a register that may have any value.
    #[must_use]
    #[allow(clippy::new_without_default, reason = "a part of `Driver::NEW`")]
    pub const fn new() -> Self {
        Self(AtomicU32::new(UNKNOWN))
    }

    /// Calls `wanted`, and writes its value with `write` if the register has another one, all in one
    /// critical section. Returns true if it wrote. A write that failed is made again by the next call.
    ///
    /// # Errors
    /// Returns the error of `write` if it fails.
    pub fn update<E>(
        &self,
        wanted: impl FnOnce() -> u16,
        write: impl FnOnce(u16) -> Result<(), E>,
    ) -> Result<bool, E> {
        masked(|| {
            let wanted = wanted();
            if self.0.load(Relaxed) == u32::from(wanted) {
                return Ok(false);
            }
            self.forget();
            write(wanted)?;
            self.0.store(wanted.into(), Relaxed);
            Ok(true)
        })
    }

    /// Notes that the register may have any value.
    pub fn forget(&self) {
        self.0.store(UNKNOWN, Relaxed);
    }
}

/// A number that several contexts count up; wraps.
#[derive(Debug)]
pub struct Count(AtomicU32);

impl Count {
    /// Makes a count of 0.
    #[must_use]
    #[allow(clippy::new_without_default, reason = "a part of `Driver::NEW`")]
    pub const fn new() -> Self {
        Self(AtomicU32::new(0))
    }

    /// Counts one more, and returns the new number.
    pub fn add(&self) -> u32 {
        masked(|| {
            let next = self.get().wrapping_add(1);
            self.0.store(next, Relaxed);
            next
        })
    }

    /// Returns the number.
    pub fn get(&self) -> u32 {
        self.0.load(Relaxed)
    }
}
