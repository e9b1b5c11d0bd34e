//! From torques of joints to tensions of antagonistic tendons, and to the commands of actuators.

mod allocation;
mod arms;
mod pair;

pub use allocation::{Allocated, Allocation, AllocationError, Rectification};
pub use arms::{ArmError, MomentArms};
pub use pair::{Pair, Pairs};
