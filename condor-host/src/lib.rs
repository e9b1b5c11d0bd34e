#![doc = include_str!("../README.md")]
#![cfg_attr(not(any(feature = "std", test)), no_std)]

// What a program needs of its processor, and shows of itself.
pub mod directory;
pub mod loops;
mod machine;
pub mod numbers;

pub use machine::{Machine, Program};
pub use numbers::PROCESSORS;

// The program `condor`.
#[cfg(feature = "program")]
pub mod cli;
#[cfg(feature = "program")]
pub mod control;
#[cfg(feature = "program")]
pub mod description;
#[cfg(feature = "program")]
pub mod services;
#[cfg(feature = "program")]
pub mod supervisor;
#[cfg(feature = "program")]
pub mod system;
