#![doc = include_str!("../README.md")]
#![cfg_attr(not(any(feature = "hostile", test)), no_std)]
#![forbid(unsafe_code)]

// Functions that tests and fuzz targets call with arbitrary bytes.
#[cfg(feature = "hostile")]
#[doc(hidden)]
pub mod hostile;

mod pairs;
mod reader;
mod record;
mod writer;

pub use pairs::NamePairs;
pub use reader::{McapError, McapReader, McapRecord};
pub use record::MessageHead;
pub use writer::McapWriter;
