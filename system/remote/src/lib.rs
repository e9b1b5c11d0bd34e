#![doc = include_str!("../README.md")]

mod error;
pub mod network;
mod remote;
mod stream;
pub mod wire;

pub use condor_ros2::RowMessage;
pub use error::RemoteError;
pub use network::{ClientTls, Network, RemoteAccess};
pub use remote::Remote;
pub use stream::{RemoteMessage, RemoteStream};
pub use wire::{Id, RemoteOutcome, RemoteState};

/// The time after which a client asks again.
const PAUSE: core::time::Duration = core::time::Duration::from_millis(20);
