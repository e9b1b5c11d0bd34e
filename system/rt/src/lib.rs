// The first definition of a link counts: here those of README.md lead to items instead of files.
//! [error]: enum@ProgramError
//! [setup]: Setup
//! [stdio]: Stdio
//! [program]: Program
//! [machine]: Machine
//!
#![doc = include_str!("../README.md")]
#![cfg_attr(not(any(feature = "std", test)), no_std)]

// Documents of their own.
#[cfg(all(feature = "sim", target_os = "linux"))]
#[doc = include_str!("../MISTAKES.md")]
pub mod mistakes {}

// A program.
mod descriptors;
mod error;
mod list;
mod running;
mod servo;
mod setup;
mod stdio;
mod text;
mod variables;

// The parts that a program needs of its processor.
mod interrupts;
mod lines;
mod machine;
pub mod numbers;
mod silent;
#[cfg(target_has_atomic = "64")]
pub mod simulated;

// The parts by which a program shows its state.
pub mod loops;
pub mod objects;
pub mod shared_log;

// The requests of a program to its host.
pub mod supervisor;

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

// The items of the crates below that most programs need, so that they depend on this one alone.
pub use condor_dev::stdio::Buffering;
pub use condor_fs::{OpenOptions, Read, Seek, SeekFrom, Write};
pub use condor_mbox::{Messenger, Processor, Vector};
pub use condor_mos::{Latest, Rate};
pub use condor_vars::{Param, Params, Var, Vars};

pub use descriptors::{DESCRIPTORS, Descriptor, STDERR, STDIN, STDOUT, StdioCause, StdioError};
pub use error::ProgramError;
pub use interrupts::Interrupts;
pub use lines::{BoardLines, FIRST_LINE, LineState, Raiser, SERIAL, SERIAL_VECTOR};
pub use machine::{Machine, MailboxOf, Program};
pub use numbers::PROCESSORS;
pub use running::{Background, ConsoleOf, FILES, FilesOf, HandlerCall, LoopTick};
pub use servo::{LOOPS, ServoLoop, on_one_stack};
pub use setup::{HANDLERS, ListenerFunction, LoopFunction, MessageHandler, Setup, users};
pub use silent::Silent;
pub use stdio::{Stdio, Stream};
pub use text::ShortText;
pub use variables::VARIABLES;
