#![doc = include_str!("../README.md")]
#![cfg_attr(not(any(feature = "std", test)), no_std)]

// What a program needs of its processor, and shows of itself.
pub mod directory;
pub mod loops;
mod machine;
pub mod numbers;
mod silent;

// The machines.
#[cfg(all(feature = "sim", target_os = "linux"))]
pub mod sim;

pub use machine::{Machine, Program};
pub use numbers::PROCESSORS;
pub use silent::{NobodyAnswers, Silent};
