//! [`Platform`]: how loops come to interrupt each other.

use critical_section::CriticalSection;

use crate::error::ConnectError;
use crate::timer::Timer;

/// A [`Timer`], and the way in which its processor nests loops.
///
/// # For implementers
/// There are two ways, and what runs next is decided elsewhere in both:
///
/// * *By a call on the interrupted stack* (RISC-V, signals, the simulator): what is left out below.
///   The timer's interrupt calls [`Scheduler::on_timer`](crate::Scheduler::on_timer), which calls the
///   loops through [`interruptible`](Self::interruptible).
/// * *By hardware vectors* (the NVIC of Cortex-M, where an interrupt does not interrupt its own
///   priority), one for each rank. That of rank 0 is the timer's: nothing is faster, so the fastest
///   loop runs where it is released. Each of the others has a vector whose priority is lower than the
///   one before, and which calls [`Scheduler::on_vector`](crate::Scheduler::on_vector).
pub trait Platform: Timer {
    /// Whether ranks have vectors.
    const VECTORS: bool = false;

    /// Pends the vectors of `ranks`, a bit for each.
    ///
    /// Called, if at all, only where there are [`VECTORS`](Self::VECTORS).
    fn pend(&self, ranks: u32) {
        let _ = ranks;
    }

    /// Whether the caller's stack is that of the loops, if they nest by calls. If not, has their own
    /// context be interrupted soon.
    ///
    /// A processor has one stack, and nothing else.
    fn is_loops_stack(&self) -> bool {
        true
    }

    /// Whether interrupts have something to call, as far as that can be known: without it nothing
    /// would ever be released, and a schedule cannot begin.
    fn has_handler(&self) -> bool {
        true
    }

    /// Runs `program`, while the timer's interrupt calls `handler`, which calls
    /// [`Scheduler::on_timer`](crate::Scheduler::on_timer).
    ///
    /// A processor whose interrupts are connected when its program is linked does no more than that
    /// call.
    ///
    /// # Errors
    /// [`ConnectError`]; `program` has not run then.
    fn connect<R>(
        &self,
        handler: impl Fn() + Sync,
        program: impl FnOnce() -> R,
    ) -> Result<R, ConnectError> {
        let _ = handler;
        Ok(program())
    }

    /// Runs the body of the loop of a rank so that the timer, and vectors, can interrupt it.
    ///
    /// Where ranks have vectors, the call is all.
    fn interruptible(&self, rank: u32, body: impl FnOnce());

    /// Runs `f` in a critical section: that of the `critical-section` crate, or one that is quicker
    /// to enter and excludes all contexts which that one excludes.
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
