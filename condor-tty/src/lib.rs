// The first definition of a link counts: here those of README.md lead to items instead of files.
#![cfg_attr(feature = "linux", doc = "[linux]: mod@linux")]
//! [wire]: mod@layout
//! [terminal]: Terminal
//! [console]: Console
//! [policy]: Policy
//! [reader]: TerminalReader
//! [editor]: LineEditor
//!
#![doc = include_str!("../README.md")]
#![cfg_attr(not(any(feature = "std", condor_loom, test)), no_std)]

// Documents of their own.
// Functions that tests and fuzz targets call with arbitrary bytes.
#[cfg(all(feature = "hostile", not(condor_loom)))]
#[doc(hidden)]
pub mod hostile;
pub mod layout;
#[cfg(feature = "linux")]
pub mod linux;

mod console;
mod editor;
mod error;
mod input;
mod output;
mod policy;
mod reader;
mod settings;
mod sync;
mod terminal;

// The processor's end.
pub use console::{Console, Poster};
pub use editor::{Complete, InputLine, LineEditor};
pub use error::{ConsoleError, TerminalError};
pub use input::InputResult;
pub use policy::Policy;
pub use settings::{Characters, InputMode, TerminalSettings};
pub use terminal::Terminal;

// The host's end, anywhere.
pub use reader::{FetchedOutput, TerminalReader, TerminalReaderError, TerminalStatus};

// Both ends.
pub use layout::TerminalVectors;
