//! Uses every call of `condor-dev` that runs without an operating system, over boards that are
//! memory: what is written to a register is read from it.
#![no_std]

mod calls;
mod memory;

pub use calls::{everything, memory};
pub use memory::BASE;
