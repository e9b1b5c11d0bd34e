//! Cortex-M: loops in interrupt vectors of the NVIC, and the core's own counter as a timer.
//!
//! A core of this family does not let an interrupt interrupt its own priority, so loops cannot nest by a call
//! from the timer's handler. [`VectorPlatform`] assigns to each rank an interrupt that the chip does not use,
//! except to the fastest rank, which runs in the timer's handler. It makes a [`Platform`](crate::Platform) of
//! any [`Alarm`](crate::Alarm): a timer of the chip, or the one here.
//!
//! [`Ticks`] is a timer that every core has: it counts periods of `SysTick` without loss. (If
//! `SysTick` were restarted for each release, the cycles between reading and restarting it would be
//! lost.) For releases at finer instants, implement [`Timer`](crate::Timer) for a compare register
//! of the chip.
//!
//! ```ignore
//! // 16 MHz, of which SysTick makes 2 kHz; four levels of priority; two interrupts to spare.
//! static SCHEDULER: Scheduler<VectorPlatform<Ticks, 2>, 3, 8> = Scheduler::new(
//!     VectorPlatform::new(Ticks::new(16_000_000, 8_000), [20, 21], 2),
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
//! The crate `cortex-m` has an implementation of critical sections for chips with one core
//! (`critical-section-single-core`); the program chooses the implementation.

mod ticks;
mod vectors;

pub use ticks::Ticks;
pub use vectors::VectorPlatform;
