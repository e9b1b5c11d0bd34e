//! Servo loops at exact rates, on one stack.
#![cfg_attr(not(any(feature = "std", condor_loom, test)), no_std)]

// Documents of their own.
#[cfg(all(feature = "cortex-m", target_arch = "arm", target_os = "none"))]
pub mod cortex_m;
#[cfg(all(
    feature = "riscv",
    any(target_arch = "riscv32", target_arch = "riscv64")
))]
pub mod riscv;
#[cfg(feature = "sim")]
pub mod sim;

// How often.
mod clock;
mod instant;
mod rate;
mod schedule;

// The machine.
mod platform;
mod timer;

// The scheduler.
mod body;
mod ceiling;
mod error;
mod masked;
mod process;
mod scheduler;
mod scope;
mod state;
mod statistics;

pub use ceiling::CeilingLock;
pub use clock::Clock;
pub use error::{LockError, LoopError, RateError, StartError};
pub use instant::{Instant, Wrapping};
pub use platform::Platform;
pub use process::Overrun;
pub use rate::Rate;
pub use schedule::{Event, EventTable, Scan, Schedule};
pub use scheduler::{LoopId, Scheduler};
pub use scope::Scope;
pub use statistics::Statistics;
pub use timer::{Armed, Timer};
