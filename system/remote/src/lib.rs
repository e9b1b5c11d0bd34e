#![doc = include_str!("../README.md")]

mod error;
pub mod network;
mod remote;
mod stream;
pub mod wire;

pub use condor_ros2::Row;
pub use error::RemoteError;
pub use network::{Access, Network, Tls};
pub use remote::Remote;
pub use stream::{Message, Stream};
pub use wire::{Id, Outcome, State};

/// The time after which a client asks again.
const PAUSE: core::time::Duration = core::time::Duration::from_millis(20);
