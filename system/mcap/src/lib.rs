#![doc = include_str!("../README.md")]
#![cfg_attr(not(test), no_std)]
#![forbid(unsafe_code)]

mod pairs;
mod reader;
mod record;
mod writer;

pub use pairs::NamePairs;
pub use reader::{McapError, McapReader, McapRecord};
pub use record::MessageHead;
pub use writer::McapWriter;
