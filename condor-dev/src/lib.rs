// The first definition of a link counts: here those of README.md lead to items instead of files.
#![cfg_attr(not(condor_loom), doc = "[uart]: drivers::Uart16550")]
#![cfg_attr(not(condor_loom), doc = "[pca9685]: drivers::Pca9685")]
#![cfg_attr(not(condor_loom), doc = "[as5600]: drivers::As5600")]
//! [presence]: Presence
//! [fd]: Fd
//! [open]: OpenError
//! [fderror]: FdError
//! [io]: IoError
//! [device]: Device
//! [stream]: stream::DeviceStream
//! [stdio]: mod@stdio
//! [switch]: Switch::on_interrupt
//! [ring]: Ring
//! [mmio]: Mmio
//! [bus]: Bus
//! [serial]: I2cBus
//! [controller]: InterruptController
//! [driver]: Driver
//!
#![doc = include_str!("../README.md")]
#![cfg_attr(
    any(target_os = "none", not(any(feature = "std", condor_loom, test))),
    no_std
)]

// Linked, so that a program which asks it for critical sections has them.
#[cfg(feature = "std")]
use condor_platform as _;

// Documents of their own.
#[cfg(feature = "conformance")]
pub mod conformance;
// Loom's atomics cannot be made in constants, as drivers are: its models are of what drivers share.
#[cfg(not(condor_loom))]
pub mod drivers;
#[cfg(all(
    feature = "linux",
    target_os = "linux",
    any(
        target_arch = "x86_64",
        target_arch = "aarch64",
        target_arch = "riscv64"
    )
))]
pub mod linux;
#[cfg(feature = "riscv")]
pub mod riscv;
#[doc(hidden)]
pub mod set;
#[cfg(all(feature = "models", not(condor_loom)))]
pub mod sim;
pub mod stdio;
pub mod stream;

// The machine.
mod bus;
mod claim;
#[cfg(any(feature = "riscv", feature = "linux"))]
#[allow(dead_code, reason = "what serves one feature may not serve the other")]
mod guarded;
mod interrupt;
mod mmio;
mod serial;
mod several;

// The switch.
mod device;
mod dispatch;
mod driver;
mod error;
mod fd;
mod record;
mod ring;
mod switch;
mod sync;
mod unit;

// Tests that need the inside, where atomics and sections are those of `interrupt_injector`.
#[cfg(all(test, not(condor_loom)))]
#[path = "../tests/interrupted/mod.rs"]
mod interrupted;

pub use bus::{Bus, BusAccessError, BusError, BusErrorKind, Registers, Width};
pub use claim::{ClaimCell, ClaimGuard};
pub use device::Device;
pub use dispatch::InterruptEntry;
pub use driver::{Attention, DeviceError, Driver};
#[cfg(not(condor_loom))]
pub use drivers::register::{Count, ShadowRegister};
pub use error::{IoError, OpenError};
pub use fd::{Fd, FdError, OpenMode};
pub use interrupt::{InterruptController, InterruptLevel, InterruptVector, NoInterrupts};
pub use mmio::Mmio;
pub use record::InterruptCounts;
pub use ring::{Ring, RingReader, RingWriter};
pub use serial::{I2cBus, SpiBus, SpiCommand};
pub use set::{DeviceSet, DriverSlot};
pub use switch::Switch;
pub use unit::{Location, Presence, Unit};
