//! [`Platform`]: how loops come to interrupt each other.

use crate::timer::Timer;

/// A [`Timer`], and the way in which its processor nests loops.
///
/// # For implementers
/// There are two ways, and what runs next is decided elsewhere in both:
///
/// * *By a call on the interrupted stack* (RISC-V, signals, the simulator). The timer's interrupt
///   calls [`Scheduler::on_timer`](crate::Scheduler::on_timer); [`dispatch`](Self::dispatch) calls `run`, and
///   [`interruptible`](Self::interruptible) lets the timer interrupt what it calls, with all that an
///   interrupt destroys saved around it.
/// * *By one hardware vector for each rank* (the NVIC of Cortex-M, where an interrupt does not
///   interrupt its own priority). Rank 0 has the highest priority below the timer's.
///   [`dispatch`](Self::dispatch) pends the vectors of `ranks`, each of which calls
///   [`Scheduler::on_vector`](crate::Scheduler::on_vector), and [`interruptible`](Self::interruptible) only calls.
pub trait Platform: Timer {
    /// Has the loops of `ranks`, a bit for each, run: by `run`, or by their vectors.
    ///
    /// Called wherever a loop may have become free to start, interrupts masked or not.
    fn dispatch(&self, ranks: u32, run: impl FnOnce());

    /// Runs the body of a loop so that the timer can interrupt it.
    fn interruptible(&self, body: impl FnOnce());
}

impl<P: Platform + ?Sized> Platform for &P {
    #[inline]
    fn dispatch(&self, ranks: u32, run: impl FnOnce()) {
        P::dispatch(self, ranks, run);
    }

    #[inline]
    fn interruptible(&self, body: impl FnOnce()) {
        P::interruptible(self, body);
    }
}
