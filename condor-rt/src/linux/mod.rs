//! Programs as processes of Linux.
//!
//! [`run`] is all that most programs need: it takes the processor's number and what belongs to it from
//! the environment, as a supervisor sets it, runs the program and prints why it failed.
//!
//! | variable | |
//! |---|---|
//! | `CONDOR_SYSTEM` | the directory of the mailbox system, as in [`System::at`](condor_mbox::linux::System::at) |
//! | `CONDOR_WINDOW_BYTES` | bytes of users' data of each processor |
//! | `CONDOR_PROCESSOR` | the processor's number |
//! | `CONDOR_BUS` | the file that is the bus, from address 0 on; without it nothing answers on the bus |
//! | `CONDOR_BUS_OFFSET`, `CONDOR_BUS_BYTES` | where in that file the bus is; without them all of the file |
//! | `CONDOR_SHARED_MEMORY`, `…_OFFSET`, `…_BYTES` | the file with the memory that belongs to no processor, and where in it that is |
//! | `CONDOR_LOOPS` | `threads`, `spin` or `signals`; without it `threads` |
//! | `CONDOR_CPU` | the core for the program; without it any |
//! | `CONDOR_PRIORITY` | 1 to 99 of `SCHED_FIFO`; without it the ordinary policy |
//!
//! # Threads, spinning or signals
//!
//! | | `threads` | `spin` | `signals` |
//! |---|---|---|---|
//! | a loop runs | in a thread of its own | where the background polls | in a signal handler, on the stack of the background |
//! | the background, and a slower loop | run on beside it, on another core | cannot be interrupted by it | are interrupted by it |
//! | messages are served | by a thread of their own, while the background computes | where the background waits | where the background waits |
//! | a loop that panics | is disabled, and `faulted` | ends the program | ends the program |
//! | `main` calls | [`run`] | [`run`] | [`run_allowing_signals`], which is `unsafe` |
//! | `CONDOR_PRIORITY` is that of | the fastest loop; each slower one has the next lower | the program | the program |
//!
//! With `threads`, a loop, a handler of messages and the background can run at the same time. What they
//! share lies in the windows, in an atomic, in a [`Latest`](condor_mos::Latest), in a
//! [`LoopLock`](condor_mos::LoopLock), or is used in a section of the machine's
//! [`exclusion`](crate::Machine::exclusion) or of `critical-section`, of which one runs at a time. The
//! thread that holds such a section or lock has the priority of the most urgent one that waits for it.
//! Handlers run one at a time, in the order in which each sender sent, whichever thread serves. Messages
//! have a priority below that of all loops, and the background has the ordinary policy.
//!
//! With `spin` the program takes a core for itself. The background polls the timer whenever it waits
//! or reads the doorbell's clock, as a mailbox does again and again while it waits, and runs there the
//! loops that are due. No signal and no system call is between an instant and its loop. But loops
//! neither interrupt the background while it computes, nor each other: what computes for long makes
//! them late.
//!
//! With `signals` the timer's signals interrupt the background wherever it is, and slower loops, too:
//! see [`Signals`](condor_mos::linux::Signals). A program that does so must keep the promises of a
//! signal handler, so its `main` says so.

mod bell;
mod bus;
mod environment;
mod error;
mod process;
mod run;
mod sections;
mod spinner;
mod timer;

pub use bell::ProcessBell;
pub use bus::ProcessBus;
pub use environment::{Environment, FileRange, Loops};
pub use error::ProcessError;
pub use process::Process;
pub use run::{run, run_allowing_signals};
pub use sections::ProcessSections;
