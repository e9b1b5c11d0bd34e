//! A simulated hand: fingers pulled by tendons, what they touch, and what their sensors say.
//!
//! A [`Finger`] is a mechanism with [`Kinematics`](crate::kinematics::Kinematics) and
//! [`Dynamics`](crate::dynamics::Dynamics), [`JointParameters`] and one [`Drive`] for each tendon. A
//! [`Hand`] is some fingers, an [`Object`] and a [`Ground`] that their tips touch, and a [`Table`]
//! that carries the palm. A [`SensorBank`] turns what is into what converters report, with noise and
//! scripted [`SensorFault`]s.
//!
//! A [`PlantModel`] makes all of that from a configuration, and what a configuration does not say.
//!
//! The same calls give the same bits, on every target. Nothing here allocates or panics. All
//! vectors are in the axes of the palm.
//!
//! Motion is integrated semi-implicitly: forces at the present state give new rates, with friction
//! taken at the new rates, and the new rates give new positions. This is what the `MuJoCo` integrator
//! `implicitfast` does with joints that have only viscous friction; with [`DriveKind::Euler`] a finger
//! follows that program to rounding. Steps of 0.1 ms bear contacts of 1e5 N/m.
//!
//! Not modelled: what the fingers do to the table, rolling friction, tips that touch each other.

mod configured;
mod contact;
mod drive;
mod error;
mod finger;
mod hand;
mod joint;
mod noise;
mod object;
mod pneumatic;
mod sensor;
mod table;

// Fingers.
pub use drive::{Drive, DriveKind};
pub use finger::{Finger, FingerParameters};
pub use joint::{JointParameters, Stop};
pub use pneumatic::{Elastic, Pneumatic};

// What a configuration says of them.
pub use configured::PlantModel;

// What they touch, and what carries them.
pub use contact::{Contact, Ground, Surface};
pub use hand::{Hand, HandParameters};
pub use object::{Object, ObjectParameters};
pub use table::{AxisParameters, Table};

// What is measured of them.
pub use noise::Noise;
pub use sensor::{Sensor, SensorBank, SensorFault, SensorFaultKind};

pub use error::PlantError;
