// The first definition of a link counts: here those of README.md lead to items instead of files.
//! [scheduler]: Scheduler
//! [rate]: Rate
//! [table]: EventTable
//! [scan]: Scan
//! [entries]: entries
//! [error]: RateError
//! [id]: LoopId
//! [lock]: LoopLock
//! [loops]: Loops
//! [overrun]: Overrun
//! [statistics]: Statistics
//! [counts]: Counts
//! [analysis]: Analysis
//! [timer]: Timer
//! [platform]: Platform
#![cfg_attr(
    all(feature = "sim", not(target_os = "none")),
    doc = "[sim]: sim::SimPlatform"
)]
//!
#![doc = include_str!("../README.md")]
#![cfg_attr(
    any(target_os = "none", not(any(feature = "std", condor_loom, test))),
    no_std
)]

// Linked, so that a program which asks it for critical sections has them.
#[cfg(feature = "std")]
use condor_platform as _;

// Documents of their own.
#[cfg(feature = "conformance")]
pub mod conformance;
#[cfg(all(feature = "cortex-m", target_arch = "arm", target_os = "none"))]
pub mod cortex_m;
#[cfg(all(feature = "linux", target_os = "linux", not(condor_loom)))]
pub mod linux;
#[cfg(all(
    feature = "riscv",
    any(target_arch = "riscv32", target_arch = "riscv64")
))]
pub mod riscv;
#[cfg(all(feature = "sim", not(target_os = "none")))]
pub mod sim;

// Rates and instants.
mod clock;
mod instant;
mod rate;
mod schedule;

// The machine.
mod platform;
mod timer;

// The scheduler.
mod analysis;
mod body;
mod error;
mod events;
// Tests that need the inside, whose atomics and sections are those of `interrupt_injector`.
#[cfg(all(test, not(condor_loom)))]
#[path = "../tests/inside/mod.rs"]
mod inside;
#[cfg(all(test, not(condor_loom)))]
#[path = "../tests/interrupted/mod.rs"]
mod interrupted;
mod latest;
mod lock;
mod loops;
mod masked;
mod process;
mod record;
mod runner;
mod scheduler;
mod scope;
mod state;
mod statistics;
mod sync;

pub use analysis::{Analysis, Load, ResponseTime};
pub use clock::ClockSpec;
pub use error::{ConnectError, LoopError, LoopLockError, RateError, StartError};
pub use instant::{CounterReading, Wrapping};
pub use latest::{Latest, LatestReader, LatestWriter};
pub use lock::LoopLock;
pub use loops::Loops;
pub use platform::Platform;
pub use process::{LoopId, Overrun};
pub use rate::Rate;
pub use record::{Counts, Histogram, Histograms, Keep, NoStatistics};
pub use schedule::{EventTable, Scan, ScheduleEvent, entries};
pub use scheduler::Scheduler;
pub use scope::Scope;
pub use statistics::Statistics;
pub use timer::{Alarm, Armed, Timer};
