//! The harts of QEMU's RISC-V machine `virt` as processors of a robot, whose host maps all of their
//! memory.
//!
//! A program is a function from a [`Hart`], which is the [`Machine`](condor_rt::Machine) of any
//! program of `condor-host`, to a status; [`program!`] makes it the entry of an image:
//!
//! ```ignore
//! #![no_std]
//! #![no_main]
//! board::program!(main);
//!
//! fn main(hart: board::Hart) -> u32 {
//!     board::run(&Servo, &hart)
//! }
//! ```
//!
//! Images are position-independent: the host puts one and the same into the ranges of several harts,
//! so that statics are of one hart. Where they come from, and where they end, is the monitor.
#![no_std]

// The board.
mod machine;
mod memory;

// The interrupts of harts, by which they also interrupt each other and the host.
mod bell;
mod boards;
mod debug;
mod hooks;
mod link;
mod msip;
mod serial;
mod trap;
mod triggers;

// The parts that a program uses.
mod hart;
mod program;
mod run;
mod simulated;
pub mod stack;

pub use bell::HartBell;
pub use boards::HartInterrupts;
pub use hart::{Hart, HartTimer};
pub use machine::MTIME;
pub use memory::memory;
pub use program::{start, status};
pub use run::run;

/// Functions for the monitor, which is the program that a hart runs while it has no other program.
pub mod resident;
