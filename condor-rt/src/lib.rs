// The first definition of a link counts: here those of README.md lead to items instead of files.
//! [error]: enum@Error
//! [setup]: Setup
//! [program]: Program
//! [machine]: Machine
//!
#![doc = include_str!("../README.md")]
#![cfg_attr(not(any(feature = "std", test)), no_std)]

// A program.
mod error;
mod list;
mod running;
mod servo;
mod setup;
mod variables;

// What it needs of its processor.
mod interrupts;
mod machine;
pub mod numbers;
mod silent;

// What it shows of itself.
pub mod directory;
pub mod loops;

// The machines.
#[cfg(all(
    feature = "linux",
    target_os = "linux",
    any(
        target_arch = "x86_64",
        target_arch = "aarch64",
        target_arch = "riscv64"
    )
))]
pub mod linux;
#[cfg(all(
    feature = "sim",
    target_os = "linux",
    any(
        target_arch = "x86_64",
        target_arch = "aarch64",
        target_arch = "riscv64"
    )
))]
pub mod sim;

pub use error::{Error, Text};
pub use interrupts::Interrupts;
pub use machine::{Machine, MailboxOf, Program};
pub use numbers::PROCESSORS;
pub use running::{Background, Call, ConsoleOf, FILES, FilesOf, Tick};
pub use servo::{LOOPS, ServoLoop, on_one_stack};
pub use setup::{Body, HANDLERS, Handler, Setup, users};
pub use silent::Silent;
pub use variables::VARIABLES;
