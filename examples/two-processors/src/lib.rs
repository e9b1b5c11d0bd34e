//! The programs of two processors: a servo that holds a joint, and a master that moves it.
#![no_std]

mod master;
mod servo;

pub use master::Master;
pub use servo::Servo;

use condor_rt::{Processor, Vector};

/// The number of the servo, as in `condor.toml`.
pub const SERVO: Processor = Processor(1);
/// Moves the joint to an angle in mrad; the reply is where it is.
pub const MOVE: Vector = Vector(1);
/// Asks where the joint is; the reply is in mrad.
pub const WHERE: Vector = Vector(2);
