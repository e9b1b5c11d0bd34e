//! Servo loops on Linux: in threads, or in signal handlers on one stack.
//!
//! | | [`Threads`] | [`SignalPlatform`] |
//! |---|---|---|
//! | a loop is | a thread | a call on the stack of the background |
//! | a loop may | do anything | do what a signal handler may; see [`SignalPlatform::new`] |
//! | to construct | safe | `unsafe`, with a contract |
//! | a release costs | a wake-up and two changes of threads | a signal and one system call |
//! | faster before slower | by `SCHED_FIFO`, where granted | always |
//! | a panic | disables its loop | ends the program |
//!
//! A [`RealTime`] lists the privileges that are asked of the kernel; the kernel's answers are [`Privileges`], which
//! can be printed. Code that takes a `&impl` [`Loops`](crate::Loops) runs on both, on bare
//! processors and in virtual time: see the example `two_rates`.
//!
//! # Critical sections
//!
//! [`SignalPlatform`] need the feature `critical-section` of condor-platform, and no other implementation
//! of critical sections in the program: with that of std a signal could enter the section that it
//! has interrupted. A platform checks this when it is connected. [`Threads`] do not use critical
//! sections.

mod context;
mod pi_mutex;
mod posix_timer;
mod real_time;
mod signals;
mod threads;
mod time;

pub use real_time::{Privileges, RealTime};
pub use signals::SignalPlatform;
pub use threads::Threads;
pub use time::CLOCK;
