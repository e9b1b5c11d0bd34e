//! From torques of joints to tensions of antagonistic tendons, and to the commands of actuators.

mod allocation;
mod arms;
pub mod fault;
mod pair;
mod servo;

pub use allocation::{Allocated, Allocation, Rectification};
pub use arms::{ArmError, MomentArms};
pub use pair::{Pair, Pairs};
pub use servo::{TensionGains, TensionServos};
