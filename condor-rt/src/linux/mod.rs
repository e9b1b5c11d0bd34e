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
//! | `CONDOR_LOOPS` | `signals` or `spin`; without it `signals` |
//! | `CONDOR_CPU` | the core for the program; without it any |
//! | `CONDOR_PRIORITY` | 1 to 99 of `SCHED_FIFO`; without it the ordinary policy |
//!
//! # Signals or spinning
//!
//! With `signals` the timer's signals interrupt the background wherever it is, and slower loops, too:
//! see [`Signals`](condor_mos::linux::Signals). A program that does so must keep the promises of a
//! signal handler, so [`run`] is `unsafe`.
//!
//! With `spin` the program takes a core for itself. The background polls the timer whenever it waits
//! or reads the doorbell's clock, as a mailbox does again and again while it waits, and runs there the
//! loops that are due. No signal and no system call is between an instant and its loop. But loops
//! neither interrupt the background while it computes, nor each other: what computes for long makes
//! them late. [`spin`] needs no promise.

mod bell;
mod bus;
mod environment;
mod error;
mod process;
mod run;
mod spinner;
mod timer;

pub use bell::ProcessBell;
pub use bus::ProcessBus;
pub use environment::{BusFile, Environment, Loops};
pub use error::ProcessError;
pub use process::Process;
pub use run::{run, spin};
pub use timer::ProcessTimer;
