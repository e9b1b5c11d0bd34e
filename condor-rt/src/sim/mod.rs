//! A whole system in one process and in virtual time: deterministic, as fast as the host allows.
//!
//! The program of each processor runs on a thread of its own. One baton passes between the threads,
//! so exactly one thread runs at any moment, and the order depends on virtual time alone. Each
//! processor has its own clock, in nanoseconds since the common beginning. The baton goes to the
//! processor whose next step is due first; if several are due at the same instant, to the one with
//! the least number.
//!
//! [`System::files`] runs a file service, which serves a directory, in the same virtual time.
//!
//! # What takes time
//!
//! | action | time that passes |
//! |---|---|
//! | a [wait](condor_mbox::Doorbell::wait) | its whole length; the baton goes to others meanwhile |
//! | reading a clock in the background | [`CLOCK_NS`], so that polling ends |
//! | a loop | the time that [`System::set_work`] declares, after its body; faster loops can interrupt it then |
//! | anything else | nothing; inside of loops and handlers of the timer the clocks stand still |
//!
//! The timer interrupts at exactly the instant for which it is armed: in waits, while the
//! doorbell's clock is read, and while a slower loop spends its declared time. Reading the timer
//! itself lets no interrupt in, since schedulers do that in critical sections; it takes time only
//! at the hundredth reading in a row. A background that only reads its clock gives the baton away
//! when it is [`LEAD_NS`] ahead of another processor.
//!
//! # What a program must not do
//!
//! A program must not hold a lock of the host, such as a mutex, while it waits or reads its clock:
//! other programs run meanwhile. A loop or a timer handler must not poll a clock, as a waiting
//! mailbox does: no time passes there, and after a million readings the program is ended.

mod baton;
mod error;
mod files;
mod processor;
mod system;
mod time;

pub use baton::LEAD_NS;
pub use error::{Cause, Failure, SimError};
pub use processor::{Bell, Processor, Uninterrupted, VirtualTimer};
pub use system::System;
pub use time::CLOCK_NS;
