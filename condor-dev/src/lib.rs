//! The static device switch.
#![cfg_attr(not(any(feature = "std", condor_loom, test)), no_std)]

// Documents of their own.
#[cfg(feature = "conformance")]
pub mod conformance;
// Loom's atomics cannot be made in constants, as drivers are: its models are of what drivers share.
#[cfg(not(condor_loom))]
pub mod drivers;
#[doc(hidden)]
pub mod set;
#[cfg(all(feature = "sim", not(condor_loom)))]
pub mod sim;

// The machine.
mod bus;
mod interrupt;

// The switch.
mod device;
mod dispatch;
mod driver;
mod fd;
mod ring;
mod switch;
mod sync;
mod unit;

pub use bus::{Bus, BusError, BusErrorKind, Registers, Width};
pub use device::Device;
pub use dispatch::InterruptCounts;
pub use driver::{Attention, DeviceError, Driver};
pub use fd::{Fd, FdError, Mode};
pub use interrupt::{InterruptController, Level, NoInterrupts, Vector};
pub use ring::{Reader, Ring, Writer};
pub use set::{DeviceSet, Has};
pub use switch::{IoError, OpenError, Switch};
pub use unit::{Place, Presence, Unit};
