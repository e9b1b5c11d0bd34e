#![doc = include_str!("../README.md")]

mod fault;
mod keys;
mod places;
mod read;
mod text;
mod whole;

pub use fault::{Fault, suggest};
pub use keys::Keys;
pub use read::read;
pub use text::{Text, TextError, TextErrors};
pub use toml::Spanned;
pub use whole::Whole;
