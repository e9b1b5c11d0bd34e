//! A simulated hand: fingers pulled by tendons, an object and a ground that they touch, and their
//! sensors.
//!
//! A [`SimFinger`] is a mechanism with [`Kinematics`](crate::kinematics::Kinematics) and
//! [`Dynamics`](crate::dynamics::Dynamics), [`JointParameters`] and one [`SimDrive`] for each tendon.
//! A [`SimHand`] has fingers, a [`SimObject`] and a [`SimGround`] that their tips touch, and a [`SimTable`]
//! that carries the palm. A [`SensorBank`] converts the state into the readings of converters, with
//! noise and scripted [`SensorFault`]s.
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
mod sensor;
mod table;

// Fingers.
pub use drive::{DriveKind, SimDrive};
pub use finger::{FingerParameters, SimFinger};
pub use joint::{JointParameters, SimStop};
pub use pneumatic::{Elastic, Pneumatic};

// Hands from a configuration.
pub use configured::PlantModel;

// The objects that they touch, and the table that carries them.
pub use contact::{SimContact, SimGround, SimSurface};
pub use hand::{HandParameters, SimHand};
pub use object::{ObjectParameters, SimObject};
pub use table::{AxisParameters, SimTable};

// Their sensors.
pub use noise::Noise;
pub use sensor::{Sensor, SensorBank, SensorFault, SensorFaultKind};
