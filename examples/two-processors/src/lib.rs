//! The programs of two processors: a servo that holds a joint, and a master that moves it.
#![no_std]

mod master;
mod panel;
mod servo;

pub use master::Master;
pub use servo::Servo;

use condor_rt::{Processor, Vector};

/// The processor that runs [`Servo`], by its number in `condor.toml`.
pub const SERVO: Processor = Processor(1);
/// The vector of requests to [`Servo`] to move the joint. The word of the message is the angle in mrad; the reply is
/// the present angle in mrad.
pub const MOVE: Vector = Vector(1);
/// The vector of questions to [`Servo`] for the present angle of the joint. The reply is the angle in mrad.
pub const WHERE: Vector = Vector(2);
