#![doc = include_str!("../README.md")]
#![cfg_attr(not(test), no_std)]
#![forbid(unsafe_code)]

mod pairs;
mod reader;
mod record;
mod writer;

pub use pairs::Pairs;
pub use reader::{ReadError, Reader, Record};
pub use record::Message;
pub use writer::Writer;
