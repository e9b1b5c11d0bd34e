// The first definition of a link counts: here those of README.md lead to items instead of files.
#![doc = include_str!("../README.md")]
#![cfg_attr(not(any(feature = "std", test)), no_std)]

// The layout that both sides know.
mod area;
pub use area::{
    AREA_BYTES, DebugRequest, FRAME_REGISTERS, HoldReason, MOST_PLANTED, PLANTED, Trigger,
    TriggerAccess,
};

// The processor's side.
mod arch;
mod stub;
pub use arch::Arch;
pub use stub::{Stub, TrapOutcome};

// The host's side.
#[cfg(feature = "gateway")]
mod tracer;
#[cfg(feature = "gateway")]
pub use tracer::{Breakpoint, PlantedBreakpoint, ProgramState, Tracer, TracerError};
#[cfg(all(feature = "gateway", target_os = "linux"))]
pub mod gateway;

// Live watch.
#[cfg(feature = "names")]
pub mod names;

// The second implementation of `Arch`.
#[cfg(feature = "sim")]
pub mod sim;

// Functions that tests and fuzz targets call with arbitrary bytes.
#[cfg(all(feature = "hostile", target_os = "linux"))]
#[doc(hidden)]
pub mod hostile;
