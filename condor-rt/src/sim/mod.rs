//! A whole system in one process and in virtual time: deterministic, as fast as the host allows.
//!
//! The program of each processor runs on a thread of its own, but one baton passes between the
//! threads, so exactly one runs at any moment, and the order depends on virtual time alone. Each
//! processor has a clock of its own, in nanoseconds since the beginning of all of them; the baton goes to
//! whoever goes on first, of several to the one with the least number.
//!
//! [`System::files`] has the file service serve a directory in the same time.
//!
//! # What takes time
//!
//! | | takes |
//! |---|---|
//! | a [wait](condor_mbox::Doorbell::wait) | as long as it lasts, and gives the baton away |
//! | reading a clock in the background | [`CLOCK_NS`], so that polling ends |
//! | a loop | what [`System::set_work`] says, after its body; faster loops interrupt it meanwhile |
//! | anything else | nothing; inside of loops and handlers of the timer the clocks stand still |
//!
//! The timer interrupts at exactly the instant it is armed for, in waits, while the doorbell's
//! clock is read, and while a slower loop takes its time. Reading the timer itself lets no interrupt
//! in, since schedulers do so in critical sections, and takes time only if it is done a hundred times
//! in a row. A background that only reads its clock gives the baton away when it is [`LEAD_NS`]
//! ahead of another processor.
//!
//! # What a program must not do
//!
//! Hold a lock of the host's, such as a mutex, while it waits or reads its clock: others run
//! meanwhile. Poll a clock in a loop, as a mailbox does that waits: time does not pass, and after a
//! million readings the program is ended.

mod baton;
mod doorbell;
mod error;
mod exclusion;
mod files;
mod processor;
mod system;
mod timer;

pub use baton::LEAD_NS;
pub use doorbell::Bell;
pub use error::{Cause, Failure, SimError};
pub use exclusion::Uninterrupted;
pub use processor::{CLOCK_NS, Processor};
pub use system::System;
pub use timer::VirtualTimer;
