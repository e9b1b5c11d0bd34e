//! [`Platform`]: the way in which loops interrupt each other.

use critical_section::CriticalSection;

use crate::error::ConnectError;
use crate::timer::Timer;

/// A processor on which a [`Scheduler`](crate::Scheduler) can run: its [`Timer`], and the way in
/// which faster loops interrupt slower ones.
///
/// # For implementers
/// There are two ways; in both the scheduler decides which loop runs next:
///
/// * *By a call on the interrupted stack* (RISC-V, signals, the simulator). Such a platform leaves
///   out the methods for vectors below. The timer's interrupt calls
///   [`Scheduler::on_timer`](crate::Scheduler::on_timer), which calls the loops through
///   [`interruptible`](Self::interruptible).
/// * *By hardware vectors* (the NVIC of Cortex-M, where an interrupt does not interrupt its own
///   priority), one for each rank. Ranks number the loops by rate, from 0 for the fastest. The
///   vector of rank 0 is the timer's: nothing is faster, so the fastest loop runs in the handler
///   that releases it. Each other rank has a vector, whose priority is lower than that of the rank
///   before, and whose handler calls [`Scheduler::on_vector`](crate::Scheduler::on_vector).
pub trait Platform: Timer {
    /// Whether each rank has a hardware vector of its own.
    const VECTORS: bool = false;

    /// Pends the vectors of `ranks`; bit *n* stands for rank *n*.
    ///
    /// Called only if [`VECTORS`](Self::VECTORS) is true.
    fn pend(&self, ranks: u32) {
        let _ = ranks;
    }

    /// Returns true if the caller runs on the stack on which loops nest by calls. Otherwise makes an interrupt
    /// come soon on that stack, and returns false.
    ///
    /// The default returns true: a bare-metal processor has only one such stack.
    fn is_loops_stack(&self) -> bool {
        true
    }

    /// Returns true if the timer's interrupt has a handler, or if that cannot be known. Without a handler no
    /// loop would ever be released, so the schedule does not start.
    fn has_handler(&self) -> bool {
        true
    }

    /// Runs `program`; while it runs, the timer's interrupt calls `handler`. A scheduler passes a
    /// handler that calls [`Scheduler::on_timer`](crate::Scheduler::on_timer).
    ///
    /// The default only calls `program`; it is for processors whose interrupts are connected when
    /// the program is linked.
    ///
    /// # Errors
    /// [`ConnectError`] if the handler cannot be connected; `program` has not run then.
    fn connect<R>(
        &self,
        handler: impl Fn() + Sync,
        program: impl FnOnce() -> R,
    ) -> Result<R, ConnectError> {
        let _ = handler;
        Ok(program())
    }

    /// Calls `body`, the body of the loop of `rank`, so that the timer and the vectors can
    /// interrupt it.
    ///
    /// If ranks have vectors, the call is enough.
    fn interruptible(&self, rank: u32, body: impl FnOnce());

    /// Runs `f` in a critical section: that of the `critical-section` crate, or a faster one that
    /// excludes the same contexts.
    #[inline(always)]
    fn masked<R>(&self, f: impl FnOnce(CriticalSection<'_>) -> R) -> R {
        crate::sync::critical_section(f)
    }
}

impl<P: Platform + ?Sized> Platform for &P {
    const VECTORS: bool = P::VECTORS;

    #[inline]
    fn pend(&self, ranks: u32) {
        P::pend(self, ranks);
    }

    #[inline]
    fn is_loops_stack(&self) -> bool {
        P::is_loops_stack(self)
    }

    #[inline]
    fn has_handler(&self) -> bool {
        P::has_handler(self)
    }

    fn connect<R>(
        &self,
        handler: impl Fn() + Sync,
        program: impl FnOnce() -> R,
    ) -> Result<R, ConnectError> {
        P::connect(self, handler, program)
    }

    #[inline]
    fn interruptible(&self, rank: u32, body: impl FnOnce()) {
        P::interruptible(self, rank, body);
    }

    #[inline(always)]
    fn masked<R>(&self, f: impl FnOnce(CriticalSection<'_>) -> R) -> R {
        P::masked(self, f)
    }
}
