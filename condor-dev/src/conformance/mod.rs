//! Suites that check your own backend, called from one test or from firmware.
//!
//! Each function runs the checks of one trait and ends at the first that fails.

mod bus;
mod interrupt_controller;

pub use bus::{BusAccess, BusFailure, BusMemory, bus};
pub use interrupt_controller::{ControllerFailure, interrupt_controller};
