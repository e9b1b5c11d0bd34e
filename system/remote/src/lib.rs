#![doc = include_str!("../README.md")]

#[cfg(feature = "client")]
mod error;
// Functions that fuzz targets call with arbitrary bytes.
#[cfg(feature = "hostile")]
#[doc(hidden)]
pub mod hostile;
#[cfg(feature = "client")]
pub mod network;
#[cfg(feature = "client")]
mod remote;
#[cfg(feature = "client")]
mod stream;
pub mod wire;

#[cfg(feature = "client")]
pub use condor_ros2::RowMessage;
#[cfg(feature = "client")]
pub use error::RemoteError;
#[cfg(feature = "client")]
pub use network::{ClientTls, Network, RemoteAccess};
#[cfg(feature = "client")]
pub use remote::Remote;
#[cfg(feature = "client")]
pub use stream::{RemoteMessage, RemoteStream};
pub use wire::{Id, RemoteOutcome, RemoteState};

/// The time after which a client asks again.
#[cfg(feature = "client")]
const PAUSE: core::time::Duration = core::time::Duration::from_millis(20);
