//! Suites that check your own backend, called from one test or from firmware.
//!
//! Each function runs the checks of one trait and ends at the first that fails.

mod doorbell;
mod limits;
mod outcome;
mod window;

pub use doorbell::{DoorbellFailure, doorbell};
pub use limits::LEAST_BYTES;
pub use outcome::{AccessOutcome, WindowFailure};
pub use window::{compare_exchange, read_only, shared, window};
