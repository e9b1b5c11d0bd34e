//! Controllers of fingers and of the table, made from a configuration: sensors in, commands out,
//! with faults.
//!
//! A [`FingerController`] is a [`FingerServo`](crate::servo::FingerServo) that follows a master's
//! set-points between its ticks, watches for faults, and comes to rest by itself after one. In every
//! tick it also checks the [guards](crate::trajectory::StopGuard) of the motions that it follows: if
//! the condition of a guard holds, the joints of its motion stop at once. A [`TableController`] moves
//! the table that carries the hand, and returns the acceleration of the palm.

mod axis;
mod finger;
mod settings;
mod table;
mod watch;
mod wiring;

pub use axis::AxisServo;
pub use finger::{FingerController, FingerTick};
pub use table::{AXES, TableController, TableState, TableTick};
pub use watch::GuardStop;
pub use wiring::{FingerSensors, read_table, write_finger, write_table};
