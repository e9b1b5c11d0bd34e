//! A whole system in one process and in virtual time: deterministic, as fast as the host allows.
//!
//! The program of each processor runs on a thread of its own. The threads share a [simulated
//! clock](condor_clock), in nanoseconds since the common beginning: exactly one of them runs at any
//! moment, and the order depends on that clock alone.
//!
//! [`VirtualSystem::files`] runs a file service, which serves a directory, in the same virtual time.
//!
//! # What takes time
//!
//! | action | time that passes |
//! |---|---|
//! | a [wait](condor_mbox::Doorbell::wait) | its whole length; others run meanwhile |
//! | a loop | the time that [`VirtualSystem::set_work`] declares, after its body; faster loops can interrupt it then |
//! | reading a clock in the background | nothing, but 100 µs at the thousandth reading in a row, so that polling ends |
//! | anything else | nothing; inside of loops and handlers of the timer the clock stands still |
//!
//! The timer interrupts at exactly the instant for which it is armed: in waits, and while a slower
//! loop spends its declared time.
//!
//! # What a program must not do
//!
//! A program must not hold a lock of the host, such as a mutex, while it waits or reads its clock:
//! other programs run meanwhile. A loop or a timer handler must not poll a clock, as a waiting
//! mailbox does: no time passes there, and after a million readings the program is ended.

mod error;
mod files;
mod processor;
mod system;

pub use error::{Cause, SimError, SimFailure};
pub use processor::{Bell, SimCriticalSection, SimMachine, TurnHandover, VirtualTimer};
pub use system::VirtualSystem;
