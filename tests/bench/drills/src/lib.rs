//! Programs for any processor: the same text for harts and for processes of Linux.
//!
//! * [`Stress`]: everybody sends to everybody, nested, from loops, handlers and backgrounds, and counts.
//! * [`Order`]: what comes when, in one simulated time for all.
//! * [`Table`]: how long a message takes, with and without reply; with [`Echo`] at its other end.
//!
//! What harts alone can run is in the image `tests/bench/drills/hart`; what it leaves behind is here:
//! [`instructions`].
#![cfg_attr(not(feature = "alone"), no_std)]
#![forbid(unsafe_code)]

#[cfg(feature = "alone")]
pub mod alone;
pub mod instructions;
pub mod order;
pub mod stress;
pub mod table;

mod arguments;
mod published;

pub use order::Order;
pub use published::published;
pub use stress::Stress;
pub use table::{Echo, Table};

/// The error text of a drill that has counted something wrong.
pub const WRONG: &str = "something is wrong; see the counts";

/// Returns the error of a processor that is not ready in time.
fn late(processor: condor_mbox::Processor) -> condor_rt::ProgramError {
    let number = processor.0;
    condor_rt::ProgramError::program(&format_args!("processor {number} is not ready in time"))
}
