//! Programs for any processor: the same text for harts and for processes of Linux.
//!
//! * [`Stress`]: everybody sends to everybody, nested, from loops, handlers and backgrounds, and counts.
//! * [`Table`]: how long a message takes, with and without reply; with [`Echo`] at its other end.
//!
//! What harts alone can run is in the image `bench/drills/hart`; what it leaves behind is here:
//! [`instructions`], [`stack`].
#![cfg_attr(not(feature = "alone"), no_std)]
#![forbid(unsafe_code)]

#[cfg(feature = "alone")]
pub mod alone;
pub mod instructions;
pub mod stack;
pub mod stress;
pub mod table;

mod arguments;
mod failure;
mod published;

pub use failure::Failure;
pub use published::published;
pub use stress::Stress;
pub use table::{Echo, Table};
