//! The static device switch.
#![cfg_attr(not(any(feature = "std", condor_loom, test)), no_std)]

// Documents of their own.
pub mod drivers;
#[doc(hidden)]
pub mod set;
#[cfg(feature = "sim")]
pub mod sim;
pub mod stdio;

// The machine.
mod bus;
mod interrupt;

// The switch.
mod device;
mod dispatch;
mod driver;
mod fd;
mod stream;
mod switch;
mod unit;

pub use bus::{Bus, BusError, BusErrorKind, Registers, Width};
pub use device::Device;
pub use dispatch::InterruptCounts;
pub use driver::{Attention, DeviceError, Driver};
pub use fd::{Fd, FdError, Mode};
pub use interrupt::{InterruptController, Level, NoInterrupts, Vector};
pub use set::{DeviceSet, Has};
pub use stream::{Descriptors, Looks, Stream, StreamError, Timeout, Wait};
pub use switch::{IoError, OpenError, Switch};
pub use unit::{Place, Presence, Unit};
