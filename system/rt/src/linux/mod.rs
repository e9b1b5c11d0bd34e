//! Programs as processes of Linux.
//!
//! Most programs need [`run`] alone. It reads the processor's number and its other settings, an [`Environment`], from
//! the environment variable `CONDOR_PROCESS`, which a supervisor has set, runs the program, and prints why it failed.
//!
//! # Simulated time
//!
//! With a [`clock`](Environment::clock), the clock, the timer and all deadlines of the program are those of the
//! system's simulated clock, and [`loops`](Environment::loops) has no meaning: loops run where the background waits.
//! Programs do not differ; what takes time is said in the [module of virtual time](crate::sim).
//!
//! # Threads, spinning or signals
//!
//! | | `threads` | `spin` | `signals` |
//! |---|---|---|---|
//! | a loop runs | in a thread of its own | where the background polls the timer | in a signal handler, on the stack of the background |
//! | while a loop runs, the background and slower loops | can run on other cores | do not run; but a loop cannot interrupt them | do not run; the loop has interrupted them |
//! | messages are served | by a thread of their own, even while the background computes | while the background waits | while the background waits |
//! | boards interrupt | in a thread of their own | where the background polls the timer | in a thread of their own; with a priority, and on the same core, where the background waits |
//! | a loop that panics; with [`hold_exceptions`](Environment::hold_exceptions) the process stops first | is disabled, and counts as `faulted` | ends the program | ends the program |
//! | `main` calls | [`run`] | [`run`] | [`run_allowing_signals`], which is `unsafe` |
//! | the [`priority`](Environment::priority) applies to | the fastest loop; each slower loop has the next lower priority | the program | the program |
//!
//! With `threads`, a loop, a message handler and the background can run at the same time. Data that
//! they share must lie in the windows, in an atomic or in a [`Latest`](crate::Latest), or be used only
//! inside critical sections: those of the machine's [`exclusion`](crate::Machine::exclusion) or of the
//! `critical-section` crate. Only one critical section runs at a time. A thread that holds such a section or lock
//! inherits the priority of the most urgent thread that waits for it. Handlers run one at a time; the messages
//! of each sender are handled in the order in which it sent them, whichever thread serves. The
//! thread that serves the boards' interrupts has a priority below that of all loops, and the one that
//! serves messages the next lower one; the background has the ordinary policy.
//!
//! With `spin` the program takes a whole core. The background polls the timer whenever it waits or
//! reads the doorbell's clock (a mailbox that waits reads that clock again and again), and runs the
//! loops that are due at that point. Neither a signal nor a system call lies between the instant at
//! which a loop is due and its start. But loops interrupt neither the background while it computes
//! nor each other, so long computations make loops late.
//!
//! With `signals` the timer's signals interrupt the background and slower loops at any instruction:
//! see [`SignalPlatform`](condor_mos::linux::SignalPlatform). Loops must then keep the rules of a signal handler,
//! so `main` has to allow it by an `unsafe` call.

mod bell;
mod bus;
mod clock;
mod environment;
mod error;
mod interrupts;
mod process;
mod run;
mod sections;
mod serial;
mod spinner;
mod timer;

pub use bell::ProcessBell;
pub use bus::ProcessBus;
pub use clock::{Bells, HostBell, HostClock, HostMailbox, MappedPage};
pub use environment::{Environment, FileRange, LoopContext, UioDevice};
pub use error::ProcessError;
pub use interrupts::ProcessInterrupts;
pub use process::LinuxProcess;
pub use run::{run, run_allowing_signals};
pub use sections::ProcessSections;
