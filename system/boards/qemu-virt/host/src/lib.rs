#![doc = include_str!("../README.md")]
#![cfg_attr(not(any(feature = "std", test)), no_std)]

mod control;
#[cfg(feature = "extension")]
mod debuggee;
#[cfg(feature = "extension")]
mod extension;
#[cfg(feature = "extension")]
mod hart;
#[cfg(feature = "host")]
mod image;
pub mod map;
#[cfg(feature = "host")]
mod memory;
#[cfg(feature = "host")]
mod qemu;
#[cfg(feature = "extension")]
pub mod service;

pub use condor_clock::LOOPS;
pub use control::{
    ARGUMENT_BYTES, Control, ERROR_BYTES, HartFault, HartState, StartOrder, cause_name,
};
#[cfg(feature = "extension")]
pub use extension::HARTS;
#[cfg(feature = "extension")]
pub use hart::{HartError, HartLauncher, Power};
#[cfg(feature = "host")]
pub use image::{HartImage, HartImageError, RAM};
pub use map::{Map, MemoryMapError, ObjectRun};
#[cfg(feature = "host")]
pub use memory::{MachineMemory, MemoryError};
#[cfg(feature = "host")]
pub use qemu::Qemu;
