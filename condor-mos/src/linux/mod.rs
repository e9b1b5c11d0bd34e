//! Servo loops on Linux: in threads, or in signal handlers on one stack.
//!
//! | | [`Threads`] | [`Signals`] |
//! |---|---|---|
//! | a loop is | a thread | a call on the stack of the background |
//! | a loop may | do anything | do what a signal handler may; see [`Signals::with_handler`] |
//! | to construct | safe | `unsafe`, with a contract |
//! | a release costs | a wake-up and two changes of threads | a signal and one system call |
//! | faster before slower | by `SCHED_FIFO`, where granted | always |
//! | data between loops | [`InheritanceLock`], or any mutex | [`CeilingLock`](crate::CeilingLock) |
//! | a panic | disables its loop | ends the program |
//!
//! What the kernel is asked for is a [`RealTime`], and what it answers, [`Privileges`], can be
//! printed.
//!
//! # One program for threads, signals and bare metal
//!
//! Loops are closures or functions that know nothing of where they run. [`Threads`] and a
//! [`Scheduler`](crate::Scheduler), over [`Signals`] or the platform of a bare processor, have the
//! same calls with the same types, so only the lines that set them up differ:
//!
//! | | [`Threads`] | [`Scheduler`](crate::Scheduler) |
//! |---|---|---|
//! | made by | `Threads::new(rates, wishes)` | `Scheduler::new(platform, table)` |
//! | loops | `scope(\|s\| s.assign(id, overrun, &mut closure))` | the same |
//! | | `start`, `stop`, `enable`, `disable`, `set_rate`, `statistics` | the same |
//! | shared data | `lock.lock(&threads, \|data\| …)` | `lock.lock(&scheduler, \|data\| …)` |
//! | the interrupt | | `platform.with_handler(\|\| scheduler.on_timer(), background)` |
//!
//! The example `two_rates` runs the same loops on both.
//!
//! # Critical sections
//!
//! [`Signals`] need the feature `critical-section` of condor-platform, and no other implementation of
//! critical sections in the program: that of std would let a signal walk into the section that
//! it has interrupted. [`Signals::with_handler`] looks. [`Threads`] do not use critical sections.

mod context;
mod error;
mod pi_mutex;
mod posix_timer;
mod real_time;
mod signals;
mod threaded;
mod threads;
mod time;

pub use error::{SignalError, ThreadError};
pub use pi_mutex::InheritanceLock;
pub use real_time::{Privileges, RealTime};
pub use signals::Signals;
pub use threads::{ThreadScope, Threads};
pub use time::CLOCK;
