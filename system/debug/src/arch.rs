//! [`Arch`]: what a stub needs of its processor.

use core::ops::Range;

use crate::Trigger;

/// A processor as its [`Stub`](crate::Stub) uses it.
///
/// # For implementers
///
/// Addresses come from shared memory and may be anything: check that they lie in the program of this
/// processor, where an instruction can begin, and outside of the trap entry.
pub trait Arch {
    /// Returns the addresses of the program at which no breakpoint can be, such as those of its trap entry.
    fn closed(&self) -> Range<u64>;

    /// Returns the instruction at `address`, for which a breakpoint can stand; `None` if none can.
    fn original(&self, address: u64) -> Option<u32>;

    /// Stores a breakpoint instruction at `address`. It must not split an access of the processor: what is
    /// executed there is the old instruction or the breakpoint. Does nothing if no breakpoint can be there.
    fn plant(&self, address: u64);

    /// Stores `original` of [`original`](Self::original) at `address` again. Does nothing if no breakpoint can
    /// be there.
    fn restore(&self, address: u64, original: u32);

    /// Returns true if the instruction at `address` is a breakpoint.
    fn is_breakpoint(&self, address: u64) -> bool;

    /// Has the hardware stop the program at the accesses of `trigger` by an exception, before they are made.
    /// Returns true if it can; a processor without triggers never does.
    fn arm(&self, trigger: Trigger) -> bool {
        let _ = trigger;
        false
    }

    /// Has the hardware forget a trigger that [`arm`](Self::arm) has accepted. Does nothing if there is none
    /// such.
    fn disarm(&self, trigger: Trigger) {
        let _ = trigger;
    }

    /// Makes the processor fetch what was stored: RISC-V's `fence.i`.
    fn synchronize(&self);

    /// Waits until the processor is rung. It may return earlier, and must return at once if a ring
    /// came since it returned last. It serves what others need of this processor even while its
    /// program is held. It need not return if the program is abandoned.
    fn wait(&self);
}

impl<A: Arch + ?Sized> Arch for &A {
    fn closed(&self) -> Range<u64> {
        (**self).closed()
    }

    fn original(&self, address: u64) -> Option<u32> {
        (**self).original(address)
    }

    fn plant(&self, address: u64) {
        (**self).plant(address);
    }

    fn restore(&self, address: u64, original: u32) {
        (**self).restore(address, original);
    }

    fn is_breakpoint(&self, address: u64) -> bool {
        (**self).is_breakpoint(address)
    }

    fn arm(&self, trigger: Trigger) -> bool {
        (**self).arm(trigger)
    }

    fn disarm(&self, trigger: Trigger) {
        (**self).disarm(trigger);
    }

    fn synchronize(&self) {
        (**self).synchronize();
    }

    fn wait(&self) {
        (**self).wait();
    }
}
