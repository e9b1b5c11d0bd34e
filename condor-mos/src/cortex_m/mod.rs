//! Cortex-M: loops in interrupt vectors of the NVIC, and the core's own counter as a timer.
//!
//! A core of this family does not let an interrupt interrupt its own priority, so loops cannot nest
//! by a call from the timer's handler. [`Vectors`] gives each rank but the fastest, which runs in the
//! timer's, an interrupt that the chip has to spare, and makes a [`Platform`](crate::Platform) of any
//! [`Alarm`](crate::Alarm): a timer of the chip's, or the one here.
//!
//! [`Ticks`] is a timer that every core has: periods of `SysTick`, which are counted without loss.
//! (`SysTick` restarted for each release would lose the cycles between reading and restarting it.)
//! For releases at instants finer than that, implement [`Timer`](crate::Timer) for a compare of
//! the chip's own.
//!
//! ```ignore
//! // 16 MHz, of which SysTick makes 2 kHz; four levels of priority; two interrupts to spare.
//! static SCHEDULER: Scheduler<Vectors<Ticks, 2>, 3, 8> = Scheduler::new(
//!     Vectors::new(Ticks::new(16_000_000, 8_000), [20, 21], 2),
//!     EventTable::new(&[Rate::hz(400), Rate::hz(100), Rate::hz(50)], Ticks::clock(16_000_000, 8_000)),
//! );
//!
//! #[exception]
//! fn SysTick() {
//!     SCHEDULER.platform().timer().on_tick();
//! }
//!
//! #[exception]
//! fn PendSV() {
//!     SCHEDULER.on_timer();
//! }
//!
//! #[interrupt]
//! fn SPARE_20() {
//!     SCHEDULER.on_vector(1);
//! }
//! // And so on for the other one.
//! ```
//!
//! The crate `cortex-m` has a critical section for cores that are alone in their chip
//! (`critical-section-single-core`); which one to use is the program's choice.

mod ticks;
mod vectors;

pub use ticks::Ticks;
pub use vectors::Vectors;
