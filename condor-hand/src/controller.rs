//! The controller of fingers as a configuration says: sensors in, commands out, with faults.
//!
//! A [`FingerController`] is a [`FingerServo`](crate::servo::FingerServo) that follows a master's
//! set-points between its ticks, watches for faults, and comes to rest by itself after one.

mod finger;
mod settings;
mod wiring;

pub use finger::{ControllerError, FingerController, Tick};
pub use wiring::{read_finger, write_finger};
