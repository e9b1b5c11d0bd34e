//! The suites that a backend of one's own calls from one test, or from a firmware.
//!
//! Each function runs the checks of one trait and ends at the first that fails.

mod doorbell;
mod limits;
mod outcome;
mod window;

pub use doorbell::{DoorbellFailure, doorbell};
pub use limits::LEAST_BYTES;
pub use outcome::{Outcome, WindowFailure};
pub use window::{compare_exchange, read_only, shared, window};
