//! A simulated hand: fingers with their actuators, and an object that they touch.
//!
//! A [`SimFinger`] is a mechanism with [`Kinematics`](crate::kinematics::Kinematics) and
//! [`Dynamics`](crate::dynamics::Dynamics), [`JointParameters`] and one [`SimDrive`] for each actuator.
//! A [`SimHand`] has fingers, a [`SimObject`] that their tips touch, and a [`SimTable`] that carries the
//! palm.
//!
//! A [`PlantModel`] makes all of that from a configuration, and adds parameters that a
//! configuration does not have.
//!
//! The same calls have the same results, to the last bit, on every target. Nothing here allocates
//! or panics. All vectors are in the axes of the palm.
//!
//! Motion is integrated semi-implicitly: forces at the present state determine the new rates, with
//! friction taken at the new rates, and the new rates determine the new positions. The `MuJoCo`
//! integrator `implicitfast` does the same with joints that have only viscous friction; with
//! [`DriveKind::Euler`] a finger agrees with that program to rounding. Steps of 0.1 ms are stable
//! with contacts of 1e5 N/m.
//!
//! The model does not include the reaction of the fingers on the table, rolling friction, and contact
//! between fingers: they pass through each other.

mod check;
mod configured;
mod contact;
mod drive;
mod finger;
mod hand;
mod joint;
mod noise;
mod object;
mod pneumatic;
mod table;

// Fingers.
pub use drive::{DriveKind, SimDrive};
pub use finger::{FingerParameters, SimFinger};
pub use joint::{JointParameters, SimStop};
pub use pneumatic::Pneumatic;

// Hands from a configuration.
pub use configured::PlantModel;

// The object that they touch, and the table that carries them.
pub use contact::{SimContact, SimSurface};
pub use hand::{HandParameters, SimHand};
pub use object::{ObjectParameters, SimObject};
pub use table::{AxisParameters, SimTable};

// The noise of sensors.
pub use noise::Noise;
