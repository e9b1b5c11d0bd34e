//! [`ShadowRegister`]: a register that both halves of a driver write. [`Count`]: a number that both count up.

use crate::sync::{AtomicU32, Ordering::Relaxed, masked};

/// Not the value of any register of 16 bits.
const UNKNOWN: u32 = u32::MAX;

/// A register of a board that several contexts of a driver write, such as one that enables interrupts. It remembers the
/// value that was last written, so that only changes are written.
///
/// The right value of the register follows from the driver's state. The interrupt handler and the other calls of the
/// driver each call [`update`](Self::update) after they changed that state. Computing the value and writing it are one
/// critical section. Otherwise a context that is interrupted between the two could overwrite a newer value by an older
/// one.
#[derive(Debug)]
pub struct ShadowRegister(AtomicU32);

impl ShadowRegister {
    /// Makes a shadow of a register with an unknown value: the first [`update`](Self::update) writes it.
    #[must_use]
    #[allow(clippy::new_without_default, reason = "a part of `Driver::NEW`")]
    pub const fn new() -> Self {
        Self(AtomicU32::new(UNKNOWN))
    }

    /// Calls `wanted` for the value that the register must have, and calls `write` with it unless that value was
    /// written last. Both calls are made in one critical section. Returns true if it wrote. After a write that failed,
    /// the next call writes again.
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

    /// Forgets the value that was last written, so that the next [`update`](Self::update) writes. Call it when
    /// something else has changed the register, such as a reset of the board.
    pub fn forget(&self) {
        self.0.store(UNKNOWN, Relaxed);
    }
}

/// A counter that several contexts increment, such as an interrupt handler and the other calls of a driver. It wraps
/// after `u32::MAX`.
#[derive(Debug)]
pub struct Count(AtomicU32);

impl Count {
    /// Makes a counter at 0.
    #[must_use]
    #[allow(clippy::new_without_default, reason = "a part of `Driver::NEW`")]
    pub const fn new() -> Self {
        Self(AtomicU32::new(0))
    }

    /// Increments the counter by 1, and returns the new count.
    pub fn add(&self) -> u32 {
        masked(|| {
            let next = self.get().wrapping_add(1);
            self.0.store(next, Relaxed);
            next
        })
    }

    /// Returns the present count.
    pub fn get(&self) -> u32 {
        self.0.load(Relaxed)
    }
}
