//! From torques of joints to tensions of antagonistic tendons, and to the commands of actuators.

mod arms;
pub mod fault;
mod pair;
mod servo;

pub use arms::{AllocatedTensions, MomentArms};
pub use pair::{Pair, TendonPairs};
pub use servo::{TensionGains, TensionServos};
