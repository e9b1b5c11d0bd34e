//! The suites that a backend of one's own calls from one test, or from a firmware.
//!
//! Each function runs the checks of one trait and ends at the first that fails.

mod bus;
mod interrupt_controller;

pub use bus::{Access, BusFailure, Ground, bus};
pub use interrupt_controller::{ControllerFailure, interrupt_controller};
