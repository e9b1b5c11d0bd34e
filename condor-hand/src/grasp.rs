//! The forces by which several fingers hold one object, and the stiffness that they give it.
//!
//! A force is that of a finger **on the object**. A wrench is the effect of all fingers together: a
//! force and a moment about a point that is an argument, all in the axes of the palm.
//!
//! ```
//! use condor_hand::grasp::{Contacts, Wrench};
//! use nalgebra::{Vector3, vector};
//!
//! let tips = [vector![0.02, 0.0, 0.0], vector![-0.02, 0.0, 0.0], vector![0.0, 0.02, 0.0]];
//! let lift = Wrench { force: vector![0.0, 0.0, 3.0], moment: Vector3::zeros() };
//! // Three newtons through the point between the first two tips: they share the load.
//! let held = Contacts::new(tips)?.forces(&lift, &Vector3::zeros())?;
//! assert!((held.forces[0] - vector![0.0, 0.0, 1.5]).norm() < 1e-12);
//! assert!(held.forces[2].norm() < 1e-12);
//! # Ok::<(), condor_hand::grasp::GraspError>(())
//! ```

// From a wrench to forces, and from the motion of tips to the object's.
mod contacts;
mod error;
mod pose_fit;
mod quaternion;
mod wrench;

// Forces that hold without moving.
mod friction;
mod normals;
mod squeeze;

// The law, in one servo loop or in those of several processors.
pub mod distributed;
mod gain;
mod law;
mod limits;
mod tuning;

pub use contacts::{Contacts, FingerForces};
pub use error::GraspError;
use error::{coincident, off, quantity, too_few, too_large};
pub use friction::ContactFriction;
pub use gain::SpatialGain;
pub use law::{FingerState, GraspOutput, GraspStiffness};
pub use limits::{TorqueExcess, TorqueLimits};
pub use normals::Normals;
pub use squeeze::Squeeze;
pub use tuning::{GraspTuning, Posture, TuningSurface};
pub use wrench::{Twist, Wrench};
