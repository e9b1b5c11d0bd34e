//! [`Arch`]: what a stub needs of its processor.

use core::ops::Range;

use crate::Trigger;

/// The operations of a processor that its debugger [`Stub`](crate::Stub) needs: breakpoint
/// instructions, hardware triggers, and waiting for a ring, the interrupt by which the host
/// announces a command.
///
/// # For implementers
///
/// Addresses come from shared memory and may be anything: check that they lie in the program of this
/// processor, where an instruction can begin, and outside of the trap entry.
pub trait Arch {
    /// Returns the addresses of the program at which no breakpoint can be, such as those of its trap entry.
    fn closed(&self) -> Range<u64>;

    /// Returns the instruction at `address`, which a breakpoint can replace; `None` if no
    /// breakpoint can be there.
    fn original(&self, address: u64) -> Option<u32>;

    /// Stores a breakpoint instruction at `address`. The store must be a single access, so that the processor executes
    /// either the old instruction or the breakpoint there. Does nothing if no breakpoint can be there.
    fn plant(&self, address: u64);

    /// Stores `original`, the instruction that [`original`](Self::original) returned, at `address` again. Does nothing
    /// if no breakpoint can be there.
    fn restore(&self, address: u64, original: u32);

    /// Returns true if the instruction at `address` is a breakpoint.
    fn is_breakpoint(&self, address: u64) -> bool;

    /// Makes the hardware stop the program by an exception before each access that `trigger` describes. Returns true if
    /// the hardware can do that. A processor without triggers always returns false, which is the default.
    fn arm(&self, trigger: Trigger) -> bool {
        let _ = trigger;
        false
    }

    /// Makes the hardware forget `trigger`, which [`arm`](Self::arm) has accepted. Does nothing if there is no such
    /// trigger.
    fn disarm(&self, trigger: Trigger) {
        let _ = trigger;
    }

    /// Makes the processor fetch what was stored: RISC-V's `fence.i`.
    fn synchronize(&self);

    /// Waits until the processor is rung. It may return earlier, and must return at once if a ring
    /// came since it returned last. Meanwhile it does what others need of this processor, even
    /// while the program is held. It need not return if the program is abandoned.
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
