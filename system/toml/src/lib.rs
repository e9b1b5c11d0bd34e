#![doc = include_str!("../README.md")]

mod fault;
mod keys;
mod line_table;
mod read;
mod text;
mod whole_number;

pub use fault::{Misreading, suggest};
pub use keys::Keys;
pub use read::read;
pub use text::{SourceText, TextError, TextErrors};
pub use toml::Spanned;
pub use whole_number::WholeNumber;
